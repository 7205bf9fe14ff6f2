"""Read point messages of rosbag2 recordings; write recordings of points as MarkerArrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import count, islice
from pathlib import Path
from statistics import median_low
from typing import Any, NamedTuple

import numpy as np

from ..core.model.hand import SIDES
from ..core.model.marker_layout import PAPER_PLACES
from ..messages.cdr import MarkerReader
from ..messages.labels import USUAL_TOPIC, LabelMap
from ..messages.landmark_kinds import LANDMARK_POSES, NAMED_LANDMARKS
from ..messages.marker_array import MARKER_ARRAY, placed
from ..messages.marker_ids import ANONYMOUS_NAMESPACE, MarkerIds, no_warning
from ..messages.message_kinds import (
    MARKER_ARRAY_KIND,
    MOCAP4R2_MARKERS,
    POINT_CLOUD,
    RIGID_BODIES,
    MalformedMessage,
)
from ..messages.point_cloud_parser import MOST_MARKERS
from ..messages.stamps import nanoseconds, seconds, stamp_of
from ..messages.templates import Template, markers_template
from .bags import TYPE_STORE, Bag, BagError, BagMessage, open_bag, write_bag
from .point_recording import (
    ROWS_AT_ONCE,
    Axes,
    BagOrigin,
    PointBuffer,
    PointRecording,
    RecordingError,
    printable,
    usual_rate,
)

BAG_FORMAT = 'rosbag2'
WRITTEN_TOPIC = '/markers'
WRITTEN_FRAME = 'world'
START_TIME = 10**9         # [ns] of a first frame at 0 s: a stamp of zero is none
LATEST_START = 2**31       # [s] of a stamp
KEPT_TEMPLATES = 512       # cached message templates, one for each set of seen markers
MAX_BAG_LABELS = 4096
POINT_MESSAGES = {kind.type: kind for kind in (
    MARKER_ARRAY_KIND, POINT_CLOUD, MOCAP4R2_MARKERS, RIGID_BODIES, LANDMARK_POSES,
    NAMED_LANDMARKS)}
LANDMARK_MESSAGES = LANDMARK_POSES.type, NAMED_LANDMARKS.type


class BagFrame(NamedTuple):
    """Points of one message of a recording.

    Attributes
    ----------
    names : list of str
        Empty of one without a name.
    frame_id : str
    stamp : int or None
        None where there is none [ns].
    points : ndarray of float32, shape (n, 3)
        [m]
    """

    names: list[str]
    frame_id: str
    stamp: int | None
    points: np.ndarray


def point_topics(bag: Bag, topic: str | None = None) -> list[str]:
    """Return the candidate topics for a recording's points: the requested one, else '/markers'.

    Parameters
    ----------
    bag : Bag
    topic : str, optional
        That asked for.

    Returns
    -------
    list of str
        If there is none, all MarkerArray topics, or else all topics with messages of points.
    """
    fitting = sorted(name for name, kind in bag.topics.items() if kind in POINT_MESSAGES)
    for wanted in (topic, f'/{topic.lstrip("/")}') if topic else (USUAL_TOPIC,):
        if wanted in fitting:
            return [wanted]
    if topic:
        return []
    return [name for name in fitting if bag.topics[name] == MARKER_ARRAY] or fitting


def point_topic(bag: Bag, topic: str | None = None) -> str:
    """Return the topic of a recording that holds the points.

    Parameters
    ----------
    bag : Bag
    topic : str, optional
        That asked for; else it is '/markers', the only one with MarkerArrays, or the only one
        with messages of points.

    Raises
    ------
    BagError
        If there is no such topic, or several and none asked for.
    """
    found = point_topics(bag, topic)
    if not found:
        there = ', '.join(f'{name} ({kind})' for name, kind in sorted(bag.topics.items()))
        raise BagError(f'{bag.path}: no topic {f"{topic} " if topic else ""}of '
                       f'{" or ".join(POINT_MESSAGES)}; it has {there}')
    if len(found) > 1:
        raise BagError(f'{bag.path}: several topics of points; choose one (--topic): '
                       + ', '.join(f'{name} ({bag.topics[name]})' for name in found))
    return found[0]


def read_bag_points(path: Path, zero_is_missing: bool = True, topic: str | None = None,
                    partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read the points of a rosbag2 recording, in any of the messages that live sources send.

    Parameters
    ----------
    path : Path
    zero_is_missing : bool, optional
        See `ReadingOptions`.
    topic : str, optional
        As in `point_topic`.
    partial : bool, optional
        As in `open_bag`.

    Returns
    -------
    PointRecording
        Labels are names, of MarkerArrays 'ns/id', or 'id' without a namespace, and of
        NamedPoseArrays such as 'right_index_tip'.
    Axes
        Metres, z up: ROS's convention, REP 103.

    Raises
    ------
    HandTrackerError
    """
    with open_bag(path, partial) as bag:
        notes, topic = bag.notes, point_topic(bag, topic)
        kind = bag.topics[topic]
        read = _frame_reader(bag, topic)
        frames: list[tuple[np.ndarray, np.ndarray]] = []
        received: list[int] = []
        stamps: list[int | None] = []
        columns: dict[tuple[str, int], int] = {}
        frame_id = ''
        for message in bag.messages([topic]):
            try:
                frame = read(message.data)
            except MalformedMessage as error:
                raise RecordingError(f'{path}: {topic}: the message of {message.time} ns is no '
                                     f'whole {kind}: {error}') from error
            if kind == POINT_CLOUD.type and len(frame.points) >= MOST_MARKERS:
                raise RecordingError(f'{path}: {topic}: a cloud of {MOST_MARKERS} points or more; '
                                     'expected fewer: markers, not the surface of things')
            # Points without a name are distinguished by their number alone.
            numbers = count()
            row = np.array([columns.setdefault((name, 0 if name else next(numbers)), len(columns))
                            for name in frame.names], int)
            if len(columns) > MAX_BAG_LABELS:
                raise RecordingError(f'{path}: more than {MAX_BAG_LABELS} ids of markers; '
                                     'expected ids that stay with their markers')
            frames.append((row, frame.points))
            received.append(message.time)
            stamps.append(frame.stamp)
            frame_id = frame_id or frame.frame_id
    if not frames:
        raise RecordingError(f'{path}: {topic}: no messages; expected at least one')
    labels = tuple(name for name, _ in columns)
    buffer = PointBuffer(path, labels, zero_is_missing, len(frames))
    for first in range(0, len(frames), ROWS_AT_ONCE):
        some = frames[first:first + ROWS_AT_ONCE]
        rows = np.full((len(some), len(labels), 3), np.nan, dtype=np.float32)
        for row, (places, points) in zip(rows, some):
            row[places] = points
        buffer.append(rows)
    labels, points = buffer.finish()
    times = _times(received, stamps)
    since_start = np.array([1e-9 * (time - times[0]) for time in times])  # [s]
    steps = np.diff(since_start)
    is_increasing = len(steps) > 0 and bool((steps > 0.).all())
    return PointRecording(
        path.name, BAG_FORMAT, labels, points, usual_rate(since_start),
        since_start if is_increasing else None, Axes(), notes,
        is_landmarks=kind in LANDMARK_MESSAGES,
        origin=BagOrigin(topic, kind, frame_id, times[0])), Axes('m', 'z')


