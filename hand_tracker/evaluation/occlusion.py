"""Hidden markers of captured hands: where we say they are, beside three plain guesses.

Windows begin at drawn frames. The tracker runs over the recording once; at each window a
copy of it goes on without the hidden markers. A short window is the start of a long one.
"""

import copy
from functools import partial
from itertools import combinations

import numpy as np

from ..calibration import fit_hand
from ..core.hand import preset_limits
from ..core.layout import MARKERS, PALM_MARKERS
from ..core.tracker import HandTracker
from .baselines import BASELINES, predictions
from .captures import InvalidCapture, load_captures
from .plain_hand import PALM, fit_plain, palm_poses
from .report import COLOURS, Picture, Table, figure_with, mean_and_p95, save
from .rows import mean_of, spread
from .tracking import advance

TITLE = 'Hidden markers'
NEEDS_FILES = True

LENGTHS = (.1, .25, .5, 1.)  # [s]
WINDOWS = 80                 # in a recording
SETS = 4                     # of two and of three hidden markers in a window, drawn
LIMITS = 'wide'
METHODS = ('hand_tracker', *BASELINES)
DIGITS = range(len(PALM_MARKERS), len(MARKERS))
HIDDEN = {'one': 'a finger marker or the thumb\'s', 'palm': 'a palm marker',
          'two': 'two of fingers and thumb', 'three': 'three of fingers and thumb'}


def evaluate(options):
    """Yield a row for each recording, method, kind of hidden markers and length of window.

    Errors are those of all hidden markers in all frames of the windows. Our rows also have
    `step_deg`, the largest step of an angle when markers vanish or come back, and
    `fastest_deg`, the largest step of an angle with all markers seen.
    """
    for rows in options.each('occlusion', partial(judge, seed=options.seed),
                             load_captures(options)):
        yield from rows


def windows(capture, seed):
    """Return the first frames of windows, one drawn from each equal part of what is judged.

    Parameters
    ----------
    capture : Capture
    seed : int

    Returns
    -------
    ndarray of int
        Frames before, in and after the longest window have all eight markers.
    """
    frames = round(max(LENGTHS) * capture.rate)
    whole = np.isfinite(capture.markers).all(axis=(1, 2))
    count = np.append(0, np.cumsum(whole))
    starts = np.arange(capture.split, len(whole) - frames)
    starts = starts[count[starts + frames + 1] - count[starts - 1] == frames + 2]
    if not starts.size:
        raise InvalidCapture(f'{capture.name}: no {max(LENGTHS):g} s in which all markers '
                             'are captured')
    # RandomState's streams are frozen for good.
    random = np.random.RandomState(seed)
    parts = np.array_split(starts, min(WINDOWS, len(starts)))
    return np.array([part[random.randint(len(part))] for part in parts])


def hidden_sets(seed, start):
    """Yield (kind, rows) of the markers that are hidden in the window at a frame."""
    yield from (('one', (row,)) for row in DIGITS)
    yield from (('palm', (row,)) for row in range(len(PALM_MARKERS)))
    random = np.random.RandomState([seed, int(start)])
    for kind, size in (('two', 2), ('three', 3)):
        sets = list(combinations(DIGITS, size))
        yield from ((kind, sets[i]) for i in random.permutation(len(sets))[:SETS])


def predicted(tracker, markers, start, length, hidden, rate):
    """Return what a copy of the tracker says while markers are hidden.

    Parameters
    ----------
    tracker : HandTracker
        After the frame before the window; it is not changed.
    markers : ndarray, shape (T, 8, 3)
        Hidden rows are not read in the window [m].
    start, length : int
        Of the window [frames].
    hidden : sequence of int
    rate : float
        [Hz]

    Returns
    -------
    places : ndarray, shape (length, len(hidden), 3)
        Of the hidden markers [m].
    angles : ndarray, shape (length + 1, 25)
        In the window and in the frame after it [rad].
    """
    tracker = copy.deepcopy(tracker)
    window = np.array(markers[start:start + length + 1])
    window[:length, hidden] = np.nan
    states = [advance(tracker, frame, start + i, rate) for i, frame in enumerate(window)]
    return (np.array([state.markers[list(hidden)] for state in states[:length]]),
            np.array([state.angles for state in states]))


