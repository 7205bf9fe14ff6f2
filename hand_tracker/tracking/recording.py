"""Track recordings as the tracker node tracks live markers, and write what was tracked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.model.hand import JOINTS, ROOT
from ..core.numerics.quaternion import quaternion
from ..core.tracker import HandState, HandTracker
from ..files.angle_table import write_angle_table
from ..files.bag_points import point_topic
from ..files.bags import (
    JOINT_STATE,
    TF,
    Bag,
    BagError,
    BagMessage,
    write_bag,
)
from ..files.written_kinds import TABLE
from ..messages.cdr import MalformedMessage, MarkerReader
from ..messages.labels import LabelMap
from ..messages.marker_array import MARKER_ARRAY
from ..messages.points import PointReader
from ..messages.stamps import nanoseconds, stamp_of
from ..messages.templates import Template, joint_state_template, transforms_template
from .auto_size import AutoSize
from .exchange_search import exchange_check_for
from .monitor import Monitor
from .point_labels import PointLabelReader, PointLabels
from .setting_names import PARAMETER_NAMES
from .stream import LearnedSize, Reader, Stream, TrackedFrame

POSE_SIZE = 7  # numbers of a position and a quaternion


class RecordedFrame(NamedTuple):
    """One frame of a recording, tracked.

    Attributes
    ----------
    time : int
        When the markers were recorded [ns].
    stamp : int
        Of the markers, else `time` [ns].
    frame_id : str
        Frame of the markers.
    state : HandState
    """

    time: int
    stamp: int
    frame_id: str
    state: HandState


def marker_topic(bag: Bag, topic: str | None = None) -> str:
    """Return the topic of an opened recording that holds the markers.

    Parameters
    ----------
    bag : Bag
    topic : str, optional
        That asked for; else by `point_topic`.

    Returns
    -------
    str

    Raises
    ------
    BagError
        If there is no such topic, or several and none asked for.
    """
    if topic and bag.stands_for == f'/{topic.lstrip("/")}':
        topic = None
    name = point_topic(bag, topic)
    if bag.topics[name] != MARKER_ARRAY:
        raise BagError(f'{bag.path}: {name} has messages {bag.topics[name]}; expected '
                       f'{MARKER_ARRAY}, or to be opened by open_recording')
    return name


class MarkerReading(NamedTuple):
    """Options for reading a hand's markers from recorded messages.

    Attributes
    ----------
    labels : LabelMap
        Ids 0 to 7 when left out.
    frame_id, scale, zero_is_missing
        See `markers_from_message`.
    has_labels : bool
        Whether the markers have labels; else `labels` is not used, and points are labelled.
    partial : bool
        As in `open_bag`.
    """

    labels: LabelMap = LabelMap()
    frame_id: str = ''
    scale: float = 1.
    zero_is_missing: bool = True
    has_labels: bool = True
    partial: bool = False

    def marker_reader(self) -> MarkerReader:
        """Return a reader of labelled markers."""
        return MarkerReader(self.labels, self.frame_id, self.scale, self.zero_is_missing)

    def point_reader(self) -> PointReader:
        """Return a reader of all points, whatever their labels."""
        return PointReader(self.frame_id, self.scale, self.zero_is_missing)


USUAL_READING = MarkerReading()


def sampled_messages(bag: Bag, topic: str, step: float) -> Iterator[BagMessage]:
    """Yield the messages of a topic that are at least a step [s] apart."""
    due = bag.start
    for message in bag.messages([topic]):
        if message.time >= due:
            due = message.time + int(1e9 * step)
            yield message


def track(messages: Iterable[BagMessage], tracker: HandTracker,
          reading: MarkerReading = USUAL_READING, monitor: Monitor | None = None,
          say: Callable[[str], None] | None = None,
          auto_size: bool = False,
          point_labels: PointLabels | None = None) -> Iterator[RecordedFrame]:
    """Track recorded markers as the tracker node tracks them live.

    As there, messages without any marker of the hand are left out, and so are all before
    the palm was first seen; where time jumps back tracking begins anew. A frame's time is its
    stamp, or when it was recorded.

    Parameters
    ----------
    messages : iterable of BagMessage
        MarkerArrays, as from `Bag.messages`.
    tracker : HandTracker
    reading : MarkerReading, optional
    monitor : Monitor, optional
        Updated by the time of the recording.
    say : callable, optional
        Called with a line: that kernels are compiled meanwhile, and when they take over.
    auto_size : bool, optional
        Whether the size of the hand is learned from the first seconds.
    point_labels : PointLabels, optional
        Of markers without labels, where it knows the other hand among them.

    Yields
    ------
    RecordedFrame

    Raises
    ------
    BagError
        If a message is damaged.
    """
    hand = RecordedHand(tracker, reading, monitor, auto_size, point_labels)
    for frames in track_hands(messages, {'': hand}, say):
        yield frames['']


class RecordedHand:
    """Track one hand, message by message.

    Parameters
    ----------
    tracker, reading, monitor, auto_size
        See `track`.
    point_labels : PointLabels, optional
        Shared with the other hand in the messages, where there are no labels.
    size : LearnedSize, optional
        Learned from the same messages before.
    """

    def __init__(self, tracker: HandTracker, reading: MarkerReading = USUAL_READING,
                 monitor: Monitor | None = None, auto_size: bool = False,
                 point_labels: PointLabels | None = None,
                 size: LearnedSize | None = None) -> None:
        self._monitor = monitor
        reader: Reader
        if reading.has_labels:
            reader = reading.marker_reader()
        else:
            reader = PointLabelReader(
                tracker.hand, tracker.layout, reading.point_reader(), point_labels,
                PARAMETER_NAMES if monitor is None else monitor.names)
        self._stream = Stream(
            tracker, reader, AutoSize(tracker.hand, tracker.layout) if auto_size else None)
        self._stream.compile_in_background()
        if size is not None:
            self._stream.begin_with(size)
        if monitor is not None:
            monitor.check_side(tracker.hand, tracker.layout)
            if reading.has_labels:
                monitor.check_exchange(exchange_check_for(tracker))

    @property
    def learns_size(self) -> bool:
        """Whether the size of the hand is still to be learned."""
        return self._stream.size == 'learning'

    @property
    def found_size(self) -> LearnedSize | None:
        """The size of the hand by the messages until now, None where they tell none."""
        return self._stream.found_size

    def track(self, message: BagMessage,
              say: Callable[[str], None] | None = None) -> RecordedFrame | None:
        """Track the hand in a message; return None where it is left out, see `track`."""
        stream, monitor, now = self._stream, self._monitor, 1e-9 * message.time
        try:
            frame = stream.track(message.data, now, partial(stamp_of, message.time))
        except MalformedMessage as error:
            raise BagError(f'{message.topic}: the message of {message.time} ns is no whole '
                           f'{message.type} of Humble or later') from error
        if say is not None:
            for _, line in stream.pop_log_lines():
                say(line)
        judged = frame if monitor is None else monitor.judge(now, frame)
        if not isinstance(judged, TrackedFrame):
            return None
        if monitor is not None:
            monitor.add(judged, now)
            stream.judge_labels(monitor.labels_are_right)
        if not judged.is_valid:
            return None
        return RecordedFrame(
            message.time, nanoseconds(judged.stamp), judged.frame_id, judged.state)


def track_hands(messages: Iterable[BagMessage], hands: Mapping[str, RecordedHand],
                say: Callable[[str], None] | None = None) -> Iterator[dict[str, RecordedFrame]]:
    """Track several hands in the same messages.

    Parameters
    ----------
    messages, say
        See `track`.
    hands : mapping of str to RecordedHand

    Yields
    ------
    dict of str to RecordedFrame
        Of each message the hands that were tracked in it.
    """
    for message in messages:
        frames = {name: hand.track(message, say) for name, hand in hands.items()}
        tracked = {name: frame for name, frame in frames.items() if frame is not None}
        if tracked:
            yield tracked


def save(path: str | Path, frames: Iterable[RecordedFrame], prefix: str,
         wrist: bool = False) -> None:
    """Write tracked frames, one by one; the file appears when it is whole.

    Parameters
    ----------
    path : path-like
        A table (`.csv`), its time beginning with the first frame; or a recording (`.mcap`,
        `.db3`) of `/joint_states` with the stamps of the markers.
    frames : iterable of RecordedFrame
    prefix : str
        Of the joints' names and the wrist's frame, as ``'right_'``.
    wrist : bool, optional
        Whether to write the wrist's pose too: as columns, or as `/tf`.

    Raises
    ------
    HandTrackerError
        If the path has another extension, or cannot be written to.
    """
    save_hands(path, ({prefix: frame} for frame in frames), [prefix], [''] if wrist else ())


def save_hands(path: str | Path, frames: Iterable[Mapping[str, RecordedFrame]],
               prefixes: Sequence[str], wrists: Sequence[str] = (),
               markers: Sequence[str] = (), zero: int | None = None) -> None:
    """Write tracked frames of several hands, see `save`.

    A table has NaN for a hand that a frame has not, a recording leaves it out.

    Parameters
    ----------
    path : path-like
    frames : iterable of mapping of str to RecordedFrame
        By the prefixes, of one stamp.
    prefixes : sequence of str
        Of the joints' names and the wrists' frames.
    wrists : sequence of str
        Of each hand what the table's columns of its wrist's pose begin with; where empty, the
        poses are not written.
    markers : sequence of str
        Names of each hand's markers whose distances from it a table has, NaN of hidden ones, and
        with them the standard deviation of each angle; where empty, it has neither.
    zero : int, optional
        Stamp at which the table's time is 0; that of the first frame when left out [ns].
    """
    path = Path(path)
    if path.suffix.lower() == TABLE:
        joints = [prefix + joint for prefix in prefixes for joint in JOINTS]
        quality = [name for prefix in prefixes if markers for name in (
            *(f'{prefix}{joint}_sd_deg' for joint in JOINTS),
            *(f'{prefix}{marker}_residual_mm' for marker in markers))]
        write_angle_table(path, joints, _rows(
            frames, prefixes, bool(wrists), len(markers), zero), wrists, quality)
    else:
        write_bag(path, _messages(frames, bool(wrists)))


def _rows(frames: Iterable[Mapping[str, RecordedFrame]], prefixes: Sequence[str],
          has_wrists: bool, markers: int, zero: int | None
          ) -> Iterator[tuple[float, np.ndarray, list[float]]]:
    for tracked in frames:
        stamp = next(iter(tracked.values())).stamp
        zero = stamp if zero is None else zero
        states = [tracked[prefix].state if prefix in tracked else None for prefix in prefixes]
        numbers = [number for state in states for number in (
            [np.nan] * POSE_SIZE if state is None else _pose(state))] if has_wrists else []
        if markers:
            numbers += [number for state in states for number in (
                [np.nan] * (len(JOINTS) + markers) if state is None else _quality(state))]
        yield 1e-9 * (stamp - zero), np.concatenate(
            [np.full(len(JOINTS), np.nan) if state is None else state.angles
             for state in states]), numbers


def _messages(frames: Iterable[Mapping[str, RecordedFrame]],
              has_wrists: bool) -> Iterator[BagMessage]:
    joint_states: dict[tuple[str, ...], Template] = {}
    transforms: dict[tuple[tuple[str, str], ...], Template] = {}
    for tracked in frames:
        prefixes = tuple(tracked)
        recorded, time, _, _ = tracked[prefixes[0]]
        stamp = stamp_of(time)
        if prefixes not in joint_states:
            joint_states[prefixes] = joint_state_template(
                [prefix + joint for prefix in prefixes for joint in JOINTS])
        yield BagMessage('/joint_states', JOINT_STATE, recorded, joint_states[prefixes].fill(
            stamp, np.concatenate([frame.state.angles for frame in tracked.values()])))
        if has_wrists:
            frame_ids = tuple(
                (frame.frame_id, prefix + ROOT) for prefix, frame in tracked.items())
            if frame_ids not in transforms:
                transforms = {frame_ids: transforms_template(frame_ids)}
            yield BagMessage('/tf', TF, recorded, transforms[frame_ids].fill(
                stamp, np.concatenate([_pose(frame.state) for frame in tracked.values()])))


def _quality(state: HandState) -> list[float]:
    """Return the deviations of the angles [degrees], and the markers' residuals [mm]."""
    return [*np.degrees(state.deviation).tolist(), *(1e3 * state.residuals).tolist()]


def _pose(state: HandState) -> tuple[float, ...]:
    return (*state.wrist_position.tolist(), *quaternion(state.wrist_rotation.tolist()))
