"""Labels of points without names, on recorded markers whose names are known.

The markers of each frame are shuffled, ghosts are added, and markers are hidden in bursts. The
statistics of the hand are learned from the first fifth of the recording (`own`), from all other
recordings of such markers but that of its other hand (`others`: it is left out, and palms may be of
any size), from a hand model (`fitted`: to the joints of the first fifth, or to all real markers,
split as in `evaluate markers`), or from that of mean size alone, with the markers of a preset
(`model`: a stream learns the size on the way); judged is the rest.
A frame is right if every visible marker has its own point, and no hidden one any.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..calibration.layout_names import names_in_layout
from ..calibration.marker_names import identify
from ..calibration.takes import MarkerTake
from ..core.errors import HandTrackerError, InvalidLayout
from ..core.model.hand import LEFT_HAND_MIRROR, WEARER_LIMITS, Hand
from ..core.model.layout_presets import LAYOUT_PRESETS, preset_layout, skin_preset
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..core.numerics.sampling import evenly_spaced
from ..core.point_labelling.cloud_labeller import CloudLabeller
from ..core.point_labelling.natural_poses import ANYBODY, FITTED, model_prototype
from ..core.point_labelling.prototypes import HandPrototype, learn_prototype
from ..tracking.auto_size import AutoSize
from ..tracking.point_labels import hand_prototype
from .capture_fit import fit_to_capture
from .captures import Capture, InvalidCapture
from .evaluation_options import Options
from .layout_markers import fit_all_markers
from .rows import Row
from .tables import SERIES_COLOURS, Picture, Table, figure_with, fixed, save_figure
from .unseen_markers import Judgement, judgements

LEARNED_SHARE = .2
SINGLE_FRAMES = 300
STREAM_FRAMES = 3000            # at most, from where the judged part begins
FINDINGS = 40                   # starts from nothing in a stream
LONGEST_FINDING = 1.            # [s]
# Ghosts in the cloud, and share of markers hidden.
CLOUDS = ((0, 0.), (2, 0.), (4, 0.), (8, 0.), (0, .1), (4, .1), (4, .3))
PAIR_CLOUDS = ((0, 0.), (4, .1))
STRANGER_CLOUDS = ((0, 0.), (4, 0.), (4, .1))
BURST_TIMES = .05, 1.           # [s] for which a marker is hidden, or a ghost seen
GHOST_RANGE = .2                # [m] from the hand's middle, on each axis
GHOST_SPEED = .1                # [m/s] standard deviation on each axis


class NamedMarkers(NamedTuple):
    """Markers of one hand with their names.

    Attributes
    ----------
    name : str
    markers : tuple of str
    digits : tuple of int
        Digit of each marker, -1 for the palm.
    points : ndarray, shape (T, M, 3)
        NaN where missing [m].
    side : {'right', 'left'}
    rate : float
        [Hz]
    sequence : ndarray of int, shape (T,)
        Changes where the recording was cut.
    fitted : (Hand, MarkerLayout) or None
        To the joints of the first part, or to real markers; None where no hand fits them.
    layout : MarkerLayout or None
        Of these markers in their order, as a preset has them; None where there is none.
    """

    name: str
    markers: tuple[str, ...]
    digits: tuple[int, ...]
    points: np.ndarray
    side: str
    rate: float
    sequence: np.ndarray
    fitted: tuple[Hand, MarkerLayout] | None = None
    layout: MarkerLayout | None = None

    @property
    def split(self) -> int:
        """Number of the first judged frame."""
        return int(LEARNED_SHARE * len(self.points))

    def prototype(self) -> HandPrototype:
        """Learn the wearer's hand from the first part."""
        return learn_prototype(self.markers, self.points[:self.split], self.digits, self.side)

    @property
    def palm_size(self) -> float:
        """Root mean square distance of the palm's markers from their middle [m]."""
        palm = self.points[:, np.array(self.digits) < 0]
        off = palm - palm.mean(axis=1, keepdims=True)
        return float(np.sqrt(np.nanmean((off ** 2).sum(axis=2))))


