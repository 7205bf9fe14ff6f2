"""Tracker and retarget node in one process: markers in, commands out, on the fast path too."""

from itertools import count

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.bench import message, stamp_of
from helpers.hands import BENT_ANGLES, hand_at
from helpers.robots import human_robot_file
from helpers.ros_process import NodeProcess, watching_node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from hand_tracker.core.numerics.jit import COMPILED

NEEDS = 'rclpy', 'trajectory_msgs'
# However late this process looks, no state in between is lost.
STATE_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FRAME_TIME = .004  # [s]

pytestmark = pytest.mark.ros


@pytest.fixture
def robot(tmp_path):
    return human_robot_file(tmp_path)


class Rig:
    """Both nodes, a hand that moves a little and a robot that does what it is told."""

    def __init__(self, node):
        self.node, self.numbers, self.is_seen, self.has_robot = node, count(1), True, True
        self.commands = node.collect(JointState, 'robot/command')
        self.diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        self.states, self.sent = [], set()
        self._subscription = node.create_subscription(
            String, 'retarget/state', lambda found: self.states.append(found.data), STATE_QOS)
        self._markers = node.create_publisher(MarkerArray, 'markers', 10)
        self._robot = node.create_publisher(JointState, 'robot/joint_states', 10)
        node.create_timer(FRAME_TIME, self._tick)

    def _tick(self):
        number = next(self.numbers)
        if self.is_seen:
            stamp = stamp_of(number)
            self.sent.add((stamp.sec, stamp.nanosec))
            self._markers.publish(message(hand_at(BENT_ANGLES * (1. + .02 * (number % 5))), number))
        if self.has_robot and self.commands:
            self._robot.publish(self.commands[-1])
        elif self.has_robot:
            names = urdf_joints()
            self._robot.publish(JointState(name=names, position=[.05] * len(names)))

    def until_following(self):
        """Engage the robot until it follows: where a hand is late it is disengaged."""
        self.node.repeat(
            lambda: self.states[-1:] == ['disengaged'] and self.node.call(
                SetBool, 'retarget/engage', SetBool.Request(data=True)),
            lambda: self.states[-1:] == ['following'])

    def until_served(self):
        """Spin until frames have been served on the fast path from now on."""
        def frames():
            return int(self.value('retarget', 'frames on fast path') or 0)

        if COMPILED:
            before = frames()
            self.node.spin_until(lambda: frames() > before + 20)

    def value(self, name, key):
        """Return the last value of a key on /diagnostics of the status that has a name in its."""
        found = [pair.value for array in self.diagnostics for status in array.status
                 if name in status.name for pair in status.values if pair.key == key]
        return found[-1] if found else ''


def urdf_joints():
    from hand_tracker.messages.builders import prefixed_names
    return [name.removeprefix('right_') for name in prefixed_names('right_').joints]


def test_frames_are_answered_on_the_fast_path_and_what_ends_ends_it(robot):
    parameters = {'robot': robot, 'side': 'right', 'auto_size': False}
    with NodeProcess('hand_tracker.nodes.teleoperate_node', parameters) as process, (
            watching_node()) as node:
        rig = Rig(node)
        process.wait_for_line('listening for the right hand')
        process.wait_for_line('listening for markers on')
        node.spin_until(lambda: 'disengaged' in rig.states)
        rig.until_following()
        rig.until_served()
        answered = {(one.header.stamp.sec, one.header.stamp.nanosec) for one in rig.commands}
        assert len(answered & rig.sent) > 20
        # The robot's driver dies, which only the fast path can see meanwhile.
        rig.has_robot = False
        node.spin_until(lambda: rig.states[-1] == 'disengaged')
        process.wait_for_line("the robot's joint states ended")
        rig.has_robot = True
        rig.until_following()
        # The hand dies.
        rig.is_seen = False
        node.spin_until(lambda: rig.states[-1] == 'disengaged')
        assert 'holding' in rig.states
        rig.is_seen = True
        rig.until_following()
        # A person ends it.
        assert node.call(SetBool, 'retarget/engage', SetBool.Request(data=False)).success
        node.spin_until(lambda: rig.states[-1] == 'disengaged')
        # Frames go on being retargeted there, so that it costs no more than to follow them.
        rig.until_served()
        rig.until_served()
        sent = len(rig.commands)
        rig.until_served()
        assert len(rig.commands) == sent
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


def test_a_wrong_parameter_of_either_ends_both_with_one_line(robot):
    for parameters, line in (({}, 'robot: empty'),
                             ({'robot': robot, 'layout': 'nonsense'}, 'nonsense')):
        with NodeProcess('hand_tracker.nodes.teleoperate_node', parameters) as process:
            assert process.wait() == 1
        assert line in process.output and 'Traceback' not in process.output
