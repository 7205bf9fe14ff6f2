"""SROS 2 enforced: the nodes work in their enclaves, and a stranger reaches nothing.

It needs sros2 and a Fast DDS with its security plug-ins; the same stranger without enforcement,
which reaches all that it tries, needs neither.
"""

import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from helpers import stranger
from helpers.bench import messages
from helpers.robots import human_robot_file
from helpers.ros_process import PATIENCE, TRACKER_MODULE, NodeProcess, Process, watching_node
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker

from benchmarks.common import end, environ
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.files.keystore import security_environment
from hand_tracker.messages.builders import prefixed_names
from hand_tracker.nodes.live_tracker import LiveTracker
from hand_tracker.nodes.runner import spinning
from hand_tracker.package_data import packaged_recording
from security.policies import (
    ARRANGEMENTS,
    ENCLAVES,
    HEARD_AS_LAUNCHED,
    NODE_NAMES,
    SHARED_PROCESSES,
    settled_rules,
)
from security.trials import DRIVER, STRANGER, UNSECURED, enforced, make_keystore

NEEDS = 'rclpy', 'tf2_msgs', 'trajectory_msgs', 'rosbag2_interfaces'

REPLAY, RETARGET = (f'hand_tracker.nodes.{program}_node' for program in ('replay', 'retarget'))
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TEST_FOLDER = str(Path(__file__).resolve().parents[1])
TRIAL_ROUNDS = 300  # of a stranger's tries, before there is anybody else
FRAMES = 300
# rmw_fastrtps says this where Fast DDS, or itself, was built without them.
WITHOUT_PLUGINS = "doesn't have the security libraries"


@pytest.fixture(scope='module')
def keystore(tmp_path_factory):
    """Return a keystore, where nodes can be run with it."""
    pytest.importorskip('sros2', reason='needs sros2, to make a keystore')
    path = make_keystore(tmp_path_factory.mktemp('security'))
    with Process([sys.executable, '-c', 'import rclpy; rclpy.init(); rclpy.create_node("driver")'],
                 enforced(path, DRIVER)) as process:
        code = process.wait()
    if WITHOUT_PLUGINS in process.output:
        pytest.skip('needs a Fast DDS with its security plug-ins')
    assert code == 0, process.output
    return path


@pytest.fixture
def robot(tmp_path):
    return human_robot_file(tmp_path)


@pytest.fixture
def set_environment(monkeypatch):
    """Return a function that puts variables where a context finds them as it is made."""
    def put(variables):
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
    yield put


def stranger_process(environment):
    paths = TEST_FOLDER, *filter(None, [os.environ.get('PYTHONPATH')])
    return Process([sys.executable, '-m', stranger.STRANGER_MODULE],
                   {**environment, 'PYTHONPATH': os.pathsep.join(paths)})


def reached(process):
    """Return what a stranger has reached so far."""
    told = [line for line in process.output.splitlines() if line.startswith('{"rounds"')]
    return SimpleNamespace(**{
        name.replace(' ', '_'): value
        for name, value in json.loads(told[-1] if told else '{"rounds": 0}').items()})


def wait_until(process, condition):
    until = time.monotonic() + PATIENCE
    while not condition():
        assert not process.ended and time.monotonic() < until, process.output[-4000:]
        time.sleep(.1)


def start_nodes(stack, robot, environment_of, by_deadman):
    """Start what a robot is driven with; return the processes."""
    processes = [stack.enter_context(NodeProcess(*arguments, environment=environment_of(program)))
                 for program, *arguments in (
                     # Of several publishers it then believes all.
                     ('tracker', TRACKER_MODULE, {'publishers': 'all'}),
                     ('retarget', RETARGET, {
                         'robot': robot, 'safety.hold_to_engage': by_deadman}))]
    for process in processes:
        process.wait_for_line('listening')
    return processes


