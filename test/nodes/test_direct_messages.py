"""Trackers that take the messages of systems as they are, over DDS: the same as of MarkerArrays."""

from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import count

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseArray
from helpers.bench import LATE, LOSSLESS, TRACKER_MODULE, lines, message, stamp_of
from helpers.clouds import cloud
from helpers.hands import RIGHT, hand_at, motion
from helpers.ros_process import PLAIN_PYTHON, NodeProcess, frames_on_fast_path, watching_node
from mocap4r2_msgs.msg import Marker, Markers, RigidBodies, RigidBody
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, PointCloud2
from teleop_ros2_interfaces.msg import NamedPoseArray
from visualization_msgs.msg import MarkerArray

from hand_tracker.adapters.point_frame import SourceUnavailable
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.files.bags import TYPE_STORE
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS, OPENXR
from hand_tracker.messages.message_kinds import MOCAP4R2_MARKERS, MessageKind
from hand_tracker.nodes import message_types, serialization
from hand_tracker.nodes.tracker_node import TrackerNode

NEEDS = 'rclpy', 'mocap4r2_msgs', 'teleop_ros2_interfaces'

pytestmark = pytest.mark.ros
BASE = 'marker_array'
LEFT = RIGHT.mirrored()
# Ids of markers without names of the hand's.
FOREIGN = {f'labels.{name}': str(1000 + row) for row, name in enumerate(MARKERS)}


def with_header(found, number):
    """Return a message with the header of a frame."""
    found.header.frame_id, found.header.stamp = 'mocap', stamp_of(number)
    return found


def named(names, positions):
    """Return markers of mocap4r2."""
    return [Marker(marker_name=name, translation=Point(**dict(zip('xyz', map(float, at)))))
            for name, at in zip(names, positions)]


def markers(positions, number):
    return with_header(Markers(markers=named(MARKERS, positions)), number)


def rigid_bodies(positions, number):
    return with_header(RigidBodies(rigidbodies=[
        RigidBody(rigid_body_name='palm', markers=named(MARKERS[:3], positions[:3])),
        RigidBody(rigid_body_name='cup'),
        RigidBody(rigid_body_name='fingers', markers=named(MARKERS[3:], positions[3:]))]), number)


def pose_array(positions, number, landmarks=25):
    at = dict(zip(PAPER_PLACES, positions))
    return with_header(PoseArray(poses=[
        Pose(position=Point(**dict(zip('xyz', map(float, at.get(name, (np.nan,) * 3))))))
        for name in LANDMARK_ORDERS[landmarks]]), number)


def named_poses(positions, number, side='right'):
    """Return landmarks of one hand by their names, and of the other elsewhere."""
    return both_named([positions + (side == 'left'), positions + (side == 'right')], number)


def both_named(frames, number):
    name_of = {landmark: name for name, landmark in OPENXR.items()}
    rows = [(f'{side}_{name_of[place]}', at) for side, positions in zip(('right', 'left'), frames)
            for place, at in zip(PAPER_PLACES, positions)]
    return with_header(NamedPoseArray(
        name=[name for name, _ in rows],
        pose=[Pose(position=Point(**dict(zip('xyz', map(float, np.nan_to_num(at, nan=7.))))))
              for _, at in rows], is_valid=[bool(np.isfinite(at).all()) for _, at in rows]), number)


def landmark_markers(positions, number, landmarks=21):
    found = message(positions, number)
    for marker, place in zip(found.markers, PAPER_PLACES):
        marker.id = LANDMARK_ORDERS[landmarks].index(place)
    return found


def point_cloud(positions, number, form='f8'):
    made = bytes(TYPE_STORE.serialize_cdr(
        cloud(positions, ('rgb', 'x', 'y', 'z'), form), 'sensor_msgs/msg/PointCloud2'))
    return with_header(deserialize_message(made, PointCloud2), number)


# Class, message of a frame and parameters, by `marker_message`.
KINDS = {BASE: (MarkerArray, message, {}), 'mocap4r2_markers': (Markers, markers, {}),
         'mocap4r2_rigid_bodies': (RigidBodies, rigid_bodies, {}),
         'pose_array': (PoseArray, pose_array, {}),
         'named_pose_array': (NamedPoseArray, named_poses, {}),
         'landmark_markers_21': (MarkerArray, landmark_markers, {}),
         'point_cloud': (PointCloud2, point_cloud, FOREIGN)}


