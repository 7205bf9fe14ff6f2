"""Layouts of all the markers that a take has: each marker left out or hidden once, and residuals.

A hand and the places of all its markers are fitted to other takes of it (one take is left out in
turn, or those of --fit; the first fifth of a take that stands alone). Then the tracker gets all
markers but one, and is asked where that one is; or that one is hidden in the second half of each
second, and it is asked where it is then; or it gets all, and is asked how far each is off.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..calibration.full_layout import full_layout
from ..calibration.marker_fit import fit_markers
from ..calibration.takes import InvalidTake, MarkerTake
from ..core.model.hand import Hand
from ..core.model.marker_layout import PALM_LANDMARKS, MarkerLayout
from ..core.tracker import HandTracker
from .evaluation_options import Options
from .rows import Row, error_statistics, mean_of
from .tables import Picture, Table, mean_and_p95, words
from .unseen_markers import Judgement, judgements

WORN, LEFT_OUT, HALF_HIDDEN = 'worn', 'left_out', 'hidden'
HIDDEN_PERIOD = 1.  # [s] in the second half of which a marker is hidden


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each recording and marker: worn with all others, left out, and hidden."""
    tasks = judgements(options.layout_takes, options.fit_layout_takes)
    yield from options.judge_each(
        'hands', judge, tasks, lambda task: ', '.join(take.name for take in task.judged),
        InvalidTake('none of the takes can be judged'))


def judge(task: Judgement) -> list[Row]:
    """Return the rows of one hand."""
    hand, layout = fit_all_markers(task.fitted)
    return [row for take in task.judged for row in _rows_of(take, hand, layout)]


def fit_all_markers(takes: Sequence[MarkerTake]) -> tuple[Hand, MarkerLayout]:
    """Return the hand that fits takes best, and the layout of all their markers on it."""
    fit = fit_markers(takes, 'wide')
    return fit.hand, full_layout(fit)


def _rows_of(take: MarkerTake, hand: Hand, layout: MarkerLayout) -> list[Row]:
    """Return the rows of one take."""
    worn = take.columns(layout.names)
    errors = {WORN: _track_layout(hand, layout, worn, take)[1].T}
    always = np.ones(len(worn), dtype=bool)
    for kind, unseen in ((LEFT_OUT, always), (HALF_HIDDEN, _half_of_time(take))):
        errors[kind] = np.array([_error_while(hand, layout, worn, take, marker, unseen)
                                 for marker in range(len(layout.names))])
    return [{'evaluation': 'layouts', 'recording': take.name, 'markers': len(layout.names),
             'kind': kind, 'marker': name, **error_statistics(own[np.isfinite(own)]),
             'frames': int(np.isfinite(own).sum())}
            for kind, of_markers in errors.items() for name, own in zip(layout.names, of_markers)
            if np.isfinite(own).any()]


def _half_of_time(take: MarkerTake) -> np.ndarray:
    """Return the frames in the second half of each `HIDDEN_PERIOD` of a sequence, (T,)."""
    starts = np.flatnonzero(np.diff(take.sequence, prepend=np.nan))
    frames = np.arange(len(take.sequence))
    since = frames - starts[np.searchsorted(starts, frames, side='right') - 1]
    return since / take.rate % HIDDEN_PERIOD >= .5 * HIDDEN_PERIOD


def _error_while(hand: Hand, layout: MarkerLayout, worn: np.ndarray, take: MarkerTake, marker: int,
                 unseen: np.ndarray) -> np.ndarray:
    """Return the errors of a marker in the frames in which the tracker does not get it [m]."""
    frames = worn.copy()
    frames[unseen, marker] = np.nan
    found, _ = _track_layout(hand, layout, frames, take)
    return np.linalg.norm(found[unseen, marker] - worn[unseen, marker], axis=1)


def _track_layout(hand: Hand, layout: MarkerLayout, frames: np.ndarray,
                  take: MarkerTake) -> tuple[np.ndarray, np.ndarray]:
    """Return the places and residuals of all markers in the frames of a take.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    frames : ndarray, shape (T, n, 3)
        NaN where not seen [m].
    take : MarkerTake
        Each of its sequences begins anew.

    Returns
    -------
    places : ndarray, shape (T, n, 3)
        Of the markers on the tracked hand, or as measured where seen [m].
    residuals : ndarray, shape (T, n)
        [m]
    """
    places, residuals = np.full(frames.shape, np.nan), np.full(frames.shape[:2], np.nan)
    tracker = HandTracker(hand, layout)
    for i, frame in enumerate(frames):
        if i and take.sequence[i] != take.sequence[i - 1]:
            tracker.reset()
        state = tracker.update(frame, i / take.rate)
        if tracker.placed:
            places[i], residuals[i] = state.markers, state.residuals
    return places, residuals


def tables(rows: list[Row]) -> list[Table]:
    """Return the errors of the markers left out, hidden and worn, by recording and by marker."""
    def cells(chosen: list[Row]) -> tuple[str, ...]:
        return tuple(mean_and_p95(mean_of([row for row in chosen if row['kind'] == kind]))
                     for kind in (LEFT_OUT, HALF_HIDDEN, WORN))

    caption = 'Distance of a marker from its place on the hand, mm, mean (p95)'
    head = ('left out', f'hidden {.5 * HIDDEN_PERIOD:g} s', 'worn')
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    found = [Table(f'{caption}; means of all markers', ('recording', 'markers', *head), [
        (recording, str(chosen[0]['markers']), *cells(chosen)) for recording in recordings
        for chosen in ([row for row in rows if row['recording'] == recording],)])]
    for count in dict.fromkeys(row['markers'] for row in rows):
        alike = [row for row in rows if row['markers'] == count]
        lines = [(words(marker), *cells([row for row in alike if row['marker'] == marker]))
                 for marker in dict.fromkeys(row['marker'] for row in alike)]
        lines += [(group, *cells(chosen)) for group, chosen in (
            ('all of the palm', [row for row in alike if _is_on_palm(row['marker'])]),
            ('all of the digits', [row for row in alike if not _is_on_palm(row['marker'])]),
            ('all', alike)) if chosen]
        names = sorted({row['recording'] for row in alike})
        found.append(Table(f'{caption}; means of {len(names)} recordings with {count} markers',
                           ('marker', *head), lines))
    return found


def _is_on_palm(marker: str) -> bool:
    """Return whether a marker is one of the palm."""
    return marker in PALM_LANDMARKS or marker.startswith(('hand', 'back', 'wrist'))


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Return no pictures: the tables say it."""
    return []