def _times(received: Sequence[int], stamps: Sequence[int | None]) -> list[int]:
    """Return the time of each message: its stamp, else receipt less the median delay [ns].

    A message without points has no stamp.
    """
    delays = [time - stamp for time, stamp in zip(received, stamps) if stamp is not None]
    delay = median_low(delays) if delays else 0
    return [time - delay if stamp is None else stamp for time, stamp in zip(received, stamps)]


def _frame_reader(bag: Bag, topic: str) -> Callable[[bytes], BagFrame]:
    """Return the function that reads the messages of a topic, as the sources live do."""
    kind, types = bag.topics[topic], bag.types(topic)
    known: Callable[[bytes], bytes] = (
        bytes if types is TYPE_STORE else lambda data: _as_known(types, data, kind))
    reader = MarkerReader(LabelMap(), kind=POINT_MESSAGES[kind])
    return lambda data: _frame_of(reader, known(data), kind)


def _as_known(types: Any, data: bytes, kind: str) -> bytes:
    """Convert a message from the recording's own definition of its type to the known one."""
    # Damaged bytes, and damaged definitions, can raise anything.
    try:
        message = types.deserialize_cdr(data, kind)
    except Exception as error:
        raise MalformedMessage(' '.join(str(error).split()) or type(error).__name__) from error
    try:
        return bytes(TYPE_STORE.serialize_cdr(message, kind))
    except Exception as error:
        raise MalformedMessage(f'defined there without fields that are expected: {error}'
                               ) from error


# Numbers beyond those of a marker become infinite, and then missing.
@np.errstate(over='ignore', invalid='ignore')
def _as_floats(points: Iterable[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.empty((0, 3)), *points]).astype(np.float32)


def _frame_of(reader: MarkerReader, data: bytes, kind: str) -> BagFrame:
    """Return the points of a serialized message.

    In a list of a MarkerArray the place of the point is its id.
    """
    names: list[str] = []
    points: list[np.ndarray] = []
    stamp: int | None = None
    frame_id = ''
    for one in reader.points(data):
        if stamp is None and seconds(one.stamp) is not None:
            stamp = nanoseconds(one.stamp)
        frame_id = frame_id or one.frame_id
        space = printable(one.ns)
        if kind != MARKER_ARRAY:
            names.append('' if space == ANONYMOUS_NAMESPACE else space)
            points.append(one.position[None])
            continue
        ids: Iterable[int] = (one.id,)
        if one.points is None:
            points.append(one.position[None])
        else:
            ids = range(len(one.points))
            points.append(placed(one.points, one.position, one.orientation, True))
        names += [f'{space}/{number}' if space else str(number) for number in ids]
    return BagFrame(names, frame_id, stamp, _as_floats(points))


