"""The retarget node: nothing moves before it is engaged, then commands come in every form."""

import re
import signal
from contextlib import contextmanager
from itertools import count
from operator import itemgetter

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist, TwistStamped
from helpers.robots import human_robot_file, wide_hand
from helpers.ros_process import NodeProcess, frames_on_fast_path, watching_node
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray, String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from benchmarks.repository import REPOSITORY
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.messages.builders import joint_state, prefixed_names
from hand_tracker.nodes import retarget_node, serialization
from hand_tracker.nodes.retarget_node import RetargetNode
from hand_tracker.retargeting.guard_options import GuardOptions
from hand_tracker.simulation.poses import pose_angles

NEEDS = 'rclpy', 'trajectory_msgs'
MODULE = 'hand_tracker.nodes.retarget_node'
# However late this process looks, no state in between is lost.
STATE_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PERIOD = .01  # [s] of the hand's frames

pytestmark = pytest.mark.ros


class Bench:
    """A retarget node, a hand that relaxes and a robot that is told what to do."""

    def __init__(self, node, side='right'):
        self.node, self.hand = node, wide_hand(side)
        self.commands = node.collect(JointState, 'robot/command')
        self.arrays = node.collect(Float64MultiArray, 'robot/position_array')
        self.trajectories = node.collect(JointTrajectory, 'robot/joint_trajectory')
        self.states = []
        self._state = node.create_subscription(
            String, 'retarget/state', lambda message: self.states.append(message.data), STATE_QOS)
        self._hand = node.create_publisher(JointState, 'joint_states', 10)
        self._robot = node.create_publisher(JointState, 'robot/joint_states', 10)
        self.by_topic = node.create_publisher(Bool, 'retarget/engage', 10)
        self.deadman = node.create_publisher(Bool, 'retarget/deadman', 10)
        self.names = prefixed_names(f'{side}_')
        self.is_seen, self.is_frozen, self.angles = True, False, self.hand.relaxed()
        self.stamps = [Time(sec=1)]
        self.start = None
        node.create_timer(PERIOD, self._tick)

    def _tick(self):
        if self.is_seen:
            if not self.is_frozen:
                self.stamps.append(Time(sec=1 + len(self.stamps)))
            self._hand.publish(joint_state(self.stamps[-1], self.names.joints, self.angles))
        if self.start is not None:
            self._robot.publish(self.start)

    def engage(self, wanted=True):
        return self.node.call(SetBool, 'retarget/engage', SetBool.Request(data=wanted))

    def until_engaged(self):
        answers = []
        self.node.repeat(lambda: answers.append(self.engage()), lambda: bool(
            answers and answers[-1].success), .1)
        self.node.spin_until(lambda: len(self.commands) > 3)

    def until(self, state):
        """Wait for a state; on a busy machine a hand may be late, which disengages the robot."""
        self.node.repeat(lambda: self.states[-1:] == ['disengaged'] and self.engage(),
                         lambda: self.states[-1:] == [state])


def robot_states(urdf_joints, value):
    return JointState(name=urdf_joints, position=[value] * len(urdf_joints))


@pytest.fixture
def robot(tmp_path):
    return human_robot_file(tmp_path)


def most_on_fast_path(diagnostics):
    """Return how many frames were answered there."""
    return max(frames_on_fast_path(diagnostics).values(), default=0)


def joints():
    return [name.removeprefix('right_') for name in prefixed_names('right_').joints]


def test_what_a_parameter_file_has_for_the_tracker_is_left_out_in_a_line(robot):
    with NodeProcess(MODULE, {'robot': robot},
                     files=[REPOSITORY / 'config' / 'tracker.yaml']) as process:
        process.wait_for_line("there are no parameters 'calibration_file', 'auto_size', ")
        assert 'not engaged; listening for the right hand' in process.output
        assert process.interrupt() == 0, process.output


