"""The source node over DDS: what a driver publishes comes out as markers of the tracker."""

import json
import time
from contextlib import contextmanager

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseArray
from helpers.clouds import cloud
from helpers.natnet_server import NatNetServer
from helpers.qtm_server import QtmServer, data_packet
from helpers.ros_process import NodeProcess, watching_node
from mocap4r2_msgs.msg import Marker, Markers, RigidBodies, RigidBody
from rcl_interfaces.msg import Log
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from teleop_ros2_interfaces.msg import NamedPoseArray
from visualization_msgs.msg import MarkerArray

from hand_tracker.adapters.natnet_client import NatNetClient
from hand_tracker.adapters.point_frame import UPRIGHT, SourceUnavailable
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES
from hand_tracker.files.bags import TYPE_STORE
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS, OPENXR
from hand_tracker.messages.marker_array import markers_from_message
from hand_tracker.nodes import source_node
from hand_tracker.nodes.runner import spinning

NEEDS = 'rclpy', 'mocap4r2_msgs', 'qtm_rt', 'teleop_ros2_interfaces'

pytestmark = pytest.mark.ros
MODULE = 'hand_tracker.nodes.source_node'
PLACES = np.arange(24.).reshape(8, 3) / 8. + 1.
# As the drivers of mocap4r2 and motion_capture_tracking publish.
DRIVERS = QoSProfile(depth=1000), QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@contextmanager
def source(**parameters):
    """Serve a source node; yield it and a node that watches it."""
    arguments = ['--ros-args']
    for name, value in parameters.items():
        arguments += ['-p', f'{name}:={json.dumps(value)}']
    rclpy.init(args=arguments)
    node = None
    try:
        node = source_node.SourceNode()
        with watching_node() as watch, spinning(node):
            yield node, watch
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.shutdown()


def heard(watch, kind, topic, message, qos=10):
    """Publish a message until markers come back; return the first."""
    found = watch.collect(MarkerArray, '/source/markers')
    publisher = watch.create_publisher(kind, topic, qos)
    watch.repeat(lambda: publisher.publish(message), lambda: found, .05)
    return found[0]


def positions(message):
    return np.array([(marker.pose.position.x, marker.pose.position.y, marker.pose.position.z)
                     for marker in message.markers])


def stamp():
    return Time(sec=5, nanosec=7)


def named(marker, at):
    return Marker(id_type=Marker.USE_NAME, marker_name=marker,
                  translation=Point(**dict(zip('xyz', map(float, at)))))


@pytest.mark.parametrize('qos', DRIVERS, ids=['reliable', 'best_effort'])
def test_a_cloud_comes_out_as_anonymous_markers(qos):
    made = cloud(PLACES, ('x', 'y', 'z', 'rgb'))
    data = bytes(TYPE_STORE.serialize_cdr(made, 'sensor_msgs/msg/PointCloud2'))
    with source(source='point_cloud', topic='/cloud') as (_, watch):
        message = heard(watch, PointCloud2, '/cloud', deserialize_message(data, PointCloud2), qos)
    np.testing.assert_array_equal(positions(message)[:8], PLACES)
    assert {marker.ns for marker in message.markers} == {'unlabelled'}
    assert message.markers[0].header.stamp == stamp()
    assert message.markers[0].header.frame_id == 'world'


def test_named_markers_of_mocap4r2_are_those_of_the_hand():
    made = Markers(markers=[named(marker, at) for marker, at in zip(MARKERS, PLACES)])
    made.header.stamp, made.header.frame_id = stamp(), 'map'
    with source(source='mocap4r2') as (_, watch):
        message = heard(watch, Markers, '/markers', made)
    frame = markers_from_message(message, LabelMap())
    np.testing.assert_array_equal(frame.positions, PLACES)
    assert frame.frame_id == 'map' and frame.stamp == stamp()


def test_bodies_of_mocap4r2_are_told_apart_by_their_subject():
    bodies = RigidBodies(rigidbodies=[
        RigidBody(rigid_body_name=body, markers=[
            named(marker, at + shift) for marker, at in zip(MARKERS, PLACES)])
        for body, shift in (('LHand', 9.), ('RHand', 0.))])
    with source(source='mocap4r2', message='rigid_bodies', subject='RHand') as (_, watch):
        message = heard(watch, RigidBodies, '/rigid_bodies', bodies)
    frame = markers_from_message(message, LabelMap())
    np.testing.assert_array_equal(frame.positions, PLACES)
    assert {marker.ns for marker in message.markers} == {f'RHand:{name}' for name in MARKERS}
    with source(source='mocap4r2', message='rigid_bodies', subject='Rhnd') as (node, watch):
        lines = watch.collect(Log, '/rosout')
        heard(watch, RigidBodies, '/rigid_bodies', bodies)
        watch.spin_until(lambda: any(
            line.msg == "/rigid_bodies: subject: 'Rhnd'; expected one of LHand, RHand"
            for line in lines))


