"""Subscription served in the middleware's thread by a compiled callback."""

from __future__ import annotations

import atexit
import ctypes
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from ...core.numerics.jit import COMPILED, JIT_IS_ON, jit
from ...messages.cdr import ENCAPSULATION
from ...messages.templates import Template
from ..executors import EventsExecutor, wake_timer
from .rcl import FastPathUnavailable, Octets, Rcl

if COMPILED:
    from .rcl import call

# Middlewares whose callbacks may take and publish; tried here.
SUPPORTED_MIDDLEWARES = 'rmw_fastrtps_cpp',
TAKE_CAPACITY = 2**16    # [bytes] of a message at first
# rmw_message_info_t, in words: the GUID of a message's publisher (RTPS 2.5, 8.2.4.1) is two.
INFO_WORDS, INFO_PUBLISHER = 16, 5
# Of rcl and C, whose addresses the compiled callback has.
C_FUNCTIONS = 'take', 'publish', 'reset_error', 'reset_timer', 'lock', 'unlock', 'get_time'
SLOW_PATH_TURN = 16      # messages on the slow path before other callbacks have their turn
MONOTONIC_CLOCK = time.CLOCK_MONOTONIC


class CallbackPath:
    """A subscription's messages: a compiled callback takes them while it is enabled.

    What derives from it makes, in its constructor, the callback and its context, a record with
    the fields `is_enabled`, `has_missed_message`, `subscription`, `timer`, `mutex`, `publishers`
    and the C functions of `C_FUNCTIONS`, and the outgoing messages.

    Raises
    ------
    FastPathUnavailable
    """

    _contexts: Any
    _context: Any
    _callback: Any
    _set_enabled: Any
    _outgoing: list[Octets]

    def __init__(self) -> None:
        self.require()
        self._rcl = Rcl()
        self._subscription: Subscription | None = None
        self._is_started = self._is_installed = False
        self._incoming: Octets = self._rcl.octets(TAKE_CAPACITY)
        self._mutex = self._rcl.mutex()

    @staticmethod
    def require() -> None:
        """Raise `FastPathUnavailable`, with the reason, where there can be no fast path."""
        if not JIT_IS_ON:
            raise FastPathUnavailable('the kernels are not compiled')
        if EventsExecutor is None:
            raise FastPathUnavailable('rclpy has no EventsExecutor')
        if get_rmw_implementation_identifier() not in SUPPORTED_MIDDLEWARES:
            raise FastPathUnavailable(
                f'it was not tried with {get_rmw_implementation_identifier()}')

    def start(self, node: Node, subscription: Subscription | None, on_disabled: Callable[[], None],
              on_message: Callable[[bytes], None]) -> None:
        """Take the messages of a subscription, which go to the slow path at first.

        Parameters
        ----------
        node : rclpy.node.Node
            Served by an EventsExecutor: others would wait in vain, busily, as a message that
            the middleware's callback takes stays announced to them.
        subscription : rclpy.subscription.Subscription or None
            None where messages come in another way alone.
        on_disabled : callable
            Called in the executor's thread before messages go to the slow path.
        on_message : callable
            The slow path: called there with a message, as bytes.
        """
        self._on_disabled, self._on_message = on_disabled, on_message
        self._node, self._subscription, self._is_started = node, subscription, True
        self._has_callback = subscription is None
        self._timer = wake_timer(node, self.serve_slow_path)
        self._context.timer[0] = self._timer.handle.pointer
        if subscription is not None:
            self._context.subscription[0] = subscription.handle.pointer

    def stop(self) -> None:
        """Take no more messages; to be called while the executor is still there."""
        if not self._is_started:
            return
        atexit.unregister(self.stop)
        self.disable()
        # Waits for a message that is being processed.
        if self._subscription is not None:
            self._set_callback(None)
        self._subscription, self._is_started = None, False
        self._node.destroy_timer(self._timer)

    def _set_callback(self, callback: int | None) -> None:
        assert self._subscription is not None
        self._rcl.set_callback(
            self._subscription.handle.pointer, callback, self._contexts.ctypes.data)

    @property
    def is_started(self) -> bool:
        """Whether it is between `start` and `stop`."""
        return self._is_started

    def invalidate(self) -> None:
        """Drop the installed signature and replies; only while the slow path handles a message."""
        self._is_installed = False

    def _set_outgoing(self, number: int, publisher: Publisher, template: Template,
                      octets: np.ndarray) -> None:
        """Have an outgoing message, by its number, published with the octets of its reply."""
        outgoing = self._outgoing[number]
        outgoing.buffer = octets.ctypes.data + ENCAPSULATION
        outgoing.length = outgoing.capacity = template.size
        self._context.publishers[number] = publisher.handle.pointer

    def disable(self) -> None:
        """Let the next message go to the slow path."""
        self.invalidate()
        self._set_enabled(self._contexts, False)

    def serve_slow_path(self) -> None:
        """Hand unprocessed messages to the slow path; only in the executor's thread."""
        self._timer.cancel()
        if not self._is_started:
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
            if self._is_installed:
                # What waits behind it would be slow otherwise, and more come meanwhile.
                self._process_waiting()
        self._rcl.reset_timer(self._timer.handle.pointer)

    def _process_waiting(self) -> None:
        """Process what waits as the callback does, in the executor's thread, while disabled."""

    def _next(self) -> bytes | None:
        """Return the next message, or None; first the one that was taken already."""
        if self._context.has_missed_message[0]:
            self._context.has_missed_message[0] = 0
            return self._incoming.content()
        return self.take()

    def take(self) -> bytes | None:
        """Return the next message that waits, or None; only while it is disabled."""
        assert self._subscription is not None
        return self._take_from(self._subscription, self._incoming)

    def _take_from(self, subscription: Subscription, incoming: Octets,
                   info: int | None = None) -> bytes | None:
        if self._rcl.take(subscription.handle.pointer, ctypes.byref(incoming), info, None):
            self._rcl.reset_error()
            return None
        return incoming.content()


# nogil: what waits here lets other threads have the interpreter.
@partial(jit, nogil=True)
def set_enabled(contexts: Any, is_enabled: bool) -> None:
    """Enable or disable the fast path while no message is processed."""
    context = contexts[0]
    call(context.lock, context.mutex, 0, 0, 0)
    context.is_enabled[0] = is_enabled
    call(context.unlock, context.mutex, 0, 0, 0)


@jit
def publish_all(context: Any, count: int) -> None:
    """Publish the first `count` outgoing messages.

    Where one fails, the fast path is disabled, for the slow path to report it.
    """
    for i in range(count):
        if context.publishers[i] and call(
                context.publish, context.publishers[i], context.outgoing[i], 0, 0):
            context.is_enabled[0] = 0


@jit
def monotonic_ns(context: Any) -> int:
    """Return the time as Python's time.monotonic_ns gives it [ns]."""
    call(context.get_time, MONOTONIC_CLOCK, context.now.ctypes.data, 0, 0)
    return context.now[0] * 1_000_000_000 + context.now[1]


@jit
def monotonic_time(context: Any) -> float:
    """Return the time as Python's time.monotonic gives it [s]."""
    return 1e-9 * monotonic_ns(context)