class Trackers:
    """Trackers of several kinds of messages that are sent the same frames."""

    def __init__(self, node, processes, kinds):
        self.node, self.processes, self._kinds = node, processes, kinds
        self._publishers = {name: node.create_publisher(kind, f'{name}/markers', 1000)
                            for name, (kind, _, _) in kinds.items()}
        self.answers = {name: node.collect(JointState, f'{name}/joint_states') for name in kinds}
        self.diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        for process in processes.values():
            process.wait_for_line('listening')
        node.spin_until(lambda: all(publisher.get_subscription_count()
                                    for publisher in self._publishers.values()))

    def send(self, positions, number, without=()):
        """Send a frame to all but some."""
        for name in self._kinds.keys() - without:
            self._publishers[name].publish(self._kinds[name][1](positions, number))

    def meet(self, positions):
        """Send a frame until all are heard; then time jumps back."""
        numbers = count(LATE)
        self.node.repeat(lambda: self.send(positions, next(numbers)),
                         lambda: all(self.answers.values()), .05)
        self.send(positions, 1)

    def answer(self, positions, number, without=()):
        """Send a frame to all but some; return the JointState of each, by name."""
        self.send(positions, number, without)
        heard = {name: found for name, found in self.answers.items() if name not in without}
        self.node.spin_until(lambda: all(
            found[-1].header.stamp == stamp_of(number) for found in heard.values()))
        return {name: found[-1] for name, found in heard.items()}

    def frames_on_fast_path(self):
        """Return the last count of each tracker, by name."""
        return {topic.split('/')[1]: frames for topic, frames
                in frames_on_fast_path(self.diagnostics, 'hardware_id').items()}


@contextmanager
def trackers(kinds, parameters=None):
    """Yield trackers that must end well."""
    with ExitStack() as stack:
        node = stack.enter_context(watching_node())
        processes = {name: stack.enter_context(NodeProcess(
            TRACKER_MODULE, {'marker_message': name.partition('__')[0], **LOSSLESS, **more,
                             **(parameters or {})},
            {'__ns': f'/{name}'})) for name, (_, _, more) in kinds.items()}
        yield Trackers(node, processes, kinds)
        assert all(process.interrupt() == 0 for process in processes.values())
        assert not any('Traceback' in process.output for process in processes.values())


def test_all_messages_of_a_frame_have_one_answer():
    frames = [np.where(np.isfinite(frame), frame, np.nan) for frame in motion(RIGHT, 60)]
    frames[11][4] = frames[12][6] = np.nan  # not at zero, which is of no meaning to landmarks
    with trackers(KINDS) as bench:
        bench.meet(frames[0])
        for number, frame in enumerate(frames, 2):
            # Points of a cloud have no names: all are there.
            frame = np.where(np.isfinite(frame), frame, frames[0])
            heard = bench.answer(frame, number)
            for name, found in heard.items():
                assert np.array_equal(found.position, heard[BASE].position), (name, number)
        numbers = count(len(frames) + 2)
        bench.node.repeat(
            lambda: bench.answer(frames[0], next(numbers)),
            lambda: not COMPILED or set(KINDS) == {
                name for name, frames in bench.frames_on_fast_path().items() if frames > 0})
        check_markers_that_are_not_seen(bench)


def check_markers_that_are_not_seen(bench):
    """Check that markers that are not seen are the same in all."""
    frames = motion(RIGHT, 40)
    frames[11][4] = frames[12][6] = np.nan
    bench.meet(frames[0])
    for number, frame in enumerate(frames, 1):
        # Of an even number, in which markers are not left out.
        heard = bench.answer(frame, 2 * number, {'point_cloud'})
        assert len({tuple(found.position) for found in heard.values()}) == 1, number


def both_arrays(frames, number):
    """Return the MarkerArray of both hands."""
    array = MarkerArray()
    for side, positions in zip(('right', 'left'), frames):
        array.markers += message(positions, number, ns=side).markers
    return array


UNKNOWN_NAMES = [[f'{side}{row}' for row in range(8)] for side in 'rl']
NAMES_WITH_SIDE = [[f'{side}Hand:{name}' for name in MARKERS] for side in 'RL']


def both_markers(names, frames, number):
    """Return the Markers of both hands, by the names of their markers."""
    return with_header(Markers(markers=[one for own, positions in zip(names, frames)
                                        for one in named(own, positions)]), number)


@pytest.mark.parametrize('names, parameters', [
    (UNKNOWN_NAMES, {'right.markers': '1000', 'left.markers': '1008'}), (NAMES_WITH_SIDE, {})])
