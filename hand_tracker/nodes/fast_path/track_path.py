"""The tracker's fast path: a callback takes messages of markers, tracks and publishes."""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription

from ...core.model.marker_layout import MARKERS, MarkerLayout
from ...core.model.marker_rows import LAYOUT_CAPACITY
from ...core.numerics.jit import COMPILED, c_callback, jit, load_kernel
from ...core.numerics.packs import empty_like_pack, packed
from ...core.tracker import HandTracker
from ...messages.cdr import MessageSignature
from ...messages.stamps import Stamp, Time
from ...messages.templates import Template
from ...tracking.monitor import TrackedFrames
from ..serialization import Reply
from .callback_path import (
    C_FUNCTIONS,
    INFO_PUBLISHER,
    INFO_WORDS,
    TAKE_CAPACITY,
    CallbackPath,
    monotonic_time,
    publish_all,
    set_enabled,
)
from .rcl import address
from .track_kernel import (
    LOG_CAPACITY,
    LOG_COLUMNS,
    MOST_HANDS,
    MOST_REPLIES,
    NOT_WANTED,
    PUBLISHED,
    RECEIVED,
    TIME,
    TrackPacks,
    drain_log,
    install_layout,
    install_part,
    install_reply,
    install_signature,
    log_frame,
    new_hand_memory,
    new_memory,
    process_message,
    state_runs,
)

if COMPILED:
    from numba import carray

    from .rcl import at, call

# New messages, of the callback, when the executor's thread calls it, or who hands over a message.
WHILE_DISABLED, HANDED_OVER = 0, 2**31
PUBLISHER_SILENCE = 1.   # [s] of the publisher that is tracked before another one is
KEPT_CAPACITY = 2**20    # [bytes] of a message that stay allocated


class CallbackContext(NamedTuple):
    """Context of the compiled callback: addresses, but for the first arrays.

    Attributes
    ----------
    is_enabled : ndarray of int, shape (1,)
    has_missed_message : ndarray of int, shape (1,)
        Whether the incoming message was taken, but not processed.
    now : ndarray of int, shape (2,)
        Seconds and nanoseconds of clock_gettime.
    info : ndarray of int, shape (INFO_WORDS,)
        rmw_message_info_t of the last message that was taken.
    publisher : ndarray of int, shape (2,)
        GUID of the one whose messages are tracked.
    heard : ndarray, shape (1,)
        When it was heard last [s].
    silence : ndarray, shape (1,)
        For how long before another one is tracked; 0 for all publishers [s].
    other : ndarray of int, shape (2,)
        GUID of the last publisher whose message was left out.
    left_out : ndarray of int, shape (1,)
        Messages of others that were left out.
    handed : ndarray of int, shape (3,)
        Address and size of the message that is handed over, and whether it was processed.
    memory : int
    hands : ndarray of int, shape (MOST_HANDS,)
        Addresses of the memories of the hands in a message, filled up with the first.
    packs : ndarray of int, shape (MOST_HANDS, 7)
        Addresses of each hand's arguments of `track_frame` before the markers.
    publishers, outgoing : ndarray of int, shape (MOST_REPLIES,)
        0 where a reply is not wanted.
    incoming, mutex : int
    subscription, timer : ndarray of int, shape (1,)
    take, publish, reset_error, reset_timer, lock, unlock, get_time : int
        C functions.
    """

    is_enabled: np.ndarray
    has_missed_message: np.ndarray
    now: np.ndarray
    info: np.ndarray
    publisher: np.ndarray
    heard: np.ndarray
    silence: np.ndarray
    other: np.ndarray
    left_out: np.ndarray
    handed: np.ndarray
    memory: int
    hands: np.ndarray
    packs: np.ndarray
    publishers: np.ndarray
    outgoing: np.ndarray
    incoming: int
    mutex: int
    subscription: np.ndarray
    timer: np.ndarray
    take: int
    publish: int
    reset_error: int
    reset_timer: int
    lock: int
    unlock: int
    get_time: int


class InstalledHand(NamedTuple):
    """A hand in the messages to process.

    Attributes
    ----------
    number : int
        Of the hand, below `MOST_HANDS`.
    packs : tuple
        As of `HandTracker.kernel_arguments`.
    layout : MarkerLayout
    signature : MessageSignature
    """

    number: int
    packs: tuple[Any, ...]
    layout: MarkerLayout
    signature: MessageSignature


