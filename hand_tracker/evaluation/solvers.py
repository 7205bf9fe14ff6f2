"""Inverse kinematics solvers compared: rigid or sphere palm, closed-form or FABRIK fingers.

The demo motion at 120 Hz with 0.3 mm of noise and all markers visible; the hand model has
calibration errors and the limits `wide`.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from ..simulation.packaged_recordings import RECORDING_NOISE, RECORDING_RATE
from .capture_tracking import track_markers, tracked_joints
from .demo_frames import demo_frames, tracked_hand
from .evaluation_options import Options
from .metrics import JOINT_CLASSES, joint_errors
from .rows import Row, error_statistics
from .simulated import moving_distance
from .tables import (
    INK,
    SERIES_COLOURS,
    Losses,
    Picture,
    Table,
    figure_with,
    fixed,
    mean_and_p95,
    save_figure,
    words,
)

PALM_SOLVERS = ('rigid', 'spheres')
FINGER_SOLVERS = ('closed_form', 'fabrik')
SOLVER_CLASSES = tuple(JOINT_CLASSES)
DEFAULT_SOLVERS = 'rigid + closed_form'
WARM_UP_FRAMES = 50  # that are not timed: kernels are compiled at the first


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each pair of solvers and class of joint.

    `frame_us` is the mean wall time of `HandTracker.update`, `iterations` the sum of FABRIK's
    iterations over the digits of a frame.
    """
    # One process: others would disturb the timing.
    alone = replace(options, jobs=1)
    for rows in alone.each('pairs of solvers', partial(judge, seed=options.seed),
                           [(palm, finger) for palm in PALM_SOLVERS for finger in FINGER_SOLVERS]):
        yield from rows


def judge(solvers: tuple[str, str], seed: int) -> list[Row]:
    """Return the rows of one pair of (palm, finger) solvers."""
    palm, finger = solvers
    method = f'{palm} + {finger}'
    demo = demo_frames()
    hand, layout = tracked_hand(demo.hand, seed)
    noise = np.random.RandomState(seed + 1).normal(0., RECORDING_NOISE, demo.markers.shape)
    markers = demo.markers + noise
    tracker = HandTracker(
        hand, layout, TrackerOptions(palm_method=palm, finger_ik=finger))
    track_markers(tracker, markers[:WARM_UP_FRAMES], RECORDING_RATE)
    tracker.reset()
    start = time.perf_counter()
    tracked = track_markers(tracker, markers, RECORDING_RATE)
    frame = (time.perf_counter() - start) / len(markers)
    errors = joint_errors(tracked_joints(hand, tracked), demo.joints)
    return [{'evaluation': 'solvers', 'recording': 'demo', 'method': method, 'joint_class': name,
             **error_statistics(errors[name]), 'frames': len(markers),
             'degrees': round(float(moving_distance(
                 tracked.angles, demo.angles).degrees.mean()), 4),
             'iterations': round(float(tracked.iterations.mean()), 3),
             'iterations_p95': round(float(np.percentile(tracked.iterations, 95.)), 3),
             'frame_us': round(1e6 * frame, 1)} for name in SOLVER_CLASSES]


def _methods(rows: list[Row]) -> list[str]:
    return list(dict.fromkeys(row['method'] for row in rows))


def tables(rows: list[Row]) -> list[Table]:
    """Return the table of all pairs of solvers."""
    lines = []
    for method in _methods(rows):
        own = {row['joint_class']: row for row in rows if row['method'] == method}
        lines.append((method, *(mean_and_p95(own[name]) for name in SOLVER_CLASSES),
                      fixed(own['all']['degrees']), fixed(own['all']['iterations'], 1),
                      fixed(own['all']['iterations_p95'], 0), fixed(own['all']['frame_us'], 0)))
    return [Table('Distance of joints, mm, mean (p95), of angles, iterations and time a frame',
                  ('palm + fingers', *SOLVER_CLASSES, 'angles, deg', 'iterations', 'p95',
                   'us a frame'), lines)]


SOLVER_LOSSES = (
    'The default keeps the palm rigid, whose three markers then err together, and takes the '
    'exact bend; the other pairs spread the same error differently, and may by chance meet '
    'the truth better in one class of joint.')


def losses(rows: list[Row]) -> Losses:
    """Return the classes of joint in which another pair has smaller errors than the default."""
    lines = []
    for name in SOLVER_CLASSES:
        means = {row['method']: row['mean_mm'] for row in rows if row['joint_class'] == name}
        best = min(means, key=means.__getitem__)
        # By at least what the table shows.
        if means[DEFAULT_SOLVERS] > means[best] + .005:
            lines.append(f'{name}: {means[DEFAULT_SOLVERS]:.2f} mm with {DEFAULT_SOLVERS}, '
                         f'{means[best]:.2f} with {best}')
    return Losses(lines, SOLVER_LOSSES)


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the errors of each pair of solvers by class of joint."""
    figure, (ax,) = figure_with(1, width=6.5)
    for i, method in enumerate(_methods(rows)):
        found = {row['joint_class']: row['mean_mm'] for row in rows if row['method'] == method}
        ax.bar(np.arange(len(SOLVER_CLASSES)) + .2 * (i - 1.5),
               [found[name] for name in SOLVER_CLASSES], width=.19, color=SERIES_COLOURS[i],
               label=words(method))
    ax.set_xticks(range(len(SOLVER_CLASSES)), map(words, SOLVER_CLASSES))
    ax.set_ylabel('mean error [mm]', fontsize=8, color=INK)
    save_figure(figure, folder / 'solvers.png', ax)
    return [Picture('solvers.png', 'Mean error of each class of joint by the solvers')]