BY_DEADMAN = pytest.mark.parametrize('by_deadman', [False, True], ids=['engage', 'deadman'])


@BY_DEADMAN
def test_without_enforcement_a_stranger_reaches_all_that_it_tries(robot, by_deadman):
    with ExitStack() as stack:
        _, retarget = start_nodes(stack, robot, lambda _: UNSECURED, by_deadman)
        process = stack.enter_context(stranger_process(UNSECURED))
        wait_until(process, lambda: reached(process).rounds and (
            reached(process).frames_read and reached(process).set
            and set(reached(process).listeners.values()) == {1}
            and 'hand_tracker' in reached(process).nodes))
        retarget.wait_for_line('following')
        if not by_deadman:
            wait_until(process, lambda: reached(process).engaged)


@BY_DEADMAN
@pytest.mark.parametrize('who', ['without an enclave', 'of another keystore', 'without permission'])
def test_a_stranger_reaches_nothing_and_the_nodes_work(
        keystore, robot, set_environment, tmp_path, who, by_deadman):
    of_stranger = {
        'without an enclave': lambda: UNSECURED,
        # Which allows it all.
        'of another keystore': lambda: enforced(make_keystore(tmp_path), DRIVER),
        'without permission': lambda: enforced(keystore, STRANGER)}[who]()
    with ExitStack() as stack:
        processes = start_nodes(stack, robot, lambda program: enforced(
            keystore, f'{ENCLAVES}/{program}'), by_deadman)
        process = stack.enter_context(stranger_process(of_stranger))
        wait_until(process, lambda: reached(process).rounds > TRIAL_ROUNDS)
        if who == 'without permission':
            # It is known to them.
            wait_until(process, lambda: 'hand_tracker' in reached(process).nodes)

        # Who may comes after it, and finds all as it was.
        set_environment(enforced(keystore, DRIVER))
        driver = Driver(stack.enter_context(watching_node('driver')))
        assert driver.value('hand_tracker', 'frames') == '0'
        replay = stack.enter_context(NodeProcess(REPLAY, {
            'recording': str(packaged_recording('right')), 'loop': True},
            environment=enforced(keystore, f'{ENCLAVES}/replay')))
        driver.node.spin_until(lambda: len(driver.frames) > FRAMES)
        assert stranger.STRANGER_FRAME not in {frame.header.frame_id for frame in driver.frames}
        assert driver.relax_time() != stranger.WANTED
        assert driver.set_relax_time()
        driver.engage(by_deadman)
        if COMPILED:
            driver.node.spin_until(
                lambda: int(driver.value('hand_tracker', 'frames on fast path')) > FRAMES)

        found = reached(process)
        assert (found.frames_read, found.set, found.engaged) == (0, 0, 0)
        assert not any(found.listeners.values())
        # It may not even have endpoints; the others have, and nobody listens.
        assert len(found.refused) == (stranger.WAYS if who == 'without permission' else 0)
        for one in (replay, *reversed(processes)):
            assert one.interrupt() == 0, one.output
            assert 'Traceback' not in one.output