def poses(points):
    return [Pose(position=Point(**dict(zip('xyz', map(float, at))))) for at in points]


@pytest.mark.parametrize('count', LANDMARK_ORDERS)
def test_the_eight_markers_are_found_among_landmarks(count):
    points = np.arange(3. * count).reshape(count, 3) + 1.
    made = PoseArray(poses=poses(points))
    made.header.stamp = stamp()
    with source(source='landmarks', topic='/hand') as (_, watch):
        message = heard(watch, PoseArray, '/hand', made)
    expected = [points[LANDMARK_ORDERS[count].index(place)] for place in PAPER_PLACES]
    np.testing.assert_array_equal(markers_from_message(message, LabelMap()).positions, expected)
    assert len(message.markers) == count
    assert message.markers[0].header.frame_id == 'mocap'


def test_one_hand_of_two_is_taken_with_its_validity():
    names = [f'{side}_{name}' for side in ('left', 'right') for name in list(OPENXR)[1:]]
    points = np.arange(150.).reshape(50, 3) + 1.
    made = NamedPoseArray(name=names, pose=poses(points), is_valid=[True] * 49 + [False])
    with source(source='landmarks', message='named_pose_array', side='right', up='y') as (
            _, watch):
        message = heard(watch, NamedPoseArray, '/xr_teleop/hand', made)
    x, y, z = points[25:].T
    np.testing.assert_array_equal(positions(message)[:24], np.stack((x, -z, y), axis=1)[:24])
    assert np.isnan(positions(message)[24]).all()
    # The tracker gives a message without stamp the time of its receipt.
    assert message.markers[0].header.stamp == Time()


@pytest.mark.parametrize('side', ['left', 'both'])
def test_motive_comes_out_as_markers(side):
    with NatNetServer((4, 1), {'RHand': MARKERS}) as server, source(
            source='natnet', server='127.0.0.1', port=server.port, side=side) as (_, watch):
        found = watch.collect(MarkerArray, '/source/markers')

        def send():
            if server.is_connected:
                server.send_frame({'RHand': PLACES}, time.monotonic())

        watch.repeat(send, lambda: found and len(found[-1].markers) > 8)
    frame = markers_from_message(found[-1], LabelMap())
    np.testing.assert_allclose(frame.positions, PLACES, rtol=1e-6)
    spaces = {'right'} if side == 'both' else {f'RHand:{name}' for name in MARKERS}
    assert {marker.ns for marker in found[-1].markers} == {*spaces, 'unlabelled'}


def test_names_of_both_hands_are_told_of_where_they_come(capfd):
    names = [f'{hand}_{name}' for hand in 'RL' for name in MARKERS]
    with NatNetServer((4, 1), {'Hands': names}) as server, source(
            source='natnet', port=server.port) as (_, watch):
        def send(sets):
            if server.is_connected:
                server.send_frame(sets, time.monotonic(), unlabelled=PLACES[:1])

        found = watch.collect(MarkerArray, '/source/markers')
        watch.repeat(lambda: send({}), lambda: found, .01)
        watch.repeat(lambda: send({'Hands': np.concatenate((PLACES, PLACES))}),
                     lambda: len(found[-1].markers) > 16, .01)
    said = capfd.readouterr().err
    assert '0 named markers' in said and '16 named markers (Hands:R_wrist' in said
    assert said.count('names of both hands; side:=both takes each by its side') == 1


def test_a_client_with_a_fault_begins_anew(monkeypatch, capfd):
    monkeypatch.setattr(source_node, 'REST_TIME', .05)
    faults, receive = [RuntimeError('bug'), RuntimeError('bug')], NatNetClient.run

    def run(self, ended):
        if faults:
            raise faults.pop()
        receive(self, ended)

    monkeypatch.setattr(NatNetClient, 'run', run)
    with NatNetServer((4, 1), {'RHand': MARKERS}) as server, source(
            source='natnet', port=server.port) as (_, watch):
        found = watch.collect(MarkerArray, '/source/markers')

        def send():
            if server.is_connected:
                server.send_frame({'RHand': PLACES}, time.monotonic())

        watch.repeat(send, lambda: found)
    said = ''.join(capfd.readouterr())
    assert said.count('begun anew after a fault') == 1 and "RuntimeError: bug" in said


