"""Packets of a system like the last one, from its socket to the fast path in compiled code alone.

What a source node decodes and writes in Python costs several times what the tracker does. But a
system's packets are alike for minutes: of those only the numbers are read, at the places where the
last one had them, and written into the message that was made of it. The thread waits for a packet
and answers it without the interpreter, which notes afterwards what came.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...adapters import clock_estimate
from ...adapters.marker_arrays import MarkerArrayWriter
from ...adapters.packet_reception import MOST_AT_ONCE, ReceivedPacket
from ...adapters.packet_structure import NO_PLACE, POINT_SIZE, PacketOrigin, PacketStructure
from ...core.numerics.jit import COMPILED, c_callback, jit
from ...core.numerics.packs import Pack, packed
from ...messages.cdr import ENCAPSULATION
from ...messages.templates import Template, fill_template
from .callback_path import monotonic_ns
from .rcl import Rcl, address
from .track_kernel import MESSAGE_CAPACITY

if TYPE_CHECKING:
    from .track_path import FastPath

if COMPILED:
    from .rcl import at, call
    from .track_path import HANDED_OVER

PACKET_CAPACITY = MOST_AT_ONCE   # [bytes] of a packet that is relayed
MOST_SOCKETS = 2
# pollfd as a number, of Linux: the file, POLLIN, and what was found
FILE_MASK, WAITS_FOR_DATA, FOUND_SHIFT = 2**32 - 1, 1 << 32, 48
MSG_DONTWAIT = 0x40
REST_MS = 1               # [ms] after an answer, if no packet comes
NOTHING_CAME = -1         # in place of a number of bytes
POINTS_CAPACITY = 2**10   # points of a packet, and stamps of a message
PART_MS = 1               # [ms] at most between parts of a packet in a stream
SIZE_BYTES = 4            # with which a packet of a stream begins: its size
NO_PACKET = -1
LARGEST_NUMBER = 2**63 - 1   # of the numbers that go up; one above is taken for a negative one
LONGEST_WAY = 1.          # [s] from exposure to receipt; else one of the clocks was set
_local_time = jit(clock_estimate.local_time)


class RelayMemory(NamedTuple):
    """Byte layout of the packets to relay, and the message that their numbers are written to.

    Attributes
    ----------
    size : ndarray of int, shape (1,)
        Of the packets, `NO_PACKET` for none [bytes].
    mask, bits : ndarray of uint8, shape (PACKET_CAPACITY,)
        Bits that decide how a packet is read, and what they are.
    marker_count : ndarray of int, shape (1,)
    markers, marker_numbers : ndarray of int, shape (POINTS_CAPACITY,)
        Of each marker: its place in the packet, and its first number in the message.
    may_be_filled : ndarray of bool, shape (POINTS_CAPACITY,)
    filled_count, labelled_count, repeated : ndarray of int, shape (1,)
    filled_in, labelled : ndarray of int, shape (POINTS_CAPACITY,)
        See `PacketOrigin`.
    point_count, room : ndarray of int, shape (1,)
    points : ndarray of int, shape (POINTS_CAPACITY,)
        Places of anonymous points in the packet.
    point_numbers : ndarray of int, shape (POINTS_CAPACITY,)
        First numbers of the places for such points in the message, of which there are `room`.
    turn : ndarray, shape (3, 3)
        By which they are multiplied.
    order, time : ndarray of int, shape (1,)
        Places of a number that goes up with each packet, and of the exposure.
    last : ndarray of int, shape (1,)
        The number that goes up, of the last packet.
    tick : ndarray, shape (1,)
        Of the exposure [s].
    clock : ndarray, shape (5,)
        Numbers of the `ClockLine`.
    wall : ndarray of int, shape (1,)
        See `wall_offset` [ns].
    message : ndarray, shape (MESSAGE_CAPACITY // 8,)
        After half a double, so that all behind its encapsulation is aligned.
    message_size : ndarray of int, shape (1,)
    stamps : ndarray of int, shape (POINTS_CAPACITY,)
        Where its stamps are, by four bytes.
    stamp_count : ndarray of int, shape (1,)
    polled : ndarray of int, shape (MOST_SOCKETS,)
        Each a pollfd: file descriptor, and what is waited for.
    packet : ndarray of uint8, shape (MOST_AT_ONCE,)
        What was received.
    now : ndarray of int, shape (2,)
        Seconds and nanoseconds of clock_gettime.
    received : ndarray of int, shape (1,)
        When, of the monotonic clock [ns].
    is_relayed : ndarray of int, shape (1,)
        Whether it was tracked.
    handed, callback, context : int
        Addresses, of the fast path.
    poll, receive, get_time : int
        C functions.
    """

    size: np.ndarray
    mask: np.ndarray
    bits: np.ndarray
    marker_count: np.ndarray
    markers: np.ndarray
    marker_numbers: np.ndarray
    may_be_filled: np.ndarray
    filled_count: np.ndarray
    filled_in: np.ndarray
    labelled_count: np.ndarray
    labelled: np.ndarray
    repeated: np.ndarray
    point_count: np.ndarray
    points: np.ndarray
    room: np.ndarray
    point_numbers: np.ndarray
    turn: np.ndarray
    order: np.ndarray
    time: np.ndarray
    last: np.ndarray
    tick: np.ndarray
    clock: np.ndarray
    wall: np.ndarray
    message: np.ndarray
    message_size: np.ndarray
    stamps: np.ndarray
    stamp_count: np.ndarray
    polled: np.ndarray
    packet: np.ndarray
    now: np.ndarray
    received: np.ndarray
    is_relayed: np.ndarray
    handed: int
    callback: int
    context: int
    poll: int
    receive: int
    get_time: int


def new_relay_memory(handed: int = 0, callback: int = 0, context: int = 0, poll: int = 0,
                     receive: int = 0, get_time: int = 0) -> RelayMemory:
    """Return a `RelayMemory` with nothing installed."""
    def integers(size: int) -> np.ndarray:
        return np.zeros(size, np.int64)

    return RelayMemory(
        np.array([NO_PACKET]), np.zeros(PACKET_CAPACITY, np.uint8),
        np.zeros(PACKET_CAPACITY, np.uint8), integers(1), integers(POINTS_CAPACITY),
        integers(POINTS_CAPACITY), np.zeros(POINTS_CAPACITY, bool), integers(1),
        integers(POINTS_CAPACITY), integers(1), integers(POINTS_CAPACITY), integers(1),
        integers(1), integers(POINTS_CAPACITY), integers(1), integers(POINTS_CAPACITY),
        np.eye(3), integers(1), integers(1), integers(1), np.ones(1),
        np.zeros(5), integers(1), np.zeros(MESSAGE_CAPACITY // 8), integers(1),
        integers(POINTS_CAPACITY), integers(1), integers(MOST_SOCKETS),
        np.zeros(MOST_AT_ONCE, np.uint8), integers(2), integers(1), integers(1), handed,
        callback, context, poll, receive, get_time)


def install_origin(memory: RelayMemory, origin: PacketOrigin, markers: np.ndarray,
                   points: np.ndarray, template: Template) -> None:
    """Have packets relayed that are like the last one.

    Parameters
    ----------
    memory : RelayMemory
        Changed.
    origin : PacketOrigin
    markers, points : ndarray of int
        Rows in the message, see `MarkerArrayWriter.rows`.
    template : Template
        With the message of that packet.
    """
    memory.size[0] = NO_PACKET
    data, mask = origin.structure.data, origin.structure.mask
    if (len(data) > PACKET_CAPACITY
            or max(map(len, (origin.markers, origin.points, origin.filled_in, origin.labelled,
                             points, template.stamps))) > POINTS_CAPACITY
            or len(template.body) > len(memory.message)):
        return
    size, numbers = len(data), template.numbers[::3]
    shown = origin.markers != NO_PLACE
    # Hidden ones are NaN in the template already, and stay so.
    _put(memory.markers, origin.markers[shown], memory.marker_count)
    _put(memory.marker_numbers, numbers[markers][shown], memory.marker_count)
    memory.may_be_filled[:] = False
    if len(origin.may_be_filled):
        memory.may_be_filled[:shown.sum()] = origin.may_be_filled[shown]
    _put(memory.filled_in, origin.filled_in, memory.filled_count)
    _put(memory.labelled, origin.labelled, memory.labelled_count)
    _put(memory.points, origin.points, memory.point_count)
    _put(memory.point_numbers, numbers[points], memory.room)
    memory.repeated[0] = origin.repeated
    memory.mask[:size] = np.frombuffer(mask, np.uint8)
    memory.bits[:size] = np.frombuffer(data, np.uint8) & memory.mask[:size]
    memory.turn[:] = origin.turn
    memory.order[0], memory.time[0], memory.tick[0] = origin.order, origin.time, origin.tick
    memory.message[:len(template.body)] = template.body
    memory.message_size[0] = template.size
    memory.stamps[:len(template.stamps)] = template.stamps
    memory.stamp_count[0] = len(template.stamps)
    memory.size[0] = size


def _put(target: np.ndarray, values: np.ndarray, count: np.ndarray) -> None:
    """Put values, and how many they are, into memory."""
    target[:len(values)], count[0] = values, len(values)


@jit
def _is_one_of(point: np.ndarray, packet: np.ndarray, places: np.ndarray) -> bool:
    """Return whether one of a packet's positions is that of a point; false for NaN."""
    for place in places:
        other = packet[place:place + POINT_SIZE].view(np.float32)
        if point[0] == other[0] and point[1] == other[1] and point[2] == other[2]:
            return True
    return False


@jit
def _put_point(message: np.ndarray, first: int, turn: np.ndarray, x: float, y: float,
               z: float) -> None:
    """Write a position into a message, turned."""
    for i in range(3):
        message[first + i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z


@jit
def fill_message(memories: Pack[RelayMemory], packet: np.ndarray, received: int) -> bool:
    """Write a packet's numbers into the message, stamped by the clock as it was estimated before.

    Parameters
    ----------
    memories : packed RelayMemory
        Changed.
    packet : ndarray of uint8, shape (n,)
    received : int
        When, of the monotonic clock [ns].

    Returns
    -------
    bool
        Whether it is a later one of those that are relayed, with no more points than the message
        has places for, of a time that leaves the estimate of the clock about as it is.
    """
    memory = memories[0]
    size = memory.size[0]
    if len(packet) != size:
        return False
    for i in range(size):
        if packet[i] & memory.mask[i] != memory.bits[i]:
            return False
    if packet[memory.order[0]:memory.order[0] + 8].view(np.int64)[0] <= memory.last[0]:
        return False
    turn, message = memory.turn, memory.message
    filled_in = memory.filled_in[:memory.filled_count[0]]
    for k in range(memory.marker_count[0]):
        place, first = memory.markers[k], memory.marker_numbers[k]
        point = packet[place:place + POINT_SIZE].view(np.float32)
        x, y, z = float(point[0]), float(point[1]), float(point[2])
        if (not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z))
                or memory.may_be_filled[k] and _is_one_of(point, packet, filled_in)):
            message[first:first + 3] = np.nan
        else:
            _put_point(message, first, turn, x, y, z)
    labelled, row = memory.labelled[:memory.labelled_count[0]], 0
    for k in range(memory.point_count[0]):
        place = memory.points[k]
        point = packet[place:place + POINT_SIZE].view(np.float32)
        x, y, z = float(point[0]), float(point[1]), float(point[2])
        if (not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z))
                or k < memory.repeated[0] and _is_one_of(point, packet, labelled)):
            continue
        if row == memory.room[0]:
            return False
        _put_point(message, memory.point_numbers[row], turn, x, y, z)
        row += 1
    for k in range(row, memory.room[0]):
        first = memory.point_numbers[k]
        message[first:first + 3] = np.nan
    exposed = memory.tick[0] * packet[memory.time[0]:memory.time[0] + 8].view(np.int64)[0]
    clock = memory.clock
    local = _local_time(exposed, clock[0], clock[1], clock[2], clock[3], clock[4])
    # False for NaN, too.
    if not 0. <= 1e-9 * received - local < LONGEST_WAY:
        return False
    nanoseconds = np.int64(np.round(1e9 * local)) + memory.wall[0]
    sec = nanoseconds // 1_000_000_000
    # The numbers are there already.
    fill_template(message.view(np.uint32), message, memory.stamps[:memory.stamp_count[0]],
                  memory.points[:0], sec, nanoseconds - 1_000_000_000 * sec, message)
    return True


