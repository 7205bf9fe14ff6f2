"""Joints of captured hands, tracked from the paper's eight markers, beside a plain hand.

Both hands are fitted on the first fifth of a recording and judged on the rest, where all
eight markers are captured: one set of frames for all methods. The tracker runs from the first
frame on. Joints that a recording lacks are not judged.

`hand_tracker` wears a hand fitted in all, with the limits `wide`. The others differ in what they
are named after and in nothing else: the limits `paper`, which a hand has that says nothing else
and which captured hands pass; the coupling `natural` (usual) or `paper` instead of the fitted
one; or both.
"""

from functools import cache, partial

import numpy as np

from ..core.model.hand import FINGERS, preset_coupling
from ..core.tracker import HandTracker
from .capture_fit import fitted_hand, fitted_plain
from .capture_tracking import track, tracked_joints
from .captures import judge_each
from .metrics import JOINT_CLASSES, joint_errors, limit_violations
from .plain_hand import plain_joints
from .rows import mean_of, spread
from .tables import COLOURS, Picture, Table, figure_with, mean_and_p95, save, share_top, words

TITLE = 'Captured hands'
NEEDS_FILES = True

WHY = ('The DIP carries the marker: both hands meet it unless a limit forbids. The thumb\'s CMC '
       'moves in captures and in neither hand, so that the fitted fifth decides. Ours has more '
       'to fit, the axes of joints, and can fit the noise of a short recording. And it filters '
       'markers, which costs a little where captures are solved to a skeleton, without noise.')
# Presets of limits and of the fingers' coupling that each variant of ours wears; None: as fitted.
VARIANTS = {'hand_tracker': ('wide', None),
            'hand_tracker_usual_coupling': ('wide', 'natural'),
            'hand_tracker_paper_coupling': ('wide', 'paper'),
            'hand_tracker_paper_limits': ('paper', None),
            'hand_tracker_paper_limits_usual_coupling': ('paper', 'natural'),
            'hand_tracker_paper_limits_and_coupling': ('paper', 'paper')}
METHODS = (*VARIANTS, 'plain')
# In the picture
SHOWN = {'hand_tracker': 'hand_tracker',
         'hand_tracker_usual_coupling': 'coupling not fitted',
         'hand_tracker_paper_limits': 'within the paper\'s limits', 'plain': 'plain hand'}


def evaluate(options):
    """Yield a row for each recording, method and class of joint.

    `within_limits_pct`, on our rows of the class 'all', is the share of frames with every
    angle within its limits.
    """
    yield from judge_each(judge, options)


def judge(capture):
    """Return the rows of one capture."""
    judged = capture.whole & (np.arange(len(capture.joints)) >= capture.split)
    true, right = capture.joints[judged], capture.right()
    rows = []
    for method, hand in _hands(capture):
        tracked = track(HandTracker(hand), capture.markers, capture.rate)
        share, _ = limit_violations(tracked.angles[judged], hand.limits)
        rows += _rows(capture, method, tracked_joints(hand, tracked)[judged], true)
        rows[-1]['within_limits_pct'] = 100. * (1. - share)
    found = plain_joints(fitted_plain(capture), right.markers[judged])
    return rows + _rows(capture, 'plain', found, right.joints[judged])


def _hands(capture):
    """Yield the name and the hand of each variant of ours."""
    fitted = cache(partial(fitted_hand, capture))
    for method, (limits, coupling) in VARIANTS.items():
        hand = fitted(limits)
        if coupling:
            hand = hand.replace(coupling=np.vstack((
                preset_coupling(coupling)[:len(FINGERS)], hand.coupling[len(FINGERS):])))
        yield method, hand


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


def losses(rows):
    """Return in which classes of joint, on which recordings, the plain hand is nearer."""
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
    return lines


def _find(rows, recording, method, name):
    return next(row for row in rows if (row['recording'], row['method'], row['joint_class'])
                == (recording, method, name))


def pictures(rows, folder):
    """Draw the mean errors of ours and of the plain hand, one pair of axes a recording."""
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    figure, axes = figure_with(len(recordings), width=4.6, height=2.4, columns=2)
    find = partial(_find, rows)
    for ax, recording in zip(axes, recordings):
        for i, (method, label) in enumerate(SHOWN.items()):
            place = np.arange(len(JOINT_CLASSES)) + .2 * (i - 1.5)
            means = [find(recording, method, name)['mean_mm'] for name in JOINT_CLASSES]
            ax.bar(place, [np.nan if mean is None else mean for mean in means],
                   width=.19, color=COLOURS[(0, 4, 2, 1)[i]], label=label)
        ax.set_title(words(recording), fontsize=9)
        ax.set_xticks(range(len(JOINT_CLASSES)), [
            words(name).replace(' ', '\n') for name in JOINT_CLASSES])
        ax.set_ylabel('mean error [mm]', fontsize=8)
    share_top(axes)
    save(figure, folder / 'recordings.png', axes[0])
    return [Picture('recordings.png', 'Mean error of each class of joint')]
