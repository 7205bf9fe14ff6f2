"""The fast path in the middleware's own thread: a callback takes, processes and publishes."""

from __future__ import annotations

import atexit
import ctypes
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from ...core.model.marker_layout import MARKERS
from ...core.numerics.jit import (
    CACHE_FOLDER,
    COMPILED,
    DEFERRED,
    JIT_IS_ON,
    empty_like_pack,
    jit,
    load_kernel,
    packed,
)
from ...core.tracker import HandTracker
from ...messages.cdr import ENCAPSULATION, MessageSignature
from ...messages.stamps import Stamp, Time
from ...messages.templates import Template
from ...tracking.monitor import TrackedFrames
from ..runner import EventsExecutor
from .kernel import (
    LOG_CAPACITY,
    LOG_COLUMNS,
    PUBLISHED,
    RECEIVED,
    REPLIES,
    TIME,
    drain_log,
    install_reply,
    install_signature,
    log_frame,
    new_memory,
    process_message,
    state_runs,
)
from .rcl import FastPathUnavailable, Rcl, address

if COMPILED:
    from .rcl import at, call

# Middlewares whose callbacks may take and publish; tried here.
SUPPORTED_MIDDLEWARES = 'rmw_fastrtps_cpp',
TAKE_CAPACITY = 2**16    # [bytes] of a message at first
SLOW_PATH_TURN = 16      # messages on the slow path before other callbacks have their turn
AT_ONCE = 1e-9           # [s], period of timers that are reset to wake the executor
MONOTONIC_CLOCK = time.CLOCK_MONOTONIC
REPORT = -1              # place of the report among the packs of `track_frame`


class CallbackContext(NamedTuple):
    """Context of the compiled callback: addresses, but for the first three arrays.
    Attributes
    ----------
    is_enabled : ndarray of int, shape (1,)
    has_missed_message : ndarray of int, shape (1,)
        Whether the incoming message was taken, but not processed.
    now : ndarray of int, shape (2,)
        Seconds and nanoseconds of clock_gettime.
    memory : int
    packs : ndarray of int, shape (7,)
        What `track_frame` takes before the markers.
    publishers, outgoing : ndarray of int, shape (3,)
        0 where a reply is not wanted.
    incoming, mutex : int
    subscription, timer : ndarray of int, shape (1,)
    take, publish, reset_error, reset_timer, lock, unlock, get_time : int
        C functions.
    """

    is_enabled: np.ndarray
    has_missed_message: np.ndarray
    now: np.ndarray
    memory: int
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


C_FUNCTIONS = CallbackContext._fields[CallbackContext._fields.index('take'):]


def require_fast_path() -> None:
    """Raise `FastPathUnavailable`, with the reason, where there can be no fast path."""
    if not JIT_IS_ON:
        raise FastPathUnavailable('the kernels are not compiled')
    if EventsExecutor is None:
        raise FastPathUnavailable('rclpy has no EventsExecutor')
    if get_rmw_implementation_identifier() not in SUPPORTED_MIDDLEWARES:
        raise FastPathUnavailable(
            f'it was not tried with {get_rmw_implementation_identifier()}')


