"""Measure how long the tracker node takes from its start to its first JointState.

    python -m benchmarks.startup [--starts 5] [--json OUT]

Cold, where plain Python tracks while the kernels are compiled, and warm, where they are on disk.
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
from hand_tracker.nodes.fast_path import FastPath

COMPILING_LIMIT = 1800.  # [s]


def start(driver, name, frames, cache):
    """Return the time until the first JointState of a new node, and its processor time [s]."""
    began = time.perf_counter_ns()
    with subprocess.Popen(
            [sys.executable, '-m', 'hand_tracker.entry', 'tracker', '--ros-args', '-r',
             f'__ns:=/{name}'],
            env=environ(NUMBA_CACHE_DIR=str(cache), HAND_TRACKER_JIT='background'),
            stderr=subprocess.DEVNULL) as process:
        try:
            answered = driver.wait_for(name, process, frames)
            if answered is None:
                raise SystemExit('the tracker node does not answer')
            return 1e-9 * (answered - began), cpu_time(process)
        finally:
            end(process)


def wait_for_kernels(cache):
    """Wait until the compiling process has filled the cache; return how long that took [s]."""
    began = time.perf_counter()
    while not any(cache.glob(f'ready-{FastPath.KERNEL_SET}-*')):
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
    names = [f'start_{i}' for i in range(options.starts + 1)]
    driver = Driver(names)
    with TemporaryDirectory() as cache:
        found = [start(driver, names[0], frames, cache)]
        compiling = wait_for_kernels(Path(cache))
        found += [start(driver, name, frames, cache) for name in names[1:]]
    rows = []
    for kind, starts in (('cold', found[:1]), ('warm', found[1:])):
        wall, cpu = np.transpose(starts)
        rows.append({'start': kind, 'starts': len(starts),
                     'seconds': round(float(np.median(wall)), 2),
                     'longest_s': round(float(wall.max()), 2),
                     'cpu_seconds': round(float(np.median(cpu)), 2)})
        print('{start}: {seconds} s to the first JointState (at most {longest_s} s in {starts}), '
              '{cpu_seconds} s of a processor'.format(**rows[-1]))
    rows.append({'start': 'compiling', 'seconds': round(compiling + found[0][0], 2)})
    print('compiled kernels were on disk {seconds} s after the cold start'.format(**rows[-1]))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