def test_that_nobody_publishes_the_hand_is_told_to_who_engages(robot):
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        answer = node.call(SetBool, 'retarget/engage', SetBool.Request(data=True))
        assert not answer.success
        assert answer.message == (
            "there is no hand to follow; nobody publishes the hand's /joint_states")
        process.wait_for_line(f'disengaged: {answer.message}')
        told = node.collect(DiagnosticArray, '/diagnostics')
        node.spin_until(lambda: told and [
            one.value for one in told[-1].status[0].values if one.key == 'missing to engage'
        ] == ['there is no hand to follow'])
        assert node.call(SetBool, 'retarget/engage', SetBool.Request(data=False)).success
        assert process.interrupt() == 0, process.output
        assert process.output.count('nobody publishes') == 1


def test_a_node_beside_one_of_its_name_is_not_engaged(robot):
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        bench = Bench(node)
        bench.start = robot_states(joints(), .05)
        bench.until_engaged()
        assert bench.engage(False).success
        with NodeProcess(MODULE, {'robot': robot}) as namesake:
            namesake.wait_for_line('another node is named /retarget too')
            refused = []
            # Each call is a new client, which may have discovered one of the two alone.
            node.repeat(lambda: refused.append(bench.engage()), lambda: (
                'not engaged: another node is named /retarget too' in process.output), .1)
            assert any('another node is named /retarget too' in one.message for one in refused)
            bench.commands.clear()
            assert not bench.engage().success
            node.spin_for(.3)
            assert not bench.commands
            assert namesake.interrupt() == 0, namesake.output
        bench.until_engaged()
        assert process.interrupt() == 0, process.output


def test_a_robot_that_does_not_move_and_two_drivers_are_told(robot):
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        answers = []
        bench = Bench(node)
        node.destroy_publisher(bench._robot)
        node.repeat(lambda: answers.append(bench.engage().message), lambda: any(
            'nobody publishes /robot/joint_states' in one for one in answers), .1)
        bench._robot = node.create_publisher(JointState, 'robot/joint_states', 10)
        # It stays .7 rad and more from the hand.
        bench.start, bench.angles = robot_states(joints(), .05), pose_angles('fist', bench.hand)
        bench.until('following')
        diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        node.spin_until(lambda: any(
            'rad from its command' in status.message and status.level == DiagnosticStatus.WARN
            for message in diagnostics for status in message.status))
        process.wait_for_line('rad from its command')
        with watching_node('driver') as driver:
            driver.create_publisher(JointState, 'robot/joint_states', 10)
            node.spin_until(lambda: '/robot/joint_states has 2 publishers' in process.output)
        assert process.interrupt() == 0, process.output
    named = re.findall(r'(\S+) is \S+ rad from its command: it grasps', process.output)
    assert named and len(named) == len(set(named))


def test_a_request_that_is_repeated_engages_no_robot_that_was_stopped(robot):
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        bench = Bench(node)
        bench.start = robot_states(joints(), .05)
        process.wait_for_line('listening')
        bench.until('following')
        bench.by_topic.publish(Bool(data=True))     # it is engaged already
        node.spin_for(.5)
        assert bench.engage(False).success
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        del bench.states[:]
        for _ in range(20):
            bench.by_topic.publish(Bool(data=True))
            node.spin_for(.1)
        assert 'easing' not in bench.states
        assert 'less than 3 s before' in process.output
        bench.until('following')
        assert process.interrupt() == 0, process.output


def test_others_who_publish_its_commands_are_named_once_it_is_engaged(robot):
    said = 'robot/command is published by /test too'
    with NodeProcess(MODULE, {'robot': robot, 'safety.hold_to_engage': True}) as process, \
            watching_node() as node:
        bench = Bench(node)
        node.create_publisher(JointState, 'robot/command', 10)
        # Pressed in vain, over and over, as there are no joint states of the robot.
        for _ in range(30):
            bench.deadman.publish(Bool(data=True))
            node.spin_for(.02)
        assert said not in process.output
        bench.start = robot_states(joints(), .05)

        presses = count()

        def press():
            # On a busy machine a hand may be late, and the deadman must be released once.
            is_released = bench.states[-1:] == ['disengaged'] and next(presses) % 10 == 9
            bench.deadman.publish(Bool(data=not is_released))

        node.repeat(press, lambda: len(bench.commands) > 200 and said in process.output, PERIOD)
        assert process.output.count(said) == 1
        assert process.interrupt() == 0, process.output


