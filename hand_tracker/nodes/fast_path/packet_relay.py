"""Packets of a system like the last one, from its bytes to the fast path in compiled code alone.

What a source node decodes and writes in Python costs several times what the tracker does. But a
system's packets are alike for minutes: of those only the numbers are read, at the places where the
last one had them, and written into the message that was made of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...adapters import clock_estimate
from ...adapters.marker_arrays import MarkerArrayWriter
from ...adapters.packet_structure import POINT_SIZE, PacketOrigin, PacketStructure
from ...core.numerics.jit import CACHE_FOLDER, COMPILED, DEFERRED, Pack, jit, packed
from ...messages.cdr import ENCAPSULATION
from ...messages.templates import Template, fill_template
from .kernel import MESSAGE_CAPACITY

if TYPE_CHECKING:
    from .middleware import FastPath

if COMPILED:
    from .middleware import HANDED_OVER
    from .rcl import at, call

PACKET_CAPACITY = 2**13   # [bytes]
POINTS_CAPACITY = 2**8    # points of a packet, and stamps of a message
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
    point_count : ndarray of int, shape (1,)
    places, numbers : ndarray of int, shape (POINTS_CAPACITY,)
        Of each point: its place in the packet, and its first number in the message.
    turn : ndarray, shape (3, 3)
        By which they are multiplied.
    order, time : ndarray of int, shape (1,)
        Places of a number that goes up with each packet, and of the exposure.
    last : ndarray of int, shape (1,)
        The number that goes up, of the last packet.
    tick : ndarray, shape (1,)
        Of the exposure [s].
    clock : ndarray, shape (3,)
        Offset, drift, centre: see `ClockEstimate.line`.
    wall : ndarray of int, shape (1,)
        See `wall_offset` [ns].
    message : ndarray, shape (MESSAGE_CAPACITY // 8,)
        After half a double, so that all behind its encapsulation is aligned.
    message_size : ndarray of int, shape (1,)
    stamps : ndarray of int, shape (POINTS_CAPACITY,)
        Where its stamps are, by four bytes.
    stamp_count : ndarray of int, shape (1,)
    handed, callback, context : int
        Addresses, of the fast path.
    """

    size: np.ndarray
    mask: np.ndarray
    bits: np.ndarray
    point_count: np.ndarray
    places: np.ndarray
    numbers: np.ndarray
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
    handed: int
    callback: int
    context: int


