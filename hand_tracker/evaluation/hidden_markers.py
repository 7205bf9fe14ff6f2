"""Predictions of hidden markers on captured hands, beside three baselines.

Windows of occlusion start at random frames, after one with all eight markers captured. The tracker
runs over the recording once; in each window a copy of it continues without the hidden markers.
Shorter windows are the start of longer ones. All methods are judged on the frames of a window with
all eight markers captured.

In a recording solved to a rigid palm, a hidden palm marker depends only on the palm's rotation
about the other two; the baselines all take the smallest rotation, and so agree there.
"""

import copy
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from ..calibration.landmarks import FINGER_ROWS, THUMB_ROWS
from ..core.model.hand import JOINTS
from ..core.model.marker_layout import MARKERS, PALM_MARKERS
from ..core.tracker import HandTracker
from .baselines import BASELINES, predictions
from .capture_fit import fit_to_capture, fitted_plain
from .capture_tracking import advance, track_markers
from .captures import Capture, InvalidCapture, judge_each
from .evaluation_options import Options
from .metrics import availability
from .plain_hand import PLAIN_PALM, palm_poses
from .rows import Row, error_statistics, mean_of
from .tables import (
    SERIES_COLOURS,
    Losses,
    Picture,
    Table,
    figure_with,
    fixed,
    mean_and_p95,
    save_figure,
    share_top,
    words,
)

HIDDEN_LENGTHS = (.1, .25, .5, 1.)  # [s]
WINDOW_COUNT = 48                   # in a recording
DRAWN_SETS = 3                      # of two and of three hidden markers in a window
JUDGED_SHARE = .5                   # least share of a window's frames with all markers
FRAMES_AFTER = 15                   # after a window, in which steps count
AVAILABLE_WITHIN = .01              # [m] error of a usable prediction; ours, unsourced
FITTED_LIMITS = 'wide'
# The tracker, with its own prediction and with the paper's.
TRACKER_METHODS = {'hand_tracker': 'fading', 'vtm_ukf': 'vtm_ukf'}
OCCLUSION_METHODS = (*TRACKER_METHODS, *BASELINES)
# Landmarks of each digit, from the wrist to the tip, shape (5, 5).
LANDMARK_CHAINS = np.pad(np.vstack((FINGER_ROWS, THUMB_ROWS)), ((0, 0), (1, 0)))
DIGIT_MARKER_ROWS = range(len(PALM_MARKERS), len(MARKERS))
# Kinds of sets of hidden markers.
HIDDEN_KINDS = {
    'one': 'a finger marker or the thumb\'s',
    'palm': 'a palm marker',
    'two': 'two of fingers and thumb',
    'three': 'three of fingers and thumb',
}


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each recording, method, kind of hidden markers and length of window.

    Errors are those of all hidden markers in all judged frames of the windows; `available_pct` is
    the share of errors within 10 mm. The tracker's rows also have the largest change of an angle
    between frames: `step_deg` in the windows and the 15 frames after each, `seen_deg` in the
    whole recording with all markers visible, and `captured_deg` of the captured bones.
    """
    yield from judge_each(partial(judge, seed=options.seed), options)


def windows(capture: Capture, seed: int) -> tuple[np.ndarray, dict[float, int]]:
    """Draw the first frames of windows, one from each of equal parts of the judged frames.

    Parameters
    ----------
    capture : Capture
    seed : int

    Returns
    -------
    starts : ndarray of int
        The frame before each and half of the frames in it have all eight markers.
    lengths : dict
        Number of frames by each of `HIDDEN_LENGTHS` [s] that fit into the recording.

    Raises
    ------
    InvalidCapture
        If not even the shortest fits.
    """
    whole = capture.whole
    count = np.append(0, np.cumsum(whole))
    lengths = {seconds: max(1, round(seconds * capture.rate)) for seconds in HIDDEN_LENGTHS}
    while lengths:
        frames = max(lengths.values())
        starts = np.arange(capture.split, len(whole) - frames)
        starts = starts[whole[starts - 1] & (
            count[starts + frames] - count[starts] >= JUDGED_SHARE * frames)]
        if starts.size:
            # RandomState's streams never change.
            random = np.random.RandomState(seed)
            parts = np.array_split(starts, min(WINDOW_COUNT, len(starts)))
            return np.array([part[random.randint(len(part))] for part in parts]), lengths
        lengths.popitem()
    raise InvalidCapture(f'no {min(HIDDEN_LENGTHS):g} s with all eight markers captured before, '
                         f'and in {100. * JUDGED_SHARE:g} % of the frames')


def _hidden_sets(seed: int, start: int) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield (kind, rows) of each set of hidden markers in the window at frame `start`."""
    yield from (('one', (row,)) for row in DIGIT_MARKER_ROWS)
    yield from (('palm', (row,)) for row in range(len(PALM_MARKERS)))
    random = np.random.RandomState([seed, int(start)])
    for kind, size in (('two', 2), ('three', 3)):
        sets = list(combinations(DIGIT_MARKER_ROWS, size))
        yield from ((kind, sets[i]) for i in random.permutation(len(sets))[:DRAWN_SETS])


