"""Points of a recording as messages of a hand's markers, or of both hands'."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.model.hand import BOTH, OTHER_SIDE, SIDES
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.bag_points import WRITTEN_TOPIC, marker_messages, recorded_frame, recorded_times
from ..files.bags import Bag, BagError, BagMessage
from ..files.point_recording import PointRecording, RecordingError
from ..files.recordings import ReadingOptions
from ..files.text_table import LATEST_TIME
from ..messages.labels import LabelMap, default_labels, labels_of_hand, maps_of_hands
from ..messages.marker_array import MARKER_ARRAY
from ..messages.marker_ids import ANONYMOUS_NAMESPACE, FIRST_FOREIGN_ID
from .compile_kernels import prepare_kernels

if TYPE_CHECKING:
    from ..calibration.hand_labels import HandLabel
    from ..calibration.hand_markers import ChosenMarkers

# [m/s] of markers in the fastest tenth of a recording: captured hands up to 0.7, one with a rate
# four times too high 1.8. Ours.
FAST_HAND = 1.5
OTHER_UNIT = 100.   # [m/s] from which on the unit is wrong, not the rate: told elsewhere


class MarkerChoice(NamedTuple):
    """Options for finding the hand's markers in recorded points.

    Attributes
    ----------
    reading : ReadingOptions
    side : {'right', 'left', 'both'} or None
        Of the hand, where the recording has two.
    names : mapping of str to str
        Label of each marker that is not found by itself.
    layout : MarkerLayout or None
        The markers; the paper's eight, where their labels say, where None.
    has_labels : bool or None
        Whether labels say which points are the markers; else all points are given. None where
        they do as far as there are any.
    finds_side : bool
        Whether the side of the paper's markers without labels is searched by their shape, where
        nothing says it: for seconds where kernels are plain Python.
    may_be_both : bool
        Whether both hands can be asked for, where a note names what else there is.
    """

    reading: ReadingOptions = ReadingOptions()
    side: str | None = None
    names: Mapping[str, str] = {}
    layout: MarkerLayout | None = None
    has_labels: bool | None = True
    finds_side: bool = False
    may_be_both: bool = True


class RecordedMarkers(NamedTuple):
    """The markers of a hand in recorded points.

    Attributes
    ----------
    side : str
        Of the hand, empty where neither the choice nor the labels nor its shape say.
    layout : MarkerLayout
        Where the markers are worn.
    labels : LabelMap
        Of those that the recording has.
    """

    side: str
    layout: MarkerLayout
    labels: LabelMap


class PointBag(Bag):
    """Recorded points that are read as if they were a `Bag` with the hands' markers on /markers.

    Their ids are the rows of the layout, in the namespace of the side where both hands are chosen;
    without labels all points are there, in their order. They come from a file, or from messages of
    a rosbag2 recording that name them.

    Parameters
    ----------
    path : Path
    choice : MarkerChoice

    Attributes
    ----------
    hands : tuple of RecordedMarkers
        One, or the right and the left one.
    has_labels : bool
        Whether labels say which points are the markers; else all points are there.
    is_landmarks : bool
        Whether the points are joint centres, not markers on the skin.
    notes : tuple of str
        See `PointRecording`.
    """

    def __init__(self, path: Path, choice: MarkerChoice) -> None:
        # Here, as the calibration imports scipy, for which a replay of messages need not wait.
        from ..calibration.recorded_points import recorded_points

        recording = recorded_points(
            path, choice.reading, choice.layout, wanted=choice.names.values())
        if not np.isfinite(recording.points).any():
            raise RecordingError(f'{path}: no point is seen in any of its '
                                 f'{len(recording.points)} frames; expected a hand\'s markers')
        self.path, self.notes = path, recording.notes
        self.is_landmarks = recording.is_landmarks
        self.has_labels = (
            any(recording.labels) if choice.has_labels is None else choice.has_labels)
        named: dict[str, int] = {}
        if self.has_labels:
            named = self._take_labelled(recording, choice)
        else:
            self._take_all(recording, choice)
        if not self.hands[0].side:
            self._settle_side(recording, choice, named)
        if recording.origin is not None:
            self.stands_for = recording.origin.topic
            self.notes += (f'points of {recording.origin.topic} ({recording.origin.type})',)
        self._times = recorded_times(recording)
        start = float(recording.times()[0])
        if recording.origin is None and abs(start) < LATEST_TIME:
            self.zero = self._times[0] - round(1e9 * start)
        self._frame_id = recorded_frame(recording)
        self.topics = {WRITTEN_TOPIC: MARKER_ARRAY}
        self.counts = {WRITTEN_TOPIC: len(self._times)}
        self.offered_qos = {WRITTEN_TOPIC: []}
        self.start, self.duration = self._times[0], self._times[-1] - self._times[0]

    def _take_labelled(self, recording: PointRecording, choice: MarkerChoice) -> dict[str, int]:
        """Take the markers that labels name; return the column of each name of the first hand."""
        from ..calibration.hand_markers import marker_points

        chosen = _chosen_hands(recording, choice)
        self.hands, self._heads = _labelled_hands(chosen)
        self._points = np.concatenate([marker_points(recording, one) for one in chosen], axis=1)
        self.notes += _left_out(recording, choice, chosen)
        for one in filter(lambda one: one.missing, chosen):
            there = len(one.columns) - len(one.missing)
            whose = f' of the {one.side} hand' if len(chosen) > 1 else ''
            self.notes += (f'no label for {", ".join(one.missing)}{whose}; the other {there} '
                           'markers are tracked',)
        if not choice.reading.frame_rate:
            self.notes += _rate_doubt(self._points, recording.rate)
        return chosen[0].columns_of(choice.names)

    def _take_all(self, recording: PointRecording, choice: MarkerChoice) -> None:
        """Take all points, without labels, as of a live source."""
        layout = choice.layout or MarkerLayout()
        labels = LabelMap(default_labels(layout.names), layout.names)
        self.hands = tuple(RecordedMarkers(side, layout, labels) for side in (
            SIDES if choice.side == BOTH else (choice.side or '',)))
        self._heads = [(ANONYMOUS_NAMESPACE, FIRST_FOREIGN_ID + row)
                       for row in range(recording.points.shape[1])]
        self._points = recording.points

    def _settle_side(self, recording: PointRecording, choice: MarkerChoice,
                     named: dict[str, int]) -> None:
        """Take the side from the choice, the file, or the hand's shape, and note doubts."""
        (hand,) = self.hands
        if recording.side:
            self.hands = (hand._replace(side=choice.side or recording.side),)
            if choice.side is None:
                self.notes += (f'a {recording.side} hand, as the file says (--side)',)
            elif choice.side != recording.side:
                self.notes += (f'the file says that it is a {recording.side} hand: is --side '
                               'right?',)
        elif self.has_labels or hand.layout.names != MARKERS:
            self._judge_bends(recording, choice, named)
        elif choice.finds_side:
            self._find_side()

    def _judge_bends(self, recording: PointRecording, choice: MarkerChoice,
                     named: dict[str, int]) -> None:
        """Take the side by how fingers bend where none is chosen; else note a contradiction."""
        from ..calibration.hand_axes import SURE, side_by_shape

        by_shape, likelihood = side_by_shape(recording, named)
        is_sure = likelihood > SURE
        self.hands = (self.hands[0]._replace(side=choice.side or by_shape),)
        if by_shape and choice.side is None:
            doubt = '' if is_sure else f', by a likelihood of {likelihood:.2f}: is it?'
            self.notes += (f'a {by_shape} hand, as its fingers bend{doubt} (--side)',)
        elif is_sure and choice.side != by_shape:
            self.notes += (f'its fingers bend as those of a {by_shape} hand: are --side, labels, '
                           'units and axes right?',)

    def _find_side(self) -> None:
        """Find the side of the paper's markers without labels by their shape."""
        from ..calibration.cloud_side import likely_side

        prepare_kernels(partial(print, file=sys.stderr), labels_points=True)
        side, _ = likely_side(self._points)
        if side in SIDES:
            self.hands = (self.hands[0]._replace(side=side),)
            self.notes += (f'a {side} hand, by the shape of the points (--side)',)
        elif side == BOTH:
            self.notes += ('a right and a left hand, by the shape of the points: the right one is '
                           'taken (--side)',)
        else:
            self.notes += ('its side cannot be told by the shape of the points: a right hand is '
                           'searched (--side)',)

    def messages(self, topics: Iterable[str] | None = None,
                 start: int | None = None) -> Iterator[BagMessage]:
        """Iterate over the markers as messages, in order of time; see `Bag.messages`."""
        if unknown := set(topics or ()) - self.topics.keys():
            raise BagError(f'{self.path}: no topic {", ".join(sorted(unknown))}; a file of points '
                           f'has {WRITTEN_TOPIC}')
        first = 0 if start is None else int(np.searchsorted(self._times, start))
        spaces, ids = zip(*self._heads) if self._heads else ((), ())
        return marker_messages(self._points[first:], self._times[first:], spaces,
                               frame_id=self._frame_id, ids=ids)