class FastPath(CallbackPath):
    """The fast path of one subscription.

    Parameters
    ----------
    packs : tuple
        As of `HandTracker.kernel_arguments`, of compiled kernels.
    folder : Path, optional
        Cache folder of the kernels; the user's when left out.

    Raises
    ------
    FastPathUnavailable
    KernelsUnavailable
        If its kernels are neither compiled here nor on disk.

    Attributes
    ----------
    KERNEL_SET : str
        Name of its set of kernels, as of `jit.is_ready`.
    PROGRAM : str
        Module that compiles them, run as ``python -m``.
    """

    KERNEL_SET = 'fast_path'
    PROGRAM = f'{__package__}.compile_fast_path'

    def __init__(self, packs: tuple[Any, ...], folder: Path | None = None) -> None:
        super().__init__()
        report = TrackPacks(*packs).report
        self._packs = [TrackPacks(*packs)] * MOST_HANDS
        self._templates: dict[int, Template] = {}
        self._memories, self._memory = packed(new_memory(), as_record=True)
        hands = [packed(new_hand_memory(), as_record=True) for _ in range(MOST_HANDS)]
        self._hand_packs, self._hands = zip(*hands)
        self._log = np.zeros((LOG_CAPACITY, LOG_COLUMNS))
        self._states = np.zeros((LOG_CAPACITY, LAYOUT_CAPACITY), np.int8)
        self._outgoing = [self._rcl.octets() for _ in range(MOST_REPLIES)]
        zeros = partial(np.zeros, dtype=np.int64)
        self._contexts, self._context = packed(CallbackContext(
            is_enabled=zeros(1), has_missed_message=zeros(1), now=zeros(2),
            info=zeros(INFO_WORDS), publisher=zeros(2), heard=np.full(1, -np.inf),
            silence=np.zeros(1), other=zeros(2), left_out=zeros(1), handed=zeros(3),
            memory=self._memories.ctypes.data, hands=zeros(MOST_HANDS),
            packs=zeros((MOST_HANDS, len(packs))), publishers=zeros(MOST_REPLIES),
            outgoing=np.array([ctypes.addressof(octets) for octets in self._outgoing]),
            incoming=ctypes.addressof(self._incoming), mutex=ctypes.addressof(self._mutex),
            subscription=zeros(1), timer=zeros(1),
            **{name: address(getattr(self._rcl, name)) for name in C_FUNCTIONS}),
            as_record=True)
        self._set_enabled = load_kernel(set_enabled, (self._contexts, False), folder)
        self._admit_publisher = load_kernel(_admit_publisher, (self._contexts,), folder)
        self._drain = load_kernel(_drain, (
            self._contexts, self._hand_packs[0], report, self._log, self._states,
            empty_like_pack(report)), folder)
        self._callback = _callback(
            self._contexts.dtype, self._memories.dtype, self._hand_packs[0].dtype,
            *(pack.dtype for pack in packs))
        self._handed, self._waiting = self._context.handed, deque[bytes]()
        self._call, self._address = self._callback.ctypes, self._contexts.ctypes.data
        # Compiled before the first frame waits for them.
        self.drain(0)
        self._set_enabled(self._contexts, False)

    def start(self, node: Node, subscription: Subscription | None,
              on_disabled: Callable[[], None], on_message: Callable[[bytes], None],
              keeps_publisher: bool = False, waiting: deque[bytes] | None = None) -> None:
        """Take the messages of a subscription, as `CallbackPath.start` does.

        Parameters
        ----------
        node, subscription, on_disabled, on_message
            See there.
        keeps_publisher : bool, optional
            Whether messages of others than the first publisher are left out, until it has been
            silent for `PUBLISHER_SILENCE`.
        waiting : deque of bytes, optional
            Messages that were handed over and wait for the slow path.
        """
        if waiting is not None:
            self._waiting = waiting
        self._context.silence[0] = PUBLISHER_SILENCE if keeps_publisher else 0.
        super().start(node, subscription, on_disabled, on_message)

    def install(self, hands: Sequence[InstalledHand], stamp: Time, scale: float,
                zero_is_missing: bool, replies: Sequence[Reply]) -> None:
        """Process messages like the last one, which the slow path has handled, from now on.

        Parameters
        ----------
        hands : sequence of InstalledHand
            That the message has, all of one stamp.
        stamp, scale, zero_is_missing
            See `install_signature`.
        replies : sequence of Reply
            At most `MOST_REPLIES`.
        """
        memories = [self._hands[hand.number] for hand in hands]
        for memory, hand in zip(memories, hands):
            install_layout(memory, hand.layout)
        if not install_signature(self._memory, memories, [hand.signature for hand in hands],
                                 stamp, scale, zero_is_missing):
            return
        for memory in memories:
            memory.reply[:] = NOT_WANTED
        self._context.publishers[:] = 0
        for number, (publisher, template, kind, members) in enumerate(replies):
            if self._templates.get(number) is not template:
                self._templates.pop(number, None)
                if not install_reply(self._memory, number, template):
                    return
                self._templates[number] = template
            size = len(template.numbers) // len(members)
            for place, member in enumerate(members):
                install_part(self._hands[member], kind, number,
                             slice(place * size, (place + 1) * size))
            self._set_outgoing(number, publisher, template, self._memory.replies[number])
        for place in range(MOST_HANDS):
            hand = hands[place if place < len(hands) else 0]
            self._packs[hand.number] = TrackPacks(*hand.packs)
            self._context.hands[place] = self._hand_packs[hand.number].ctypes.data
            self._context.packs[place] = [pack.ctypes.data for pack in hand.packs]
        self._is_installed = True

    def drain(self, hand: int) -> TrackedFrames | None:
        """Return the frames of a hand processed since the last call, None where there were none.

        Parameters
        ----------
        hand : int
            Its number.
        """
        report = self._packs[hand].report
        last_report = empty_like_pack(report)
        logged, count, sec, nanosec = self._drain(
            self._contexts, self._hand_packs[hand], report, self._log, self._states, last_report)
        if not logged:
            return None
        log = self._log[:logged]
        received, published, times = log[:, (RECEIVED, PUBLISHED, TIME)].T.tolist()
        if logged < count:
            times[0] = np.nan
        stamp = Stamp(sec, nanosec)
        listed = int(self._hands[hand].listed[0])
        # The runs keep what they are given.
        runs = state_runs(log, self._states[:logged, :listed or len(MARKERS)].copy())
        return TrackedFrames(
            count, stamp, HandTracker.state_from_report(last_report, listed), received, published,
            times, runs, None, on_fast_path=True, restarted=False)

    @property
    def entrance(self) -> tuple[int, int, int]:
        """Addresses by which compiled code hands over a message: `handed`, callback, context."""
        return self._handed.ctypes.data, self._callback.address, self._address

    @property
    def frame_count(self) -> int:
        """Number of frames of hands processed so far."""
        return int(sum(hand.frames[0] for hand in self._hands))

    @property
    def publishers(self) -> tuple[bytes, bytes] | None:
        """GUIDs of the publisher that is tracked and of one that is left out; None without one."""
        if not self._context.left_out[0]:
            return None
        return self._context.publisher.tobytes(), self._context.other.tobytes()

    def take(self) -> bytes | None:
        """Return the next message that waits, or None; only while it is disabled."""
        if self._waiting:
            return self._waiting.popleft()
        if self._subscription is None:
            return None
        if self._incoming.capacity > KEPT_CAPACITY:
            self._rcl.resize(self._incoming, TAKE_CAPACITY)
        info = self._context.info.ctypes.data
        while (data := self._take_from(self._subscription, self._incoming, info)) is not None:
            if self._admit_publisher(self._contexts):
                return data
        return None

    def process(self, message: bytes) -> bool:
        """Process a message that is handed over, in the caller's thread, which is always the same.

        Returns
        -------
        bool
            False while the fast path is disabled, which it is from a message on that it does not
            process.
        """
        self._handed[:] = np.frombuffer(message, np.uint8).ctypes.data, len(message), 0
        self._call(self._address, HANDED_OVER)
        return bool(self._handed[2])

    def _process_waiting(self) -> None:
        if self._subscription is not None:
            self._call(self._address, WHILE_DISABLED)
        self._on_disabled()


