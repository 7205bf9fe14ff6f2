"""Track recordings without ROS: the angles of every frame, as a table or as a recording.

Command: ``hand_tracker track IN -o OUT.csv``; `track` is the same as a library. Messages stay
bytes (`codec`): objects of them would cost more than the tracking.
"""

from pathlib import Path
from typing import NamedTuple

from ..core.model.hand import JOINTS, ROOT
from ..core.numerics.quaternion import quaternion
from ..core.tracker import HandState
from ..files.angle_table import write_angle_table
from ..files.bags import (
    JOINT_STATE,
    MARKER_ARRAY,
    STORAGE,
    TF,
    BagError,
    BagMessage,
    write_bag,
)
from ..messages.cdr import (
    MalformedMessage,
    MarkerReader,
    Stamp,
    joint_state_template,
    transforms_template,
)
from ..messages.labels import LabelMap
from ..messages.marker_array import FrameTime

USUAL_TOPIC = '/markers'
NAMELESS = 'world'   # frame of markers that have none, as TF needs one
TABLE = '.csv'
KINDS = (TABLE, *STORAGE)


class TrackedFrame(NamedTuple):
    """One frame of a recording, tracked.

    Attributes
    ----------
    time : int
        When the markers were recorded [ns].
    stamp : int
        Of the markers, else `time` [ns].
    frame_id : str
        The markers' frame.
    state : HandState
    """

    time: int
    stamp: int
    frame_id: str
    state: HandState


def marker_topic(bag, topic=None):
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


def track(messages, tracker, labels=None, frame_id='', scale=1., zero_is_missing=True,
          watch=None):
    """Track recorded markers as the tracker node tracks them live.

    As there, messages without any marker of the hand are left out, and so are all before
    the palm was first seen; where time jumps back all begins anew. A frame's time is its
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
    watch : Watch, optional
        Told what came, by the time of the recording.

    Yields
    ------
    TrackedFrame

    Raises
    ------
    BagError
        If a message is damaged.
    """
    reader = MarkerReader(LabelMap() if labels is None else labels, frame_id, scale,
                          zero_is_missing)
    time = FrameTime()
    for message in messages:
        try:
            frame = reader.read(message.data)
        except MalformedMessage as error:
            raise BagError(f'{message.topic}: the message of {message.time} ns is no whole '
                           f'{message.type} of Humble or later') from error
        if watch is not None:
            watch.received(1e-9 * message.time, frame)
        if frame.stamp is None:
            continue
        state = tracker.update(
            frame.positions, time.of(frame.stamp, 1e-9 * message.time))
        if watch is not None:
            watch.tracked(1e-9 * message.time, state)
            if tracker.restarted:
                watch.restarted()
        if tracker.placed:
            stamp = frame.stamp.sec * 10**9 + frame.stamp.nanosec
            yield TrackedFrame(message.time, stamp or message.time, frame.frame_id or NAMELESS,
                               state)


def save(path, frames, prefix, wrist=False):
    """Write tracked frames, one by one; the file appears when it is whole.

    Parameters
    ----------
    path : path-like
        A table (`.csv`), its time beginning with the first frame; or a recording (`.mcap`,
        `.db3`) of `/joint_states` with the stamps of the markers.
    frames : iterable of TrackedFrame
    prefix : str
        Of the joints' names and the wrist's frame, as 'right_'.
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


def _rows(frames, wrist):
    first = None
    for _, stamp, _, state in frames:
        first = stamp if first is None else first
        yield 1e-9 * (stamp - first), state.angles, _pose(state) if wrist else ()


def _messages(frames, joints, wrist):
    joint_states, transforms = joint_state_template(joints), {}
    for recorded, stamp, frame_id, state in frames:
        stamp = Stamp(*divmod(stamp, 10**9))
        yield BagMessage('/joint_states', JOINT_STATE, recorded,
                         joint_states.fill(stamp, state.angles))
        if wrist is not None:
            if frame_id not in transforms:
                transforms = {frame_id: transforms_template([(frame_id, wrist)])}
            yield BagMessage('/tf', TF, recorded, transforms[frame_id].fill(stamp, _pose(state)))


def _pose(state):
    return (*state.wrist_position.tolist(), *quaternion(state.wrist_rotation.tolist()))