class PacketRelay:
    """Relay of the packets of one system to a fast path.

    Parameters
    ----------
    fast_path : FastPath
    """

    def __init__(self, fast_path: FastPath) -> None:
        rcl = Rcl()
        self._memories, self._memory = packed(new_relay_memory(
            *fast_path.entrance, address(rcl.poll), address(rcl.receive),
            address(rcl.get_time)), as_record=True)
        # It stays while it is called, even if nobody else has it any more.
        self._fast_path = fast_path
        self._callback = _receive_callback(self._memories.dtype)
        self._call, self._address = self._callback.ctypes, self._memories.ctypes.data
        self._origin: PacketOrigin | None = None
        self._installed: tuple[PacketStructure, Template] | None = None

    def install(self, origin: PacketOrigin | None, writer: MarkerArrayWriter) -> None:
        """Relay packets like the last one, which was handed over; none where it has no origin.

        Parameters
        ----------
        origin : PacketOrigin or None
        writer : MarkerArrayWriter
            That wrote its message.
        """
        if origin is None:
            self._memory.size[0] = NO_PACKET
            return
        if self._installed != (origin.structure, writer.template) or (
                self._memory.size[0] == NO_PACKET):
            install_origin(self._memory, *writer.rows(origin), writer.template)
        self._origin, self._installed = origin, (origin.structure, writer.template)
        self._keep_time()

    def _keep_time(self) -> None:
        assert self._origin is not None
        number, line, self._memory.wall[0] = self._origin.now()
        self._memory.last[0] = min(number, LARGEST_NUMBER)
        self._memory.clock[:] = line

    def receive(self, sockets: Sequence[int], timeout: float,
                is_stream: bool = False) -> Sequence[ReceivedPacket]:
        """Receive on one of at most `MOST_SOCKETS` sockets, and track a packet that is alike.

        Parameters
        ----------
        sockets, timeout, is_stream
            See `Relay`.
        """
        memory = self._memory
        for place, file in enumerate(sockets):
            memory.polled[place] = WAITS_FOR_DATA | file
        size = self._call(self._address, len(sockets), round(1e3 * timeout), is_stream)
        if size == NOTHING_CAME:
            return ()
        data, received = memory.packet[:size].tobytes(), int(memory.received[0])
        is_relayed = bool(memory.is_relayed[0])
        if is_relayed:
            assert self._origin is not None
            self._origin.follow(data, received)
            self._keep_time()
        return ReceivedPacket(data, received, is_relayed),

    def message(self) -> bytes:
        """Return the message of the last packet."""
        return self._memory.message.tobytes()[ENCAPSULATION:][:int(self._memory.message_size[0])]