class LabellingTrial(NamedTuple):
    """Recordings of one or two hands in one cloud, and the prototypes to find them by.

    Attributes
    ----------
    recordings : tuple of NamedMarkers
        Of as many frames.
    prototypes : tuple of HandPrototype
    learned : {'own', 'fitted', 'others', 'model'}
    clouds : tuple of (int, float)
        Ghosts and share of hidden markers.
    """

    recordings: tuple[NamedMarkers, ...]
    prototypes: tuple[HandPrototype, ...]
    learned: str
    clouds: tuple[tuple[int, float], ...]

    @property
    def name(self) -> str:
        """Name of the recordings."""
        return ' and '.join(recording.name for recording in self.recordings)


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each recording, source of the statistics, kind of start and cloud.

    `right_pct` is the share of right frames, of random frames (`start`: single_frame) or of a
    stream; `wrong_per_10000` are labels on wrong points, of all markers; `markers_right_pct` the
    share of visible markers with their own point; `found_after_s_p95` the time after a total loss
    until a frame is right, where the hand is not found within a second that [s].
    """
    by_layout = {take.name: take for take in options.layout_takes}
    placed = [by_layout.get(take.name, take) for take in options.takes]
    tasks = judgements(placed, options.fit_layout_takes)
    fits = {take.name: found for task, found in zip(tasks, options.each('hands', _fit, tasks))
            for take in task.judged}
    recordings = [_of_take(take, same, fits[take.name])
                  for take, same in zip(options.takes, placed)]
    taken = {recording.name for recording in recordings}
    recordings += [_of_capture(one) for one in options.captures if one.name not in taken]
    for recording in recordings:
        if recording.fitted is None:
            options.leave_out(f'{recording.name}, learned from a fitted hand: none fits its '
                              'markers')
    yield from options.judge_each(
        'clouds', partial(judge, seed=options.seed), list(trials(recordings)),
        lambda trial: trial.name, InvalidCapture('none of the recordings can be labelled'))


def _of_capture(capture: Capture) -> NamedMarkers:
    """Return the paper's eight markers of a capture."""
    try:
        fitted = fit_to_capture(capture, WEARER_LIMITS), MarkerLayout()
    except HandTrackerError:
        fitted = None
    return NamedMarkers(capture.name, MARKERS, (-1, -1, -1, 0, 1, 2, 3, 4), capture.markers,
                        capture.side, capture.rate, np.zeros(len(capture.joints), dtype=int),
                        fitted, MarkerLayout())


def _fit(task: Judgement) -> tuple[Hand, MarkerLayout] | None:
    """Return the hand that fits the takes, with all their markers; None where none does."""
    try:
        return fit_all_markers(task.fitted)
    except HandTrackerError:
        return None


def _of_take(take: MarkerTake, placed: MarkerTake,
             fit: tuple[Hand, MarkerLayout] | None) -> NamedMarkers:
    """Return the markers of a take whose names say where they are, with the hand by `_fit`.

    Parameters
    ----------
    take, placed : MarkerTake
        By its own names, and by those of a layout, which are taken where they say it of more.
    fit : (Hand, MarkerLayout) or None
        With the names of `placed`.
    """
    own, by_layout = ([(i, marker) for i, marker in enumerate(identify(one.names)) if marker]
                      for one in (take, placed))
    known, points = ((by_layout, placed.points) if len(by_layout) > len(own)
                     else (own, take.points))
    columns, names = [i for i, _ in known], tuple(marker.name for _, marker in known)
    found = NamedMarkers(take.name, names, tuple(marker.digit for _, marker in known),
                         points[:, columns], take.side, take.rate, take.sequence)
    if points.shape != placed.points.shape:
        return found    # the layout names other points than these
    layout_names = [placed.names[i] for i in columns]
    found = found._replace(layout=_worn_layout(layout_names, names))
    if fit is None or not set(layout_names) <= set(fit[1].names):
        return found
    hand, layout = fit
    return found._replace(fitted=(hand.replace(side=take.side),
                                  replace(layout.in_order(layout_names), names=names)))