def test_both_hands_of_one_message(names, parameters):
    kinds = {BASE: (MarkerArray, both_arrays, {}),
             'mocap4r2_markers': (Markers, partial(both_markers, names), parameters),
             'named_pose_array': (NamedPoseArray, both_named, {})}
    rest = hand_at(), hand_at(hand=LEFT)
    with trackers(kinds, {'side': 'both'}) as bench:
        bench.meet(rest)
        for number, frames in enumerate(zip(motion(RIGHT)[:9], motion(LEFT)[:9]), 1):
            one, *others = bench.answer(frames, 2 * number).values()
            assert len(one.name) == 50
            for other in others:
                assert list(one.name) == list(other.name)
                assert np.array_equal(one.position, other.position)
        numbers = count(20)
        bench.node.repeat(lambda: bench.answer(rest, 2 * next(numbers)), lambda: not COMPILED or (
            set(kinds) == {name for name, frames in bench.frames_on_fast_path().items()
                           if frames > 0}))


def test_a_cloud_without_labels_is_labelled_by_the_shape_of_the_hand():
    random = np.random.default_rng(1)
    with trackers({'point_cloud': (PointCloud2, point_cloud, {'labels': 'none'})}) as bench:
        bench.meet(hand_at())
        for number in range(2, 9):
            cloud_of_hand = np.concatenate((hand_at(), hand_at()[:1] + random.uniform(.3, .4)))
            bench.answer(cloud_of_hand[random.permutation(9)], number)
        bench.processes['point_cloud'].wait_for_line('the right hand is found among')


def test_what_is_wrong_with_landmarks_is_said_once():
    with trackers({'pose_array': KINDS['pose_array']}) as bench:
        process = bench.processes['pose_array']
        bench.meet(hand_at())
        publisher = bench._publishers['pose_array']
        for _ in range(3):
            publisher.publish(PoseArray(poses=[Pose()] * 20))
        process.wait_for_line('PoseArray of 20 poses; expected are 21, 25, 26 landmarks')
        full = {name: (.01 * row, .02 * row, 0.) for row, name in enumerate(LANDMARK_ORDERS[21])}
        at = [Pose(position=Point(**dict(zip('xyz', place)))) for place in full.values()]
        publisher.publish(with_header(PoseArray(poses=at), LATE * 2))
        publisher.publish(with_header(PoseArray(poses=at), LATE * 2 + 1))
        process.wait_for_line('from wrist to middle MCP the landmarks measure')
        bench.answer(hand_at(), LATE * 3)
        assert len(lines(process, 'of 20 poses')) == len(lines(process, 'landmarks measure')) == 1


def test_a_publisher_of_another_message_is_named():
    with NodeProcess(TRACKER_MODULE, {'marker_message': 'mocap4r2_markers'},
                     environment=PLAIN_PYTHON) as process, \
            watching_node() as node:
        process.wait_for_line('listening')
        node.create_publisher(MarkerArray, 'markers', 10)
        process.wait_for_line(
            'publishes visualization_msgs/msg/MarkerArray, not mocap4r2_msgs/msg/Markers')
        assert process.interrupt() == 0


def test_another_message_than_these_is_refused():
    with NodeProcess(TRACKER_MODULE, {'marker_message': 'pose'},
                     environment=PLAIN_PYTHON) as process:
        assert process.wait() == 1
        assert "marker_message: 'pose' is not one of marker_array, mocap4r2_markers" in (
            process.output)


def test_other_layouts_of_messages_are_left_to_a_source_node(monkeypatch):
    monkeypatch.setattr(serialization, 'codec_agrees', lambda: False)
    rclpy.init(args=['--ros-args', '-p', 'marker_message:=pose_array'])
    try:
        with pytest.raises(SourceUnavailable, match='expected marker_array from a source node'):
            TrackerNode()
    finally:
        rclpy.shutdown()


def test_lacking_messages_and_other_fields_are_named(monkeypatch):
    assert message_types.class_of(MOCAP4R2_MARKERS) is Markers
    with pytest.raises(SourceUnavailable, match='no_such_msgs is not installed'):
        message_types.class_of(MessageKind('no_such_msgs/msg/Markers', 1))
    monkeypatch.setitem(message_types.KNOWN_FIELDS, MOCAP4R2_MARKERS.type, {
        'Marker': {'id_type': 'int8', 'marker_index': 'int64'}})
    with pytest.raises(SourceUnavailable, match='mocap4r2_msgs/Marker has other fields here'):
        message_types.class_of(MOCAP4R2_MARKERS)