def _receive_callback(of_memory: np.dtype) -> Any:
    """Return the compiled function that receives and relays, for memory of this layout."""
    import numba

    @c_callback('int64(voidptr, int64, int64, int64)')
    def receive(address: Any, sockets: Any, milliseconds: Any, is_stream: Any) -> Any:
        memories = numba.carray(address, (1,), of_memory)
        memory = memories[0]
        memory.is_relayed[0] = 0
        if call(memory.poll, memory.polled.ctypes.data, sockets, milliseconds, 0) <= 0:
            return NOTHING_CAME
        ready = 0
        while ready < sockets - 1 and memory.polled[ready] >> FOUND_SHIFT == 0:
            ready += 1
        # Of a stream no more than a packet that is alike: what follows may be the next one.
        most = (memory.size[0] if is_stream and memory.size[0] != NO_PACKET
                else len(memory.packet))
        size = call(memory.receive, memory.polled[ready] & FILE_MASK, memory.packet.ctypes.data,
                    most, MSG_DONTWAIT)
        if size < 0:
            return NOTHING_CAME
        # The rest of a packet that comes in parts.
        while (is_stream and SIZE_BYTES <= size < most
               and size < memory.packet[:SIZE_BYTES].view(np.uint32)[0]
               and call(memory.poll, memory.polled.ctypes.data, sockets, PART_MS, 0) > 0):
            more = call(memory.receive, memory.polled[ready] & FILE_MASK,
                        memory.packet.ctypes.data + size, most - size, MSG_DONTWAIT)
            if more <= 0:
                break
            size += more
        memory.received[0] = monotonic_ns(memory)
        if not fill_message(memories, memory.packet[:size], memory.received[0]):
            return size
        handed = numba.carray(at(memory.handed), (3,), np.int64)
        handed[0] = memory.message.ctypes.data + ENCAPSULATION
        handed[1], handed[2] = memory.message_size[0], 0
        call(memory.callback, memory.context, HANDED_OVER, 0, 0)
        memory.is_relayed[0] = handed[2]
        if handed[2]:
            # Else Python's work takes the processor from who waits for the answer: on two cores
            # that came 0.2 ms later.
            call(memory.poll, memory.polled.ctypes.data, sockets, REST_MS, 0)
        return size

    return receive
