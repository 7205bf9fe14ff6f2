"""Unseen markers of real takes: a hand fitted to all markers, tracked from the eight worn ones.

What is judged are the markers that the tracker does not get. With takes to fit on the hand is
fitted to those and judged on the others; else one take of a hand is left out in turn, and the first
fifth of a take that stands alone is fitted and the rest judged. `hand_tracker` fits the hand and
where the markers are on it (limits: `wide`, widened by what the takes show) and tracks the worn
markers; `plain` is the plain hand of the captures, its joints taken for the markers at them;
`ridge` is a regression without any hand.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..calibration.fitted_hand import place_mounted
from ..calibration.marker_fit import MarkerFit, fit_markers
from ..calibration.marker_names import identify
from ..calibration.takes import InvalidTake, MarkerTake
from ..core.model.hand import widened_limits
from ..core.model.kinematics import Pose
from ..core.model.marker_layout import MARKERS
from ..core.tracker import HandTracker
from .capture_tracking import Tracked, track_markers
from .evaluation_options import Options
from .plain_markers import fit_plain_markers, plain_markers
from .ridge_markers import fit_ridge, ridge_markers
from .rows import Row, error_statistics, mean_of
from .tables import (
    SERIES_COLOURS,
    Losses,
    Picture,
    Table,
    figure_with,
    mean_and_p95,
    save_figure,
    words,
)

MARKER_METHODS = ('hand_tracker', 'plain', 'ridge')
MARKER_GROUPS = ('all pip', 'all tip', 'all thumb', 'all')
MARKER_LOSSES = (
    'The regression knows no hand: where it has seen the motion it is nearer, as it learns what '
    'skin and tendons do together, and farther where it has not. The plain hand takes a marker '
    'for the centre of the joint below it.')
ALONE_SHARE = .2   # first part of a take that stands alone


class Judgement(NamedTuple):
    """Takes to fit on, and those to judge.

    Attributes
    ----------
    fitted, judged : tuple of MarkerTake
    """

    fitted: tuple[MarkerTake, ...]
    judged: tuple[MarkerTake, ...]


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each recording, method and unseen marker."""
    tasks = judgements(options.takes, options.fit_takes)
    yield from options.judge_each(
        'hands', judge, tasks, lambda task: ', '.join(take.name for take in task.judged),
        InvalidTake('none of the takes can be judged'))


def judgements(takes: Sequence[MarkerTake], fit_takes: Sequence[MarkerTake]) -> list[Judgement]:
    """Return the splits of the takes into those to fit hands to and those to judge.

    Parameters
    ----------
    takes, fit_takes : sequence of MarkerTake

    Returns
    -------
    list of Judgement
    """
    if fit_takes:
        return [Judgement(tuple(fit_takes), tuple(takes))]
    groups: dict[tuple[str, tuple[str, ...]], list[MarkerTake]] = {}
    for take in takes:
        groups.setdefault((take.side, take.names), []).append(take)
    found = []
    for group in groups.values():
        if len(group) > 1:
            found += [Judgement(tuple(other for other in group if other is not take), (take,))
                      for take in group]
        else:
            found.append(_split(group[0]))
    return found


def _split(take: MarkerTake) -> Judgement:
    """Return the judgement of a take that stands alone: by sequences where it has several."""
    numbers = np.unique(take.sequence)
    if len(numbers) > 1:
        first = np.isin(take.sequence, numbers[:max(1, int(ALONE_SHARE * len(numbers)))])
    else:
        first = np.arange(len(take.points)) < ALONE_SHARE * len(take.points)
    return Judgement((take.part(first),), (take.part(~first),))


def judge(task: Judgement) -> list[Row]:
    """Return the rows of one hand.

    Raises
    ------
    InvalidTake
        If a marker is missing that is to be worn, or to be judged.
    """
    fit = fit_markers(task.fitted, 'wide')
    fit = fit._replace(hand=fit.hand.replace(limits=widened_limits(
        fit.hand.limits, fit.hand.range_of_motion)))
    if '' in fit.worn:
        raise InvalidTake('the takes that the hand is fitted to lack a marker of '
                          + ', '.join(marker for marker, name in zip(MARKERS, fit.worn)
                                      if not name))
    return [row for take in task.judged for row in _rows_of(task.fitted, take, fit)]