def judge(capture, seed):
    """Return the rows of one capture."""
    rate, markers = capture.rate, capture.markers
    lengths = {seconds: max(1, round(seconds * rate)) for seconds in LENGTHS}
    frames = max(lengths.values())
    starts = set(windows(capture, seed).tolist())
    right = capture.right()
    fitted = right.joints[:capture.split]
    template = fit_plain(fitted[np.isfinite(fitted).all(axis=(1, 2))]).template[PALM]
    poses = palm_poses(right.markers[:, :3], template)
    tracker = HandTracker(fit_hand(
        capture.joints[:capture.split], capture.side, preset_limits(LIMITS)))
    errors = {(kind, method): [] for kind in HIDDEN for method in METHODS}
    steps = {kind: [] for kind in HIDDEN}
    fastest, before = 0., None
    for frame in range(len(markers)):
        if frame in starts:
            for kind, hidden in hidden_sets(seed, frame):
                hidden = list(hidden)
                places, angles = predicted(tracker, markers, frame, frames, hidden, rate)
                steps[kind] += [np.abs(angles[0] - before).max(),
                                np.abs(angles[-1] - angles[-2]).max()]
                guesses = predictions(
                    right.markers, poses, frame, frames, hidden, rate, template)
                true = right.markers[frame:frame + frames, hidden]
                for method, guess in guesses.items():
                    errors[kind, method].append(np.linalg.norm(guess - true, axis=2))
                errors[kind, 'hand_tracker'].append(np.linalg.norm(
                    places - markers[frame:frame + frames, hidden], axis=2))
        state = advance(tracker, markers[frame], frame, rate)
        if before is not None:
            fastest = max(fastest, np.abs(state.angles - before).max())
        before = state.angles
    return [_row(capture, kind, method, seconds, np.array(errors[kind, method])[:, :count],
                 max(steps[kind]), fastest)
            for kind in HIDDEN for method in METHODS for seconds, count in lengths.items()]


def _row(capture, kind, method, seconds, errors, step, fastest):
    """Return a row; errors of shape (windows, frames, markers) [m], steps [rad]."""
    row = {'evaluation': 'occlusion', 'recording': capture.name, 'method': method,
           'hidden': kind, 'hidden_s': seconds, **spread(errors),
           'frames': errors.shape[0] * errors.shape[1], 'windows': len(errors)}
    # Every window comes back after the longest time.
    if method == 'hand_tracker' and seconds == max(LENGTHS):
        row.update(step_deg=round(float(np.degrees(step)), 3),
                   fastest_deg=round(float(np.degrees(fastest)), 3))
    return row


def _find(rows, kind, method, seconds):
    """Return the rows of all recordings."""
    return [row for row in rows
            if (row['hidden'], row['method'], row['hidden_s']) == (kind, method, seconds)]


def tables(rows):
    """Return a table of the means over recordings, and one of every recording."""
    header = tuple(f'{seconds:g} s' for seconds in LENGTHS)
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    every = [(recording, kind, method, *(
        mean_and_p95(mean_of([row for row in _find(rows, kind, method, seconds)
                              if row['recording'] == recording])) for seconds in LENGTHS))
        for recording in recordings for kind in ('one', 'palm') for method in METHODS]
    means = [(HIDDEN[kind], method, *(
        mean_and_p95(mean_of(_find(rows, kind, method, seconds))) for seconds in LENGTHS))
        for kind in HIDDEN for method in METHODS]
    caption = 'Error of hidden markers while they are hidden, mm, mean (p95)'
    tables = [Table(f'{caption}, mean of {len(recordings)} recordings',
                    ('hidden', 'method', *header), means)]
    if len(recordings) > 1:
        tables.append(Table(f'{caption}, each recording',
                            ('recording', 'hidden', 'method', *header), every))
    steps = [row for row in rows if row.get('step_deg') is not None]
    tables.append(Table(
        'Largest step of an angle from frame to frame, degrees',
        ('recording', 'hidden', 'markers vanish or come back', 'all markers seen'),
        [(row['recording'], row['hidden'], f'{row["step_deg"]:.1f}', f'{row["fastest_deg"]:.1f}')
         for row in steps]))
    return tables


def pictures(rows, folder):
    """Draw the mean error over the length of the windows, one pair of axes a kind."""
    figure, axes = figure_with(len(HIDDEN), width=3.)
    for ax, kind in zip(axes, HIDDEN):
        for i, method in enumerate(METHODS):
            found = [mean_of(_find(rows, kind, method, seconds)) for seconds in LENGTHS]
            ax.plot(LENGTHS, [row['mean_mm'] if row else np.nan for row in found],
                    marker='osD^'[i], markersize=4, color=COLOURS[i], linewidth=2.4 - .4 * i,
                    label=method)
        ax.set_title(f'{kind} hidden', fontsize=9)
        ax.set_xlabel('hidden for [s]', fontsize=8)
        ax.set_ylim(bottom=0.)
    axes[0].set_ylabel('mean error [mm]', fontsize=8)
    save(figure, folder / 'occlusion.png', axes[0])
    return [Picture('occlusion.png', 'Error of hidden markers, mean of the recordings')]
