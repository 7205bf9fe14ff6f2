"""The fast path of a robot: a callback takes joint states of the hand and publishes commands."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from ...core.numerics.jit import COMPILED, c_callback, jit
from ...core.numerics.packs import packed
from ...messages.joint_states import JointStateReader
from ...messages.templates import Template
from ...retargeting.follow_kernel import COMMANDED, NOT_FOLLOWED
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
from .command_kernel import (
    MOST_COMMANDS,
    install_numbers,
    new_command_memory,
    process_deviations,
    process_hand,
    process_position,
)
from .rcl import FastPathUnavailable, address
from .track_kernel import install_reply

if COMPILED:
    from .rcl import at, call

# Topics whose messages are taken beside those of the hand, by number
HAND_DEVIATIONS, ROBOT = range(2)
OTHER_TOPICS = 2
MOST_WAITING = 16  # messages of a topic that are taken at once; more than its queue has


class CommandContext(NamedTuple):
    """Context of the compiled callback: addresses, but for arrays.

    Attributes
    ----------
    is_enabled : ndarray of int, shape (1,)
    has_missed_message : ndarray of int, shape (1,)
        Whether the hand's message was taken, but not processed.
    has_missed_other : ndarray of int, shape (OTHER_TOPICS,)
        The same of `HAND_DEVIATIONS` and `ROBOT`.
    now : ndarray of int, shape (2,)
        Seconds and nanoseconds of clock_gettime.
    info : ndarray of int, shape (INFO_WORDS,)
        rmw_message_info_t of the hand's last message that was taken.
    sender : ndarray of int, shape (2,)
        GUID of the publisher of the hand's last frame.
    turns : ndarray of int, shape (1,)
        How often another publisher than that of the frame before sent one.
    memory : int
    packs : ndarray of int, shape (5,)
        Arguments of `follow_frame` before the stamp.
    publishers, outgoing : ndarray of int, shape (MOST_COMMANDS,)
        0 where a message is not sent.
    incoming, mutex : int
    other_incoming, other_subscriptions : ndarray of int, shape (OTHER_TOPICS,)
    subscription, timer : ndarray of int, shape (1,)
    take, publish, reset_error, reset_timer, lock, unlock, get_time : int
        C functions.
    """

    is_enabled: np.ndarray
    has_missed_message: np.ndarray
    has_missed_other: np.ndarray
    now: np.ndarray
    info: np.ndarray
    sender: np.ndarray
    turns: np.ndarray
    memory: int
    packs: np.ndarray
    publishers: np.ndarray
    outgoing: np.ndarray
    incoming: int
    mutex: int
    other_incoming: np.ndarray
    other_subscriptions: np.ndarray
    subscription: np.ndarray
    timer: np.ndarray
    take: int
    publish: int
    reset_error: int
    reset_timer: int
    lock: int
    unlock: int
    get_time: int


class ListedJoints(NamedTuple):
    """Reader of a topic's JointStates, and the rows of them that count.

    Attributes
    ----------
    reader : JointStateReader
        Has read the last one.
    rows : ndarray of int, shape (n,)
        Which of its positions count.
    """

    reader: JointStateReader
    rows: np.ndarray


class CommandPath(CallbackPath):
    """The fast path from a hand's joint states to the commands of a robot.

    Parameters
    ----------
    packs : tuple
        As of `Teleoperation.packs`, of compiled kernels.

    Raises
    ------
    FastPathUnavailable
    """

    def __init__(self, packs: tuple[Any, ...]) -> None:
        if not COMPILED:
            raise FastPathUnavailable('the kernels are not compiled')
        super().__init__()
        self._packs = packs
        self._commands, self._memory = packed(new_command_memory(), as_record=True)
        self._outgoing = [self._rcl.octets() for _ in range(MOST_COMMANDS)]
        self._other_incoming = [self._rcl.octets(TAKE_CAPACITY) for _ in range(OTHER_TOPICS)]
        self._other_subscriptions: Sequence[Subscription] = ()

        def zeros(size: int) -> np.ndarray:
            return np.zeros(size, np.int64)

        self._contexts, self._context = packed(CommandContext(
            is_enabled=zeros(1), has_missed_message=zeros(1), has_missed_other=zeros(OTHER_TOPICS),
            now=zeros(2), info=zeros(INFO_WORDS), sender=zeros(2), turns=zeros(1),
            memory=self._commands.ctypes.data,
            packs=np.array([pack.ctypes.data for pack in packs]),
            publishers=zeros(MOST_COMMANDS),
            outgoing=np.array([ctypes.addressof(octets) for octets in self._outgoing]),
            incoming=ctypes.addressof(self._incoming), mutex=ctypes.addressof(self._mutex),
            other_incoming=np.array([ctypes.addressof(one) for one in self._other_incoming]),
            other_subscriptions=zeros(OTHER_TOPICS), subscription=zeros(1), timer=zeros(1),
            **{name: address(getattr(self._rcl, name)) for name in C_FUNCTIONS}),
            as_record=True)
        self._set_enabled = set_enabled
        self._callback = _command_callback(
            self._contexts.dtype, self._commands.dtype, *(pack.dtype for pack in packs))
        # Compiled before the first frame waits for it.
        self._set_enabled(self._contexts, False)

    def start_all(self, node: Node, hand: Subscription, others: Sequence[Subscription],
                  on_disabled: Callable[[], None], on_message: Callable[[bytes], None]) -> None:
        """Take the messages of all subscriptions, which go to the slow path at first.

        Parameters
        ----------
        node, hand, on_disabled, on_message
            See `start`.
        others : sequence of Subscription
            Of `HAND_DEVIATIONS` and `ROBOT`: the slow path has what came of them by `take_others`.
        """
        self._other_subscriptions = others
        self._context.other_subscriptions[:] = [one.handle.pointer for one in others]
        self.start(node, hand, on_disabled, on_message)

    def take_others(self) -> Iterator[tuple[int, bytes]]:
        """Yield the messages that wait of `HAND_DEVIATIONS` and `ROBOT`; only while disabled."""
        for topic, subscription in enumerate(self._other_subscriptions):
            incoming = self._other_incoming[topic]
            if self._context.has_missed_other[topic]:
                self._context.has_missed_other[topic] = 0
                yield topic, incoming.content()
            while (data := self._take_from(subscription, incoming)) is not None:
                yield topic, data

    def install(self, hand: ListedJoints, others: Sequence[ListedJoints],
                replies: Sequence[tuple[Publisher, Template]]) -> None:
        """Process messages like the last ones, which the slow path has handled, from now on.

        Parameters
        ----------
        hand : ListedJoints
        others : sequence of ListedJoints
            Of `HAND_DEVIATIONS` and `ROBOT`; messages of a layout that is not installed go to the
            slow path.
        replies : sequence of (Publisher, Template)
            At most `MOST_COMMANDS`.
        """
        memory, context = self._memory, self._context
        is_hand = install_numbers(memory.hand, hand.reader, hand.rows)
        for listed, topic in zip((memory.deviations, memory.robot), others):
            install_numbers(listed, topic.reader, topic.rows)
        if is_hand:
            memory.wanted[:] = context.publishers[:] = 0
            for number, (publisher, template) in enumerate(replies):
                if not install_reply(memory, number, template):
                    memory.hand.size[0] = 0
                    return
                memory.wanted[number] = 1
                self._set_outgoing(number, publisher, template, memory.replies[number])
        # Also after a message of others, which share the hand's topic.
        self._is_installed = bool(memory.hand.size[0])

    @property
    def frame_count(self) -> int:
        """Number of frames processed so far."""
        return int(self._memory.frames[0])

    @property
    def turns(self) -> int:
        """How often a frame of the hand came from another publisher than the one before."""
        return int(self._context.turns[0])

    @property
    def served_time(self) -> float:
        """When a frame was last answered here, or needed no answer [s]; -inf before the first."""
        return float(self._memory.served_time[0])


@jit
def _note_sender(context: Any) -> None:
    """Count a turn if the hand's message just taken is of another publisher than the last."""
    first, second = context.info[INFO_PUBLISHER], context.info[INFO_PUBLISHER + 1]
    if context.sender[0] != first or context.sender[1] != second:
        context.sender[0], context.sender[1] = first, second
        context.turns[0] += 1


