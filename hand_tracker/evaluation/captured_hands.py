"""Joint errors on captured hands tracked from the paper's eight markers, beside a plain hand.

Both hand models are fitted to the first fifth of a recording and judged on the rest, in frames
with all eight markers captured, the same for all methods. The tracker runs from the first frame
on. Joints missing in a recording are not judged.

`hand_tracker` has a fully fitted hand model with the limits `wide`. Its variants differ in what
their names say only: the limits `wearer`, the default of a calibrated hand, or `paper`, which
captured hands exceed; the coupling `natural` (usual) or `paper` instead of the fitted one; or both.
"""

from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np

from ..core.model.hand import FINGERS, Hand, preset_coupling
from ..core.tracker import HandTracker
from .capture_fit import fit_to_capture, fitted_plain
from .capture_tracking import track_markers, tracked_joints
from .captures import Capture, judge_each
from .evaluation_options import Options
from .metrics import JOINT_CLASSES, joint_errors, limit_violations
from .plain_hand import plain_joints
from .rows import Row, error_statistics, mean_of
from .tables import (
    SERIES_COLOURS,
    Losses,
    Picture,
    Table,
    figure_with,
    mean_and_p95,
    save_figure,
    share_top,
    words,
)

# Presets of limits and of the fingers' coupling of each variant; None: the fitted coupling.
HAND_VARIANTS: dict[str, tuple[str, str | None]] = {
    'hand_tracker': ('wide', None),
    'hand_tracker_usual_coupling': ('wide', 'natural'),
    'hand_tracker_paper_coupling': ('wide', 'paper'),
    'hand_tracker_wearer_limits': ('wearer', None),
    'hand_tracker_paper_limits': ('paper', None),
    'hand_tracker_paper_limits_usual_coupling': ('paper', 'natural'),
    'hand_tracker_paper_limits_and_coupling': ('paper', 'paper'),
}
CAPTURE_METHODS = (*HAND_VARIANTS, 'plain')
# Methods in the picture, with their labels.
DRAWN_METHODS = {
    'hand_tracker': 'hand_tracker',
    'hand_tracker_usual_coupling': 'coupling not fitted',
    'hand_tracker_paper_limits': 'within the paper\'s limits',
    'plain': 'plain hand',
}


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each recording, method and class of joint.

    `within_limits_pct`, on the tracker's rows of the class 'all', is the share of frames with
    every angle within its limits.
    """
    yield from judge_each(judge, options)


def judge(capture: Capture) -> list[Row]:
    """Return the rows of one capture."""
    judged = capture.whole & (np.arange(len(capture.joints)) >= capture.split)
    true, right = capture.joints[judged], capture.right()
    rows: list[Row] = []
    for method, hand in _hands(capture):
        tracked = track_markers(HandTracker(hand), capture.markers, capture.rate)
        share, _ = limit_violations(tracked.angles[judged], hand.limits)
        rows += _rows(capture, method, tracked_joints(hand, tracked)[judged], true)
        rows[-1]['within_limits_pct'] = 100. * (1. - share)
    found = plain_joints(fitted_plain(capture), right.markers[judged])
    return rows + _rows(capture, 'plain', found, right.joints[judged])


def _hands(capture: Capture) -> Iterator[tuple[str, Hand]]:
    """Yield the name and the hand model of each variant of the tracker."""
    fitted = cache(partial(fit_to_capture, capture))
    for method, (limits, coupling) in HAND_VARIANTS.items():
        hand = fitted(limits)
        if coupling:
            hand = hand.replace(coupling=np.vstack((
                preset_coupling(coupling)[:len(FINGERS)], hand.coupling[len(FINGERS):])))
        yield method, hand


def _rows(capture: Capture, method: str, found: np.ndarray, true: np.ndarray) -> list[Row]:
    return [{'evaluation': 'recordings', 'recording': capture.name, 'method': method,
             'joint_class': name, **error_statistics(errors), 'frames': len(true)}
            for name, errors in joint_errors(found, true).items()]


def tables(rows: list[Row]) -> list[Table]:
    """Return the table of all recordings, methods and classes of joint."""
    lines = []
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    for recording in recordings:
        for method in CAPTURE_METHODS:
            lines.append((recording, method, *(
                mean_and_p95(_find(rows, recording, method, name)) for name in JOINT_CLASSES)))
    if len(recordings) > 1:
        for method in CAPTURE_METHODS:
            lines.append((f'mean of the {len(recordings)}', method, *(
                mean_and_p95(mean_of([_find(rows, recording, method, name)
                                      for recording in recordings])) for name in JOINT_CLASSES)))
    return [Table('Distance of each joint from its captured place, mm, mean (p95)',
                  ('recording', 'method', *JOINT_CLASSES), lines)]


CAPTURE_LOSSES = (
    'The DIP carries the marker: both hands meet it unless a limit forbids. Ours has more '
    'to fit, the axes of joints, and can fit the noise of a short recording. And it filters '
    'markers, which costs a little where captures are solved to a skeleton, without noise.')


def losses(rows: list[Row]) -> Losses:
    """Return the classes of joint and recordings in which the plain hand has smaller errors."""
    lines = []
    for name in JOINT_CLASSES:
        worse = []
        for recording in dict.fromkeys(row['recording'] for row in rows):
            ours, plain = (_find(rows, recording, method, name)['mean_mm']
                           for method in ('hand_tracker', 'plain'))
            if ours is not None and ours > plain:
                worse.append(f'{recording} {ours:.2f} mm against {plain:.2f}')
        if worse:
            lines.append(f'{name}: the plain hand is nearer on ' + ', '.join(worse))
    return Losses(lines, CAPTURE_LOSSES)


def _find(rows: list[Row], recording: str, method: str, name: str) -> Row:
    return next(row for row in rows if (row['recording'], row['method'], row['joint_class'])
                == (recording, method, name))


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the mean errors of the tracker and the plain hand, a plot for each recording."""
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    figure, axes = figure_with(len(recordings), width=4.6, height=2.4, columns=2)
    find = partial(_find, rows)
    for ax, recording in zip(axes, recordings):
        for i, (method, label) in enumerate(DRAWN_METHODS.items()):
            place = np.arange(len(JOINT_CLASSES)) + .2 * (i - 1.5)
            means = [find(recording, method, name)['mean_mm'] for name in JOINT_CLASSES]
            ax.bar(place, [np.nan if mean is None else mean for mean in means],
                   width=.19, color=SERIES_COLOURS[(0, 4, 2, 1)[i]], label=label)
        ax.set_title(words(recording), fontsize=9)
        ax.set_xticks(range(len(JOINT_CLASSES)), [
            words(name).replace(' ', '\n') for name in JOINT_CLASSES])
        ax.set_ylabel('mean error [mm]', fontsize=8)
    share_top(axes)
    save_figure(figure, folder / 'recordings.png', axes[0])
    return [Picture('recordings.png', 'Mean error of each class of joint')]