def predicted(tracker: HandTracker, markers: np.ndarray, start: int, lengths: Collection[int],
              hidden: Sequence[int], rate: float,
              prediction: str = 'fading') -> tuple[np.ndarray, list[np.ndarray]]:
    """Track a window with hidden markers in a copy of the tracker.

    Parameters
    ----------
    tracker : HandTracker
        After the frame before the window; not changed.
    markers : ndarray, shape (T, 8, 3)
        Hidden rows are not read in the window [m].
    start : int
        First frame of the window.
    lengths : collection of int
        Lengths of occlusion [frames], each continued in a copy of its own.
    hidden : sequence of int
        Rows of the hidden markers.
    rate : float
        [Hz]
    prediction : str
        Of `TrackerOptions`.

    Returns
    -------
    places : ndarray, shape (max(lengths), len(hidden), 3)
        Predicted positions of the hidden markers [m].
    angles : list of ndarray, shape (length + FRAMES_AFTER, 25)
        For each length, in the window and in the frames after it, fewer at the end of the
        recording [rad].
    """
    tracker = copy.deepcopy(tracker)
    if prediction != tracker.options.prediction:
        tracker.configure(options=replace(tracker.options, prediction=prediction))
    window = np.array(markers[start:start + max(lengths)])
    window[:, hidden] = np.nan
    states = []
    after: dict[int, np.ndarray] = {}
    for i, frame in enumerate(window):
        states.append(advance(tracker, frame, start + i, rate))
        if i + 1 in lengths:
            end = start + i + 1
            after[i + 1] = track_markers(
                copy.deepcopy(tracker), markers[end:end + FRAMES_AFTER], rate, end).angles
    angles = np.array([state.angles for state in states])
    return (np.array([state.markers[list(hidden)] for state in states]),
            [np.concatenate((angles[:length], after[length])) for length in lengths])


def _largest_step(angles: np.ndarray) -> float:
    """Return the largest change between consecutive frames, along the first axis [rad]."""
    return np.nanmax(np.abs(np.diff(angles, axis=0)), initial=0.)


def captured_bends(joints: np.ndarray) -> np.ndarray:
    """Return the angles between consecutive captured bones, three in each digit.

    Parameters
    ----------
    joints : ndarray, shape (T, 21, 3)
        In the order of `LANDMARKS` [m].

    Returns
    -------
    ndarray, shape (T, 5, 3)
        NaN where not captured [rad].
    """
    bones = np.diff(joints[:, LANDMARK_CHAINS], axis=2)
    bones = bones / np.linalg.norm(bones, axis=3, keepdims=True)
    before, after = bones[:, :, :-1], bones[:, :, 1:]
    return 2. * np.arctan2(np.linalg.norm(after - before, axis=3),
                           np.linalg.norm(after + before, axis=3))


