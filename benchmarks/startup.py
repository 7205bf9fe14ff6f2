"""Measure how long the tracker node takes from its start to its first JointState.

    python -m benchmarks.startup [--starts 5] [--json OUT]

Cold, where neither kernels nor byte code are on disk and plain Python tracks while the kernels are
compiled, and warm, where all are. Beside each warm start, a minimal node in rclpy is started, as a
yardstick: both wait for DDS to discover them, which takes from a tenth of a second to three.
Markers are sent all the while. Between the two the compiling process is waited for, and its time
is printed.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import RATE, add_json_option, end, environ, environment, write_rows
from benchmarks.round_trip import Driver, cpu_time, isolate, messages
from hand_tracker.core.numerics.jit import LABELLING_SET, TRACKING_SET
from hand_tracker.nodes.fast_path import FastPath

TRACKER_START = 'hand_tracker.entry', 'tracker'
ECHO_START = 'benchmarks.round_trip', '--echo'
COMPILING_LIMIT = 1800.  # [s]


def start(driver, command, name, frames, cache):
    """Return the time until the first JointState of a new node, and its processor time [s]."""
    variables = environ(NUMBA_CACHE_DIR=str(cache / 'kernels'),
                        PYTHONPYCACHEPREFIX=str(cache / 'byte_code'),
                        HAND_TRACKER_JIT='background' if command == TRACKER_START else '0')
    began = time.perf_counter_ns()
    with subprocess.Popen([sys.executable, '-m', *command, '--ros-args', '-r', f'__ns:=/{name}'],
                          env=variables, stderr=subprocess.DEVNULL) as process:
        try:
            answered = driver.wait_for(name, process, frames)
            if answered is None:
                raise SystemExit('the node does not answer')
            return 1e-9 * (answered - began), cpu_time(process)
        finally:
            end(process)


def wait_for_kernels(cache):
    """Wait until the compiling process has filled the cache; return how long that took [s]."""
    began = time.perf_counter()
    sets = FastPath.KERNEL_SET, TRACKING_SET, LABELLING_SET
    while not all(any((cache / 'kernels').rglob(f'ready-{name}-*')) for name in sets):
        if time.perf_counter() - began > COMPILING_LIMIT:
            raise SystemExit('the kernels were not compiled')
        time.sleep(.1)
    return time.perf_counter() - began


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--starts', type=int, default=5, help='warm ones')
    add_json_option(parser)
    options = parser.parse_args()
    isolate()
    print(environment())
    frames = messages(['right'], RATE)
    trackers = [f'start_{i}' for i in range(options.starts + 1)]
    echoes = [f'echo_{i}' for i in range(options.starts)]
    driver = Driver([*trackers, *echoes])
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        cache = Path(folder)
        found = {'cold': [start(driver, TRACKER_START, trackers[0], frames, cache)],
                 'warm': [], 'rclpy_echo': []}
        compiling = wait_for_kernels(cache)
        for tracker, echo in zip(trackers[1:], echoes):
            found['warm'].append(start(driver, TRACKER_START, tracker, frames, cache))
            found['rclpy_echo'].append(start(driver, ECHO_START, echo, frames, cache))
    rows = []
    for kind, starts in found.items():
        wall, cpu = np.transpose(starts)
        rows.append({'start': kind, 'starts': len(starts),
                     'seconds': round(float(np.median(wall)), 2),
                     'shortest_s': round(float(wall.min()), 2),
                     'longest_s': round(float(wall.max()), 2),
                     'cpu_seconds': round(float(np.median(cpu)), 2)})
        print('{start}: {seconds} s to the first JointState ({shortest_s} to {longest_s} s in '
              '{starts}), {cpu_seconds} s of a processor'.format(**rows[-1]))
    rows.append({'start': 'compiling', 'seconds': round(compiling + found['cold'][0][0], 2)})
    print('compiled kernels were on disk {seconds} s after the cold start'.format(**rows[-1]))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
