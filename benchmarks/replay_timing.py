"""Measure the timing errors of the replay node against the times of a recording.

    python -m benchmarks.replay_timing [--rate 480] [--seconds 20] [--json OUT]

Plays a generated recording in a child process. There it measures the lateness of each call of
`publish`, here the errors of the intervals between messages at a subscriber.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier
from visualization_msgs.msg import MarkerArray

from benchmarks.common import add_json_option, environment, write_rows
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.files.bags import bag_message, marker_array_message, write_bag
from hand_tracker.nodes import replay_node
from hand_tracker.nodes.runner import run

FIRST_STAMP_NS = 1_700_000_000 * 10**9


class TimedReplay(replay_node.ReplayNode):
    """Replay node that records the lateness of each published message."""

    def __init__(self):
        super().__init__()
        self.lateness = []

    def _publish(self, cue, due):
        self.lateness.append(time.time_ns() - due)
        super()._publish(cue, due)


def play(out):
    """Play in this process; write the lateness [ns] and the processor load [1]."""
    sys.setswitchinterval(replay_node.SWITCH_INTERVAL)

    def work(node):
        before, start = time.process_time(), time.monotonic()
        node.play()
        load = (time.process_time() - before) / (time.monotonic() - start)
        out.write_text(json.dumps({'lateness': node.lateness, 'load': load}))

    return run(TimedReplay, work, ros_words_alone=False)


def record(path, rate, seconds):
    """Write a recording of eight random markers."""
    rng = np.random.default_rng(0)
    write_bag(path, (
        bag_message('/markers', stamp, marker_array_message(
            stamp, 'mocap', MARKERS, rng.normal(size=(len(MARKERS), 3))))
        for stamp in (FIRST_STAMP_NS + round(i * 1e9 / rate)
                      for i in range(round(rate * seconds)))))


def listen(process):
    """Return the arrival times of messages until a process ends [ns]."""
    rclpy.init()
    node = Node('replay_timing')
    times = []
    node.create_subscription(
        MarkerArray, 'markers', lambda data: times.append(time.monotonic_ns()), 100, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while process.poll() is None:
        executor.spin_once(.1)
    rclpy.shutdown()
    if process.returncode:
        raise SystemExit(process.returncode)
    return np.array(times)


def row(name, errors, rate):
    """Return the row of a measurement from errors [ns]."""
    median, p99 = np.percentile(np.abs(errors), (50, 99)) * 1e-6
    return {'name': name, 'rate_hz': rate, 'count': len(errors),
            'median_ms': round(median, 4), 'p99_ms': round(p99, 4),
            'max_ms': round(np.abs(errors).max() * 1e-6, 4)}


def _version(package):
    try:
        return version(package)
    except ModuleNotFoundError:
        return os.environ.get('ROS_DISTRO', 'unknown')


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--rate', type=float, default=480., help='frames per second')
    parser.add_argument('--seconds', type=float, default=20., help='length of the recording')
    add_json_option(parser)
    parser.add_argument('--play', type=Path, help=argparse.SUPPRESS)
    options, ros_args = parser.parse_known_args()
    if options.play:
        return play(options.play)

    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    print(environment(rclpy=_version('rclpy'), rosbags=version('rosbags'),
                      rmw=get_rmw_implementation_identifier()))
    with TemporaryDirectory() as folder:
        recording, out = Path(folder, 'markers.mcap'), Path(folder, 'lateness.json')
        record(recording, options.rate, options.seconds)
        arrivals = listen(subprocess.Popen(
            [sys.executable, '-m', 'benchmarks.replay_timing', '--play', out, '--ros-args',
             '-p', f'recording:={recording}', *ros_args], stdout=subprocess.DEVNULL))
        played = json.loads(out.read_text())
    intervals = np.diff(arrivals) - 1e9 / options.rate
    rows = [row('published after its time', played['lateness'], options.rate),
            row('interval at a subscriber', intervals, options.rate)]
    for measured in rows:
        print('{name}: median {median_ms:.3f} ms, p99 {p99_ms:.3f} ms, max {max_ms:.3f} ms, '
              '{count} at {rate_hz:g} Hz'.format(**measured))
    print(f"replay's load: {100 * played['load']:.0f} % of a core")
    write_rows(options.json, [{**measured, 'load': played['load']} for measured in rows])
    return 0


if __name__ == '__main__':
    sys.exit(main())
