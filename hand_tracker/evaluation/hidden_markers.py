"""Hidden markers of captured hands: where we say they are, beside three plain guesses.

Windows begin at drawn frames, after a frame in which all eight markers are captured. The
tracker runs over the recording once; at each window a copy of it goes on without the hidden
markers. A short window is the start of a long one. All methods are judged on the frames of a
window in which all eight markers are captured.

Where a recording is solved to a rigid palm, a hidden palm marker follows from how the palm
turns about the two others; the baselines carry the palm alike, by the smallest rotation, so
that all three say the same there.
"""

import copy
from functools import partial
from itertools import combinations

import numpy as np

from ..calibration.landmarks import FINGER_ROWS, THUMB_ROWS
from ..core.model.marker_layout import MARKERS, PALM_MARKERS
from ..core.tracker import HandTracker
from .baselines import BASELINES, predictions
from .capture_fit import fitted_hand, fitted_plain
from .capture_tracking import advance, track
from .captures import InvalidCapture, judge_each
from .metrics import availability
from .plain_hand import PALM, palm_poses
from .rows import mean_of, spread
from .tables import (
    COLOURS,
    Picture,
    Table,
    figure_with,
    mean_and_p95,
    number,
    save,
    share_top,
    words,
)

TITLE = 'Hidden markers'
NEEDS_FILES = True

LENGTHS = (.1, .25, .5, 1.)  # [s]
WINDOWS = 48                 # in a recording
SETS = 3                     # of two and of three hidden markers in a window, drawn
USABLE = .5                  # share of a window's frames that have all markers
AFTER = 15                   # frames after a window in which steps count
AVAILABLE = .01              # [m] within which a place can be used; ours, unsourced
LIMITS = 'wide'
METHODS = ('hand_tracker', *BASELINES)
WHY = ('A baseline predicts where a marker goes and nothing else; the tracker\'s prediction keeps '
       'limits and bones, and must not jump when the marker comes back. A regression over the '
       'last ten seconds knows habits of this one recording.')
# Landmarks from the wrist to the tip of each digit
BONES = np.pad(np.vstack((FINGER_ROWS, THUMB_ROWS)), ((0, 0), (1, 0)))
DIGITS = range(len(PALM_MARKERS), len(MARKERS))
HIDDEN = {'one': 'a finger marker or the thumb\'s', 'palm': 'a palm marker',
          'two': 'two of fingers and thumb', 'three': 'three of fingers and thumb'}


def evaluate(options):
    """Yield a row for each recording, method, kind of hidden markers and length of window.

    Errors are those of all hidden markers in all judged frames of the windows;
    `available_pct` is the share of them within 10 mm. Our rows also have the largest step of
    an angle from frame to frame: `step_deg` in the windows and the 15 frames after each, and
    in the whole recording `seen_deg` with nothing hidden and `captured_deg` of the captured
    bones.
    """
    yield from judge_each(partial(judge, seed=options.seed), options)


def windows(capture, seed):
    """Return the first frames of windows, one drawn from each equal part of what is judged.

    Parameters
    ----------
    capture : Capture
    seed : int

    Returns
    -------
    starts : ndarray of int
        The frame before each has all eight markers, and so have half of those in it.
    lengths : dict
        Frames of each of `LENGTHS` [s] that the recording has room for.

    Raises
    ------
    InvalidCapture
        If there is no room for the shortest.
    """
    whole = capture.whole
    count = np.append(0, np.cumsum(whole))
    lengths = {seconds: max(1, round(seconds * capture.rate)) for seconds in LENGTHS}
    while lengths:
        frames = max(lengths.values())
        starts = np.arange(capture.split, len(whole) - frames)
        starts = starts[whole[starts - 1] & (
            count[starts + frames] - count[starts] >= USABLE * frames)]
        if starts.size:
            # RandomState's streams are frozen for good.
            random = np.random.RandomState(seed)
            parts = np.array_split(starts, min(WINDOWS, len(starts)))
            return np.array([part[random.randint(len(part))] for part in parts]), lengths
        lengths.popitem()
    raise InvalidCapture(f'no {min(LENGTHS):g} s with all eight markers captured before, and in '
                         f'{100. * USABLE:g} % of the frames')


def hidden_sets(seed, start):
    """Yield (kind, rows) of the markers that are hidden in the window at a frame."""
    yield from (('one', (row,)) for row in DIGITS)
    yield from (('palm', (row,)) for row in range(len(PALM_MARKERS)))
    random = np.random.RandomState([seed, int(start)])
    for kind, size in (('two', 2), ('three', 3)):
        sets = list(combinations(DIGITS, size))
        yield from ((kind, sets[i]) for i in random.permutation(len(sets))[:SETS])


