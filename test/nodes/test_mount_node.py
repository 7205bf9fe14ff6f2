"""The mount node over DDS: a body's frames and a tracked hand in, the hand on the body out."""

from itertools import count

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from helpers.bench import message
from helpers.hands import BENT_ANGLES, RIGHT, markers_of
from helpers.ros_process import TRACKER_MODULE, NodeProcess, watching_node
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from hand_tracker.core.model.hand import LINKS
from hand_tracker.core.model.kinematics import forward, joint_table

NEEDS = 'rclpy', 'tf2_msgs', 'std_srvs'
MOUNT = 'hand_tracker.nodes.mount_node'
PERIOD = .01    # [s]
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OFFSET = np.array((.02, .05, .2)), Rotation.from_rotvec((.3, -.8, 1.1))

pytestmark = pytest.mark.ros


class Arm:
    """An arm that moves, its body's TF, and the markers of the hand on it."""

    def __init__(self):
        rng = np.random.default_rng(1)
        knots = np.arange(0., 400., .6)
        self._places = CubicSpline(knots, rng.normal(0., .15, (len(knots), 3)))
        self._turns = CubicSpline(knots, rng.normal(0., .5, (len(knots), 3)))
        self._pose = forward(joint_table(RIGHT), BENT_ANGLES)

    def forearm(self, time):
        """Return place and rotation of the body's frame in the body's world."""
        return self._places(time), Rotation.from_rotvec(self._turns(time))

    def markers(self, time):
        """Return the markers in their own world, which is turned upside down and shifted."""
        place, turn = self.forearm(time)
        markers = markers_of(RIGHT, BENT_ANGLES, None, (turn * OFFSET[1]).as_matrix(),
                             place + turn.apply(OFFSET[0]))
        return markers * (1., -1., -1.) + (0., 0., 2.)


def transform(parent, child, stamp, place, turn):
    """Return a TransformStamped."""
    made = TransformStamped(child_frame_id=child, transform=Transform(
        translation=Vector3(**dict(zip('xyz', map(float, place)))),
        rotation=Quaternion(**dict(zip('xyzw', turn.as_quat().tolist())))))
    made.header.frame_id, made.header.stamp = parent, stamp
    return made


def latest(messages, child):
    """Return parent, place and rotation of the newest transform of a frame; None before it."""
    for one in reversed(messages):
        for each in reversed(one.transforms):
            if each.child_frame_id == child:
                at, turn = each.transform.translation, each.transform.rotation
                return (each.header.frame_id, np.array((at.x, at.y, at.z)),
                        Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)))
    return None