class FastPath:
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
    """

    def __init__(self, packs: tuple[Any, ...], folder: Path | None = None) -> None:
        require_fast_path()
        self._rcl = Rcl()
        self._packs = packs
        self._subscription: Subscription | None = None
        self._is_installed = False
        self._templates: dict[int, Template] = {}
        self._memories, self._memory = packed(new_memory(), as_record=True)
        self._log = np.zeros((LOG_CAPACITY, LOG_COLUMNS))
        self._states = np.zeros((LOG_CAPACITY, len(MARKERS)), np.int8)
        self._incoming = self._rcl.octets(TAKE_CAPACITY)
        self._outgoing = [self._rcl.octets() for _ in range(REPLIES)]
        self._mutex = self._rcl.mutex()
        zeros = partial(np.zeros, dtype=np.int64)
        self._contexts, self._context = packed(CallbackContext(
            is_enabled=zeros(1), has_missed_message=zeros(1), now=zeros(2),
            memory=self._memories.ctypes.data, packs=zeros(len(packs)),
            publishers=zeros(REPLIES),
            outgoing=np.array([ctypes.addressof(octets) for octets in self._outgoing]),
            incoming=ctypes.addressof(self._incoming), mutex=ctypes.addressof(self._mutex),
            subscription=zeros(1), timer=zeros(1),
            **{name: address(getattr(self._rcl, name)) for name in C_FUNCTIONS}),
            as_record=True)
        self._set_enabled = load_kernel(_set_enabled, (self._contexts, False), folder)
        self._drain = load_kernel(_drain, (
            self._contexts, self._memories, packs[REPORT], self._log, self._states,
            empty_like_pack(packs[REPORT])), folder)
        self._callback = _callback(
            self._contexts.dtype, self._memories.dtype, *(pack.dtype for pack in packs))
        # Compiled before the first frame waits for them.
        self.drain()
        self._set_enabled(self._contexts, False)

    def start(self, node: Node, subscription: Subscription, on_disabled: Callable[[], None],
              on_message: Callable[[bytes], None]) -> None:
        """Take the messages of a subscription, which go to the slow path at first.

        Parameters
        ----------
        node : rclpy.node.Node
            Served by an EventsExecutor: others would wait in vain, busily, as a message that
            the middleware's callback takes stays announced to them.
        subscription : rclpy.subscription.Subscription
        on_disabled : callable
            Called in the executor's thread before messages go to the slow path.
        on_message : callable
            The slow path: called there with a message, as bytes.
        """
        self._on_disabled, self._on_message = on_disabled, on_message
        self._node, self._subscription = node, subscription
        self._has_callback = False
        # Resetting a timer is what wakes an executor from another thread.
        self._timer = node.create_timer(
            AT_ONCE, self._serve_slow_path, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._context.timer[0] = self._timer.handle.pointer
        self._context.subscription[0] = subscription.handle.pointer

    def stop(self) -> None:
        """Take no more messages; to be called while the executor is still there."""
        if self._subscription is None:
            return
        atexit.unregister(self.stop)
        self.disable()
        # Waits for a message that is being processed.
        self._set_callback(None)
        self._subscription = None
        self._node.destroy_timer(self._timer)

    def _set_callback(self, callback: int | None) -> None:
        assert self._subscription is not None
        self._rcl.set_callback(
            self._subscription.handle.pointer, callback, self._contexts.ctypes.data)

    @property
    def is_started(self) -> bool:
        """Whether it is between `start` and `stop`."""
        return self._subscription is not None

    def invalidate(self) -> None:
        """Drop what is installed; only while the slow path handles a message."""
        self._is_installed = False

    def disable(self) -> None:
        """Let the next message go to the slow path."""
        self.invalidate()
        self._set_enabled(self._contexts, False)

    def install(self, packs: tuple[Any, ...], signature: MessageSignature, stamp: Time,
                scale: float, zero_is_missing: bool,
                replies: Mapping[int, tuple[Publisher, Template]]) -> None:
        """Process messages like the last one, which the slow path has handled, from now on.

        Parameters
        ----------
        packs : tuple
            As of `HandTracker.kernel_arguments`.
        signature, stamp, scale, zero_is_missing
            See `install_signature`.
        replies : mapping of int to (rclpy.publisher.Publisher, Template)
            What is published, by the reply's number.
        """
        if not install_signature(self._memory, signature, stamp, scale, zero_is_missing):
            return
        for number in range(REPLIES):
            publisher, template = replies.get(number, (None, None))
            if self._templates.get(number) is not template:
                self._templates.pop(number, None)
                self._memory.wanted[number] = False
                if template is not None:
                    if not install_reply(self._memory, number, template):
                        return
                    self._templates[number] = template
            if template is not None:
                octets = self._outgoing[number]
                octets.buffer = self._memory.replies[number].ctypes.data + ENCAPSULATION
                octets.length = octets.capacity = template.size
            self._context.publishers[number] = publisher.handle.pointer if publisher else 0
        self._packs = packs
        self._context.packs[:] = [pack.ctypes.data for pack in packs]
        self._is_installed = True

    def drain(self) -> TrackedFrames | None:
        """Return the frames processed since the last call, None where there were none."""
        last_report = empty_like_pack(self._packs[REPORT])
        logged, count, sec, nanosec = self._drain(
            self._contexts, self._memories, self._packs[REPORT], self._log, self._states,
            last_report)
        if not logged:
            return None
        log = self._log[:logged]
        received, published, times = log[:, (RECEIVED, PUBLISHED, TIME)].T.tolist()
        if logged < count:
            times[0] = np.nan
        stamp = Stamp(sec, nanosec)
        # The runs keep what they are given.
        runs = state_runs(log, self._states[:logged].copy())
        return TrackedFrames(
            count, stamp, HandTracker.state_from_report(last_report), received, published, times,
            runs, None, on_fast_path=True, restarted=False)

    def _serve_slow_path(self) -> None:
        """Hand what was not processed to the slow path."""
        self._timer.cancel()
        if not self.is_started:
            return
        if not self._has_callback:
            # Not before: the timer must be the executor's when the middleware resets it.
            self._has_callback = True
            # Else the middleware might still call what Python has taken down.
            atexit.register(self.stop)
            self._set_callback(self._callback.address)
        self._set_enabled(self._contexts, False)
        self._on_disabled()
        for _ in range(SLOW_PATH_TURN):
            data = self._next()
            if data is None:
                if self._is_installed:
                    self._set_enabled(self._contexts, True)
                return
            self._on_message(data)
        self._rcl.reset_timer(self._timer.handle.pointer)

    def _next(self) -> bytes | None:
        """Return the next message, or None; first the one that was taken already."""
        if self._context.has_missed_message[0]:
            self._context.has_missed_message[0] = 0
            return self._incoming.content()
        return self.take()

    def take(self) -> bytes | None:
        """Return the next message that waits, or None; only while it is disabled."""
        assert self._subscription is not None
        if self._rcl.take(self._subscription.handle.pointer, ctypes.byref(self._incoming),
                          None, None):
            self._rcl.reset_error()
            return None
        return self._incoming.content()


# nogil: what waits here lets other threads have the interpreter.
@partial(jit, nogil=True)
def _set_enabled(contexts: Any, is_enabled: bool) -> None:
    """Enable or disable the fast path while no message is processed."""
    context = contexts[0]
    call(context.lock, context.mutex, 0, 0, 0)
    context.is_enabled[0] = is_enabled
    call(context.unlock, context.mutex, 0, 0, 0)


@partial(jit, nogil=True)
def _drain(contexts: Any, memories: Any, reports: Any, log: np.ndarray, states: np.ndarray,
           last_report: Any) -> tuple[int, int, int, int]:
    """Drain the log while no message is processed; return also the last stamp."""
    context = contexts[0]
    call(context.lock, context.mutex, 0, 0, 0)
    logged, count = drain_log(memories, reports, log, states, last_report)
    sec, nanosec = memories[0].stamp[0], memories[0].stamp[1]
    call(context.unlock, context.mutex, 0, 0, 0)
    return logged, count, sec, nanosec


@jit
def _now(context: Any) -> float:
    """Return the time as Python's time.monotonic gives it [s]."""
    call(context.get_time, MONOTONIC_CLOCK, context.now.ctypes.data, 0, 0)
    return context.now[0] + 1e-9 * context.now[1]