def _chosen_hands(recording: PointRecording, choice: MarkerChoice) -> list[ChosenMarkers]:
    """Return the markers of the hand that is chosen, or of both, which wear the same layout."""
    from ..calibration.hand_markers import choose_markers

    if choice.side != BOTH:
        return [choose_markers(recording, choice.side, choice.names, choice.layout)]
    named = {side: {name.removeprefix(f'{side}_'): label for name, label in choice.names.items()
                    if name.startswith(f'{side}_')} for side in SIDES}
    if sum(map(len, named.values())) < len(choice.names):
        raise RecordingError(f'{recording.name}: --markers names the points of one hand; expected '
                             '--side right or left, or --side both where labels name the sides, or '
                             '--markers with right_index=LABEL, left_index=LABEL and so on')
    chosen, layout = [], choice.layout
    for side in SIDES:
        one = choose_markers(recording, side, named[side], layout)
        chosen.append(one._replace(side=side) if named[side] else one)
        layout = chosen[0].layout
        if chosen[-1].side != side:
            raise RecordingError(f'{recording.name}: labels that name no {side} hand; expected '
                                 'such as right_index and left_index for --side both, or --labels '
                                 'none, which finds both hands among points by their shapes')
    return chosen


def _rate_doubt(points: np.ndarray, rate: float) -> tuple[str, ...]:
    """Return a note on markers, shape (T, n, 3) [m], too fast for a hand at a rate [Hz]."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2)
    speeds = rate * steps[np.isfinite(steps)]
    fast = float(np.percentile(speeds, 90.)) if speeds.size and math.isfinite(rate) else 0.
    return (f'a tenth of the time its markers move at {fast:.1f} m/s or more, which hands hardly '
            f'do: is {rate:g} Hz its rate (--frame-rate)? With too high a one fast fingers lag',
            ) if FAST_HAND < fast < OTHER_UNIT else ()


def _left_out(recording: PointRecording, choice: MarkerChoice,
              chosen: Sequence[ChosenMarkers]) -> tuple[str, ...]:
    """Return notes on hands that labels name, but that are not among the chosen ones."""
    from ..calibration.hand_axes import names_other_hand
    from ..calibration.hand_labels import hand_labels

    notes = []
    if choice.side is None and names_other_hand(recording, chosen[0].side):
        other = OTHER_SIDE[chosen[0].side]
        notes.append(f'labels name a {other} hand, too, which is left out (--side {other}'
                     + (', or both)' if choice.may_be_both else ')'))
    subjects: dict[HandLabel, list[str]] = {}
    for label, point in zip(recording.labels, hand_labels(recording.labels,
                                                          recording.is_landmarks)):
        subject = label.rpartition(':')[0]
        if point is not None and subject not in subjects.setdefault(point, []):
            subjects[point].append(subject)
    first, *others = max(subjects.values(), key=len, default=[''])
    if others:
        notes.append(f'{", ".join(others)}: points called as those of {first}, which are taken '
                     '(--subject)')
    return tuple(notes)


def _labelled_hands(chosen: Sequence[ChosenMarkers]
                    ) -> tuple[tuple[RecordedMarkers, ...], list[tuple[str, int]]]:
    """Return the hands, and the namespace and id of each of their markers in the messages."""
    names = chosen[0].layout.names
    texts = {one.side: ['' if name in one.missing else label for name, label in zip(
        names, default_labels(names))] for one in chosen}
    if len(chosen) > 1:
        texts = {side: list(labels_of_hand(own, f'{side}/0')) for side, own in texts.items()}
    labels = maps_of_hands(texts, names)
    heads = [(one.side if len(chosen) > 1 else 'hand', row)
             for one in chosen for row in range(len(names))]
    return tuple(RecordedMarkers(one.side, one.layout, labels[one.side]) for one in chosen), heads
