"""Fast path: decode a serialized MarkerArray, track it and fill the serialized replies, compiled.

Decoding, tracking and filling one after the other from Python costs several times what the
tracking does, most of it in bringing the interpreter back into the processor's caches. But
messages have equal signatures: the slow path installs that of a message that it has decoded, with
the templates of the replies, into a `FastPathMemory`; messages with that signature are then
processed here, and give the same replies. No ROS.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...core.model.hand import JOINTS
from ...core.model.marker_layout import MARKERS
from ...core.model.states import PALM_STATES
from ...core.numerics.jit import jit, overwrite
from ...core.numerics.quaternion import write_transforms
from ...core.pipeline import track_frame
from ...core.pose.report import Report, mean_residual
from ...messages.cdr import (
    ENCAPSULATION,
    LITTLE_ENDIAN,
    SMALLEST_MARKER,
    MessageSignature,
    gather_positions,
    parse_marker_array,
)
from ...messages.stamps import Time, stamp_time
from ...messages.templates import Template, fill_template
from ...tracking.input_monitor import StateRun

MESSAGE_CAPACITY = 2**14  # [bytes] of a MarkerArray
REPLY_CAPACITY = 2**13    # [bytes] of a reply
STAMPS_CAPACITY, NUMBERS_CAPACITY = 32, 256  # stamps and numbers in a reply
LOG_CAPACITY = 1024       # frames until the log is drained
# Replies, by their number
JOINT_STATES, TRANSFORMS, CONFIDENCES = range(3)
REPLIES = 3
# Columns of the log
RECEIVED, PUBLISHED, TIME, RESIDUAL, PALM_STATE = range(5)
LOG_COLUMNS = 5


class FastPathMemory(NamedTuple):
    """Memory of the fast path: installed signature and reply templates, buffers, frame log.
    Attributes
    ----------
    message : ndarray, shape (MESSAGE_CAPACITY // 8,)
        Payload of the message, aligned.
    heads, places, strings : ndarray
        See `parse_marker_array`.
    known_heads, known_strings : ndarray
        The same of the installed signature.
    known : ndarray of int, shape (2,)
        Its number of markers, and bytes of its strings.
    first, marker_count : ndarray of int, shape (1,)
        Place of the marker that has the stamp; number of the hand's markers.
    slots, markers, rows, scale, zero_is_missing
        See `gather_positions`.
    stamp : ndarray of int, shape (2,)
        Seconds and nanoseconds of the last frame.
    time : ndarray, shape (1,)
        The same as a number [s].
    wanted : ndarray of int, shape (3,)
        Which replies are filled.
    replies : ndarray, shape (3, REPLY_CAPACITY // 8)
        Each after half a double, so that all behind its encapsulation is aligned.
    stamps_at, numbers_at : ndarray of int, shape (3, STAMPS_CAPACITY), (3, NUMBERS_CAPACITY)
        Where stamps and numbers are in the replies, by four and by eight bytes.
    stamps, numbers : ndarray of int, shape (3,)
        How many there are.
    transforms : ndarray, shape (26, 7)
        See `write_transforms`.
    frames, drained : ndarray of int, shape (1,)
        Frames processed so far, and those of them drained from the log.
    log : ndarray, shape (LOG_CAPACITY, 5)
        When a frame was received and published, its time [s]; its mean residual [m]; its palm.
    states : ndarray of int, shape (LOG_CAPACITY, 8)
        States of its markers.
    """

    message: np.ndarray
    heads: np.ndarray
    places: np.ndarray
    strings: np.ndarray
    known_heads: np.ndarray
    known_strings: np.ndarray
    known: np.ndarray
    first: np.ndarray
    marker_count: np.ndarray
    slots: np.ndarray
    markers: np.ndarray
    rows: np.ndarray
    scale: np.ndarray
    zero_is_missing: np.ndarray
    stamp: np.ndarray
    time: np.ndarray
    wanted: np.ndarray
    replies: np.ndarray
    stamps_at: np.ndarray
    numbers_at: np.ndarray
    stamps: np.ndarray
    numbers: np.ndarray
    transforms: np.ndarray
    frames: np.ndarray
    drained: np.ndarray
    log: np.ndarray
    states: np.ndarray


def new_memory() -> FastPathMemory:
    """Return a `FastPathMemory` with nothing installed."""
    def integers(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.int64)

    most, count = MESSAGE_CAPACITY // SMALLEST_MARKER + 1, len(MARKERS)
    return FastPathMemory(
        message=np.zeros(MESSAGE_CAPACITY // 8), heads=np.zeros((most, 5), np.int32),
        places=integers(most, 3), strings=np.zeros(MESSAGE_CAPACITY, np.uint8),
        known_heads=np.zeros((most, 5), np.int32),
        known_strings=np.zeros(MESSAGE_CAPACITY, np.uint8),
        known=np.array((-1, 0)), first=integers(1), marker_count=integers(1), slots=integers(count),
        markers=integers(count), rows=np.zeros((count, 3)), scale=np.ones(1),
        zero_is_missing=integers(1), stamp=integers(2), time=np.zeros(1),
        wanted=integers(REPLIES), replies=np.zeros((REPLIES, REPLY_CAPACITY // 8)),
        stamps_at=integers(REPLIES, STAMPS_CAPACITY),
        numbers_at=integers(REPLIES, NUMBERS_CAPACITY),
        stamps=integers(REPLIES), numbers=integers(REPLIES),
        transforms=np.zeros((1 + len(JOINTS), 7)),
        frames=integers(1), drained=integers(1), log=np.zeros((LOG_CAPACITY, LOG_COLUMNS)),
        states=np.zeros((LOG_CAPACITY, count), np.int8))


def install_signature(memory: FastPathMemory, signature: MessageSignature, stamp: Time,
                      scale: float, zero_is_missing: bool) -> bool:
    """Install the signature of the messages to process.

    Parameters
    ----------
    memory : FastPathMemory
        Changed.
    signature : MessageSignature
        Of a message that the slow path has decoded.
    stamp : Time
        Of that message.
    scale, zero_is_missing
        See `markers_from_message`.

    Returns
    -------
    bool
        Whether the fast path supports it: points of list markers it does not.
    """
    heads, strings, sources = signature
    if sources.first is None or sources.has_lists:
        return False
    if len(heads) > len(memory.known_heads) or len(strings) > len(memory.known_strings):
        return False
    count = len(sources.slots)
    memory.known[:] = len(heads), len(strings)
    memory.known_heads[:len(heads)], memory.known_strings[:len(strings)] = heads, strings
    memory.first[0], memory.marker_count[0] = sources.first, count
    memory.stamp[:] = stamp.sec, stamp.nanosec
    memory.slots[:count], memory.markers[:count] = sources.slots, sources.markers
    memory.scale[0], memory.zero_is_missing[0] = scale, zero_is_missing
    return True


def install_reply(memory: FastPathMemory, number: int, template: Template) -> bool:
    """Install a reply to be filled for each frame.

    Parameters
    ----------
    memory : FastPathMemory
        Changed.
    number : int
        `JOINT_STATES`, `TRANSFORMS` or `CONFIDENCES`.
    template : Template

    Returns
    -------
    bool
        Whether it fits.
    """
    body, stamps, numbers = template.body, template.stamps, template.numbers
    if (body.size > memory.replies.shape[1] or len(stamps) > STAMPS_CAPACITY
            or len(numbers) > NUMBERS_CAPACITY):
        return False
    memory.replies[number, :body.size] = body
    memory.stamps[number], memory.numbers[number] = len(stamps), len(numbers)
    memory.stamps_at[number, :len(stamps)] = stamps
    memory.numbers_at[number, :len(numbers)] = numbers
    memory.wanted[number] = True
    return True


@jit
def copy_payload(memory: FastPathMemory, octets: np.ndarray) -> int:
    """Copy a message without its encapsulation; return its size, -1 where it is not supported."""
    size = len(octets) - ENCAPSULATION
    if not 0 <= size <= MESSAGE_CAPACITY:
        return -1
    if octets[0] != LITTLE_ENDIAN[0] or octets[1] != LITTLE_ENDIAN[1]:
        return -1
    message = memory.message.view(np.uint8)
    for i in range(size):
        message[i] = octets[ENCAPSULATION + i]
    return size


@jit
def matches_signature(memory: FastPathMemory, size: int) -> bool:
    """Return whether the message has the installed signature."""
    count, used = parse_marker_array(
        memory.message.view(np.uint8), memory.message.view(np.int32), size, memory.heads,
        memory.places, memory.strings)
    if count != memory.known[0] or used != memory.known[1]:
        return False
    for i in range(count):
        for k in range(5):
            if memory.heads[i, k] != memory.known_heads[i, k]:
                return False
    for i in range(used):
        if memory.strings[i] != memory.known_strings[i]:
            return False
    return True


@jit
def process_message(memories: Any, packs: tuple[Any, ...], octets: np.ndarray) -> bool:
    """Track a message and fill the replies, if it has the installed signature.

    Only regular frames are processed: with stamps that go forward, after the palm was seen.

    Parameters
    ----------
    memories : packed FastPathMemory
        Changed.
    packs : tuple
        What `track_frame` takes before the markers: model, digits, options, clock, blank state,
        state and report, all packed; the last four are changed.
    octets : ndarray of uint8, shape (n,)
        The message.

    Returns
    -------
    bool
        Whether it was processed; nothing was tracked if not.
    """
    model, digits, options, clock, blank, state, report = packs
    memory = memories[0]
    size = copy_payload(memory, octets)
    if size < 0 or not state[0].wrist.placed[0] or not matches_signature(memory, size):
        return False
    at = memory.places[memory.first[0], 0]
    words = memory.message.view(np.int32)
    sec, nanosec = np.int64(words[at]), np.int64(words[at + 1]) & 0xffffffff
    time = stamp_time(sec, nanosec)
    # False for NaN, the time of an unset stamp.
    if not time > clock[0].last[0]:
        return False
    # A time that the clock has not believed may come again, which listeners of TF refuse.
    if sec == memory.stamp[0] and nanosec == memory.stamp[1]:
        return False
    count = memory.marker_count[0]
    gather_positions(memory.message, memory.places, memory.slots[:count], memory.markers[:count],
                     memory.scale[0], memory.zero_is_missing[0] > 0, memory.rows)
    track_frame(model, digits, options, clock, blank, state, report, memory.rows, time)
    memory.stamp[0], memory.stamp[1], memory.time[0] = sec, nanosec, time
    fill_replies(memory, model[0].table.parent, report[0])
    return True


@jit
def fill_replies(memory: FastPathMemory, parent: np.ndarray, report: Report) -> None:
    """Write stamp and numbers of the frame into the wanted replies."""
    if memory.wanted[JOINT_STATES]:
        _fill_reply(memory, JOINT_STATES, report.angles)
    if memory.wanted[TRANSFORMS]:
        transforms = memory.transforms[:memory.numbers[TRANSFORMS] // 7]
        write_transforms(parent, report.link_rotations, report.link_positions,
                        report.wrist_rotation, report.wrist_position, transforms)
        _fill_reply(memory, TRANSFORMS, transforms.reshape(transforms.size))
    if memory.wanted[CONFIDENCES]:
        _fill_reply(memory, CONFIDENCES, report.confidence)


@jit
def _fill_reply(memory: FastPathMemory, reply: int, numbers: np.ndarray) -> None:
    doubles = memory.replies[reply]
    fill_template(doubles.view(np.uint32), doubles, memory.stamps_at[reply, :memory.stamps[reply]],
                  memory.numbers_at[reply, :memory.numbers[reply]], memory.stamp[0],
                  memory.stamp[1], numbers)


@jit
def log_frame(memory: FastPathMemory, report: Report, received: float, published: float) -> None:
    """Log the last frame.

    Parameters
    ----------
    memory : FastPathMemory
        Changed.
    report : Report
    received, published : float
        [s]
    """
    at = memory.frames[0] % LOG_CAPACITY
    log = memory.log
    log[at, RECEIVED], log[at, PUBLISHED], log[at, TIME] = received, published, memory.time[0]
    log[at, RESIDUAL] = mean_residual(report.residuals)
    log[at, PALM_STATE] = report.palm[0]
    for i in range(len(report.marker_states)):
        memory.states[at, i] = report.marker_states[i]
    memory.frames[0] += 1


@jit
def drain_log(memories: Any, reports: Any, log: np.ndarray, states: np.ndarray,
              last_report: Any) -> tuple[int, int]:
    """Copy the log since the last call, and the last frame's report.

    Parameters
    ----------
    memories : packed FastPathMemory
        Changed.
    reports : packed Report
    log, states : ndarray
        Of the shapes in `FastPathMemory`; filled.
    last_report : packed Report
        Filled.

    Returns
    -------
    logged, frames : int
        Rows that are filled, and frames processed since the last call.
    """
    memory = memories[0]
    frames = memory.frames[0] - memory.drained[0]
    logged = min(frames, LOG_CAPACITY)
    for i in range(logged):
        at = (memory.frames[0] - logged + i) % LOG_CAPACITY
        log[i] = memory.log[at]
        states[i] = memory.states[at]
    memory.drained[0] = memory.frames[0]
    if logged:
        overwrite(last_report, reports)
    return logged, frames


def state_runs(log: np.ndarray, states: np.ndarray) -> list[tuple[float, Any]]:
    """Group logged frames into runs in which the states of palm and markers stay the same.

    Parameters
    ----------
    log, states : ndarray, shape (n, 5) and (n, 8)
        See `drain_log`.

    Returns
    -------
    list of (float, StateRun)
        When the first frame of each run was published, and the last [s].
    """
    is_new = ((states[1:] != states[:-1]).any(axis=1)
              | (log[1:, PALM_STATE] != log[:-1, PALM_STATE]))
    found: list[tuple[float, Any]] = []
    for run in np.split(np.arange(len(log)), np.flatnonzero(is_new) + 1):
        state = StateRun(PALM_STATES[int(log[run[0], PALM_STATE])], states[run[0]],
                         log[run, RESIDUAL].mean(keepdims=True))
        found += [(at, state) for at in np.unique(log[run[[0, -1]], PUBLISHED]).tolist()]
    return found