def judge(capture: Capture, seed: int) -> list[Row]:
    """Return the rows of one capture."""
    rate, markers, right = capture.rate, capture.markers, capture.right()
    first_frames, lengths = windows(capture, seed)
    starts, ends = set(first_frames.tolist()), list(lengths.values())
    frames = max(ends)
    template = fitted_plain(capture).template[PLAIN_PALM]
    poses = palm_poses(right.markers[:, :3], template)
    tracker = HandTracker(fit_to_capture(capture, FITTED_LIMITS))
    errors: dict[tuple[str, str], list[np.ndarray]] = {
        (kind, method): [] for kind in HIDDEN_KINDS for method in OCCLUSION_METHODS}
    steps: dict[str, list[list[float]]] = {kind: [] for kind in HIDDEN_KINDS}
    seen, before = 0., np.empty((0, len(JOINTS)))
    for frame in range(len(markers)):
        if frame in starts:
            for kind, rows_hidden in _hidden_sets(seed, frame):
                hidden = list(rows_hidden)
                found = {method: predicted(tracker, markers, frame, ends, hidden, rate, prediction)
                         for method, prediction in TRACKER_METHODS.items()}
                angles = found['hand_tracker'][1]
                steps[kind].append([_largest_step(np.vstack((before, path))) for path in angles])
                part = slice(frame, frame + frames)
                guesses = predictions(right.markers, poses, part, hidden, rate, template)
                # The same frames for all methods: those with all markers captured.
                judged = np.where(capture.whole[part], 0., np.nan)[:, None]
                guesses.update({method: places for method, (places, _) in found.items()})
                for method, guess in guesses.items():
                    true = (capture if method in TRACKER_METHODS else right).markers[part, hidden]
                    errors[kind, method].append(
                        np.linalg.norm(guess - true, axis=2) + judged)
        state = advance(tracker, markers[frame], frame, rate)
        seen = max(seen, _largest_step(np.vstack((before, state.angles))))
        before = state.angles[None]
    captured = _largest_step(captured_bends(capture.joints))
    rows = []
    for kind in HIDDEN_KINDS:
        for method in OCCLUSION_METHODS:
            distances = np.array(errors[kind, method])
            mine = [_row(capture, kind, method, seconds, distances[:, :count])
                    for seconds, count in lengths.items()]
            if method == 'hand_tracker':
                for row, step in zip(mine, np.max(steps[kind], axis=0)):
                    row.update({key: round(float(np.degrees(angle)), 3) for key, angle in (
                        ('step_deg', step), ('seen_deg', seen), ('captured_deg', captured))})
            rows += mine
    return rows


def _row(capture: Capture, kind: str, method: str, seconds: float, errors: np.ndarray) -> Row:
    """Return a row from errors (windows, frames, markers), NaN where not judged [m]."""
    judged = errors[np.isfinite(errors)]
    return {'evaluation': 'occlusion', 'recording': capture.name, 'method': method,
            'hidden': kind, 'hidden_s': seconds, **error_statistics(judged),
            'available_pct': round(100. * availability(judged, AVAILABLE_WITHIN), 2),
            'frames': int(np.isfinite(errors).all(axis=2).sum()), 'windows': len(errors)}


def _find(rows: list[Row], kind: str, method: str, seconds: float) -> list[Row]:
    """Return the rows of all recordings."""
    return [row for row in rows
            if (row['hidden'], row['method'], row['hidden_s']) == (kind, method, seconds)]


def tables(rows: list[Row]) -> list[Table]:
    """Return the tables of means over recordings, of every recording and of the largest steps."""
    header = tuple(f'{seconds:g} s' for seconds in HIDDEN_LENGTHS)
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    every = [(recording, kind, method, *(
        mean_and_p95(mean_of([row for row in _find(rows, kind, method, seconds)
                              if row['recording'] == recording])) for seconds in HIDDEN_LENGTHS))
             for recording in recordings for kind in HIDDEN_KINDS for method in OCCLUSION_METHODS]
    means = [(HIDDEN_KINDS[kind], method, *(
        mean_and_p95(mean_of(_find(rows, kind, method, seconds))) for seconds in HIDDEN_LENGTHS),
        fixed(_available(rows, kind, method), 1))
        for kind in HIDDEN_KINDS for method in OCCLUSION_METHODS]
    caption = 'Error of hidden markers while they are hidden, mm, mean (p95)'
    tables = [Table(f'{caption}, mean of {len(recordings)} recordings',
                    ('hidden', 'method', *header, f'within {1e3 * AVAILABLE_WITHIN:g} mm, %'),
                    means)]
    if len(recordings) > 1:
        tables.append(Table(f'{caption}, each recording',
                            ('recording', 'hidden', 'method', *header), every))
    tables.append(Table(
        'Largest step of an angle from frame to frame, degrees: while markers are hidden and in '
        f'{FRAMES_AFTER} frames after, with all seen, and captured',
        ('recording', 'hidden', *header, 'all seen', 'captured'),
        [_steps(recording, kind, rows) for recording in recordings for kind in HIDDEN_KINDS]))
    return tables