def _rows_of(fitted: Sequence[MarkerTake], take: MarkerTake, fit: MarkerFit) -> list[Row]:
    """Return the rows of one take."""
    names = tuple(marker.name for marker in identify(take.names)
                  if marker is not None and marker.name in fit.mounts)
    unseen = tuple(name for name in names if name not in fit.worn)
    worn = take.columns(fit.worn)
    whole = np.isfinite(worn).all(axis=(1, 2))
    if not whole.any():
        raise InvalidTake(f'{take.name}: no frame has {", ".join(fit.worn)}')

    tracked = _track_worn(fit, take)
    found = {'hand_tracker': place_mounted(
        fit.hand, [fit.mounts[name] for name in unseen], tracked.angles,
        tracked.wrist_rotation, tracked.wrist_position)[whole]}
    all_names = (*fit.worn, *unseen)
    known = np.concatenate([other.columns(all_names) * other.mirror for other in fitted])
    known = known[np.isfinite(known).all(axis=(1, 2))]
    if not len(known):
        raise InvalidTake('no frame that the hand is fitted to has all its markers')
    right = worn[whole] * take.mirror
    found['plain'] = take.mirror * plain_markers(
        fit_plain_markers(all_names, known, fit.worn), unseen, right)
    found['ridge'] = take.mirror * ridge_markers(
        fit_ridge(known[:, :len(fit.worn)], known[:, len(fit.worn):]), right)

    true = take.columns(unseen)[whole]
    rows = []
    for method in MARKER_METHODS:
        errors = np.linalg.norm(found[method] - true, axis=2)
        for i, name in enumerate(unseen):
            seen = np.isfinite(errors[:, i])
            rows.append({'evaluation': 'markers', 'recording': take.name, 'method': method,
                         'marker': name, **error_statistics(errors[seen, i]),
                         'frames': int(seen.sum())})
    return rows


def _track_worn(fit: MarkerFit, take: MarkerTake) -> Tracked:
    """Track the worn markers of a take; each of its sequences begins anew."""
    worn = take.columns(fit.worn)
    cuts = np.flatnonzero(np.diff(take.sequence)) + 1
    parts = [track_markers(HandTracker(fit.hand, fit.layout), part, take.rate)
             for part in np.split(worn, cuts)]
    angles, rotation, position, pose, markers, iterations = zip(*parts)
    return Tracked(
        np.concatenate(angles), np.concatenate(rotation), np.concatenate(position),
        Pose(*map(np.concatenate, zip(*pose))), np.concatenate(markers),
        np.concatenate(iterations))


def tables(rows: list[Row]) -> list[Table]:
    """Return the table of all markers and methods, means over the recordings."""
    recordings = list(dict.fromkeys(row['recording'] for row in rows))
    markers = list(dict.fromkeys(row['marker'] for row in rows))
    lines = []
    for marker in [*markers, *MARKER_GROUPS]:
        chosen = [row for row in rows if _belongs(row['marker'], marker)]
        if chosen:
            lines.append((words(marker), *(
                mean_and_p95(mean_of([row for row in chosen if row['method'] == method]))
                for method in MARKER_METHODS)))
    by_recording = [(recording, *(
        mean_and_p95(mean_of([row for row in rows
                              if (row['recording'], row['method']) == (recording, method)]))
        for method in MARKER_METHODS)) for recording in recordings]
    caption = 'Distance of each unseen marker from its measured place, mm, mean (p95)'
    found = [Table(f'{caption}; means of {len(recordings)} recordings',
                   ('marker', *MARKER_METHODS), lines)]
    if len(recordings) > 1:
        found.append(Table(f'{caption}; means of all unseen markers',
                           ('recording', *MARKER_METHODS), by_recording))
    return found


def losses(rows: list[Row]) -> Losses:
    """Return the markers and recordings in which a baseline is nearer."""
    lines = []
    for baseline in MARKER_METHODS[1:]:
        worse = []
        for row in rows:
            if row['method'] != 'hand_tracker' or row['mean_mm'] is None:
                continue
            other = next(one for one in rows if one['method'] == baseline and (
                one['recording'], one['marker']) == (row['recording'], row['marker']))
            if row['mean_mm'] > other['mean_mm']:
                worse.append(f'{row["recording"]} {words(row["marker"])} {row["mean_mm"]:.2f} mm '
                             f'against {other["mean_mm"]:.2f}')
        if worse:
            lines.append(f'{baseline} is nearer: ' + ', '.join(worse))
    return Losses(lines, MARKER_LOSSES)


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the mean error of each unseen marker, methods side by side."""
    markers = list(dict.fromkeys(row['marker'] for row in rows))
    figure, (ax,) = figure_with(1, width=9., height=2.8)
    for i, method in enumerate(MARKER_METHODS):
        means = [mean_of([row for row in rows if row['method'] == method
                          and row['marker'] == marker]) for marker in markers]
        ax.bar(np.arange(len(markers)) + .27 * (i - 1),
               [np.nan if mean is None else mean['mean_mm'] for mean in means], width=.25,
               color=SERIES_COLOURS[i], label=words(method))
    ax.set_xticks(range(len(markers)), [words(name).replace(' ', '\n') for name in markers])
    ax.set_ylabel('mean error [mm]', fontsize=8)
    save_figure(figure, folder / 'markers.png', ax)
    return [Picture('markers.png', 'Mean error of each marker that the tracker did not get')]


def _belongs(marker: str, group: str) -> bool:
    """Return whether a marker is the one named, or of the group named."""
    if group == 'all':
        return True
    if group == 'all thumb':
        return marker.startswith('thumb')
    if group in MARKER_GROUPS:
        return marker.endswith(group.split()[1]) and not marker.startswith('thumb')
    return marker == group