# nogil: what waits here lets other threads have the interpreter.
@partial(jit, nogil=True)
def _drain(contexts: Any, hands: Any, reports: Any, log: np.ndarray, states: np.ndarray,
           last_report: Any) -> tuple[int, int, int, int]:
    """Drain a hand's log while no message is processed; return also the last stamp."""
    context = contexts[0]
    call(context.lock, context.mutex, 0, 0, 0)
    logged, count = drain_log(hands, reports, log, states, last_report)
    sec, nanosec = hands[0].stamp[0], hands[0].stamp[1]
    call(context.unlock, context.mutex, 0, 0, 0)
    return logged, count, sec, nanosec


@jit
def _admit_publisher(contexts: Any) -> bool:
    """Return whether the message just taken is to be processed, by its publisher.

    Writes into the context: `publisher` and `heard` of a message that is, `other` and `left_out`
    of one that is not.
    """
    context = contexts[0]
    if context.silence[0] == 0.:
        return True
    now = monotonic_time(context)
    first, second = context.info[INFO_PUBLISHER], context.info[INFO_PUBLISHER + 1]
    is_same = context.publisher[0] == first and context.publisher[1] == second
    if not is_same and now - context.heard[0] < context.silence[0]:
        context.other[0], context.other[1] = first, second
        context.left_out[0] += 1
        return False
    context.publisher[0], context.publisher[1] = first, second
    context.heard[0] = now
    return True


