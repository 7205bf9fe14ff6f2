"""Open a recording of any format for tracking: a rosbag2 recording, or points by their labels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from ..files.bag_points import WRITTEN_TOPIC, marker_messages, recorded_frame, recorded_times
from ..files.bags import Bag, BagError, BagMessage, open_bag
from ..files.point_recording import PointRecording
from ..files.recordings import ReadingOptions, is_marker_bag, read_recording
from ..messages.labels import InvalidLabel, LabelMap, default_labels
from ..messages.marker_array import MARKER_ARRAY


class MarkerChoice(NamedTuple):
    """Options for finding the hand's markers in a file of points.

    Attributes
    ----------
    reading : ReadingOptions
    side : str or None
        Of the hand, where the file has two.
    names : mapping of str to str
        Label of each marker that is not found by itself.
    layout : MarkerLayout or None
        The markers; the paper's eight, where their labels say, where None.
    has_labels : bool or None
        Whether labels say which points are the markers; else all points are given. None where
        they do as far as there are any.
    """

    reading: ReadingOptions = ReadingOptions()
    side: str | None = None
    names: Mapping[str, str] = {}
    layout: MarkerLayout | None = None
    has_labels: bool | None = True


class PointBag(Bag):
    """Recorded points that are read as if they were a `Bag` with a hand's markers on /markers.

    Their ids are the rows of the layout; without labels all points are there, in their order.
    They come from a file, or from messages other than MarkerArrays of a rosbag2 recording.

    Parameters
    ----------
    path : Path
    choice : MarkerChoice

    Attributes
    ----------
    layout : MarkerLayout
        Where the markers are worn.
    labels : LabelMap
        Of those that the file has.
    has_labels : bool
        Whether they say which points are the markers; else all points are there.
    side : str
        Of the hand, empty where neither the choice nor the labels nor its shape say.
    notes : tuple of str
        See `PointRecording`.
    """

    def __init__(self, path: Path, choice: MarkerChoice) -> None:
        # Here, as the calibration imports scipy, for which a replay of messages need not wait.
        from ..calibration.hand_axes import side_by_shape, with_recognised_axes
        from ..calibration.hand_markers import choose_markers, marker_points

        recording = with_recognised_axes(read_recording(path, choice.reading))
        self.path, self.notes = path, recording.notes
        missing: Sequence[str] = ()
        self.has_labels = (
            any(recording.labels) if choice.has_labels is None else choice.has_labels)
        if self.has_labels:
            chosen = choose_markers(recording, choice.side, choice.names, choice.layout)
            self.layout, missing = chosen.layout, chosen.missing
            self.side = choice.side or chosen.side or ''
            self._points = marker_points(recording, chosen)
        else:
            self.layout, self.side = choice.layout or MarkerLayout(), choice.side or ''
            self._points = recording.points
        if not self.side and (by_shape := side_by_shape(recording)):
            self.side = by_shape
            self.notes += (f'a {by_shape} hand, as its fingers bend (--side)',)
        self.labels = LabelMap(['' if name in missing else label for name, label in zip(
            self.layout.names, default_labels(self.layout.names))], self.layout.names)
        if missing:
            self.notes += (f'no label for {", ".join(missing)}; the other '
                           f'{len(self.layout.names) - len(missing)} markers are tracked',)
        if recording.origin is not None:
            self.stands_for = recording.origin.topic
            self.notes += (f'points of {recording.origin.topic} ({recording.origin.type})',)
        self._times = recorded_times(recording)
        self._frame_id = recorded_frame(recording)
        self.topics = {WRITTEN_TOPIC: MARKER_ARRAY}
        self.counts = {WRITTEN_TOPIC: len(self._times)}
        self.offered_qos = {WRITTEN_TOPIC: []}
        self.start, self.duration = self._times[0], self._times[-1] - self._times[0]

    def messages(self, topics: Iterable[str] | None = None,
                 start: int | None = None) -> Iterator[BagMessage]:
        """Iterate over the markers as messages, in order of time; see `Bag.messages`."""
        if unknown := set(topics or ()) - self.topics.keys():
            raise BagError(f'{self.path}: no topic {", ".join(sorted(unknown))}; a file of points '
                           f'has {WRITTEN_TOPIC}')
        first = 0 if start is None else int(np.searchsorted(self._times, start))
        return marker_messages(self._points[first:], self._times[first:],
                               ('hand',) * self._points.shape[1], frame_id=self._frame_id)


def named_labels(text: str, names: Sequence[str] = MARKERS) -> dict[str, str]:
    """Return the label of each marker that a text such as 'index=LFIN,thumb=LTHM' names.

    Parameters
    ----------
    text : str
        May be empty.
    names : sequence of str, optional
        Of the layout's markers.

    Returns
    -------
    dict of str to str

    Raises
    ------
    InvalidLabel
        Naming what is no MARKER=LABEL.
    """
    found = {}
    for one in filter(None, (part.strip() for part in text.split(','))):
        marker, given, label = one.partition('=')
        if not given or marker.strip() not in names:
            raise InvalidLabel(f"markers: '{one}'; expected MARKER=LABEL, the marker being one "
                               f'of {", ".join(names)}')
        found[marker.strip()] = label.strip()
    return found


@contextmanager
def open_recording(path: str | PathLike[str] | PointBag,
                   choice: MarkerChoice | None = None) -> Iterator[Bag]:
    """Open a recording of any format for reading messages of markers.

    Parameters
    ----------
    path : path-like or PointBag
        A rosbag2 recording, or a file that `read_recording` reads; a `PointBag` is yielded as
        it is.
    choice : MarkerChoice, optional
        Of all but MarkerArrays.

    Yields
    ------
    Bag
        A `PointBag` for a file of points, and for a rosbag2 recording of other messages than
        MarkerArrays.

    Raises
    ------
    HandTrackerError
    """
    if isinstance(path, PointBag):
        yield path
        return
    choice = choice or MarkerChoice()
    if not is_marker_bag(path, choice.reading.topic):
        yield PointBag(Path(path), choice)
        return
    with open_bag(path) as bag:
        yield bag


def recorded_points(path: str | PathLike[str], reading: ReadingOptions) -> PointRecording:
    """Read a recording as points, with unit and handedness by its hands.

    Parameters
    ----------
    path : path-like
    reading : ReadingOptions

    Returns
    -------
    PointRecording
        MarkerArrays of which all markers have the ids 0 to 7 are named.
    """
    from ..calibration.hand_axes import with_recognised_axes

    recording = read_recording(path, reading)
    if recording.origin is not None and recording.origin.type == MARKER_ARRAY:
        labels = LabelMap()
        slots = [labels.slot('', int(label.rpartition('/')[2])) for label in recording.labels]
        named = tuple(PAPER_PLACES[slot] for slot in slots if slot is not None)
        if len(set(named)) == len(recording.labels):
            recording = recording._replace(labels=named)
    return with_recognised_axes(recording)