@jit
def _publish(context: Any) -> None:
    """Publish the replies; disable the fast path where one fails, for the slow path to report."""
    for i in range(REPLIES):
        if context.publishers[i] and call(
                context.publish, context.publishers[i], context.outgoing[i], 0, 0):
            context.is_enabled[0] = 0


def _callback(*layouts: np.dtype) -> Any:
    """Return the compiled callback for new messages, for packs of these layouts."""
    import numba

    (of_context, of_memory, of_model, of_digits, of_options, of_clock, of_blank, of_state,
     of_report) = layouts

    @numba.cfunc('void(voidptr, uintp)', cache=DEFERRED or CACHE_FOLDER is not None,
                 error_model='numpy')
    def on_messages(address: Any, count: Any) -> None:
        context = numba.carray(address, (1,), of_context)[0]
        memories = numba.carray(at(context.memory), (1,), of_memory)
        incoming = numba.carray(at(context.incoming), (2,), np.int64)
        taken = True
        while taken:
            call(context.lock, context.mutex, 0, 0, 0)
            taken = context.is_enabled[0] > 0 and call(
                context.take, context.subscription[0], context.incoming, 0, 0) == 0
            if taken:
                received = _now(context)
                packs = context.packs
                reports = numba.carray(at(packs[6]), (1,), of_report)
                if process_message(
                        memories, (numba.carray(at(packs[0]), (1,), of_model),
                                   numba.carray(at(packs[1]), (1,), of_digits),
                                   numba.carray(at(packs[2]), (1,), of_options),
                                   numba.carray(at(packs[3]), (1,), of_clock),
                                   numba.carray(at(packs[4]), (1,), of_blank),
                                   numba.carray(at(packs[5]), (1,), of_state), reports),
                        numba.carray(at(incoming[0]), (incoming[1],), np.uint8)):
                    _publish(context)
                    log_frame(memories[0], reports[0], received, _now(context))
                else:
                    context.has_missed_message[0] = 1
                    context.is_enabled[0] = 0
            is_enabled = context.is_enabled[0] > 0
            call(context.unlock, context.mutex, 0, 0, 0)
        call(context.reset_error, 0, 0, 0, 0)
        if not is_enabled:
            call(context.reset_timer, context.timer[0], 0, 0, 0)

    return on_messages