def marker_messages(points: np.ndarray, times: Sequence[int], names: Sequence[str],
                    frame_id: str = WRITTEN_FRAME,
                    ids: Sequence[int] | None = None) -> Iterator[BagMessage]:
    """Yield points as MarkerArrays, one for each frame; missing ones are left out.

    Parameters
    ----------
    points : ndarray, shape (T, n, 3)
        NaN where missing [m].
    times : sequence of int, length T
        [ns]
    names : sequence of str, length n
        Namespaces of the markers.
    frame_id : str, optional
        Of the messages.
    ids : sequence of int, length n, optional
        Of the markers; 0 to n - 1 when left out.

    Yields
    ------
    BagMessage
    """
    heads = list(zip(names, range(len(names)) if ids is None else ids))
    templates: dict[bytes, Template] = {}
    for time, row in zip(times, points):
        seen = np.isfinite(row).all(axis=1)
        key = seen.tobytes()
        if key not in templates:
            if len(templates) >= KEPT_TEMPLATES:
                templates.clear()
            templates[key] = markers_template(
                frame_id, [heads[i] for i in np.flatnonzero(seen).tolist()])
        yield BagMessage(WRITTEN_TOPIC, MARKER_ARRAY, int(time),
                         templates[key].fill(stamp_of(int(time)), row[seen]))


def write_bag_points(path: Path, recording: PointRecording) -> None:
    """Write points as a rosbag2 recording (.mcap, .db3) of MarkerArrays on /markers.

    Namespaces and ids are those of `MarkerIds`, as of a live source; points that come from
    MarkerArrays keep theirs.

    Parameters
    ----------
    path : Path
    recording : PointRecording
    """
    heads = [(head.ns, head.id) for head in MarkerIds(no_warning).heads(
        WRITTEN_FRAME, [label or None for label in recording.labels])]
    if recording.origin is not None and recording.origin.type == MARKER_ARRAY:
        heads = [_recorded_head(label) or head for label, head in zip(recording.labels, heads)]
    write_bag(path, marker_messages(
        recording.points, recorded_times(recording), [name for name, _ in heads],
        frame_id=recorded_frame(recording), ids=[number for _, number in heads]))


def _recorded_head(label: str) -> tuple[str, int] | None:
    """Return the namespace and id of a label of `read_bag_points`, or of both hands' markers."""
    space, separator, number = label.rpartition('/')
    if separator and number.lstrip('-').isdecimal():
        return space, int(number)
    side, _, place = label.partition('_')
    return (side, PAPER_PLACES.index(place)) if side in SIDES and place in PAPER_PLACES else None


def marker_names(labels: Sequence[str]) -> tuple[str, ...]:
    """Return the names of markers of MarkerArrays, where each has a namespace of its own.

    Parameters
    ----------
    labels : sequence of str
        Such as 'RHand:index/3', of `read_bag_points`.

    Returns
    -------
    tuple of str
        Empty for points that the source did not name; empty where namespaces name no markers.
    """
    spaces = [label.rpartition('/')[0] for label in labels]
    named = [space for space in spaces if space != ANONYMOUS_NAMESPACE]
    if not named or not all(named) or len(set(named)) < len(named):
        return ()
    return tuple('' if space == ANONYMOUS_NAMESPACE else space for space in spaces)


def sampled_labels(bag: Bag, topic: str, count: int) -> list[str]:
    """Return the labels that markers have in the first messages of a topic of MarkerArrays."""
    read = _frame_reader(bag, topic)
    with suppress(MalformedMessage):
        return list(dict.fromkeys(name for message in islice(bag.messages([topic]), count)
                                  for name in read(message.data).names))
    return []


def recorded_times(recording: PointRecording) -> list[int]:
    """Return the time of each frame [ns].

    Of files other than bags it is their own, as far as the first frame's can be a stamp; else that
    is `START_TIME`.
    """
    own = recording.times()
    times = np.round(1e9 * (own - own[:1])).astype(np.int64)
    if recording.origin is not None:
        start = recording.origin.start
    else:
        start = round(1e9 * float(own[0])) if len(own) and 0. < own[0] < LATEST_START else 0
    return [(start or START_TIME) + time for time in times.tolist()]


def recorded_frame(recording: PointRecording) -> str:
    """Return the frame of a recording's points."""
    return (recording.origin.frame_id if recording.origin else '') or WRITTEN_FRAME