def _worn_layout(layout_names: Sequence[str], names: tuple[str, ...]) -> MarkerLayout | None:
    """Return markers of the first preset that has them, where people wear it, with other names.

    None where no preset has them all, or where they do not place the wrist.
    """
    for preset, make in LAYOUT_PRESETS.items():
        layout = preset_layout(skin_preset(make()) or preset)
        try:
            own, _ = names_in_layout(layout)
            if set(layout_names) <= set(own):
                found = layout.in_order([layout.names[own.index(name)] for name in layout_names])
                return replace(found, names=names)
        except InvalidLayout:
            continue
    return None


def trials(recordings: Sequence[NamedMarkers]) -> Iterator[LabellingTrial]:
    """Yield the trials of recordings: each by all kinds of statistics, and in pairs."""
    for recording in recordings:
        try:
            own = recording.prototype()
        except HandTrackerError:
            continue
        yield LabellingTrial((recording,), (own,), 'own', CLOUDS)
        # Not its other hand, which one person holds alike.
        others = [one for one in recordings
                  if one.markers == recording.markers and person(one) != person(recording)]
        if others:
            yield LabellingTrial((recording,), (prototype_of_others(others, recording.side),),
                                 'others', STRANGER_CLOUDS)
        if recording.layout is not None:
            yield LabellingTrial((recording,), (model_prototype(
                Hand.scaled(side=recording.side), recording.layout, recording.markers),),
                'model', STRANGER_CLOUDS)
        if recording.fitted is not None:
            yield LabellingTrial((recording,), (model_prototype(
                *recording.fitted, recording.markers, FITTED),), 'fitted', CLOUDS)
    for right in recordings:
        for left in recordings:
            if (right.side, left.side) == ('right', 'left') and person(right) == person(left):
                pair = together(right, left)
                prototypes = tuple(one.prototype() for one in pair)
                yield LabellingTrial(pair, prototypes, 'own', PAIR_CLOUDS)


def person(recording: NamedMarkers) -> str:
    """Return the name of a recording without the side of its hand."""
    return recording.name.replace('left', '').replace('right', '')


def prototype_of_others(others: Sequence[NamedMarkers], side: str) -> HandPrototype:
    """Learn from all frames of recordings of like markers, to find hands of anybody by.

    Parameters
    ----------
    others : sequence of NamedMarkers
        Of as many frames of each, scaled to one size of the palm.
    side : {'right', 'left'}
        Of the hands to find.
    """
    size = float(np.mean([one.palm_size for one in others]))
    count = min(len(one.points) for one in others)
    frames = [one.points[evenly_spaced(len(one.points), count)]
              * (size / one.palm_size) * (1. if one.side == side else LEFT_HAND_MIRROR)
              for one in others]
    # Interleaved, as `learn_prototype` takes every so many.
    points = np.stack(frames, axis=1).reshape(-1, *frames[0].shape[1:])
    return learn_prototype(others[0].markers, points, others[0].digits, side, *ANYBODY)


def together(right: NamedMarkers, left: NamedMarkers) -> tuple[NamedMarkers, ...]:
    """Return the frames that two recordings have in common, by their sequences."""
    kept: tuple[list[np.ndarray], list[np.ndarray]] = [], []
    for sequence in np.intersect1d(right.sequence, left.sequence):
        rows = [np.flatnonzero(one.sequence == sequence) for one in (right, left)]
        count = min(map(len, rows))
        for mine, row in zip(kept, rows):
            mine.append(row[:count])
    return tuple(one._replace(points=one.points[np.concatenate(rows)],
                              sequence=one.sequence[np.concatenate(rows)])
                 for one, rows in zip((right, left), kept))


class Clouds(NamedTuple):
    """Points of the judged frames.

    Attributes
    ----------
    points : list of ndarray, shape (n, 3)
        Of each frame, in random order [m].
    rows : ndarray of int, shape (T, hands, M)
        Point of each marker, -1 where hidden.
    """

    points: list[np.ndarray]
    rows: np.ndarray