@pytest.mark.parametrize('name, meant', [
    ('safety.max_spead', 'safety.max_speed'), ('saftey.max_speed', 'safety.max_speed'),
    ('wrist.max_sped', 'wrist.max_speed')])
def test_a_limit_that_is_not_there_ends_the_start(name, meant, robot):
    with NodeProcess(MODULE, {'robot': robot, name: 2.}) as process:
        process.wait_for_line(f"there is no parameter '{name}'; did you mean '{meant}'?")
        assert process.wait() == 1, process.output


def test_a_limit_given_without_its_section_is_named_with_it(robot):
    with NodeProcess(MODULE, {'robot': robot, 'max_speed': 1.}) as process:
        process.wait_for_line("there is no parameter 'max_speed': left out; did you mean "
                              "'safety.max_speed' or 'wrist.max_speed'?")
        assert process.interrupt() == 0, process.output


def test_a_hand_of_which_nobody_says_how_much_is_known_is_told(robot):
    line = 'nobody publishes /joint_confidence: a hand whose markers are lost is followed'

    def warned(level):
        return any(status.level == level and line in status.message
                   for message in statuses for status in message.status)

    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        bench, statuses = Bench(node), node.collect(DiagnosticArray, '/diagnostics')
        bench.start = robot_states(joints(), .05)
        bench.until('following')
        node.spin_until(lambda: line in process.output and warned(DiagnosticStatus.WARN))
        publisher = node.create_publisher(JointState, 'joint_confidence', 10)
        node.spin_until(lambda: statuses and not any(
            line in status.message for status in statuses[-1].status))
        # A publisher that says nothing, or of another hand, is no judge.
        line = '/joint_confidence says nothing of this hand: a hand whose markers are lost'
        node.spin_until(lambda: warned(DiagnosticStatus.WARN))
        judgement = joint_state(Time(), bench.names.joints, [.01] * 25)
        judgement.effort = [.3] * 25
        node.repeat(lambda: publisher.publish(judgement), lambda: any(
            status.message.startswith('following') and line not in status.message
            for status in statuses[-1].status), PERIOD)
        assert line in process.output
        assert process.interrupt() == 0, process.output


