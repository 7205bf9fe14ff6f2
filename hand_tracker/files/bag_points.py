"""MarkerArrays of rosbag2 recordings as recordings of points, and back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ..messages.cdr import MalformedMessage, MarkerReader
from ..messages.labels import LabelMap
from ..messages.marker_array import MARKER_ARRAY, placed
from ..messages.stamps import seconds, stamp_of
from ..messages.templates import Template, markers_template
from .bags import BagMessage, open_bag, write_bag
from .point_recording import (
    ROWS_AT_ONCE,
    Axes,
    PointBuffer,
    PointRecording,
    RecordingError,
    printable,
)

BAG_FORMAT = 'rosbag2'
WRITTEN_TOPIC = '/markers'
WRITTEN_FRAME = 'world'
START_TIME = 10**9         # [ns] of the first frame: a stamp of zero is none
KEPT_TEMPLATES = 512       # of markers that are seen together
MAX_BAG_LABELS = 4096


def read_bag_points(path: Path, zero_is_missing: bool = True) -> tuple[PointRecording, Axes]:
    """Read the markers of a rosbag2 recording, whatever their ids.

    Parameters
    ----------
    path : Path
    zero_is_missing : bool, optional
        See `ReadingOptions`.

    Returns
    -------
    PointRecording
        Of its topic '/markers', else of the first one with MarkerArrays; labels are 'ns/id',
        or 'id' without a namespace.
    Axes
        Metres, z up: ROS's convention, REP 103.

    Raises
    ------
    HandTrackerError
    """
    with open_bag(path) as bag:
        topics = sorted(name for name, kind in bag.topics.items() if kind == MARKER_ARRAY)
        if not topics:
            there = ', '.join(f'{name} ({kind})' for name, kind in sorted(bag.topics.items()))
            raise RecordingError(f'{path}: no topic of {MARKER_ARRAY}; it has {there}')
        topic = WRITTEN_TOPIC if WRITTEN_TOPIC in topics else topics[0]
        notes = [f'topic {topic} of {", ".join(topics)}'] if len(topics) > 1 else []
        frames, times = [], []
        columns: dict[str, int] = {}
        reader = MarkerReader(LabelMap())
        for message in bag.messages([topic]):
            try:
                names, stamp, points = _points_of(reader, message.data)
            except MalformedMessage as error:
                raise RecordingError(f'{path}: {topic}: the message of {message.time} ns is no '
                                     f'whole {MARKER_ARRAY}') from error
            row = np.array([columns.setdefault(name, len(columns)) for name in names], int)
            if len(columns) > MAX_BAG_LABELS:
                raise RecordingError(f'{path}: more than {MAX_BAG_LABELS} ids of markers; '
                                     'expected ids that stay with their markers')
            frames.append((row, points))
            times.append(1e-9 * message.time if stamp is None else stamp)
    if not frames:
        raise RecordingError(f'{path}: {topic}: no messages; expected at least one')
    labels = tuple(columns)
    buffer = PointBuffer(path, labels, zero_is_missing, len(frames))
    for first in range(0, len(frames), ROWS_AT_ONCE):
        some = frames[first:first + ROWS_AT_ONCE]
        rows = np.full((len(some), len(labels), 3), np.nan, dtype=np.float32)
        for row, (places, points) in zip(rows, some):
            row[places] = points
        buffer.append(rows)
    labels, points = buffer.finish()
    stamps = np.array(times)
    steps = np.diff(stamps)
    rate = float(1. / np.median(steps[steps > 0.])) if (steps > 0.).any() else math.nan
    is_increasing = len(steps) > 0 and bool((steps > 0.).all())
    return PointRecording(path.name, BAG_FORMAT, labels, points, rate,
                          stamps - stamps[0] if is_increasing else None, Axes(),
                          tuple(notes)), Axes('m', 'z')


# Numbers beyond those of a marker become infinite, and then missing.
@np.errstate(over='ignore', invalid='ignore')
def _points_of(reader: MarkerReader, data: bytes
               ) -> tuple[list[str], float | None, np.ndarray]:
    """Return names, stamp of the first marker [s] and positions (n, 3) [m] of a message's points.

    A name is 'ns/id', or 'id' without a namespace; in a list the place of the point is its id.
    """
    names: list[str] = []
    points: list[np.ndarray] = [np.empty((0, 3))]
    stamp = None
    for one in reader.points(data):
        stamp = seconds(one.stamp) if stamp is None else stamp
        ids: Iterable[int] = (one.id,)
        if one.points is None:
            points.append(one.position[None])
        else:
            ids = range(len(one.points))
            points.append(placed(one.points, one.position, one.orientation, True))
        space = printable(one.ns)
        names += [f'{space}/{number}' if space else str(number) for number in ids]
    return names, stamp, np.concatenate(points).astype(np.float32)


def marker_messages(points: np.ndarray, times: Sequence[int], names: Sequence[str],
                    start: int = 0) -> Iterator[BagMessage]:
    """Yield points as MarkerArrays, one for each frame; missing ones are left out.

    Parameters
    ----------
    points : ndarray, shape (T, n, 3)
        NaN where missing [m].
    times : sequence of int, length T
        [ns]
    names : sequence of str, length n
        Namespaces of the markers; their ids are 0 to n - 1.
    start : int, optional
        Only frames at this time or later [ns].

    Yields
    ------
    BagMessage
    """
    templates: dict[bytes, Template] = {}
    for time, row in zip(times, points):
        if time < start:
            continue
        seen = np.isfinite(row).all(axis=1)
        key = seen.tobytes()
        if key not in templates:
            if len(templates) >= KEPT_TEMPLATES:
                templates.clear()
            templates[key] = markers_template(
                WRITTEN_FRAME, [(names[i], i) for i in np.flatnonzero(seen).tolist()])
        yield BagMessage(WRITTEN_TOPIC, MARKER_ARRAY, int(time),
                         templates[key].fill(stamp_of(int(time)), row[seen]))


def write_bag_points(path: Path, recording: PointRecording) -> None:
    """Write points as a rosbag2 recording (.mcap, .db3) of MarkerArrays on /markers.

    The namespaces are the labels, the ids count from 0.

    Parameters
    ----------
    path : Path
    recording : PointRecording
    """
    names = [label or 'unlabeled' for label in recording.labels]
    write_bag(path, marker_messages(recording.points, recorded_times(recording), names))


def recorded_times(recording: PointRecording) -> list[int]:
    """Return the time of each frame, the first one `START_TIME` [ns]."""
    times = np.round(1e9 * recording.times()).astype(np.int64)
    return (times - times[:1] + START_TIME).tolist()
