"""Measure the time of a frame of two hands among points without names, and of labelled ones.

    python -m benchmarks.labelling [--frames 3000] [--json OUT]

Both hands, with the paper's eight markers, in the demo motion, among ghosts that come and go.
`labelled` is the time of tracking both by labelled markers, `following` that of labelling all
points and tracking both, `search` that of all frames from nothing until both are found. Ways take
turns of some frames, so that all meet the same load. `ratio` is over the median of `labelled`.
"""

import sys
from pathlib import Path
from time import perf_counter_ns

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import print_measured
from benchmarks.layouts import LAYOUT_RATE, TURN, UNCOUNTED_LAYOUT_FRAMES, layout_frames
from hand_tracker.core.model.hand import SIDES, Hand
from hand_tracker.core.model.layout_presets import PAPER_LAYOUT
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.natural_poses import model_prototype
from hand_tracker.core.tracker import HandTracker
from hand_tracker.evaluation.point_labelling import NamedMarkers, clouds

CLOUD_SIZE = 40
APART = .25       # [m] between the hands
SEARCHES = 20


def hands_in_motion(count):
    """Return both hands' markers as `NamedMarkers`."""
    return [NamedMarkers(
        side, MARKERS, (-1, -1, -1, 0, 1, 2, 3, 4),
        layout_frames(PAPER_LAYOUT, count, Hand.scaled(side=side)) + (0., number * APART, 0.),
        side, LAYOUT_RATE, np.zeros(count, dtype=int)) for number, side in enumerate(SIDES)]


def measure(count):
    """Return the rows."""
    hands = hands_in_motion(count)
    ghosts = CLOUD_SIZE - len(SIDES) * len(MARKERS)
    cloud = clouds(hands, ghosts, 0., np.random.RandomState(1))
    ways = {way: [HandTracker(Hand.scaled(side=side)) for side in SIDES]
            for way in ('labelled', 'following')}
    prototypes = [model_prototype(Hand.scaled(side=side), MarkerLayout(), MARKERS)
                  for side in SIDES]
    labeller = CloudLabeller(prototypes)
    times = {way: np.zeros(count) for way in ways}
    right = 0
    for first in range(0, count, TURN):
        for way, trackers in ways.items():
            for i in range(first, min(first + TURN, count)):
                points, time = cloud.points[i], i / LAYOUT_RATE
                start = perf_counter_ns()
                if way == 'labelled':
                    frames = [hand.points[i] for hand in hands]
                else:
                    labels = labeller.update(points, time)
                    frames = labels.places
                for tracker, markers in zip(trackers, frames):
                    tracker.update(markers, time)
                times[way][i] = perf_counter_ns() - start
                if way == 'following':
                    right += np.array_equal(labels.rows, cloud.rows[i])
    rows = [{'benchmark': 'labelling', 'way': way, **{
        name: round(1e-3 * float(np.percentile(taken[UNCOUNTED_LAYOUT_FRAMES:], share)), 2)
        for name, share in (('median_us', 50), ('p99_us', 99))}} for way, taken in times.items()]
    rows[1]['right_pct'] = round(100. * right / count, 2)
    rows.append({'benchmark': 'labelling', 'way': 'search',
                 'median_us': round(1e-3 * float(np.median(searches(prototypes, cloud))), 2)})
    for row in rows:
        row['points'] = CLOUD_SIZE
        row['ratio'] = round(row['median_us'] / rows[0]['median_us'], 2)
    return rows


def searches(prototypes, cloud):
    """Return the times of searches from nothing, until both hands are found [ns]."""
    found = []
    for first in np.linspace(0, len(cloud.points) - 1, SEARCHES).astype(int):
        labeller = CloudLabeller(prototypes)
        start = perf_counter_ns()
        # The clock stands: the same points again and again.
        while not all(labeller.update(cloud.points[first]).found):
            if perf_counter_ns() - start > 10**10:
                break
        found.append(perf_counter_ns() - start)
    return found


def main():
    """Measure and print."""
    return print_measured(__doc__, measure, '{way:10s} {median_us:9.1f} µs {ratio:7.2f} x')


if __name__ == '__main__':
    sys.exit(main())