@jit
def _packs_at(addresses: np.ndarray, of_model: np.dtype, of_chains: np.dtype, of_options: np.dtype,
              of_clock: np.dtype, of_blank: np.dtype, of_state: np.dtype,
              of_report: np.dtype) -> TrackPacks:
    """Return the packs at a hand's addresses, of these layouts."""
    return TrackPacks(
        carray(at(addresses[0]), (1,), of_model), carray(at(addresses[1]), (1,), of_chains),
        carray(at(addresses[2]), (1,), of_options), carray(at(addresses[3]), (1,), of_clock),
        carray(at(addresses[4]), (1,), of_blank), carray(at(addresses[5]), (1,), of_state),
        carray(at(addresses[6]), (1,), of_report))


def _callback(*layouts: np.dtype) -> Any:
    """Return the compiled callback for new messages, for packs of these layouts."""
    import numba

    (of_context, of_memory, of_hand, of_model, of_chains, of_options, of_clock, of_blank, of_state,
     of_report) = layouts

    @c_callback('void(voidptr, uintp)')
    def on_messages(address: Any, count: Any) -> None:
        contexts = numba.carray(address, (1,), of_context)
        context = contexts[0]
        memories = numba.carray(at(context.memory), (1,), of_memory)
        incoming = numba.carray(at(context.incoming), (2,), np.int64)
        # While it is disabled its state is that thread's, which must not take with the mutex held.
        is_disabled = count == WHILE_DISABLED
        is_handed = count == HANDED_OVER
        taken = True
        while taken:
            if not is_disabled:
                call(context.lock, context.mutex, 0, 0, 0)
            taken = (is_disabled or context.is_enabled[0] > 0) and (is_handed or call(
                context.take, context.subscription[0], context.incoming,
                context.info.ctypes.data, 0) == 0)
            if taken and (is_handed or _admit_publisher(contexts)):
                place, size = ((context.handed[0], context.handed[1]) if is_handed
                               else (incoming[0], incoming[1]))
                received = monotonic_time(context)
                # A message has one hand or two.
                hands = (numba.carray(at(context.hands[0]), (1,), of_hand),
                         numba.carray(at(context.hands[1]), (1,), of_hand))
                packs = (_packs_at(context.packs[0], of_model, of_chains, of_options, of_clock,
                                   of_blank, of_state, of_report),
                         _packs_at(context.packs[1], of_model, of_chains, of_options, of_clock,
                                   of_blank, of_state, of_report))
                if process_message(memories, hands, packs,
                                   numba.carray(at(place), (size,), np.uint8)):
                    publish_all(context, MOST_REPLIES)
                    published = monotonic_time(context)
                    for i in range(memories[0].hand_count[0]):
                        log_frame(hands[i][0], packs[i].report[0], received, published)
                    context.handed[2] = is_handed
                else:
                    if not is_handed:
                        context.has_missed_message[0] = 1
                    context.is_enabled[0] = 0
                    taken = False
            taken = taken and not is_handed
            is_enabled = context.is_enabled[0] > 0
            if not is_disabled:
                call(context.unlock, context.mutex, 0, 0, 0)
        call(context.reset_error, 0, 0, 0, 0)
        if not is_enabled and not is_disabled and not is_handed:
            call(context.reset_timer, context.timer[0], 0, 0, 0)

    return on_messages