def new_relay_memory(handed: int = 0, callback: int = 0, context: int = 0) -> RelayMemory:
    """Return a `RelayMemory` with nothing installed."""
    def integers(size: int) -> np.ndarray:
        return np.zeros(size, np.int64)

    return RelayMemory(
        np.array([NO_PACKET]), np.zeros(PACKET_CAPACITY, np.uint8),
        np.zeros(PACKET_CAPACITY, np.uint8), integers(1), integers(POINTS_CAPACITY),
        integers(POINTS_CAPACITY), np.eye(3), integers(1), integers(1), integers(1), np.ones(1),
        np.zeros(3), integers(1), np.zeros(MESSAGE_CAPACITY // 8), integers(1),
        integers(POINTS_CAPACITY), integers(1), handed, callback, context)


def install_origin(memory: RelayMemory, origin: PacketOrigin, places: np.ndarray,
                   rows: np.ndarray, template: Template) -> None:
    """Have packets relayed that are like the last one.

    Parameters
    ----------
    memory : RelayMemory
        Changed.
    origin : PacketOrigin
    places : ndarray of int, shape (n,)
        Of its points in the packet.
    rows : ndarray of int, shape (n,)
        Of the message's markers that these are.
    template : Template
        With the message of that packet.
    """
    memory.size[0] = NO_PACKET
    data, mask = origin.structure.data, origin.structure.mask
    if (len(data) > PACKET_CAPACITY or len(places) > POINTS_CAPACITY
            or len(template.stamps) > POINTS_CAPACITY
            or len(template.body) > len(memory.message)):
        return
    size, count, numbers = len(data), len(places), template.numbers[::3][rows]
    memory.mask[:size] = np.frombuffer(mask, np.uint8)
    memory.bits[:size] = np.frombuffer(data, np.uint8) & memory.mask[:size]
    memory.point_count[0], memory.places[:count], memory.numbers[:count] = count, places, numbers
    memory.turn[:] = origin.turn
    memory.order[0], memory.time[0], memory.tick[0] = origin.order, origin.time, origin.tick
    memory.message[:len(template.body)] = template.body
    memory.message_size[0] = template.size
    memory.stamps[:len(template.stamps)] = template.stamps
    memory.stamp_count[0] = len(template.stamps)
    memory.size[0] = size


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
        Whether it is a later one of those that are relayed, with all its points, of a time that
        leaves the estimate of the clock about as it is.
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
    for k in range(memory.point_count[0]):
        place, first = memory.places[k], memory.numbers[k]
        point = packet[place:place + POINT_SIZE].view(np.float32)
        x, y, z = float(point[0]), float(point[1]), float(point[2])
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
            return False
        for i in range(3):
            message[first + i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
    exposed = memory.tick[0] * packet[memory.time[0]:memory.time[0] + 8].view(np.int64)[0]
    local = _local_time(exposed, memory.clock[0], memory.clock[1], memory.clock[2])
    # False for NaN, too.
    if not 0. <= 1e-9 * received - local < LONGEST_WAY:
        return False
    nanoseconds = np.int64(np.round(1e9 * local)) + memory.wall[0]
    sec = nanoseconds // 1_000_000_000
    # The numbers are there already.
    fill_template(message.view(np.uint32), message, memory.stamps[:memory.stamp_count[0]],
                  memory.numbers[:0], sec, nanoseconds - 1_000_000_000 * sec, message)
    return True


class PacketRelay:
    """Relay of the packets of one system to a fast path.

    Parameters
    ----------
    fast_path : FastPath
    """

    def __init__(self, fast_path: FastPath) -> None:
        self._memories, self._memory = packed(
            new_relay_memory(*fast_path.entrance), as_record=True)
        self._callback = _relay_callback(self._memories.dtype)
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
            install_origin(self._memory, origin, *writer.places(origin), writer.template)
        self._origin, self._installed = origin, (origin.structure, writer.template)
        self._keep_time()

    def _keep_time(self) -> None:
        assert self._origin is not None
        number, line, self._memory.wall[0] = self._origin.now()
        self._memory.last[0] = min(number, LARGEST_NUMBER)
        self._memory.clock[:] = line

    def relay(self, packet: bytes, received: int) -> bool:
        """Hand over a packet, received at a time of the monotonic clock [ns], if it is alike.

        Returns
        -------
        bool
            Whether it was tracked.
        """
        if not self._call(self._address, packet, len(packet), received):
            return False
        assert self._origin is not None
        self._origin.follow(packet, received)
        self._keep_time()
        return True

    def message(self) -> bytes:
        """Return the message of the last packet."""
        return self._memory.message.tobytes()[ENCAPSULATION:][:int(self._memory.message_size[0])]


def _relay_callback(of_memory: np.dtype) -> Any:
    """Return the compiled function that relays a packet, for memory of this layout."""
    import numba

    @numba.cfunc('int64(voidptr, voidptr, uintp, int64)', error_model='numpy',
                 cache=DEFERRED or CACHE_FOLDER is not None)
    def relay_packet(address: Any, data: Any, size: Any, received: Any) -> Any:
        memories = numba.carray(address, (1,), of_memory)
        if not fill_message(memories, numba.carray(data, (size,), np.uint8), received):
            return 0
        memory = memories[0]
        handed = numba.carray(at(memory.handed), (3,), np.int64)
        handed[0] = memory.message.ctypes.data + ENCAPSULATION
        handed[1], handed[2] = memory.message_size[0], 0
        call(memory.callback, memory.context, HANDED_OVER, 0, 0)
        return handed[2]

    return relay_packet
