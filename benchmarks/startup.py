"""Measure how long the tracker node takes from its start to its first JointState.

    python -m benchmarks.startup [--starts 5] [--json OUT]

The first, where neither kernels nor byte code are on disk; cold, where no kernels are; and warm,
where all are. Without kernels plain Python tracks while they are compiled: after the first start
that is waited for, and its time is printed. Cold and warm starts take turns with starts of a
minimal node in rclpy, as a yardstick: all wait for DDS to discover them, which takes from a tenth
of a second to three. Markers are sent all the while.
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
import psutil

from benchmarks.common import RATE, add_json_option, end, environ, environment, write_rows
from benchmarks.round_trip import Driver, cpu_time, isolate, messages
from hand_tracker.core.numerics.jit import LABELLING_SET, TRACKING_SET
from hand_tracker.nodes.fast_path import FastPath

TRACKER_START = 'hand_tracker.entry', 'tracker'
ECHO_START = 'benchmarks.round_trip', '--echo'
COMPILING_LIMIT = 1800.  # [s]


def start(driver, command, name, frames, kernels, byte_code, compiles_on=False):
    """Return the time until the first JointState of a new node, and its processor time [s].

    Where it `compiles_on`, the process that compiles its kernels outlives it.
    """
    variables = environ(NUMBA_CACHE_DIR=str(kernels), PYTHONPYCACHEPREFIX=str(byte_code),
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
            children = [] if compiles_on else psutil.Process(process.pid).children()
            end(process)
            for child in children:
                child.kill()


def wait_for_kernels(kernels):
    """Wait until the compiling process has filled a folder; return how long that took [s]."""
    began = time.perf_counter()
    sets = FastPath.KERNEL_SET, TRACKING_SET, LABELLING_SET
    while not all(any(kernels.rglob(f'ready-{name}-*')) for name in sets):
        if time.perf_counter() - began > COMPILING_LIMIT:
            raise SystemExit('the kernels were not compiled')
        time.sleep(.1)
    return time.perf_counter() - began


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--starts', type=int, default=5, help='of each kind')
    add_json_option(parser)
    options = parser.parse_args()
    isolate()
    print(environment())
    frames = messages(['right'], RATE)
    kinds = {'cold': TRACKER_START, 'warm': TRACKER_START, 'rclpy_echo': ECHO_START}
    names = [f'{kind}_{i}' for i in range(options.starts) for kind in kinds]
    driver = Driver(['first', *names])
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        cache = Path(folder)
        kernels, byte_code = cache / 'kernels', cache / 'byte_code'
        found = {'first': [start(driver, TRACKER_START, 'first', frames, kernels, byte_code,
                                 True)]}
        compiling = wait_for_kernels(kernels)
        for name in names:
            kind = name.rpartition('_')[0]
            found.setdefault(kind, []).append(start(
                driver, kinds[kind], name, frames,
                cache / name if kind == 'cold' else kernels, byte_code))
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
    rows.append({'start': 'compiling', 'seconds': round(compiling + found['first'][0][0], 2)})
    print('compiled kernels were on disk {seconds} s after the first start'.format(**rows[-1]))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