def predicted(tracker, markers, start, lengths, hidden, rate):
    """Return what a copy of the tracker says while markers are hidden.

    Parameters
    ----------
    tracker : HandTracker
        After the frame before the window; it is not changed.
    markers : ndarray, shape (T, 8, 3)
        Hidden rows are not read in the window [m].
    start : int
        Of the window [frames].
    lengths : sequence of int
        Times after which they come back, each in a copy of its own [frames].
    hidden : sequence of int
    rate : float
        [Hz]

    Returns
    -------
    places : ndarray, shape (max(lengths), len(hidden), 3)
        Of the hidden markers [m].
    angles : list of ndarray, shape (length + AFTER, 25)
        In the window of each length and in the frames after it, as far as there are [rad].
    """
    tracker = copy.deepcopy(tracker)
    window = np.array(markers[start:start + max(lengths)])
    window[:, hidden] = np.nan
    states, after = [], {}
    for i, frame in enumerate(window):
        states.append(advance(tracker, frame, start + i, rate))
        if i + 1 in lengths:
            end = start + i + 1
            after[i + 1] = track(
                copy.deepcopy(tracker), markers[end:end + AFTER], rate, end).angles
    angles = np.array([state.angles for state in states])
    return (np.array([state.markers[list(hidden)] for state in states]),
            [np.concatenate((angles[:length], after[length])) for length in lengths])


def largest_step(angles):
    """Return the largest change from one frame to the next, over the first axis."""
    return np.nanmax(np.abs(np.diff(angles, axis=0)), initial=0.)


def captured_bends(joints):
    """Return the angles between captured bones, three a digit.

    Parameters
    ----------
    joints : ndarray, shape (T, 21, 3)
        In the order of `LANDMARKS` [m].

    Returns
    -------
    ndarray, shape (T, 5, 3)
        NaN where not captured [rad].
    """
    bones = np.diff(joints[:, BONES], axis=2)
    bones = bones / np.linalg.norm(bones, axis=3, keepdims=True)
    before, after = bones[:, :, :-1], bones[:, :, 1:]
    return 2. * np.arctan2(np.linalg.norm(after - before, axis=3),
                           np.linalg.norm(after + before, axis=3))


def judge(capture, seed):
    """Return the rows of one capture."""
    rate, markers, right = capture.rate, capture.markers, capture.right()
    starts, lengths = windows(capture, seed)
    starts, ends = set(starts.tolist()), list(lengths.values())
    frames = max(ends)
    template = fitted_plain(capture).template[PALM]
    poses = palm_poses(right.markers[:, :3], template)
    tracker = HandTracker(fitted_hand(capture, LIMITS))
    errors = {(kind, method): [] for kind in HIDDEN for method in METHODS}
    steps = {kind: [] for kind in HIDDEN}
    seen, before = 0., None
    for frame in range(len(markers)):
        if frame in starts:
            for kind, hidden in hidden_sets(seed, frame):
                hidden = list(hidden)
                places, angles = predicted(tracker, markers, frame, ends, hidden, rate)
                steps[kind].append([largest_step(np.vstack((before, path))) for path in angles])
                guesses = predictions(
                    right.markers, poses, frame, frames, hidden, rate, template)
                part = slice(frame, frame + frames)
                # One set of frames for all: those where nothing else is missing.
                judged = np.where(capture.whole[part], 0., np.nan)[:, None]
                guesses['hand_tracker'] = places
                for method, guess in guesses.items():
                    true = (capture if method == 'hand_tracker' else right).markers[part, hidden]
                    errors[kind, method].append(
                        np.linalg.norm(guess - true, axis=2) + judged)
        state = advance(tracker, markers[frame], frame, rate)
        if before is not None:
            seen = max(seen, largest_step(np.stack((before, state.angles))))
        before = state.angles
    captured = largest_step(captured_bends(capture.joints))
    rows = []
    for kind in HIDDEN:
        for method in METHODS:
            found = np.array(errors[kind, method])
            mine = [_row(capture, kind, method, seconds, found[:, :count])
                    for seconds, count in lengths.items()]
            if method == 'hand_tracker':
                for row, step in zip(mine, np.max(steps[kind], axis=0)):
                    row.update({key: round(float(np.degrees(angle)), 3) for key, angle in (
                        ('step_deg', step), ('seen_deg', seen), ('captured_deg', captured))})
            rows += mine
    return rows


