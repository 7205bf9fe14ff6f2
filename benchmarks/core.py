"""Measure the time of a frame in the core, by stage, compiled and as plain Python.

    python -m benchmarks.core [--frames 4000] [--json OUT]

The demo motion with no, one and three hidden markers, and all constraints on. `all` is
`HandTracker.update`; compiled, the stages are one kernel, so that they are timed in plain Python
alone. Stages are named as in `hand_tracker/core/pipeline.py`. `own_p99_us` is the 99th percentile
of each frame's shortest time of ten: of the frames' own work, without what interrupts them.
"""

import argparse
import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter_ns
from unittest import mock

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import RATE, add_json_option, environ, environment, write_rows
from hand_tracker.core import pipeline, tracker
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.simulation.motions import motion_named

NOISE = 1e-4          # [m]
HIDDEN = {0: (), 1: ('middle',), 3: ('index_mcp', 'middle', 'little')}
SEEN_FIRST = 240      # frames with all markers visible, not counted
PLAIN_FRAMES = 600
REPEATS = 10          # of the compiled frames
TRACK_FRAME = getattr(pipeline.track_frame, 'py_func', pipeline.track_frame)
STAGES = tuple(name for name in TRACK_FRAME.__code__.co_names
               if getattr(vars(pipeline).get(name), '__module__', '') == pipeline.__name__)


def frames(count, hidden, hand):
    """Return markers (count, 8, 3) [m], some hidden at times, and the mask of counted frames."""
    motion = motion_named('demo', hand)
    angles, rotation, position = motion.sample(np.arange(count) / RATE % motion.duration)
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(MarkerLayout().mounting(hand), pose, rotation, position)
    markers += np.random.default_rng(0).normal(scale=NOISE, size=markers.shape)
    # Half of each second: the work when markers disappear and return counts too.
    off = (np.arange(count) % RATE >= .5 * RATE) & (np.arange(count) >= SEEN_FIRST)
    for name in hidden:
        markers[off, MARKERS.index(name)] = np.nan
    counted = off if hidden else np.arange(count) >= SEEN_FIRST
    return markers, counted


def measure_all(markers, hand):
    """Return the time of each `update` [ns]."""
    followed = tracker.HandTracker(hand)
    times = []
    for row in markers:
        start = perf_counter_ns()
        followed.update(row)
        times.append(perf_counter_ns() - start)
    return np.array(times)


def measure_stages(markers, hand):
    """Return the times of each stage [ns], called as separate kernels, of those that are."""
    times = {name: [] for name in STAGES}
    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(tracker, 'track_frame', TRACK_FRAME))
        for name, found in times.items():
            stage = getattr(pipeline, name)
            stack.enter_context(mock.patch.object(pipeline, name, timed(stage, found)))
        measure_all(markers, hand)
    # Some are for layouts of more markers alone.
    return {name: np.array(found) for name, found in times.items() if found}


def timed(stage, times):
    """Wrap a stage to record its times [ns]."""
    def run(*arguments):
        start = perf_counter_ns()
        found = stage(*arguments)
        times.append(perf_counter_ns() - start)
        return found

    return run


def measure(count):
    """Return the rows measured in this process."""
    hand = Hand.scaled()
    rows = []
    for number, hidden in HIDDEN.items():
        markers, counted = frames(count, hidden, hand)
        measure_all(markers[:SEEN_FIRST], hand)
        stages = {} if COMPILED else measure_stages(markers, hand)
        runs = np.array([measure_all(markers, hand) for _ in range(REPEATS if COMPILED else 1)])
        for stage, times in {**stages, 'all': runs}.items():
            median, p99 = np.percentile(times[..., counted], (50, 99)) * 1e-3
            rows.append({'stage': stage, 'markers_hidden': number, 'compiled': COMPILED,
                         'median_us': round(float(median), 2), 'p99_us': round(float(p99), 2)})
        if COMPILED:
            own = np.percentile(runs[:, counted].min(axis=0), 99) * 1e-3
            rows[-1]['own_p99_us'] = round(float(own), 2)
    return rows


def elsewhere(switch, count):
    """Return the rows measured in a child process, with kernels compiled or plain."""
    command = [sys.executable, '-m', 'benchmarks.core', '--here', '--frames', str(count)]
    found = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True,
                           env=environ(HAND_TRACKER_JIT=switch))
    return json.loads(found.stdout)


def table(rows):
    """Return the rows as lines of text."""
    columns = [(compiled, number) for compiled in (True, False) for number in HIDDEN]
    found = {(row['compiled'], row['markers_hidden'], row['stage']): row for row in rows}
    columns = [column for column in columns if (*column, 'all') in found]
    lines = ['median/p99, µs'.ljust(16) + ''.join(
        f'{"compiled" if compiled else "plain"}, {number} hidden'.rjust(22)
        for compiled, number in columns)]
    for stage in (*STAGES, 'all'):
        cells = (found.get((*column, stage)) for column in columns)
        lines.append(stage.ljust(16) + ''.join(
            (f'{cell["median_us"]:.1f}/{cell["p99_us"]:.1f}' if cell else '-').rjust(22)
            for cell in cells))
    return '\n'.join(lines)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=4000, help='compiled; plain at most 600')
    add_json_option(parser)
    parser.add_argument('--here', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        print(json.dumps(measure(options.frames)))
        return 0

    print(environment())
    rows = elsewhere('0', min(options.frames, PLAIN_FRAMES))
    if COMPILED:
        rows = elsewhere('1', options.frames) + rows
    print(table(rows))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