def _steps(recording: str, kind: str, rows: list[Row]) -> tuple[str, ...]:
    """Return a line of the table of largest steps."""
    mine = {row['hidden_s']: row for row in rows if row.get('step_deg') is not None
            and (row['recording'], row['hidden']) == (recording, kind)}
    last = list(mine.values())[-1]
    return (recording, kind,
            *(fixed(mine[seconds]['step_deg'] if seconds in mine else None, 1)
              for seconds in HIDDEN_LENGTHS),
            fixed(last['seen_deg'], 1), fixed(last['captured_deg'], 1))


def _available(rows: list[Row], kind: str, method: str) -> float:
    """Return the share of usable predictions, mean over recordings and lengths [%]."""
    found = [row['available_pct'] for row in rows
             if (row['hidden'], row['method']) == (kind, method)]
    return sum(found) / len(found)


OCCLUSION_LOSSES = (
    'A baseline predicts where a marker goes and nothing else; the tracker\'s prediction keeps '
    'limits and bones, and must not jump when the marker comes back. A regression over the '
    'last ten seconds knows habits of this one recording.')


def losses(rows: list[Row]) -> Losses:
    """Return the recordings, hidden markers and lengths in which a baseline has smaller errors."""
    lines = []
    for recording in dict.fromkeys(row['recording'] for row in rows):
        own = [row for row in rows if row['recording'] == recording]
        for kind, hidden in HIDDEN_KINDS.items():
            worse = []
            for seconds in HIDDEN_LENGTHS:
                means = {row['method']: row['mean_mm']
                         for row in own if (row['hidden'], row['hidden_s']) == (kind, seconds)
                         and row['mean_mm'] is not None}
                best = min(means, key=means.__getitem__, default='hand_tracker')
                # By at least what a table shows.
                if means and means['hand_tracker'] > means[best] + .005:
                    worse.append(f'{seconds:g} s ({means["hand_tracker"]:.2f} mm against '
                                 f'{means[best]:.2f} of {best})')
            if worse:
                lines.append(f'{recording}, {hidden} hidden for ' + ', '.join(worse))
    return Losses(lines, OCCLUSION_LOSSES)


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the mean error over the length of occlusion, a plot for each kind of hidden markers."""
    figure, axes = figure_with(len(HIDDEN_KINDS), height=2.6, columns=2)
    for ax, (kind, hidden) in zip(axes, HIDDEN_KINDS.items()):
        # Without fading the paper's prediction would leave the picture.
        for i, method in enumerate(('hand_tracker', *BASELINES)):
            found = [mean_of(_find(rows, kind, method, seconds)) for seconds in HIDDEN_LENGTHS]
            # The tracker on top, visible where a baseline has equal values.
            ax.plot(HIDDEN_LENGTHS, [row['mean_mm'] if row else np.nan for row in found],
                    marker='osD^'[i], markersize=4, color=SERIES_COLOURS[i],
                    label=words(method) if i else method,
                    linewidth=2.4 if i else 1.4, zorder=3 - .1 * i)
        ax.set_title(f'hidden: {hidden}', fontsize=9)
        ax.set_xlabel('hidden for [s]', fontsize=8)
        ax.set_ylabel('mean error [mm]', fontsize=8)
    share_top(axes)
    save_figure(figure, folder / 'occlusion.png', axes[0])
    return [Picture('occlusion.png', 'Error of hidden markers, mean of the recordings, '
                    'without vtm_ukf, which is off the scale')]