def test_an_arm_may_share_the_topic_of_the_hand(robot):
    from rclpy.node import Node
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        bench, arm = Bench(node), Node('arm_driver', context=node.context)
        publisher = arm.create_publisher(JointState, 'joint_states', 10)
        node.create_timer(.2 * PERIOD, lambda: publisher.publish(
            JointState(name=['shoulder', 'elbow'], position=[0., 0.])))
        bench.start = robot_states(joints(), .05)
        bench.until('following')
        process.wait_for_line('joint_states has 2 publishers (/arm_driver, /test)')
        sent = len(bench.commands)
        node.spin_until(lambda: len(bench.commands) > sent + 100)
        # A busy machine may pause the hand now and then.
        assert process.output.count('they are not of this hand') < 20
        # Another hand on it, in another pose, moves nothing, and the status says so.
        statuses = node.collect(DiagnosticArray, '/diagnostics')
        fist = pose_angles('fist', bench.hand)
        # Between two frames of the hand, by the stamps.
        node.create_timer(PERIOD, lambda: publisher.publish(joint_state(
            Time(sec=bench.stamps[-1].sec, nanosec=10**9 // 2), bench.names.joints, fist)))
        node.spin_until(lambda: any(
            status.level > DiagnosticStatus.OK and 'jumps of the hand refused: ' in status.message
            for message in statuses for status in message.status))
        arm.destroy_node()
        assert process.interrupt() == 0, process.output


@pytest.mark.skipif(not COMPILED, reason='needs the fast path')
def test_two_trackers_of_one_name_are_told_but_not_one_that_was_started_anew(robot):
    said = '/joint_states has frames of this hand from several publishers by turns (/test, /test): '
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node, \
            watching_node('test') as namesake:
        bench, statuses = Bench(node), node.collect(DiagnosticArray, '/diagnostics')
        bench.start = robot_states(joints(), .05)
        bench.until('following')
        first, bench._hand = bench._hand, namesake.create_publisher(JointState, 'joint_states', 10)
        # The first is silent, as a tracker that was killed, which is still listed.
        sent, frames = len(statuses), most_on_fast_path(statuses)
        node.spin_until(lambda: len(statuses) > sent + 3
                        and most_on_fast_path(statuses) > frames + 50)
        assert node.count_publishers('joint_states') == 2
        bench.until('following')
        assert 'by turns' not in process.output
        # Between two frames of the other, by the stamps.
        node.create_timer(PERIOD, lambda: first.publish(joint_state(
            Time(sec=bench.stamps[-1].sec, nanosec=10**9 // 2), bench.names.joints, bench.angles)))
        node.spin_until(lambda: any(
            status.level == DiagnosticStatus.WARN and said in status.message
            for message in statuses for status in message.status))
        process.wait_for_line(said)
        assert process.interrupt() == 0, process.output
    assert len(re.findall(r'WARN.*' + re.escape(said), process.output)) == 1


def test_it_moves_from_where_the_robot_is_in_every_form_once_engaged(robot):
    parameters = {'robot': robot, 'outputs': 'joint_state joint_trajectory position_array',
                  'rate': 50.}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        bench = Bench(node)
        process.wait_for_line('listening for the right hand')
        node.spin_until(lambda: bench.states == ['disengaged'])
        # With a hand but without the robot's joint states it does not engage.
        refused = []
        node.repeat(lambda: refused.append(bench.engage()), lambda: bool(
            refused and 'joint states' in refused[-1].message), .1)
        assert not refused[-1].success and not bench.commands
        at = .05
        bench.start = robot_states(joints(), at)
        bench.until_engaged()
        first = bench.commands[0]
        moved = dict(zip(first.name, first.position))
        # The locked joints cannot be elsewhere than at zero.
        assert all(abs(moved[name] - at) < .03 for name in moved if 'cmc_flexion' not in name
                   or 'thumb' in name)
        assert set(first.name) == set(joints())
        node.spin_until(lambda: bench.arrays and bench.trajectories)
        trajectory, array = bench.trajectories[0], bench.arrays[0]
        assert list(trajectory.joint_names) == list(first.name)
        assert (trajectory.header.stamp.sec, trajectory.header.stamp.nanosec) == (0, 0)
        (point,) = trajectory.points
        assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, 20_000_000)
        assert list(point.positions) == list(first.position) == list(array.data)
        # The hand dies: the stream holds, and ends as it has to be engaged anew.
        bench.is_seen = False
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        assert 'holding' in bench.states
        sent = len(bench.commands)
        assert np.isfinite(bench.commands[-1].position).all()
        bench.is_seen = True
        bench.until_engaged()
        assert len(bench.commands) > sent
        # The topic ends it as the service does, and /diagnostics says so.
        bench.by_topic.publish(Bool(data=False))
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        node.spin_until(lambda: any(
            'disengaged: by the person' in status.message
            for message in diagnostics for status in message.status))
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


@contextmanager
def following(robot, fast_path):
    """Yield process, watching node and bench of a robot that follows; it ends without a fault."""
    parameters = {'robot': robot, 'fast_path': fast_path}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        bench = Bench(node)
        process.wait_for_line('listening')
        bench.start = robot_states(joints(), .05)
        bench.until('following')
        yield process, node, bench
        assert process.interrupt() == 0, process.output
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('fast_path', [True, False])
def test_a_tracker_that_repeats_its_last_frame_is_no_hand(fast_path, robot):
    with following(robot, fast_path) as (_, node, bench):
        bench.is_frozen = True
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        assert bench.states[-2:] == ['holding', 'disengaged']
        assert 'no hand' in bench.engage().message
        bench.is_frozen = False
        bench.until_engaged()


@pytest.mark.parametrize('fast_path', [True, False])
def test_a_robot_whose_joint_states_repeat_one_stamp_is_not_known(fast_path, robot):
    with following(robot, fast_path) as (process, node, bench):
        is_frozen = [False]

        def stamp():
            bench.start.header.stamp.sec += not is_frozen[0]

        node.create_timer(PERIOD, stamp)
        # It has no stamp until here, as of a driver without a clock.
        bench.until_engaged()
        is_frozen[0] = True
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        fault = 'they have the same stamp again and again'
        process.wait_for_line(f"disengaged: the robot's joint states ended: {fault}")
        assert fault in bench.engage().message
        is_frozen[0] = False
        bench.until_engaged()


@pytest.mark.parametrize('fast_path', [True, False])
def test_a_node_that_was_stopped_for_long_does_not_go_on(fast_path, robot):
    with following(robot, fast_path) as (process, node, bench):
        process.send_signal(signal.SIGSTOP)
        stopped = len(bench.states)
        # As the hand is elsewhere when it goes on.
        bench.angles = pose_angles('fist', bench.hand)
        options = GuardOptions()
        node.spin_for(options.hand_timeout + options.disengage_after + .3)
        process.send_signal(signal.SIGCONT)
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        assert set(bench.states[stopped:]) <= {'holding', 'disengaged'}
        bench.until_engaged()


def test_no_command_is_sent_in_a_state_before_that_is_published(robot):
    with NodeProcess(MODULE, {'robot': robot}) as process, watching_node() as node:
        bench, sent = Bench(node), []
        for kind, topic, read, qos in (
                (String, 'retarget/state', lambda message: message.data, STATE_QOS),
                (JointState, 'robot/command', lambda message: tuple(message.position), 1000)):
            # Topics have no common order of receipt.
            node.create_subscription(
                kind, topic, lambda message, info, read=read: sent.append(
                    (info['source_timestamp'], read(message))), qos)
        process.wait_for_line('listening')
        bench.start = robot_states(joints(), .05)
        bench.until_engaged()
        for pose in ('fist', 'open', 'fist'):
            bench.is_seen = False
            node.spin_until(lambda: bench.states[-1] == 'holding')
            # The robot has far to go at once.
            bench.angles, bench.is_seen = pose_angles(pose, bench.hand), True
            node.spin_until(lambda: bench.states[-1] != 'holding')
            bench.until_engaged()
        assert process.interrupt() == 0, process.output
    state, held = '', []
    for _, what in sorted(sent, key=itemgetter(0)):
        if isinstance(what, str):
            state, held = what, []
        elif state == 'holding':
            held.append(what)
            assert what == held[0]


def test_while_kernels_are_compiled_the_robot_is_shown(robot, monkeypatch):
    watched = []

    def compile_following(loaded, hand):
        with watching_node() as node:
            shown = node.collect(JointState, 'robot/shown')
            bench = Bench(node)
            node.spin_until(lambda: len(shown) > 1)
            watched.extend([*shown, bench.stamps])

    monkeypatch.setattr(retarget_node, 'compile_following', compile_following)
    rclpy.init(args=['--ros-args', '-p', f'robot:={robot}', '-p', 'show_robot:=true'])
    try:
        node = RetargetNode()
        assert not list(one for one in node.subscriptions if one.topic_name == '/joint_states')[1:]
        node.destroy_node()
    finally:
        rclpy.shutdown()
    *shown, stamps = watched
    for one in shown:
        assert one.header.stamp in stamps and set(one.name) == set(joints())
        assert one.position == shown[0].position


def test_the_robot_is_shown_before_it_is_engaged_and_as_it_is_commanded(robot):
    parameters = {'robot': robot, 'outputs': 'joint_state joint_trajectory position_array',
                  'show_robot': True}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        bench = Bench(node)
        bench.is_frozen = True
        shown = node.collect(JointState, 'robot/shown')
        diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        process.wait_for_line('listening')
        node.spin_until(lambda: shown)
        assert set(shown[0].name) == set(joints())
        assert shown[0].header.stamp == Time(sec=1)
        bench.is_frozen = False
        bench.start = robot_states(joints(), .05)
        node.spin_until(lambda: np.allclose(shown[-1].position, .05))
        node.spin_until(lambda: len(shown) > 20)
        assert not (bench.commands or bench.arrays or bench.trajectories)
        bench.until_engaged()
        if COMPILED:
            node.spin_until(lambda: most_on_fast_path(diagnostics) > 20)
        del shown[:], bench.commands[:]
        node.spin_until(lambda: len(shown) > 20 and len(bench.commands) > 20)
        assert {tuple(one.position) for one in shown} & {
            tuple(one.position) for one in bench.commands}
        assert bench.engage(False).success
        node.spin_until(lambda: np.allclose(shown[-1].position, .05))
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


def test_the_deadman_engages_and_its_release_ends_it_and_the_wrist_too(robot):
    tf2_msgs = pytest.importorskip('tf2_msgs.msg')
    parameters = {'robot': robot, 'safety.hold_to_engage': True, 'wrist.outputs': 'pose twist',
                  'wrist.base_frame': 'arm_base'}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        bench = Bench(node)
        bench.start = robot_states(joints(), .05)
        wrist = TransformStamped(child_frame_id='right_wrist')
        wrist.transform.rotation.w = 1.
        hand = node.create_publisher(tf2_msgs.TFMessage, '/tf', 10)
        arm = PoseStamped()
        arm.pose.position.z, arm.pose.orientation.w = .7, 1.
        arms = node.create_publisher(PoseStamped, 'robot/wrist_pose', 10)
        targets = node.collect(PoseStamped, 'robot/wrist_target')
        twists = node.collect(TwistStamped, 'robot/wrist_twist')
        process.wait_for_line('listening')

        def press():
            bench.deadman.publish(Bool(data=True))
            arms.publish(arm)
            # Once the arm follows, the person's wrist rises by 5 cm.
            wrist.transform.translation.z = .05 * bool(targets and twists)
            hand.publish(tf2_msgs.TFMessage(transforms=[wrist]))

        node.repeat(press, lambda: len(bench.commands) > 3 and targets and twists
                    and targets[-1].pose.position.z > .74, .05)
        assert targets[0].header.frame_id == twists[0].header.frame_id == 'arm_base'
        assert targets[0].pose.position.z == pytest.approx(.7)
        assert max(one.twist.linear.z for one in twists) == pytest.approx(.25)
        # It is pressed no more.
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        process.wait_for_line('the deadman was released')
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


def is_at_rest(message):
    """Return whether a TwistStamped moves nothing."""
    return message.twist == Twist()


class ArmBench:
    """A person's wrist that rises, and an arm."""

    def __init__(self, node):
        tf2_msgs = pytest.importorskip('tf2_msgs.msg')
        self._wrist, self.pose = TransformStamped(child_frame_id='right_wrist'), PoseStamped()
        self._wrist.transform.rotation.w = self.pose.pose.orientation.w = 1.
        transforms = node.create_publisher(tf2_msgs.TFMessage, '/tf', 10)
        arms = node.create_publisher(PoseStamped, 'robot/wrist_pose', 10)
        self.targets = node.collect(PoseStamped, 'robot/wrist_target')
        self.twists = node.collect(TwistStamped, 'robot/wrist_twist')
        self._diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        self.has_pose = False

        def tell():
            self._wrist.transform.translation.z += .0005
            transforms.publish(tf2_msgs.TFMessage(transforms=[self._wrist]))
            if self.has_pose:
                arms.publish(self.pose)

        node.create_timer(PERIOD, tell)

    def said(self):
        """Return what the last status of the node says: its message, and that of the wrist."""
        status = self._diagnostics[-1].status[0] if self._diagnostics else None
        return status and (status.message, next(
            pair.value for pair in status.values if pair.key == 'wrist'))


def test_an_arm_whose_pose_comes_later_stays_until_it_is_engaged_anew(robot):
    parameters = {'robot': robot, 'wrist.outputs': 'pose twist'}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        bench, arm = Bench(node), ArmBench(node)
        node.spin_until(lambda: arm.said() and arm.said()[1].endswith("wrist is missing"))
        bench.start = robot_states(joints(), .05)
        bench.until_engaged()
        answer = bench.engage()
        fault = "the arm stays where it is: the pose of the robot's wrist is missing"
        assert answer.success and fault in answer.message and 'engage anew' in answer.message
        bench.until('following')
        node.spin_until(lambda: fault in arm.said()[0] and fault in arm.said()[1])
        arm.has_pose = True
        # Poses that came before the answer to a call have been taken.
        node.spin_for(20 * PERIOD)
        node.call(GetParameters, 'retarget/get_parameters', GetParameters.Request(names=['robot']))
        assert not arm.targets and not arm.twists
        node.repeat(bench.engage, lambda: arm.targets and arm.twists, .1)
        node.spin_until(lambda: arm.said()[1] == 'ok')
        clutch = node.create_publisher(Bool, 'retarget/clutch', 1)
        node.repeat(lambda: clutch.publish(Bool(data=True)),
                    lambda: arm.said()[1] == 'held by the clutch', .1)
        node.repeat(lambda: clutch.publish(Bool(data=False)), lambda: arm.said()[1] == 'ok', .1)
        bench.until('following')
        node.repeat(bench.engage, lambda: not is_at_rest(arm.twists[-1]), .1)
        # Its pose ends: as of a robot whose joint states end, nothing is moved any more.
        arm.has_pose = False
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        process.wait_for_line("disengaged: the pose of the robot's wrist ended")
        node.spin_until(lambda: is_at_rest(arm.twists[-1]))
        arm.has_pose = True
        node.spin_for(20 * PERIOD)
        del arm.targets[:], arm.twists[:], bench.commands[:]
        bench.engage(False)
        assert not arm.targets and not arm.twists and not bench.commands
        node.repeat(bench.engage, lambda: arm.targets and bench.commands, .1)
        assert process.output.count("the pose of the robot's wrist ended") == 1
        # One that comes with one stamp again and again has ended, too.
        arm.pose.header.stamp.sec = 1
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        assert process.interrupt() == 0, process.output
    assert process.output.count("the pose of the robot's wrist ended") == 2
    assert 'Traceback' not in process.output


def test_a_wrist_in_another_frame_is_refused_by_name_or_no_movement(robot):
    tf2_msgs = pytest.importorskip('tf2_msgs.msg')
    parameters = {'robot': robot, 'wrist.outputs': 'pose', 'wrist.base_frame': 'arm_base'}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        bench = Bench(node)
        bench.start = robot_states(joints(), .05)
        wrist, arm = TransformStamped(child_frame_id='right_wrist'), PoseStamped()
        wrist.header.frame_id, wrist.transform.rotation.w = 'markers', 1.
        arm.header.frame_id, arm.pose.position.z, arm.pose.orientation.w = 'world', 1.7, 1.
        hand = node.create_publisher(tf2_msgs.TFMessage, '/tf', 10)
        arms = node.create_publisher(PoseStamped, 'robot/wrist_pose', 10)
        targets = node.collect(PoseStamped, 'robot/wrist_target')
        diagnostics = node.collect(DiagnosticArray, '/diagnostics')

        def tell():
            arms.publish(arm)
            hand.publish(tf2_msgs.TFMessage(transforms=[wrist]))

        def said_of_wrist():
            return [value.value for message in diagnostics for status in message.status
                    for value in status.values if value.key == 'wrist']

        node.create_timer(PERIOD, tell)
        bench.until('following')
        node.spin_until(lambda: "frame_id 'world'" in ''.join(said_of_wrist()[-1:]))
        process.wait_for_line("left out: robot/wrist_pose: frame_id 'world'; expected "
                              "wrist.base_frame, 'arm_base'")
        # Nor is a target sent from there.
        assert not targets
        arm.header.frame_id, arm.pose.position.z = 'arm_base', .7
        node.spin_until(lambda: said_of_wrist()[-1].startswith('the arm stays where it is'))
        # It is engaged anew, as whoever engaged the robot was told that the arm stays.
        assert not targets
        bench.engage()
        node.spin_until(lambda: len(targets) > 20 and said_of_wrist()[-1] == 'ok')
        # The same place, as another frame has it; then a way of 5 cm in that frame.
        wrist.header.frame_id, wrist.transform.translation.z = 'room', .09
        before = len(targets)
        node.spin_until(lambda: len(targets) > before + 50)
        wrist.transform.translation.z = .14
        node.spin_until(lambda: targets[-1].pose.position.z > .749)
        there = len(targets)
        node.spin_until(lambda: len(targets) > there + 20)
        assert {one.header.frame_id for one in targets} == {'arm_base'}
        assert targets[0].pose.position.z == pytest.approx(.7)
        assert max(one.pose.position.z for one in targets) == pytest.approx(.75)
        assert process.interrupt() == 0, process.output
    assert process.output.count('left out: robot/wrist_pose') == 1
    assert 'Traceback' not in process.output


@pytest.mark.skipif(not COMPILED, reason='needs the fast path')
def test_the_fingers_stay_on_the_fast_path_while_an_arms_wrist_follows(robot):
    tf2_msgs = pytest.importorskip('tf2_msgs.msg')
    with NodeProcess(MODULE, {
            'robot': robot, 'wrist.outputs': 'twist', 'on_body': True}) as process, (
            watching_node()) as node:
        bench = Bench(node)
        bench.start = robot_states(joints(), .05)
        wrist = TransformStamped(child_frame_id='right_wrist_tracked')
        wrist.transform.rotation.w = 1.
        transforms = node.create_publisher(tf2_msgs.TFMessage, '/tf', 10)
        twists = node.collect(TwistStamped, 'robot/wrist_twist')
        diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        process.wait_for_line('listening')

        def rise():
            wrist.transform.translation.z += .0005
            transforms.publish(tf2_msgs.TFMessage(transforms=[wrist]))

        node.create_timer(PERIOD, rise)
        bench.until_engaged()
        # The person's wrist may be discovered later than their fingers.
        node.repeat(bench.engage, lambda: twists, .1)
        node.spin_until(lambda: most_on_fast_path(diagnostics) > 50)
        # The wrist goes on beside them: by the way that it was seen to rise.
        del twists[:]
        before = most_on_fast_path(diagnostics)
        node.spin_until(lambda: len(twists) > 50 and most_on_fast_path(diagnostics) > before + 20)
        assert np.median([one.twist.linear.z for one in twists]) > .01
        # What ends the fingers ends the wrist.
        assert bench.engage(False).success
        node.spin_until(lambda: bench.states[-1] == 'disengaged')
        # Of an arm that goes on with its last twist, that is none.
        node.spin_until(lambda: is_at_rest(twists[-1]))
        del twists[:]
        for _ in range(20):
            rise()
            bench.engage(False)
        assert not twists
        bench.until_engaged()
        node.repeat(bench.engage, lambda: twists and not is_at_rest(twists[-1]), .1)
        assert process.interrupt() == 0, process.output
        node.spin_until(lambda: is_at_rest(twists[-1]))
    assert 'Traceback' not in process.output


def test_it_says_that_it_is_slower_where_the_codec_does_not_know_the_layout(monkeypatch, capfd):
    monkeypatch.setattr(serialization, 'codec_agrees', lambda: False)
    rclpy.init(args=['--ros-args', '-p', 'robot:=plain'])
    try:
        RetargetNode().destroy_node()
    finally:
        rclpy.shutdown()
    assert f'{serialization.UNKNOWN_LAYOUT}: slower' in capfd.readouterr().err


@pytest.mark.parametrize('parameters, message', [
    ({}, 'robot: empty; expected a preset or a file'),
    ({'robot': 'hal'}, "robot: 'hal' is no file and no preset"),
    ({'outputs': 'morse'}, "outputs: 'morse'; expected of joint_state"),
    ({'side': 'left'}, "the robot's hand is a right one, the person's a left one"),
    ({'order': 'knee'}, "order: there is no movable joint 'knee'"),
])
def test_what_is_wrong_ends_it_with_one_line(parameters, message, robot):
    given = parameters if not parameters or 'robot' in parameters else {
        'robot': robot, **parameters}
    with NodeProcess(MODULE, given) as process:
        assert process.wait() == 1
    assert process.output.count(message) == 1
    assert 'Traceback' not in process.output
