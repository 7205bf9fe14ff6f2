"""Measure the latency of a round trip: markers published, tracked by a node, joint states back.

    python -m benchmarks.round_trip [--rates 120 480] [--seconds 5] [--json OUT] [--samples OUT]

Compares the tracker node with its defaults, a minimal echo node in rclpy that answers each
MarkerArray with a JointState, and the same in C on rcl with serialized messages, where a C compiler
and the headers are installed. All run at once and receive markers in turns.
"""

import argparse
import gc
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import (
    MARK,
    add_json_option,
    add_timing_options,
    end,
    environ,
    environment,
    put_stamps,
    stamp_places,
    write_rows,
)

HANDS = 'right', 'left'
BOTH_HANDS = 'both'    # hands in one message, for one node
SIDES_OF = {'1': HANDS[:1], '2': HANDS, BOTH_HANDS: (BOTH_HANDS,)}
FIRST_STAMP = 1_700_000_000  # [s] of the first stamp
FIRST_ANSWER_TIME = 300.  # [s] for the first answer: kernels may have to be compiled
WARM = .5              # [s] before the measurement
LAP = 2.               # [s] of motion, sent forwards and backwards
REST = .2              # [s] for the last answers
BOUTS = 5              # turns of each node at a rate
ECHO = Path(__file__).with_name('echo.c')
C_LIBRARIES = ('rcl', 'rmw', 'rcutils', 'rosidl_runtime_c', 'sensor_msgs__rosidl_typesupport_c',
               'visualization_msgs__rosidl_typesupport_c')
MEASURED_NODES = 'hand_tracker', 'rclpy_echo', 'c_echo'
HEADING = (f"{'node':14}{'Hz':>6}{'hands':>7}{'median µs':>11}{'p99 µs':>9}{'CPU %':>7}"
           f"{'dropped %':>11}")
LINE = ('{node:14}{rate_hz:6g}{hands:7}{median_us:11.0f}{p99_us:9.0f}{cpu_percent:7.1f}'
        '{dropped_percent:11.2f}')


