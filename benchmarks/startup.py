"""Measure how long the tracker node takes from its start to its first JointState.

    python -m benchmarks.startup [--starts 5] [--json OUT]

Cold, where the kernels have to be compiled, and warm, where an earlier start has left them in
numba's cache. Markers are sent all the while.
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

from benchmarks.common import add_json_option, environ, environment, write_rows
from benchmarks.round_trip import Driver, cpu_time, isolate, messages

RATE = 120.


def start(driver, name, frames, cache):
    """Return the time until the first JointState of a new node, and its processor time [s]."""
    began = time.perf_counter_ns()
    with subprocess.Popen(
            [sys.executable, '-m', 'hand_tracker.nodes.tracker_node', '--ros-args', '-r',
             f'__ns:=/{name}'], env=environ(NUMBA_CACHE_DIR=str(cache)),
            stderr=subprocess.DEVNULL) as process:
        try:
            answered = driver.wait_for(name, process, frames)
            if answered is None:
                raise SystemExit('the tracker node does not answer')
            return 1e-9 * (answered - began), cpu_time(process)
        finally:
            process.terminate()


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--starts', type=int, default=5, help='warm ones')
    add_json_option(parser)
    options = parser.parse_args()
    isolate()
    print(environment())
    frames = messages('right', RATE)
    names = [f'start_{i}' for i in range(options.starts + 1)]
    driver = Driver(names)
    with TemporaryDirectory() as cache:
        found = [start(driver, name, frames, cache) for name in names]
    rows = []
    for kind, starts in (('cold', found[:1]), ('warm', found[1:])):
        wall, cpu = np.transpose(starts)
        rows.append({'start': kind, 'starts': len(starts),
                     'seconds': round(float(np.median(wall)), 2),
                     'longest_s': round(float(wall.max()), 2),
                     'cpu_seconds': round(float(np.median(cpu)), 2)})
        print('{start}: {seconds} s to the first JointState (at most {longest_s} s in {starts}), '
              '{cpu_seconds} s of a processor'.format(**rows[-1]))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