def clouds(recordings: Sequence[NamedMarkers], ghosts: int, hidden: float,
           random: np.random.RandomState) -> Clouds:
    """Shuffle the markers of all hands together, hide some in bursts, and add ghosts.

    Parameters
    ----------
    recordings : sequence of NamedMarkers
        With equal numbers of frames and of markers.
    ghosts : int
        In each frame.
    hidden : float
        Share of the markers that is hidden.
    random : RandomState

    Returns
    -------
    Clouds
    """
    markers = np.concatenate([one.points for one in recordings], axis=1)
    rate, hands, count = recordings[0].rate, len(recordings), len(recordings[0].markers)
    seen = np.isfinite(markers).all(axis=2) & ~bursts(markers.shape[:2], hidden, rate, random)
    false = _ghost_places(markers, ghosts, rate, random)
    points, rows = [], np.full(markers.shape[:2], -1)
    for frame in range(len(markers)):
        visible = np.flatnonzero(seen[frame])
        cloud = np.concatenate((markers[frame, visible], false[frame]))
        order = random.permutation(len(cloud))
        place = np.argsort(order)
        points.append(cloud[order])
        rows[frame, visible] = place[:len(visible)]
    return Clouds(points, rows.reshape(len(markers), hands, count))


def bursts(shape: tuple[int, int], share: float, rate: float,
           random: np.random.RandomState) -> np.ndarray:
    """Draw when markers are hidden, (frames, markers) bool: in bursts, for a share of the time."""
    hidden = np.zeros(shape, dtype=bool)
    if share > 0.:
        pause = np.mean(BURST_TIMES) * (1. - share) / share
        for marker in range(shape[1]):
            start = 0.
            while start < shape[0]:
                start += random.exponential(pause) * rate
                end = start + random.uniform(*BURST_TIMES) * rate
                hidden[int(start):int(end), marker] = True
                start = end
    return hidden


def _ghost_places(markers: np.ndarray, ghosts: int, rate: float,
                  random: np.random.RandomState) -> np.ndarray:
    """Draw ghosts near the hands, each for a burst and slowly moving, (frames, ghosts, 3) [m]."""
    places = np.full((len(markers), ghosts, 3), np.nan)
    middle = np.nanmean(markers, axis=1)
    for ghost in range(ghosts):
        start = 0
        while start < len(markers):
            end = min(start + max(1, int(random.uniform(*BURST_TIMES) * rate)), len(markers))
            first = middle[start] + random.uniform(-GHOST_RANGE, GHOST_RANGE, 3)
            speed = random.normal(0., GHOST_SPEED, 3)
            places[start:end, ghost] = first + speed * np.arange(end - start)[:, None] / rate
            start = end
    return places


def judge(trial: LabellingTrial, seed: int) -> list[Row]:
    """Return the rows of one trial."""
    first = trial.recordings[0].split
    judged = [one._replace(points=one.points[first:], sequence=one.sequence[first:])
              for one in trial.recordings]
    rate = judged[0].rate
    rows = []
    for ghosts, hidden in trial.clouds:
        random = np.random.RandomState([seed, ghosts, int(100 * hidden)])
        made = clouds(judged, ghosts, hidden, random)
        for start in ('single_frame', 'stream'):
            if start == 'single_frame':
                frames = random.randint(len(made.points), size=SINGLE_FRAMES)
                labeller = CloudLabeller(trial.prototypes)
                labels = np.array([labeller.label_frame(made.points[i]).rows for i in frames])
                after = None
            else:
                frames = np.arange(min(STREAM_FRAMES, len(made.points)))
                labels = _stream_labels(trial, made, frames, rate)
                after = _finding_times(trial, made, rate, random)
            true = made.rows[frames]
            visible = true >= 0
            wrong = (labels >= 0) & (labels != true)
            rows.append({
                'evaluation': 'labelling', 'recording': trial.name, 'start': start,
                'hands': len(judged), 'markers': true.shape[2], 'learned': trial.learned,
                'ghosts': ghosts, 'hidden_pct': round(100. * hidden),
                'right_pct': round(100. * float((labels == true).all(axis=(1, 2)).mean()), 2),
                'markers_right_pct': round(
                    100. * float((labels == true)[visible].mean()), 3),
                'wrong_per_10000': round(1e4 * float(wrong.mean()), 2),
                'found_after_s_p95': None if after is None else round(
                    float(np.percentile(after, 95.)), 3),
                'frames': len(frames)})
    return rows


