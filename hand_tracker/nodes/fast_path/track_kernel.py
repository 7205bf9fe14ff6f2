"""Fast path: decode a message of points, track it and fill the serialized replies, compiled.

Decoding, tracking and filling one after the other from Python costs several times what the
tracking does, most of it in bringing the interpreter back into the processor's caches. But
messages have equal signatures: the slow path installs that of a message that it has decoded, with
the templates of the replies, into a `FastPathMemory`; messages with that signature are then
processed here, and give the same replies. No ROS.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.filtering.frame_clock import FrameClock
from ...core.inverse_kinematics.digit import Chains
from ...core.model.marker_layout import MarkerLayout
from ...core.model.marker_rows import LAYOUT_CAPACITY, ROW_CAPACITY, layout_rows
from ...core.model.states import PALM_STATES
from ...core.numerics.jit import jit
from ...core.numerics.packs import Pack, overwrite
from ...core.numerics.quaternion import write_transforms
from ...core.options import KernelOptions
from ...core.pipeline import track_frame
from ...core.pose.report import LISTED_RESIDUAL, Report, listed_count, mean_residual
from ...core.records import Model, State
from ...messages.cdr import (
    ENCAPSULATION,
    LITTLE_ENDIAN,
    MessageSignature,
    gather_positions,
    number_capacity,
    parse_points,
    point_capacity,
)
from ...messages.stamps import Time, is_repeated, stamp_time
from ...messages.templates import (
    ALL_TRANSFORMS,
    ANGLE_DEVIATIONS,
    JOINT_STATES,
    REPLIES,
    TRANSFORMS,
    Template,
    fill_template,
)
from ...tracking.input_monitor import StateRun

if TYPE_CHECKING:
    from .command_kernel import CommandMemory

MESSAGE_CAPACITY = 2**14  # [bytes] of a message
MOST_HANDS = 2            # in a message
MOST_REPLIES = REPLIES * MOST_HANDS
REPLY_CAPACITY = 2**14    # [bytes] of a reply
STAMPS_CAPACITY = ALL_TRANSFORMS * MOST_HANDS       # stamps in a reply
NUMBERS_CAPACITY = 7 * ALL_TRANSFORMS * MOST_HANDS  # numbers in a reply
NOT_WANTED = -1
LOG_CAPACITY = 1024       # frames until the log is drained
# Columns of the log
RECEIVED, PUBLISHED, TIME, RESIDUAL, PALM_STATE = range(5)
LOG_COLUMNS = 5


class TrackPacks(NamedTuple):
    """Arguments of `track_frame` before the markers, as of `HandTracker.kernel_arguments`."""

    model: Pack[Model]
    chains: Pack[Chains]
    options: Pack[KernelOptions]
    clock: Pack[FrameClock]
    blank: Pack[State]
    state: Pack[State]
    report: Pack[Report]


class FastPathMemory(NamedTuple):
    """Memory of one subscription: installed signature, reply templates and buffers.

    Attributes
    ----------
    parser : ndarray of int, shape (1,)
        Number of the messages' parser.
    message : ndarray
        Payload of the message, aligned, and space behind it.
    heads, places, strings : ndarray
        See `parse_points`.
    known_heads, known_strings : ndarray
        The same of the installed signature.
    known : ndarray of int, shape (2,)
        Its number of markers, and bytes of its strings.
    scale, zero_is_missing
        See `gather_positions`.
    hand_count : ndarray of int, shape (1,)
        Hands that are in such a message.
    replies : ndarray, shape (MOST_REPLIES, REPLY_CAPACITY // 8)
        Each after half a double, so that all behind its encapsulation is aligned.
    stamps_at : ndarray of int, shape (MOST_REPLIES, STAMPS_CAPACITY)
    numbers_at : ndarray of int, shape (MOST_REPLIES, NUMBERS_CAPACITY)
        Where stamps and numbers are in the replies, by four and by eight bytes.
    stamps : ndarray of int, shape (MOST_REPLIES,)
        How many stamps there are.
    """

    parser: np.ndarray
    message: np.ndarray
    heads: np.ndarray
    places: np.ndarray
    strings: np.ndarray
    known_heads: np.ndarray
    known_strings: np.ndarray
    known: np.ndarray
    scale: np.ndarray
    zero_is_missing: np.ndarray
    hand_count: np.ndarray
    replies: np.ndarray
    stamps_at: np.ndarray
    numbers_at: np.ndarray
    stamps: np.ndarray


class HandMemory(NamedTuple):
    """Memory of one hand of a subscription: its markers' places, its parts of replies, its log.

    Attributes
    ----------
    first, marker_count : ndarray of int, shape (1,)
        Place of the marker that has the stamp; number of the hand's markers.
    slots, markers, rows
        See `gather_positions`; slots are rows of the kernels, of which a layout uses the first.
    row_of_slot : ndarray of int, shape (60,)
        Row of the kernels in which each marker of the layout is.
    listed : ndarray of int, shape (1,)
        Markers of another layout than the paper's eight, else 0.
    stamp : ndarray of int, shape (2,)
        Seconds and nanoseconds of the last frame.
    time : ndarray, shape (1,)
        The same as a number [s].
    reply, first_number, number_count : ndarray of int, shape (3,)
        By `JOINT_STATES`, `TRANSFORMS` and `ANGLE_DEVIATIONS`: in which reply the hand's numbers
        are, `NOT_WANTED` if in none, from which of its numbers on, and how many.
    transforms : ndarray, shape (26, 7)
        See `write_transforms`.
    frames, drained : ndarray of int, shape (1,)
        Frames processed so far, and those of them drained from the log.
    log : ndarray, shape (LOG_CAPACITY, 5)
        When a frame was received and published, its time [s]; its mean residual [m]; its palm.
    states : ndarray of int, shape (LOG_CAPACITY, 60)
        States of its markers, in the order of the layout.
    """

    first: np.ndarray
    marker_count: np.ndarray
    slots: np.ndarray
    markers: np.ndarray
    rows: np.ndarray
    row_of_slot: np.ndarray
    listed: np.ndarray
    stamp: np.ndarray
    time: np.ndarray
    reply: np.ndarray
    first_number: np.ndarray
    number_count: np.ndarray
    transforms: np.ndarray
    frames: np.ndarray
    drained: np.ndarray
    log: np.ndarray
    states: np.ndarray


def _integers(*shape: int) -> np.ndarray:
    return np.zeros(shape, np.int64)


def new_memory() -> FastPathMemory:
    """Return a `FastPathMemory` with nothing installed."""
    most = point_capacity(MESSAGE_CAPACITY)
    return FastPathMemory(
        parser=_integers(1), message=np.zeros(number_capacity(MESSAGE_CAPACITY)),
        heads=np.zeros((most, 5), np.int32),
        places=_integers(most, 3), strings=np.zeros(MESSAGE_CAPACITY, np.uint8),
        known_heads=np.zeros((most, 5), np.int32),
        known_strings=np.zeros(MESSAGE_CAPACITY, np.uint8),
        known=np.array((-1, 0)), scale=np.ones(1), zero_is_missing=_integers(1),
        hand_count=_integers(1),
        replies=np.zeros((MOST_REPLIES, REPLY_CAPACITY // 8)),
        stamps_at=_integers(MOST_REPLIES, STAMPS_CAPACITY),
        numbers_at=_integers(MOST_REPLIES, NUMBERS_CAPACITY), stamps=_integers(MOST_REPLIES))


def new_hand_memory() -> HandMemory:
    """Return a `HandMemory` with nothing installed."""
    return HandMemory(
        first=_integers(1), marker_count=_integers(1), slots=_integers(LAYOUT_CAPACITY),
        markers=_integers(LAYOUT_CAPACITY), rows=np.zeros((ROW_CAPACITY, 3)),
        row_of_slot=np.arange(LAYOUT_CAPACITY), listed=_integers(1), stamp=_integers(2),
        time=np.zeros(1),
        reply=np.full(REPLIES, NOT_WANTED), first_number=_integers(REPLIES),
        number_count=_integers(REPLIES), transforms=np.zeros((ALL_TRANSFORMS, 7)),
        frames=_integers(1), drained=_integers(1), log=np.zeros((LOG_CAPACITY, LOG_COLUMNS)),
        states=np.zeros((LOG_CAPACITY, LAYOUT_CAPACITY), np.int8))


def install_layout(hand: HandMemory, layout: MarkerLayout) -> None:
    """Have a hand's markers read and logged as those of a layout.

    Parameters
    ----------
    hand : HandMemory
        Changed.
    layout : MarkerLayout
    """
    hand.listed[0] = listed_count(layout)
    for row, slot in enumerate(layout_rows(layout)):
        if slot >= 0:
            hand.row_of_slot[slot] = row


def install_signature(memory: FastPathMemory, hands: Sequence[HandMemory],
                      signatures: Sequence[MessageSignature], stamp: Time, scale: float,
                      zero_is_missing: bool) -> bool:
    """Install the signature of the messages to process.

    Parameters
    ----------
    memory : FastPathMemory
        Changed.
    hands : sequence of HandMemory
        Of the hands in the message; changed.
    signatures : sequence of MessageSignature
        Of a message that the slow path has decoded, with the sources of each hand.
    stamp : Time
        Of that message.
    scale, zero_is_missing
        See `markers_from_message`.

    Returns
    -------
    bool
        Whether the fast path supports it: points of list markers it does not.
    """
    parser, heads, strings, _ = signatures[0]
    if any(one.sources.first is None or one.sources.has_lists for one in signatures):
        return False
    if len(heads) > len(memory.known_heads) or len(strings) > len(memory.known_strings):
        return False
    memory.parser[0] = parser
    memory.known[:] = len(heads), len(strings)
    memory.known_heads[:len(heads)], memory.known_strings[:len(strings)] = heads, strings
    memory.hand_count[0] = len(hands)
    memory.scale[0], memory.zero_is_missing[0] = scale, zero_is_missing
    for hand, (_, _, _, sources) in zip(hands, signatures):
        count = len(sources.slots)
        hand.first[0], hand.marker_count[0] = sources.first, count
        hand.stamp[:] = stamp.sec, stamp.nanosec
        hand.slots[:count] = hand.row_of_slot[sources.slots]
        hand.markers[:count] = sources.markers
    return True


def install_reply(memory: FastPathMemory | CommandMemory, number: int,
                  template: Template) -> bool:
    """Install a reply to be filled for each frame.

    Parameters
    ----------
    memory : FastPathMemory or CommandMemory
        Changed.
    number : int
        Of the reply, below their number in the memory.
    template : Template

    Returns
    -------
    bool
        Whether it fits.
    """
    body, stamps, numbers = template.body, template.stamps, template.numbers
    if (body.size > memory.replies.shape[1] or len(stamps) > memory.stamps_at.shape[1]
            or len(numbers) > memory.numbers_at.shape[1]):
        return False
    memory.replies[number, :body.size] = body
    memory.stamps[number] = len(stamps)
    memory.stamps_at[number, :len(stamps)] = stamps
    memory.numbers_at[number, :len(numbers)] = numbers
    return True


def install_part(hand: HandMemory, kind: int, reply: int, part: slice) -> None:
    """Have a hand's numbers written into a part of a reply.

    Parameters
    ----------
    hand : HandMemory
        Changed.
    kind : int
        `JOINT_STATES`, `TRANSFORMS` or `ANGLE_DEVIATIONS`.
    reply : int
        Its number.
    part : slice
        Which of the reply's numbers are the hand's.
    """
    hand.reply[kind] = reply
    hand.first_number[kind], hand.number_count[kind] = part.start, part.stop - part.start


@jit
def _copy_payload(memory: FastPathMemory, octets: np.ndarray) -> int:
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
def _matches_signature(memory: FastPathMemory, size: int) -> bool:
    """Return whether the message has the installed signature."""
    # Slices, as numba compiles anew for a record's arrays what `MarkerReader` calls with others.
    count, used = parse_points(
        memory.parser[0], memory.message.view(np.uint8), memory.message.view(np.int32),
        memory.message[:], size, memory.heads[:], memory.places[:], memory.strings[:])
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
def process_message(memories: Pack[FastPathMemory], hands: Sequence[Pack[HandMemory]],
                    packs: Sequence[TrackPacks], octets: np.ndarray) -> bool:
    """Track a message and fill the replies, if it has the installed signature.

    Only regular frames are processed: of one stamp, which goes forward, after the palms were
    seen.

    Parameters
    ----------
    memories : packed FastPathMemory
        Changed.
    hands : tuple of packed HandMemory
        Of the hands in the message, at least; changed.
    packs : tuple of TrackPacks
        For each of `hands`; all but model, chains and options are changed.
    octets : ndarray of uint8, shape (n,)
        The message.

    Returns
    -------
    bool
        Whether it was processed; nothing was tracked if not.
    """
    memory = memories[0]
    size = _copy_payload(memory, octets)
    if size < 0 or not _matches_signature(memory, size):
        return False
    sec, nanosec = _stamp_of(memory, hands[0][0])
    count = memory.hand_count[0]
    # Before any hand is tracked.
    for i in range(count):
        if not _is_next(memory, hands[i][0], packs[i].clock[0], packs[i].state[0], sec, nanosec):
            return False
    for i in range(count):
        _track_hand(memory, hands[i][0], packs[i], sec, nanosec)
    return True


@jit
def _stamp_of(memory: FastPathMemory, hand: HandMemory) -> tuple[int, int]:
    """Return seconds and nanoseconds of the stamp of a hand's markers."""
    at = memory.places[hand.first[0], 0]
    words = memory.message.view(np.int32)
    return np.int64(words[at]), np.int64(words[at + 1]) & 0xffffffff


@jit
def _is_next(memory: FastPathMemory, hand: HandMemory, clock: FrameClock, state: State,
             sec: int, nanosec: int) -> bool:
    """Return whether a stamp is that of a hand's markers, and a later one than the last."""
    own_sec, own_nanosec = _stamp_of(memory, hand)
    if own_sec != sec or own_nanosec != nanosec or not state.wrist.placed[0]:
        return False
    # False for NaN, the time of an unset stamp.
    if not stamp_time(sec, nanosec) > clock.last[0]:
        return False
    # A time that the clock has not believed may come again.
    return not is_repeated(sec, nanosec, hand.stamp[0], hand.stamp[1])


@jit
def _track_hand(memory: FastPathMemory, hand: HandMemory, packs: TrackPacks, sec: int,
                nanosec: int) -> None:
    """Track a hand's markers of the message, and fill its parts of the replies."""
    model, chains, options, clock, blank, state, report = packs
    count, rows = hand.marker_count[0], hand.rows[:model[0].rows.used[0]]
    gather_positions(memory.message[:], memory.places[:], hand.slots[:count], hand.markers[:count],
                     memory.scale[0], memory.zero_is_missing[0] > 0, rows)
    hand.stamp[0], hand.stamp[1], hand.time[0] = sec, nanosec, stamp_time(sec, nanosec)
    track_frame(model, chains, options, clock, blank, state, report, rows, hand.time[0])
    _fill_replies(memory, hand, model[0].table.parent, report[0])


@jit
def _fill_replies(memory: FastPathMemory, hand: HandMemory, parent: np.ndarray,
                  report: Report) -> None:
    """Write stamp and numbers of a hand's frame into its parts of the replies."""
    if hand.reply[JOINT_STATES] != NOT_WANTED:
        _fill_part(memory, hand, JOINT_STATES, report.angles)
    if hand.reply[TRANSFORMS] != NOT_WANTED:
        transforms = hand.transforms[:hand.number_count[TRANSFORMS] // 7]
        write_transforms(parent, report.link_rotations, report.link_positions,
                        report.wrist_rotation, report.wrist_position, transforms)
        _fill_part(memory, hand, TRANSFORMS, transforms.reshape(transforms.size))
    if hand.reply[ANGLE_DEVIATIONS] != NOT_WANTED:
        _fill_part(memory, hand, ANGLE_DEVIATIONS, report.deviation)


@jit
def _fill_part(memory: FastPathMemory, hand: HandMemory, kind: int, numbers: np.ndarray) -> None:
    reply, first = hand.reply[kind], hand.first_number[kind]
    doubles = memory.replies[reply]
    fill_template(doubles.view(np.uint32), doubles, memory.stamps_at[reply, :memory.stamps[reply]],
                  memory.numbers_at[reply, first:first + hand.number_count[kind]], hand.stamp[0],
                  hand.stamp[1], numbers)


@jit
def log_frame(hand: HandMemory, report: Report, received: float, published: float) -> None:
    """Log the last frame of a hand.

    Parameters
    ----------
    hand : HandMemory
        Changed.
    report : Report
    received, published : float
        [s]
    """
    at = hand.frames[0] % LOG_CAPACITY
    log = hand.log
    log[at, RECEIVED], log[at, PUBLISHED], log[at, TIME] = received, published, hand.time[0]
    listed = hand.listed[0]
    log[at, PALM_STATE] = report.palm[0]
    if listed:
        log[at, RESIDUAL] = mean_residual(report.listed[:listed, LISTED_RESIDUAL])
        for i in range(listed):
            hand.states[at, i] = report.listed_states[i]
    else:
        log[at, RESIDUAL] = mean_residual(report.residuals)
        for i in range(len(report.marker_states)):
            hand.states[at, i] = report.marker_states[i]
    hand.frames[0] += 1


@jit
def drain_log(hands: Pack[HandMemory], reports: Pack[Report], log: np.ndarray,
              states: np.ndarray, last_report: Pack[Report]) -> tuple[int, int]:
    """Copy the log of a hand since the last call, and its last frame's report.

    Parameters
    ----------
    hands : packed HandMemory
        Changed.
    reports : packed Report
    log, states : ndarray
        Of the shapes in `HandMemory`; filled.
    last_report : packed Report
        Filled.

    Returns
    -------
    logged, frames : int
        Rows that are filled, and frames processed since the last call.
    """
    hand = hands[0]
    frames = hand.frames[0] - hand.drained[0]
    logged = min(frames, LOG_CAPACITY)
    for i in range(logged):
        at = (hand.frames[0] - logged + i) % LOG_CAPACITY
        log[i] = hand.log[at]
        states[i] = hand.states[at]
    hand.drained[0] = hand.frames[0]
    if logged:
        overwrite(last_report, reports)
    return logged, frames


def state_runs(log: np.ndarray, states: np.ndarray) -> list[tuple[float, StateRun]]:
    """Group logged frames into runs in which the states of palm and markers stay the same.

    Parameters
    ----------
    log, states : ndarray, shape (n, 5) and (n, m)
        See `drain_log`.

    Returns
    -------
    list of (float, StateRun)
        When the first frame of each run was published, and the last [s].
    """
    is_new = ((states[1:] != states[:-1]).any(axis=1)
              | (log[1:, PALM_STATE] != log[:-1, PALM_STATE]))
    found: list[tuple[float, StateRun]] = []
    for run in np.split(np.arange(len(log)), np.flatnonzero(is_new) + 1):
        state = StateRun(PALM_STATES[int(log[run[0], PALM_STATE])], states[run[0]],
                         log[run, RESIDUAL].mean(keepdims=True))
        found += [(at, state) for at in np.unique(log[run[[0, -1]], PUBLISHED]).tolist()]
    return found