@pytest.mark.parametrize('said, asked, turn', [
    ('+Z', {}, np.eye(3)), ('-Z', {}, np.eye(3)), ('+Y', {}, UPRIGHT['y']),
    ('+Y', {'up': 'z'}, np.eye(3)), ('+Z', {'up': '+y'}, UPRIGHT['y'])])
def test_qtm_comes_out_as_markers_with_z_up(said, asked, turn, capfd):
    with QtmServer(MARKERS, up=said) as server, source(
            source='qualisys', server='127.0.0.1', port=server.port, **asked) as (_, watch):
        found = watch.collect(MarkerArray, '/source/markers')
        number = iter(range(1, 10**6))

        def send():
            if server.streams:
                now = next(number)
                server.send(data_packet(now, 1000 * now, {'3d': 1e3 * PLACES}))

        watch.repeat(send, lambda: found)
    frame = markers_from_message(found[-1], LabelMap())
    np.testing.assert_allclose(frame.positions, PLACES @ turn.T, rtol=1e-6)
    logged = ''.join(capfd.readouterr())
    assert logged.count('-z is up; expected z or y') == (said == '-Z')


def test_the_messages_are_those_that_rclpy_writes():
    made = Markers(markers=[named('index', (1., 2., 3.))])
    with source(source='mocap4r2') as (_, watch):
        message = heard(watch, Markers, '/markers', made)
    data = serialize_message(message)
    assert deserialize_message(data, MarkerArray) == message
    assert message.markers[0].pose.orientation.w == 1. and message.markers[0].color.a == 1.


@pytest.mark.parametrize('parameters, said', [
    ({'source': 'point_cloud', 'message': 'markers'}, "'markers' is none of point_cloud's"),
    ({'source': 'landmarks', 'landmarks': 22}, '22; expected one of 21, 25, 26'),
    ({'source': 'landmarks', 'side': 'both'}, "side: 'both'; expected of landmarks: right, left")])
def test_parameters_that_contradict_each_other_are_refused(parameters, said):
    with pytest.raises(SourceUnavailable, match=said), source(**parameters):
        pass


def test_its_status_is_on_diagnostics():
    made = Markers(markers=[named(marker, at) for marker, at in zip(MARKERS, PLACES)])
    with source(source='mocap4r2', subject='RHand') as (_, watch):
        found = watch.collect(DiagnosticArray, '/diagnostics')
        watch.spin_until(lambda: found)
        status, = found[0].status
        assert status.message == 'no frame yet; nobody publishes it'
        assert (status.name, status.hardware_id) == ('source: mocap4r2', '/markers')
        publisher = watch.create_publisher(Markers, '/markers', 10)
        fault = "/markers: subject: 'RHand'; expected none, as its markers have no subject"
        watch.repeat(lambda: publisher.publish(made),
                     lambda: found[-1].status[0].message == f'frames come; {fault}', .05)
        watch.repeat(lambda: publisher.publish(made), lambda: float(next(
            value.value for value in found[-1].status[0].values
            if value.key == 'rate [Hz]')) > 0., .05)


def test_what_a_client_says_is_in_its_status(monkeypatch):
    def run(self, ended):
        while not ended.wait(.1):
            self._on_news(False, 'found')
            self._on_news(True, 'no answer')

    monkeypatch.setattr(NatNetClient, 'run', run)
    with source(source='natnet', port=9) as (_, watch):
        found = watch.collect(DiagnosticArray, '/diagnostics')
        watch.spin_until(lambda: found)
        assert found[0].status[0].message == 'no frame yet; no answer'


def test_lacking_messages_are_named():
    with pytest.raises(SourceUnavailable, match='no_such_msgs is not installed'):
        source_node.imported_message('no_such_msgs', 'Markers')


def test_as_a_process_it_says_what_is_wrong_and_ends_when_interrupted():
    with NodeProcess(MODULE, {'source': 'point_cloud', 'topic': '/cloud'}) as process, \
            watching_node() as watch:
        process.wait_for_line('publishing on /source/markers')
        made = cloud(PLACES)
        made.fields[0].name = 'u'
        data = bytes(TYPE_STORE.serialize_cdr(made, 'sensor_msgs/msg/PointCloud2'))
        publisher = watch.create_publisher(PointCloud2, '/cloud', 10)
        watch.repeat(lambda: publisher.publish(data), lambda: "no field 'x'" in process.output, .05)
        watch.repeat(lambda: publisher.publish(data), iter([False] * 5 + [True]).__next__, .05)
        assert process.interrupt() == 0, process.output
    assert process.output.count("no field 'x'") == 1 and 'Traceback' not in process.output
