"""Measure the time of a frame in the core for layouts of more and more markers, in one run.

    python -m benchmarks.layouts [--frames 3000] [--json OUT]

The demo motion with noise, all markers seen; layouts take turns of some frames, so that all meet
the same load. `ratio` is a layout's median over that of the eight markers of the paper.
"""

import sys
from pathlib import Path
from time import perf_counter_ns

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import print_measured
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import LAYOUT_PRESETS, preset_layout
from hand_tracker.core.model.marker_layout import marker_positions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.simulation.motions import motion_named

LAYOUT_RATE = 120.
LAYOUT_NOISE = 1e-4   # [m]
TURN = 60             # frames in which a layout has its turn
UNCOUNTED_LAYOUT_FRAMES = 120  # not counted


def layout_frames(name, count, hand):
    """Return the markers of a layout (count, n, 3) of the demo motion [m]."""
    motion = motion_named('demo', hand)
    angles, rotation, position = motion.sample(np.arange(count) / LAYOUT_RATE % motion.duration)
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(preset_layout(name).mounting(hand), pose, rotation, position)
    return markers + np.random.default_rng(0).normal(scale=LAYOUT_NOISE, size=markers.shape)


def measure(count):
    """Return a row for each layout."""
    hand = Hand.scaled()
    trackers = {name: HandTracker(hand, preset_layout(name)) for name in LAYOUT_PRESETS}
    frames = {name: layout_frames(name, count, hand) for name in LAYOUT_PRESETS}
    times = {name: np.zeros(count) for name in LAYOUT_PRESETS}
    for first in range(0, count, TURN):
        for name, tracker in trackers.items():
            for i in range(first, min(first + TURN, count)):
                start = perf_counter_ns()
                tracker.update(frames[name][i])
                times[name][i] = perf_counter_ns() - start
    rows = []
    for name, taken in times.items():
        median, p99 = np.percentile(taken[UNCOUNTED_LAYOUT_FRAMES:], (50, 99)) * 1e-3
        rows.append({'benchmark': 'layouts', 'layout': name, 'markers': frames[name].shape[1],
                     'median_us': round(float(median), 2), 'p99_us': round(float(p99), 2)})
    for row in rows:
        row['ratio'] = round(row['median_us'] / rows[0]['median_us'], 2)
    return rows


def main():
    """Measure and print."""
    return print_measured(
        __doc__, measure,
        '{layout:18s} {markers:3d} markers {median_us:7.1f} µs ({p99_us:.1f}) {ratio:.2f} x')


if __name__ == '__main__':
    sys.exit(main())