def isolate():
    """Restrict discovery to this machine, in a ROS domain of its own."""
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def echo(args):
    """Run a minimal rclpy node that answers each MarkerArray with a JointState."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.node import Node
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import MarkerArray

    from hand_tracker.core.model.hand import JOINTS
    from hand_tracker.core.model.marker_layout import MARKERS

    rclpy.init(args=args)
    node = Node('echo')
    publisher = node.create_publisher(JointState, 'joint_states', 10)

    def answer(message):
        names = JOINTS * (len(message.markers) // len(MARKERS))
        found = JointState(name=names, position=[0.] * len(names))
        found.header.stamp = message.markers[0].header.stamp
        publisher.publish(found)

    node.create_subscription(MarkerArray, 'markers', answer, QoSProfile(
        depth=5, reliability=ReliabilityPolicy.BEST_EFFORT))
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


def compiled_echo(folder):
    """Compile the C echo node; return its command by number of hands, none if that fails."""
    from hand_tracker.core.model.hand import JOINTS
    from hand_tracker.messages.stamps import Stamp
    from hand_tracker.messages.templates import joint_state_template
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    prefix = next((Path(prefix) for prefix in prefixes
                   if prefix and Path(prefix, 'include/rcl').is_dir()), None)
    compiler = shutil.which('cc')
    if prefix is None or compiler is None:
        return {}
    program = Path(folder, 'echo')
    answers = {}
    for hands in 1, 2:
        answers[hands] = Path(folder, f'answer_{hands}')
        joints = [f'{side}_{joint}' for side in HANDS[:hands] for joint in JOINTS]
        answers[hands].write_bytes(
            joint_state_template(joints).fill(Stamp(0, 0), np.zeros(len(joints))))
    # Libraries from wheels have symbols that the Python library resolves.
    folder, python = map(sysconfig.get_config_var, ('LIBDIR', 'LDLIBRARY'))
    done = subprocess.run(
        [compiler, '-O2', '-o', program, ECHO, '-Wl,--no-as-needed',
         *([Path(folder, python), f'-Wl,-rpath,{folder}'] if python.endswith('.so') else []),
         *(f'-I{path}' for path in (prefix / 'include').iterdir()),
         f'-L{prefix}/lib', f'-Wl,-rpath,{prefix}/lib', '-Wl,--allow-shlib-undefined',
         *(f'-l{library}' for library in C_LIBRARIES)], stderr=subprocess.PIPE, text=True)
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        return {}
    return {hands: [program, answer] for hands, answer in answers.items()}


class Driver:
    """Publisher of serialized markers that records when joint states return.

    Parameters
    ----------
    names : sequence of str
        Namespaces of the nodes.
    topics : mapping of str to str, optional
        Topics of the answers in their namespaces, where they are not `joint_states`.
    context : rclpy.Context, optional
        Initialised; the default one is initialised here.
    node : str, optional
        Name of its own node.
    """

    def __init__(self, names, topics=None, context=None, node='round_trip'):
        import rclpy
        from rclpy.node import Node
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState
        from visualization_msgs.msg import MarkerArray

        if context is None:
            rclpy.init()
        try:
            from rclpy.experimental.events_executor import EventsExecutor as Executor
        except ImportError:
            from rclpy.executors import SingleThreadedExecutor as Executor
        self.node = Node(node, context=context)
        best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        topics = topics or {}
        self._publishers, self._answers, self._subscriptions = {}, {}, []
        for name in names:
            self._publishers[name] = self.node.create_publisher(
                MarkerArray, f'/{name}/markers', best_effort)
            self._answers[name] = answers = {}
            self._subscriptions.append(self.node.create_subscription(
                JointState, f"/{name}/{topics.get(name, 'joint_states')}",
                lambda data, answers=answers: answers.setdefault(
                    data[4:12], time.perf_counter_ns()), 100, raw=True))
        self._executor = Executor(context=context)
        self._executor.add_node(self.node)
        self._sent, self._time = 0, FIRST_STAMP * 10**9

    def wait_for(self, name, process, frames):
        """Send to a node until it answers; return the time of the answer [ns], or None."""
        until = time.monotonic() + FIRST_ANSWER_TIME
        while not self._answers[name]:
            if process.poll() is not None or time.monotonic() > until:
                return None
            self.send([name], [frames], 100.)
            self.spin_until(time.perf_counter_ns() + 10_000_000)
        return min(self._answers[name].values())

    def measure(self, names, frames, rate, seconds):
        """Return the round-trip times of each node [ns] and the number of frames sent."""
        for name in names:
            self._answers[name].clear()
        sent, due = {}, time.perf_counter_ns()
        for _ in range(round(rate * seconds)):
            self.spin_until(due)
            stamp = self.send(names, frames, rate)
            sent[stamp] = self._given
            due += round(1e9 / rate)
        self.spin_until(time.perf_counter_ns() + round(1e9 * REST))
        return [[answers[stamp] - given[i] for stamp, given in sent.items() if stamp in answers]
                for i, answers in enumerate(self._answers[name] for name in names)], len(sent)

    def send(self, names, frames, rate):
        """Send a frame to each of the nodes; return its stamp."""
        self._sent += 1
        # Stamps continue over runs: trackers restart when time jumps back.
        self._time += round(1e9 / rate)
        self._given = []
        for name, messages in zip(names, frames):
            data, places = messages[self._sent % len(messages)]
            stamp = put_stamps(data, places, self._time)
            message = bytes(data)
            self._given.append(time.perf_counter_ns())
            self._publishers[name].publish(message)
        return stamp

    def spin_until(self, due):
        """Take answers until a time [ns]."""
        while (left := due - time.perf_counter_ns()) > 0:
            self._executor.spin_once(1e-9 * left)


def messages(sides, rate):
    """Return frames of moving hands as pairs: serialized MarkerArray, offsets of its stamps.

    The markers of one hand are in namespace 'leds', those of both each in that of its side.
    """
    from builtin_interfaces.msg import Time
    from rclpy.serialization import serialize_message
    from visualization_msgs.msg import Marker, MarkerArray

    from hand_tracker.core.model.hand import Hand
    from hand_tracker.core.model.marker_layout import MARKERS
    from hand_tracker.simulation.packaged_recordings import demo_recording

    mark = Time(sec=MARK, nanosec=MARK)
    markers = MarkerArray(markers=[
        Marker(ns='leds' if len(sides) == 1 else side, id=number, type=Marker.SPHERE)
        for side in sides for number in range(len(MARKERS))])
    for marker in markers.markers:
        marker.header.frame_id, marker.header.stamp = 'mocap', mark
    found = []
    recording = np.concatenate(
        [demo_recording(Hand.scaled(side=side), rate=rate).markers[:round(LAP * rate)]
         for side in sides], axis=1)
    # Forwards and backwards: the motion is continuous.
    for positions in (*recording, *recording[-2:0:-1]):
        for marker, position in zip(markers.markers, positions.tolist()):
            at = marker.pose.position
            at.x, at.y, at.z = position
        data = bytearray(serialize_message(markers))
        found.append((data, stamp_places(data)))
    return found


def start(stack, folder, sides):
    """Start all nodes for sides, or `BOTH_HANDS`; return their processes by namespace."""
    commands = {'hand_tracker': [sys.executable, '-m', 'hand_tracker.nodes.tracker_node'],
                'rclpy_echo': [sys.executable, '-m', 'benchmarks.round_trip', '--echo']}
    echoes = compiled_echo(folder)
    if not echoes:
        print('c_echo: not there, it needs a C compiler and the headers of rcl')
    processes = {}
    for node in MEASURED_NODES if echoes else commands:
        for side in sides:
            more = (['-p', f'side:={side}', '-p', 'auto_size:=false'] if node == 'hand_tracker'
                    else [])
            name = f'{node}_{side}'
            command = commands.get(node) or echoes[2 if side == BOTH_HANDS else 1]
            process = stack.enter_context(subprocess.Popen(
                [*map(str, command), '--ros-args', '-r', f'__ns:=/{name}', *more],
                stderr=subprocess.DEVNULL, env=environ()))
            stack.callback(end, process)
            processes[name] = process
    return processes


def cpu_time(process):
    """Return the processor time of a process [s]."""
    import psutil
    times = psutil.Process(process.pid).cpu_times()
    return times.user + times.system


def measure(driver, processes, nodes, frames, rate, sides, seconds):
    """Return a row for each node, and its round-trip times [µs], NaN for dropped frames.

    Each of the sides has a process and messages of its own; `BOTH_HANDS` has one of both hands.
    Nodes are measured in short turns, since the speed of the machine varies.
    """
    found = {node: Bouts() for node in nodes}
    # A garbage collection here would count as the node's latency.
    gc.collect()
    gc.disable()
    for _ in range(BOUTS):
        for node, bouts in found.items():
            names = [f'{node}_{side}' for side in sides]
            driver.measure(names, frames, rate, WARM)
            before, began = [cpu_time(processes[name]) for name in names], time.monotonic()
            trips, sent = driver.measure(names, frames, rate, seconds / BOUTS)
            bouts.seconds += time.monotonic() - began
            bouts.used += sum(cpu_time(processes[name]) for name in names) - sum(before)
            bouts.answered.append(np.concatenate(trips) * 1e-3)
            bouts.sent += sent * len(sides)
    rows, samples = [], []
    for node, bouts in found.items():
        answered = np.concatenate(bouts.answered)
        median, p99 = np.percentile(answered, (50, 99)) if answered.size else (np.nan,) * 2
        rows.append({
            'node': node, 'rate_hz': rate,
            'hands': 'both' if BOTH_HANDS in sides else len(sides),
            'median_us': round(float(median), 1),
            'p99_us': round(float(p99), 1),
            'cpu_percent': round(100. * bouts.used / bouts.seconds, 1),
            'dropped_percent': round(100. * (1. - answered.size / bouts.sent), 3)})
        samples.append(
            np.pad(answered, (0, bouts.sent - answered.size), constant_values=np.nan))
    return rows, samples


@dataclass
class Bouts:
    """Measurements of a node at one rate."""

    seconds: float = 0.
    used: float = 0.  # processor time [s]
    answered: list = field(default_factory=list)  # round-trip times [µs]
    sent: int = 0     # frames


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_timing_options(parser, [120., 480., 960.])
    parser.add_argument('--hands', nargs='+', choices=SIDES_OF, default=list(SIDES_OF),
                        help='one node, two nodes, both hands in one message for one node')
    add_json_option(parser)
    parser.add_argument('--samples', metavar='OUT', help='write every round trip [µs] here, NaN '
                        'if dropped: an NPZ archive with an array NODE_HZ_HANDS for each row')
    parser.add_argument('--echo', action='store_true', help=argparse.SUPPRESS)
    options, ros_args = parser.parse_known_args()
    if options.echo:
        return echo(ros_args)

    isolate()
    from rclpy.utilities import get_rmw_implementation_identifier
    print(environment())
    print(get_rmw_implementation_identifier())
    rows, samples = [], {}
    with TemporaryDirectory() as folder, ExitStack() as stack:
        measured_sides = [SIDES_OF[hands] for hands in options.hands]
        processes = start(stack, folder, dict.fromkeys(
            side for sides in measured_sides for side in sides))
        frames = {rate: {side: messages(HANDS if side == BOTH_HANDS else (side,), rate)
                         for side in (*HANDS, BOTH_HANDS)} for rate in options.rates}
        driver = Driver(processes)
        for name, process in processes.items():
            side = name.rpartition('_')[2]
            if driver.wait_for(name, process, frames[options.rates[0]][side]) is None:
                raise SystemExit(f'{name} does not answer')
        print(HEADING)
        nodes = dict.fromkeys(name.rpartition('_')[0] for name in processes)
        for sides in measured_sides:
            for rate in options.rates:
                measured, trips = measure(
                    driver, processes, nodes, [frames[rate][side] for side in sides], rate, sides,
                    options.seconds)
                rows += measured
                for row, trip in zip(measured, trips):
                    samples[f"{row['node']}_{rate:g}_{row['hands']}"] = trip
                    print(LINE.format(**row))
    write_rows(options.json, rows)
    if options.samples:
        np.savez_compressed(options.samples, **samples)
    return 0


if __name__ == '__main__':
    sys.exit(main())
