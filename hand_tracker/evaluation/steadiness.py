"""Steadiness: how far angles are off and how they move from frame to frame, beside the truth.

The shipped recording (the very hand, 0.3 mm of noise) and simulated motions (eight cameras, the
hand as `hand_tracker calibrate` finds it from a simulated take of markers at all joints; truth is
the angle of the true bones about its axes). Judged are seen digits: in two frames in a row with
their marker and the palm's three. A step is the change of an angle from a frame to the next; steps
and errors are root mean squares.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from ..core.model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, Hand
from ..core.tracker import HandTracker
from ..simulation.packaged_recordings import demo_recording
from .calibrated_fit import calibrated_fit, true_angles
from .capture_tracking import track_markers, tracked_joints
from .demo_frames import demo_frames
from .evaluation_options import Options
from .metrics import joint_errors
from .rows import Row, error_statistics, root_mean_square_deg
from .simulated import trial
from .tables import (
    INK,
    SERIES_COLOURS,
    Picture,
    Table,
    figure_with,
    fixed,
    save_figure,
    words,
)

SHIPPED = 'shipped recording'
STEADY_MOTIONS = 'spelling', 'typing', 'power_grasp', 'demo'
STEADINESS_RATES = 120., 480.    # [Hz]
STEADINESS_DURATION = 10.        # [s] at most
SETTLING_TIME = .5               # [s] after the start that is not judged
NEAR_STRAIGHT, BENT = 12., 40.   # [degrees] of the true PIP: at most, and at least


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each motion, rate and class of joints.

    `joint_class` is `pip`, of it `pip_straight` and `pip_bent` (by the true angle), `mcp_flexion`
    and `mcp_abduction`, all of the fingers, and `thumb_flexion` and `thumb_abduction`;
    `error_deg`, `step_deg` and `truth_step_deg` are root mean squares [degrees]; `mean_mm` and
    `p95_mm` are of all joints of the hand.
    """
    tasks = [(motion, rate) for motion in (SHIPPED, *STEADY_MOTIONS) for rate in STEADINESS_RATES]
    for rows in options.each('motions', partial(judge, seed=options.seed), tasks):
        yield from rows


def judge(task: tuple[str, float], seed: int) -> list[Row]:
    """Return the rows of one (motion, rate [Hz])."""
    motion, rate = task
    if motion == SHIPPED:
        demo = demo_frames(rate)
        true, joints = demo.angles, demo.joints
        markers = demo_recording(rate=rate).markers
        count = min(round(STEADINESS_DURATION * rate), len(markers), len(true))
        markers, true, joints = markers[:count], true[:count], joints[:count]
        hand = Hand.scaled()
        tracked = track_markers(HandTracker(hand), markers, rate)
    else:
        one = trial(motion, seed + STEADY_MOTIONS.index(motion), rate, STEADINESS_DURATION)
        fit = calibrated_fit(seed)
        markers, true, joints, hand = one.measured(), true_angles(one, fit), one.joints, fit.hand
        tracked = track_markers(HandTracker(hand, fit.layout), markers, rate)
    found = tracked.angles
    errors = joint_errors(tracked_joints(hand, tracked), joints)['all']
    seen = np.isfinite(markers).all(axis=2)
    judged = seen[:, 3:] & seen[:, :3].all(axis=1)[:, None]
    judged[:round(SETTLING_TIME * rate)] = False
    rows = []
    for name, angles, mask in _classes(true, judged):
        mask = mask & np.isfinite(true[:, angles])
        pairs = mask[1:] & mask[:-1]
        if not pairs.any():
            continue
        rows.append({
            'evaluation': 'steadiness', 'recording': motion, 'method': 'hand_tracker',
            'motion': motion, 'rate_hz': round(rate), 'joint_class': name,
            'error_deg': root_mean_square_deg((found - true)[:, angles][mask]),
            'step_deg': root_mean_square_deg(np.diff(found[:, angles], axis=0)[pairs]),
            'truth_step_deg': root_mean_square_deg(np.diff(true[:, angles], axis=0)[pairs]),
            **error_statistics(errors), 'frames': int(pairs.sum())})
    return rows


def _classes(true: np.ndarray, judged: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the name, the joints and the judged frames of each class.

    Parameters
    ----------
    true : ndarray, shape (n, 25)
        True angles [rad].
    judged : ndarray of bool, shape (n, 5)
        Frames of each digit.
    """
    fingers, thumb = slice(0, 4), slice(4, 5)
    pip = FLEXION_JOINTS[fingers, 1]
    bend = np.degrees(true[:, pip])
    yield 'pip', pip, judged[:, fingers]
    yield 'pip_straight', pip, judged[:, fingers] & (bend <= NEAR_STRAIGHT)
    yield 'pip_bent', pip, judged[:, fingers] & (bend >= BENT)
    yield 'mcp_flexion', FLEXION_JOINTS[fingers, 0], judged[:, fingers]
    yield 'mcp_abduction', ABDUCTION_JOINTS[fingers], judged[:, fingers]
    yield 'thumb_flexion', FLEXION_JOINTS[thumb, 1], judged[:, thumb]
    yield 'thumb_abduction', ABDUCTION_JOINTS[thumb], judged[:, thumb]


def tables(rows: list[Row]) -> list[Table]:
    """Return a table of each rate."""
    return [Table(
        f'At {rate} Hz: root mean squares, degrees', ('motion', 'joints', 'error', 'step',
                                                      'true step', 'step over true'),
        [(words(row['motion']), words(row['joint_class']), fixed(row['error_deg']),
          fixed(row['step_deg'], 3), fixed(row['truth_step_deg'], 3), fixed(_ratio(row)))
         for row in rows if row['rate_hz'] == rate])
        for rate in dict.fromkeys(row['rate_hz'] for row in rows)]


def _ratio(row: Row) -> float | None:
    """Return the step over the true step; None where the truth rests."""
    return float(row['step_deg'] / row['truth_step_deg']) if row['truth_step_deg'] > 0. else None


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw tracked and true steps of each class in the shipped recording, at each rate."""
    rates = list(dict.fromkeys(row['rate_hz'] for row in rows))
    figure, axes = figure_with(len(rates), width=5.)
    for ax, rate in zip(axes, rates):
        mine = [row for row in rows if row['rate_hz'] == rate and row['motion'] == SHIPPED]
        places = np.arange(len(mine))
        for i, (key, name) in enumerate((('step_deg', 'tracked'), ('truth_step_deg', 'true'))):
            ax.bar(places + .38 * (i - .5), [row[key] for row in mine], .38,
                   color=SERIES_COLOURS[i], label=name)
        ax.set_xticks(places, [words(row['joint_class']).replace(' ', '\n') for row in mine],
                      fontsize=7)
        ax.set_xlabel(f'{rate} Hz', fontsize=8, color=INK)
    axes[0].set_ylabel('step from frame to frame [degrees]', fontsize=8, color=INK)
    save_figure(figure, folder / 'steadiness.png', axes[0])
    return [Picture('steadiness.png', 'Steps of angles in the shipped recording')]