class Driver:
    """Somebody with an enclave of its own, who may drive the robot."""

    def __init__(self, node):
        self.node = node
        self.frames = node.collect(JointState, 'joint_states')
        self.states = []
        node.create_subscription(
            String, 'retarget/state', lambda message: self.states.append(message.data), LATCHED)
        self._diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        self._robot = node.create_publisher(JointState, 'robot/joint_states', 10)
        self._deadman = node.create_publisher(Bool, 'retarget/deadman', 10)

    def value(self, node, key):
        """Return the next value of a node's diagnostics."""
        self._diagnostics.clear()
        found = []

        def look():
            found.extend(pair.value for array in self._diagnostics for status in array.status
                         if status.name.startswith(node) for pair in status.values
                         if pair.key == key)
            return found

        self.node.spin_until(look)
        return found[-1]

    def relax_time(self):
        """Return the parameter that strangers set."""
        answer = self.node.call(GetParameters, 'hand_tracker/get_parameters',
                                GetParameters.Request(names=[stranger.PARAMETER]))
        return answer.values[0].double_value

    def set_relax_time(self):
        """Set it; return whether that was done."""
        return self.node.call(
            SetParametersAtomically, 'hand_tracker/set_parameters_atomically',
            SetParametersAtomically.Request(parameters=messages(
                {stranger.PARAMETER: stranger.WANTED + 1.}))).result.successful

    def engage(self, by_deadman):
        """Engage the robot, which nobody has done before."""
        self.node.spin_until(lambda: self.states)
        assert set(self.states) == {'disengaged'}

        names = [name.removeprefix('right_') for name in prefixed_names('right_').joints]

        def act():
            self._robot.publish(JointState(
                name=names, position=[stranger.STRANGER_ANGLE] * len(names)))
            self._deadman.publish(Bool(data=by_deadman))
            if not by_deadman:
                self.node.call(SetBool, 'retarget/engage', SetBool.Request(data=True))

        self.node.repeat(act, lambda: self.states[-1] != 'disengaged')


@pytest.mark.parametrize('program', sorted({*ARRANGEMENTS, *SHARED_PROCESSES} - {'viewer'}))
def test_every_node_starts_enforced_in_every_arrangement(
        keystore, set_environment, tmp_path, program):
    set_environment(enforced(keystore, DRIVER))
    with watching_node('driver') as driver:
        driver.collect(Marker, 'hand_skin')  # the skin listens while somebody listens to it
        # An enclave as the launch file gives it.
        environment = environ(**security_environment(str(keystore)))
        del environment['ROS_SECURITY_ENCLAVE_OVERRIDE']
        parts = {NODE_NAMES.get(part, part) for part in SHARED_PROCESSES.get(program, (program,))}
        arrangements = [[word for each in parameters for word in ('-p', each)]
                        for parameters in ARRANGEMENTS.get(program, (['robot:=plain'],))]
        arrangements += [[*arrangements[0], '-r', f'markers:={topic}']
                         for topic in sorted(HEARD_AS_LAUNCHED.get(program, ()))]
        for number, words in enumerate(arrangements):
            # The last one is forgotten.
            driver.spin_until(lambda: parts.isdisjoint(driver.get_node_names()))
            output = tmp_path / str(number)
            with ExitStack() as stack, output.open('w') as file:
                process = stack.enter_context(subprocess.Popen(
                    [sys.executable, '-m', f'hand_tracker.nodes.{program}_node', '--ros-args',
                     '--enclave', f'{ENCLAVES}/{program}', *words],
                    env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=file))
                stack.callback(end, process)
                for part in parts:
                    settled_rules(driver, part, '/', process)
            told = output.read_text()
            assert f'{ENCLAVES.lstrip("/")}/{program}' in told
            assert 'allow rule' not in told and 'Traceback' not in told, told


def test_the_viewer_sees_the_hand_enforced(keystore, set_environment):
    with ExitStack() as stack:
        for program, module, parameters in (('tracker', TRACKER_MODULE, {}), ('replay', REPLAY, {
                'recording': str(packaged_recording('right')), 'loop': True})):
            stack.enter_context(NodeProcess(
                module, parameters, environment=enforced(keystore, f'{ENCLAVES}/{program}')))
        set_environment(enforced(keystore, f'{ENCLAVES}/viewer'))
        rclpy.init()
        stack.callback(rclpy.try_shutdown)
        node = rclpy.create_node('viewer')
        with spinning(node):
            live = LiveTracker(node)
            live.prepare(print)
            live.set_demand(looked_at=True, compared=True)
            until = time.monotonic() + PATIENCE
            while live.state() is None or live.bare_state() is None:
                assert time.monotonic() < until, 'it sees no hand'
                time.sleep(.1)