def _command_callback(*layouts: np.dtype) -> Any:
    """Return the compiled callback for new messages, for packs of these layouts."""
    import numba

    of_context, of_memory, of_follow, of_human, of_problem, of_solution, of_guard = layouts

    @c_callback('void(voidptr, uintp)')
    def on_hand(address: Any, count: Any) -> None:
        context = numba.carray(address, (1,), of_context)[0]
        commands = numba.carray(at(context.memory), (1,), of_memory)
        incoming = numba.carray(at(context.incoming), (2,), np.int64)
        packs = (numba.carray(at(context.packs[0]), (1,), of_follow),
                 numba.carray(at(context.packs[1]), (1,), of_human),
                 numba.carray(at(context.packs[2]), (1,), of_problem),
                 numba.carray(at(context.packs[3]), (1,), of_solution),
                 numba.carray(at(context.packs[4]), (1,), of_guard))
        taken = True
        while taken:
            call(context.lock, context.mutex, 0, 0, 0)
            taken = context.is_enabled[0] > 0 and call(
                context.take, context.subscription[0], context.incoming,
                context.info.ctypes.data, 0) == 0
            if taken:
                now = monotonic_time(context)
                is_known = True
                for topic in range(OTHER_TOPICS):
                    # All that wait, as what is taken later would seem to be new then.
                    left = MOST_WAITING
                    while left > 0 and call(context.take, context.other_subscriptions[topic],
                                            context.other_incoming[topic], 0, 0) == 0:
                        left -= 1
                        buffer = numba.carray(at(context.other_incoming[topic]), (2,), np.int64)
                        octets = numba.carray(at(buffer[0]), (buffer[1],), np.uint8)
                        if topic == HAND_DEVIATIONS:
                            known = process_deviations(commands, packs[0], packs[4], octets)
                        else:
                            known = process_position(
                                commands, packs[0], packs[4], octets, now)
                        if not known:
                            context.has_missed_other[topic] = 1
                            is_known = False
                            left = 0
                done, frames = NOT_FOLLOWED, commands[0].frames[0]
                if is_known:
                    done = process_hand(commands, packs, numba.carray(
                        at(incoming[0]), (incoming[1],), np.uint8), now)
                if commands[0].frames[0] > frames:
                    _note_sender(context)
                if done == COMMANDED:
                    publish_all(context, MOST_COMMANDS)
                elif done == NOT_FOLLOWED:
                    context.has_missed_message[0] = 1
                    context.is_enabled[0] = 0
            is_enabled = context.is_enabled[0] > 0
            call(context.unlock, context.mutex, 0, 0, 0)
        call(context.reset_error, 0, 0, 0, 0)
        if not is_enabled:
            call(context.reset_timer, context.timer[0], 0, 0, 0)

    return on_hand
