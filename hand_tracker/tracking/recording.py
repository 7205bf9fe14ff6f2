"""Track recordings as the tracker node tracks live markers, and write what was tracked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.model.hand import JOINTS, ROOT
from ..core.numerics.quaternion import quaternion
from ..core.tracker import HandState, HandTracker
from ..files.angle_table import write_angle_table
from ..files.bags import (
    JOINT_STATE,
    STORAGE,
    TF,
    Bag,
    BagError,
    BagMessage,
    write_bag,
)
from ..messages.cdr import MalformedMessage, MarkerReader
from ..messages.labels import LabelMap
from ..messages.marker_array import MARKER_ARRAY, MarkerFrame
from ..messages.stamps import nanoseconds, stamp_of
from ..messages.templates import Template, joint_state_template, transforms_template
from .auto_size import AutoSize
from .monitor import Monitor, TrackedFrames
from .stream import Stream

USUAL_TOPIC = '/markers'
TABLE = '.csv'
OUTPUT_KINDS = (TABLE, *STORAGE)


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
    """Return the topic of a recording that holds the markers.

    Parameters
    ----------
    bag : Bag
    topic : str, optional
        That asked for; else it is '/markers' or the only one of the type.

    Returns
    -------
    str

    Raises
    ------
    BagError
        If there is no such topic, or several and none asked for.
    """
    fitting = [name for name, kind in bag.topics.items() if kind == MARKER_ARRAY]
    there = ', '.join(f'{name} ({kind})' for name, kind in sorted(bag.topics.items()))
    if topic:
        name = topic if topic in bag.topics else '/' + topic.lstrip('/')
        if name not in fitting:
            raise BagError(f'{bag.path}: no topic {topic} of {MARKER_ARRAY}; it has {there}')
        return name
    if not fitting:
        raise BagError(f'{bag.path}: no topic of {MARKER_ARRAY}; it has {there}')
    if len(fitting) > 1 and USUAL_TOPIC not in fitting:
        raise BagError(f'{bag.path}: several topics of {MARKER_ARRAY}; '
                       f'choose one of {", ".join(sorted(fitting))}')
    return fitting[0] if len(fitting) == 1 else USUAL_TOPIC


def track(messages: Iterable[BagMessage], tracker: HandTracker, labels: LabelMap | None = None,
          frame_id: str = '', scale: float = 1., zero_is_missing: bool = True,
          monitor: Monitor | None = None, say: Callable[[str], None] | None = None,
          auto_size: bool = False) -> Iterator[RecordedFrame]:
    """Track recorded markers as the tracker node tracks them live.

    As there, messages without any marker of the hand are left out, and so are all before
    the palm was first seen; where time jumps back tracking begins anew. A frame's time is its
    stamp, or when it was recorded.

    Parameters
    ----------
    messages : iterable of BagMessage
        MarkerArrays, as from `Bag.messages`.
    tracker : HandTracker
    labels : LabelMap, optional
        Ids 0 to 7 when left out.
    frame_id, scale, zero_is_missing
        See `markers_from_message`.
    monitor : Monitor, optional
        Updated by the time of the recording.
    say : callable, optional
        Told in a line that kernels are compiled meanwhile, and when they take over.
    auto_size : bool, optional
        Whether the size of the hand is learned from the first seconds.

    Yields
    ------
    RecordedFrame

    Raises
    ------
    BagError
        If a message is damaged.
    """
    stream = Stream(tracker, MarkerReader(
        LabelMap() if labels is None else labels, frame_id, scale, zero_is_missing),
        AutoSize(tracker.hand, tracker.layout) if auto_size else None)
    stream.compile_in_background()
    for message in messages:
        now = 1e-9 * message.time
        try:
            frame = stream.track(message.data, now, partial(stamp_of, message.time))
        except MalformedMessage as error:
            raise BagError(f'{message.topic}: the message of {message.time} ns is no whole '
                           f'{message.type} of Humble or later') from error
        if say is not None:
            for _, line in stream.news():
                say(line)
        if isinstance(frame, MarkerFrame):
            if monitor is not None:
                monitor.received_none(now, frame)
            continue
        if monitor is not None:
            monitor.update(TrackedFrames.of(frame, now))
        if frame.is_valid:
            yield RecordedFrame(message.time, nanoseconds(frame.stamp), frame.frame_id,
                                frame.state)


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
    path = Path(path)
    joints = [prefix + joint for joint in JOINTS]
    if path.suffix == TABLE:
        write_angle_table(path, joints, _rows(frames, wrist), wrist)
    else:
        write_bag(path, _messages(frames, joints, prefix + ROOT if wrist else None))


def _rows(frames: Iterable[RecordedFrame],
          wrist: bool) -> Iterator[tuple[float, np.ndarray, tuple[float, ...]]]:
    first = None
    for _, stamp, _, state in frames:
        first = stamp if first is None else first
        yield 1e-9 * (stamp - first), state.angles, _pose(state) if wrist else ()


def _messages(frames: Iterable[RecordedFrame], joints: list[str],
              wrist: str | None) -> Iterator[BagMessage]:
    joint_states = joint_state_template(joints)
    transforms: dict[str, Template] = {}
    for recorded, time, frame_id, state in frames:
        stamp = stamp_of(time)
        yield BagMessage('/joint_states', JOINT_STATE, recorded,
                         joint_states.fill(stamp, state.angles))
        if wrist is not None:
            if frame_id not in transforms:
                transforms = {frame_id: transforms_template([(frame_id, wrist)])}
            yield BagMessage('/tf', TF, recorded, transforms[frame_id].fill(stamp, _pose(state)))


def _pose(state: HandState) -> tuple[float, ...]:
    return (*state.wrist_position.tolist(), *quaternion(state.wrist_rotation.tolist()))