def _row(capture, kind, method, seconds, errors):
    """Return a row; errors of shape (windows, frames, markers), NaN where not judged [m]."""
    judged = errors[np.isfinite(errors)]
    return {'evaluation': 'occlusion', 'recording': capture.name, 'method': method,
            'hidden': kind, 'hidden_s': seconds, **spread(judged),
            'available_pct': round(100. * availability(judged, AVAILABLE), 2),
            'frames': int(np.isfinite(errors).all(axis=2).sum()), 'windows': len(errors)}


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
        for recording in recordings for kind in HIDDEN for method in METHODS]
    means = [(HIDDEN[kind], method, *(
        mean_and_p95(mean_of(_find(rows, kind, method, seconds))) for seconds in LENGTHS),
        number(_available(rows, kind, method), 1)) for kind in HIDDEN for method in METHODS]
    caption = 'Error of hidden markers while they are hidden, mm, mean (p95)'
    tables = [Table(f'{caption}, mean of {len(recordings)} recordings',
                    ('hidden', 'method', *header, f'within {1e3 * AVAILABLE:g} mm, %'), means)]
    if len(recordings) > 1:
        tables.append(Table(f'{caption}, each recording',
                            ('recording', 'hidden', 'method', *header), every))
    tables.append(Table(
        'Largest step of an angle from frame to frame, degrees: while markers are hidden and in '
        f'{AFTER} frames after, with all seen, and captured',
        ('recording', 'hidden', *header, 'all seen', 'captured'),
        [_steps(recording, kind, rows) for recording in recordings for kind in HIDDEN]))
    return tables


def _steps(recording, kind, rows):
    """Return a line of the largest steps."""
    mine = {row['hidden_s']: row for row in rows if row.get('step_deg') is not None
            and (row['recording'], row['hidden']) == (recording, kind)}
    last = list(mine.values())[-1]
    return (recording, kind,
            *(number(mine[seconds]['step_deg'] if seconds in mine else None, 1)
              for seconds in LENGTHS),
            number(last['seen_deg'], 1), number(last['captured_deg'], 1))


def _available(rows, kind, method):
    """Return the share of usable places, a mean over recordings and lengths [%]."""
    found = [row['available_pct'] for row in rows
             if (row['hidden'], row['method']) == (kind, method)]
    return sum(found) / len(found)


def losses(rows):
    """Return for which recordings, markers and times a baseline is nearer."""
    lines = []
    for recording in dict.fromkeys(row['recording'] for row in rows):
        own = [row for row in rows if row['recording'] == recording]
        for kind, hidden in HIDDEN.items():
            worse = []
            for seconds in LENGTHS:
                means = {row['method']: row['mean_mm']
                         for row in own if (row['hidden'], row['hidden_s']) == (kind, seconds)
                         and row['mean_mm'] is not None}
                best = min(means, key=means.get, default='hand_tracker')
                # Not by what the last digit of a table does not show.
                if means and means['hand_tracker'] > means[best] + .005:
                    worse.append(f'{seconds:g} s ({means["hand_tracker"]:.2f} mm against '
                                 f'{means[best]:.2f} of {best})')
            if worse:
                lines.append(f'{recording}, {hidden} hidden for ' + ', '.join(worse))
    return lines


def pictures(rows, folder):
    """Draw the mean error over the length of the windows, one pair of axes a kind."""
    figure, axes = figure_with(len(HIDDEN), height=2.6, columns=2)
    for ax, (kind, hidden) in zip(axes, HIDDEN.items()):
        for i, method in enumerate(METHODS):
            found = [mean_of(_find(rows, kind, method, seconds)) for seconds in LENGTHS]
            # Ours on top, so that no baseline of the same values hides it.
            ax.plot(LENGTHS, [row['mean_mm'] if row else np.nan for row in found],
                    marker='osD^'[i], markersize=4, color=COLOURS[i],
                    label=words(method) if i else method,
                    linewidth=2.4 if i else 1.4, zorder=3 - .1 * i)
        ax.set_title(f'hidden: {hidden}', fontsize=9)
        ax.set_xlabel('hidden for [s]', fontsize=8)
        ax.set_ylabel('mean error [mm]', fontsize=8)
    share_top(axes)
    save(figure, folder / 'occlusion.png', axes[0])
    return [Picture('occlusion.png', 'Error of hidden markers, mean of the recordings')]
