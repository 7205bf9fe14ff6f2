"""Joints of captured hands, tracked from the paper's eight markers, beside a plain hand.

Both hands are fitted on the first fifth of a recording and judged on the rest.
"""

from functools import cache, partial

import numpy as np

from ..calibration import fit_hand
from ..core.hand import FINGERS, preset_coupling, preset_limits
from ..core.metrics import JOINT_CLASSES, joint_errors, limit_violations
from ..core.tracker import HandTracker
from .captures import load_captures
from .plain_hand import fit_plain, plain_joints
from .report import COLOURS, Picture, Table, figure_with, mean_and_p95, save
from .rows import mean_of, spread
from .tracking import track, tracked_joints

TITLE = 'Captured hands'
NEEDS_FILES = True

# Presets of limits and of the fingers' coupling that each variant of ours wears; None: as fitted.
VARIANTS = {'hand_tracker': ('wide', None),
            'hand_tracker_usual_coupling': ('wide', 'natural'),
            'hand_tracker_paper_limits': ('paper', 'paper')}
METHODS = (*VARIANTS, 'plain')


def evaluate(options):
    """Yield a row for each recording, method and class of joint.

    `within_limits_pct`, on our rows of the class 'all', is the share of frames with every
    angle within its limits.
    """
    for rows in options.each('recordings', judge, load_captures(options)):
        yield from rows


def judge(capture):
    """Return the rows of one capture."""
    judged, true = capture.markers[capture.split:], capture.joints[capture.split:]
    rows = []
    fitted = cache(lambda limits: fit_hand(
        capture.joints[:capture.split], capture.side, preset_limits(limits)))
    for method, (limits, coupling) in VARIANTS.items():
        hand = fitted(limits)
        if coupling:
            hand = hand.replace(coupling=np.vstack((
                preset_coupling(coupling)[:len(FINGERS)], hand.coupling[len(FINGERS):])))
        tracked = track(HandTracker(hand), judged, capture.rate, capture.split)
        share, _ = limit_violations(tracked.angles, hand.limits)
        rows += _rows(capture, method, tracked_joints(hand, tracked), true)
        rows[-1]['within_limits_pct'] = 100. * (1. - share)
    right = capture.right()
    before = right.joints[:capture.split]
    plain = fit_plain(before[np.isfinite(before).all(axis=(1, 2))])
    seen = np.isfinite(judged).all(axis=(1, 2))
    found = np.full(true.shape, np.nan)
    found[seen] = plain_joints(plain, right.markers[capture.split:][seen])
    return rows + _rows(capture, 'plain', found, right.joints[capture.split:])


def _rows(capture, method, found, true):
    return [{'evaluation': 'recordings', 'recording': capture.name, 'method': method,
             'joint_class': name, **spread(errors), 'frames': len(true)}
            for name, errors in joint_errors(found, true).items()]


def tables(rows):
    """Return one table of all recordings."""
    lines = []
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    for recording in recordings:
        for method in METHODS:
            lines.append((recording, method, *(
                mean_and_p95(_find(rows, recording, method, name)) for name in JOINT_CLASSES)))
    if len(recordings) > 1:
        for method in METHODS:
            lines.append((f'mean of the {len(recordings)}', method, *(
                mean_and_p95(mean_of([_find(rows, recording, method, name)
                                      for recording in recordings])) for name in JOINT_CLASSES)))
    return [Table('Distance of each joint from its captured place, mm, mean (p95)',
                  ('recording', 'method', *JOINT_CLASSES), lines)]


def _find(rows, recording, method, name):
    return next(row for row in rows if (row['recording'], row['method'], row['joint_class'])
                == (recording, method, name))


def pictures(rows, folder):
    """Draw the mean errors of ours and of the plain hand, one pair of axes a recording."""
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    figure, axes = figure_with(len(recordings), width=3.4)
    find = partial(_find, rows)
    for ax, recording in zip(axes, recordings):
        for i, method in enumerate(METHODS):
            place = np.arange(len(JOINT_CLASSES)) + .2 * (i - 1.5)
            ax.bar(place, [find(recording, method, name)['mean_mm'] for name in JOINT_CLASSES],
                   width=.19, color=COLOURS[(0, 4, 2, 1)[i]], label=method)
        ax.set_title(recording, fontsize=8)
        ax.set_xticks(range(len(JOINT_CLASSES)), JOINT_CLASSES, rotation=45, ha='right')
        ax.set_ylabel('mean error [mm]', fontsize=8)
    save(figure, folder / 'recordings.png', axes[0])
    return [Picture('recordings.png', 'Mean error of each class of joint')]