def test_the_hand_hangs_on_the_body_where_the_calibration_finds_it(tmp_path):
    arm, numbers, written = Arm(), count(1), tmp_path / 'mount.yaml'
    with (NodeProcess(TRACKER_MODULE, {'on_body': True, 'broadcast': 'all'}) as tracker,
          NodeProcess(MOUNT, {'body_frame': 'forearm', 'duration': 5.,
                              'mount_file': str(written)}) as mount, watching_node() as node):
        moving, resting = node.collect(TFMessage, '/tf'), node.collect(
            TFMessage, '/tf_static', LATCHED)
        markers = node.create_publisher(MarkerArray, 'markers', 10)
        body = node.create_publisher(TFMessage, '/tf', 10)
        at_rest = node.create_publisher(TFMessage, '/tf_static', LATCHED)
        at_rest.publish(TFMessage(transforms=[
            transform('studio', 'hips', Time(), (0., 0., 1.), Rotation.identity())]))

        def send():
            number = next(numbers)
            array = message(arm.markers(number * PERIOD), 2 * number)
            sec, nanosec = divmod(number * 10_000_000, 10**9)
            stamp = Time(sec=sec, nanosec=nanosec)
            for one in array.markers:
                one.header.stamp = stamp
            place, turn = arm.forearm(number * PERIOD)
            body.publish(TFMessage(transforms=[
                transform('hips', 'forearm', stamp, place - (0., 0., 1.), turn)]))
            markers.publish(array)

        node.create_timer(PERIOD, send)
        tracker.wait_for_line('listening')
        mount.wait_for_line('~/calibrate finds it')
        node.spin_until(lambda: latest(moving, 'right_wrist_tracked'))
        answer = node.call(Trigger, 'mount/calibrate', Trigger.Request())
        assert answer.success and str(written) in answer.message
        assert not node.call(Trigger, 'mount/calibrate', Trigger.Request()).success
        node.spin_until(written.exists)
        node.spin_until(lambda: latest(resting, 'right_wrist')[1].any())
        mount.wait_for_line('calibration: both captures differ by')
        parent, place, turn = latest(resting, 'right_wrist')
        assert parent == 'forearm'
        np.testing.assert_allclose(place, OFFSET[0], atol=.005)
        assert np.degrees((turn * OFFSET[1].inv()).magnitude()) < 2.
        # The hand hangs on that frame, and where it was tracked is told beside.
        assert latest(moving, 'right_wrist') is None
        assert latest(moving, 'right_wrist_tracked')[0] == 'mocap'
        assert latest(moving, f'right_{LINKS[0]}')[0] == 'right_wrist'
        assert mount.interrupt() == 0 and tracker.interrupt() == 0
    # What it has written is what it starts with.
    with NodeProcess(MOUNT, files=[written]) as mount, watching_node() as node:
        resting = node.collect(TFMessage, '/tf_static', LATCHED)
        mount.wait_for_line('right_wrist rests in forearm, at the offset given')
        node.spin_until(lambda: latest(resting, 'right_wrist'))
        np.testing.assert_allclose(latest(resting, 'right_wrist')[1], place, atol=1e-12)
        assert mount.interrupt() == 0
    assert set(yaml.safe_load(written.read_text())['/**']['ros__parameters']) == {
        'body_frame', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'}


def test_a_calibration_without_a_body_says_so_and_changes_nothing(tmp_path):
    written = tmp_path / 'mount.yaml'
    with (NodeProcess(MOUNT, {'body_frame': 'forearm', 'duration': 1.,
                              'mount_file': str(written)}) as mount, watching_node() as node):
        mount.wait_for_line('rests in forearm')
        assert node.call(Trigger, 'mount/calibrate', Trigger.Request()).success
        mount.wait_for_line('0 are of the same times')
        assert mount.interrupt() == 0
    assert 'Traceback' not in mount.output and not written.exists()


def test_frames_that_nobody_broadcasts_are_named_while_a_calibration_goes_on(tmp_path):
    with (NodeProcess(MOUNT, {'body_frame': 'forearm', 'duration': 600.,
                              'mount_file': str(tmp_path / 'mount.yaml')}) as mount,
          watching_node() as node):
        mount.wait_for_line('rests in forearm')
        assert node.call(Trigger, 'mount/calibrate', Trigger.Request()).success
        mount.wait_for_line("no pose of the frame 'forearm' on /tf yet; expected it from the body")
        mount.wait_for_line("no pose of the frame 'right_wrist_tracked' on /tf yet")
        assert mount.interrupt() == 0


def test_a_file_that_cannot_be_written_is_said_before_anybody_moves(tmp_path):
    written = tmp_path / 'nowhere' / 'mount.yaml'
    with (NodeProcess(MOUNT, {'body_frame': 'forearm', 'mount_file': str(written)}) as mount,
          watching_node() as node):
        answer = node.call(Trigger, 'mount/calibrate', Trigger.Request())
        assert not answer.success and f'{written}: cannot be written' in answer.message
        assert mount.interrupt() == 0
    assert 'Traceback' not in mount.output


@pytest.mark.parametrize('parameters, line', [
    ({}, "body_frame: ''; expected a frame of TF"),
    ({'body_frame': '/hand'}, "body_frame: '/hand'; expected a frame of TF"),
    ({'body_frame': 'hand', 'qw': 0.}, 'qx, qy, qz, qw: all 0; expected a rotation'),
    ({'body_frame': 'hand', 'x': 9.}, 'x: ')])
def test_parameters_that_make_no_sense_end_it_with_one_line(parameters, line):
    with NodeProcess(MOUNT, parameters) as mount:
        assert mount.wait() == 1
    assert line in mount.output and 'Traceback' not in mount.output, mount.output