def _stream_labels(trial: LabellingTrial, made: Clouds, frames: np.ndarray,
                   rate: float) -> np.ndarray:
    """Return the labels of consecutive frames, (frames, hands, M)."""
    labeller, layout = CloudLabeller(trial.prototypes), trial.recordings[0].layout
    size = (AutoSize(Hand.scaled(side=trial.recordings[0].side), layout)
            if trial.learned == 'model' and layout is not None else None)
    rows = []
    for i in frames:
        labels = labeller.update(made.points[i], i / rate)
        rows.append(labels.rows)
        if size is not None and layout is not None and size.is_learning:
            hand = size.add(labels.places[0], i / rate, made.points[i])
            if hand is not None and size.is_confirmed:
                labeller.replace_prototype(0, hand_prototype(hand, layout))
    return np.array(rows)


def _finding_times(trial: LabellingTrial, made: Clouds, rate: float,
                   random: np.random.RandomState) -> np.ndarray:
    """Return the times until a frame is right, from starts from nothing, (n,) [s]."""
    labeller = CloudLabeller(trial.prototypes)
    longest = int(LONGEST_FINDING * rate)
    times = []
    for start in random.randint(max(len(made.points) - longest, 1), size=FINDINGS):
        labeller.reset()
        after = LONGEST_FINDING
        for i in range(start, min(start + longest, len(made.points))):
            if np.array_equal(labeller.update(made.points[i], i / rate).rows, made.rows[i]):
                after = (i - start) / rate
                break
        times.append(after)
    return np.array(times)


def tables(rows: list[Row]) -> list[Table]:
    """Return a table for each kind of start."""
    found = []
    for start, caption in (('single_frame', 'Random single frames, without history'),
                           ('stream', 'Streams')):
        lines = [(row['recording'], str(row['hands']), str(row['markers']), row['learned'],
                  str(row['ghosts']), str(row['hidden_pct']), fixed(row['right_pct'], 1),
                  fixed(row['markers_right_pct'], 1), fixed(row['wrong_per_10000'], 1),
                  fixed(row['found_after_s_p95'], 2))
                 for row in rows if row['start'] == start]
        found.append(Table(
            caption, ('recording', 'hands', 'markers', 'learned from', 'ghosts', 'hidden, %',
                      'right frames, %', 'right markers, %', 'wrong of 10,000',
                      'found after, s, p95'), lines))
    return found


def _data_set(row: Row) -> str:
    """Return the name of the data set of a row's recording."""
    return str(row['recording']).partition('__')[0]


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the share of right frames by a hand's own statistics: means of each data set."""
    own = [row for row in rows if row['learned'] == 'own' and row['hands'] == 1]
    starts = list(dict.fromkeys(row['start'] for row in own))
    figure, axes = figure_with(len(starts), width=5.)
    for ax, start in zip(axes, starts):
        for i, name in enumerate(dict.fromkeys(_data_set(row) for row in own)):
            mine = [row for row in own if (row['start'], _data_set(row)) == (start, name)]
            means = [np.mean([row['right_pct'] for row in mine if (
                row['ghosts'], row['hidden_pct']) == (ghosts, round(100. * hidden))])
                for ghosts, hidden in CLOUDS]
            ax.plot(range(len(CLOUDS)), means, marker='o', markersize=4,
                    color=SERIES_COLOURS[i % len(SERIES_COLOURS)], label=name)
        ax.set_xticks(range(len(CLOUDS)), [
            f'{ghosts} ghosts\n{100. * hidden:.0f} %' for ghosts, hidden in CLOUDS], fontsize=7)
        ax.set_title(start.replace('_', ' '), fontsize=9)
    axes[0].set_ylabel('right frames [%]', fontsize=8)
    save_figure(figure, folder / 'labelling.png', axes[0])
    return [Picture('labelling.png', 'Right frames by ghosts and share of hidden markers')]
