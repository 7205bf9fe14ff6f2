"""The short way of a frame: from the middleware to the middleware without the interpreter.

The middleware's own thread takes a message, `pass_message` tracks it, and the answers are
published, all compiled. It never runs Python. What does not pass goes the long way, in the
executor's thread; until that has come to an end, the short way is shut. So one of the two at
a time has the tracker's state and the passage: this one while it is open, else the other.

The middleware's locks are taken before the mutex, and the interpreter's by none who has it.
"""

import atexit
import ctypes
import time
from functools import partial
from typing import NamedTuple

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.utilities import get_rmw_implementation_identifier

from ...core.model.marker_layout import MARKERS
from ...core.numerics.jit import CACHED, COMPILED, another, jit, packed
from ...messages.cdr import ENCAPSULATION
from ..runner import EventsExecutor
from .kernel import (
    ANSWERS,
    KEPT,
    LOGGED,
    PUBLISHED,
    RECEIVED,
    TIME,
    glimpses,
    look,
    new_passage,
    note,
    pass_message,
    teach_answer,
    teach_kind,
)
from .rcl import Rcl, Unavailable, address

if COMPILED:
    import numba

    from .rcl import at, call

# Where messages may be taken and published in the thread that brings them; tried here.
MIDDLEWARES = 'rmw_fastrtps_cpp',
LONGEST = 2**16  # [bytes] of a message at first
TURN = 16        # messages that go the long way before others get their turn
NOW = 1e-9       # [s]
STEADY = time.CLOCK_MONOTONIC


class Line(NamedTuple):
    """Where compiled code finds what it works with: addresses, but for the first three.

    Attributes
    ----------
    is_open : ndarray of int, shape (1,)
    is_left : ndarray of int, shape (1,)
        Whether the incoming message was taken, but did not pass.
    moment : ndarray of int, shape (2,)
        Of clock_gettime.
    passage : int
    tracker : ndarray of int, shape (7,)
        What `track_frame` takes before the markers.
    publishers, outgoing : ndarray of int, shape (3,)
        0 where an answer is not wanted.
    incoming, mutex : int
    subscription, timer : ndarray of int, shape (1,)
    take, publish, reset_error, reset_timer, lock, unlock, get_time : int
        Functions.
    """

    is_open: np.ndarray
    is_left: np.ndarray
    moment: np.ndarray
    passage: int
    tracker: np.ndarray
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


FUNCTIONS = Line._fields[Line._fields.index('take'):]


class Frames(NamedTuple):
    """Frames that passed.

    Attributes
    ----------
    count : int
        Of all, more than there are times of when they were not looked at for long.
    stamp : tuple of int
        Seconds and nanoseconds of the last.
    state : HandState
        After the last.
    received, published, times : list of float
        Its first time is NaN when frames before it are not known any more [s].
    glimpses : list of (float, Glimpse)
    """

    count: int
    stamp: tuple
    state: NamedTuple
    received: list
    published: list
    times: list
    glimpses: list


class Direct:
    """The short way from one subscription.

    Parameters
    ----------
    tracker : HandTracker

    Raises
    ------
    Unavailable
    """

    def __init__(self, tracker):
        if not COMPILED:
            raise Unavailable('the kernels are not compiled')
        if EventsExecutor is None:
            raise Unavailable('rclpy has no EventsExecutor')
        if get_rmw_implementation_identifier() not in MIDDLEWARES:
            raise Unavailable(f'it was not tried with {get_rmw_implementation_identifier()}')
        self._rcl = Rcl()
        self._tracker, self._kept = tracker, tracker.kernel_arguments()
        self._subscription = None
        self._is_taught = False
        self._templates = {}
        self._passages, self._passage = packed(new_passage())
        self._log, self._states = np.zeros((KEPT, LOGGED)), np.zeros((KEPT, len(MARKERS)), np.int8)
        self._incoming = self._rcl.octets(LONGEST)
        self._outgoing = [self._rcl.octets() for _ in range(ANSWERS)]
        self._mutex = self._rcl.mutex()
        none = partial(np.zeros, dtype=np.int64)
        self._lines, self._line = packed(Line(
            is_open=none(1), is_left=none(1), moment=none(2),
            passage=self._passages.ctypes.data, tracker=none(len(self._kept)),
            publishers=none(ANSWERS),
            outgoing=np.array([ctypes.addressof(octets) for octets in self._outgoing]),
            incoming=ctypes.addressof(self._incoming), mutex=ctypes.addressof(self._mutex),
            subscription=none(1), timer=none(1),
            **{name: address(getattr(self._rcl, name)) for name in FUNCTIONS}))
        self._callback = _callback(
            self._lines.dtype, self._passages.dtype, *(pack.dtype for pack in self._kept))
        # Compiled before the first frame waits for them.
        self.frames()
        _set_open(self._lines, False)

    def open(self, node, subscription, on_pause, on_message):
        """Let messages come as soon as the node is served, to go the long way at first.

        Parameters
        ----------
        node : rclpy.node.Node
            To be served by an EventsExecutor: others would wait in vain, busily, as a message
            that the middleware's callback takes stays announced.
        subscription : rclpy.subscription.Subscription
            To be kept from the executor until `close`.
        on_pause : callable
            Called in the executor's thread before messages go the long way.
        on_message : callable
            The long way: called there with a message, as bytes.
        """
        self._on_pause, self._on_message = on_pause, on_message
        self._node, self._subscription = node, subscription
        self._is_heard = False
        # To reset a timer is what wakes an executor from another thread.
        self._timer = node.create_timer(
            NOW, self._serve, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._line.timer[0] = self._timer.handle.pointer
        self._line.subscription[0] = subscription.handle.pointer

    def close(self):
        """Let none come any more, while the executor is still there."""
        if not self.is_used:
            return
        atexit.unregister(self.close)
        self.shut()
        # Waits for a message that is on its way.
        self._listen(None)
        self._subscription = None
        self._node.destroy_timer(self._timer)

    def _listen(self, callback):
        self._rcl.listen(
            self._subscription.handle.pointer, callback, self._lines.ctypes.data)

    @property
    def is_used(self):
        """Whether it is between `open` and `close`."""
        return self._subscription is not None

    def forget(self):
        """Note that what was taught holds no more; the way is shut already."""
        self._is_taught = False

    def shut(self):
        """Let the next message go the long way."""
        self.forget()
        _set_open(self._lines, False)

    def teach(self, kind, stamp, scale, zero_is_missing, answers):
        """Let messages like the last one, which came the long way, pass from the next one on.

        Parameters
        ----------
        kind, stamp, scale, zero_is_missing
            Of `teach_kind`.
        answers : dict of int to (rclpy.publisher.Publisher, Template)
            What is published, by the number that the passage has for it.
        """
        if not teach_kind(self._passage, kind, stamp, scale, zero_is_missing):
            return
        for number in range(ANSWERS):
            publisher, template = answers.get(number, (None, None))
            if self._templates.get(number) is not template:
                self._templates.pop(number, None)
                self._passage.wanted[number] = False
                if template is not None and not teach_answer(self._passage, number, template):
                    return
                self._templates[number] = template
            if template is not None:
                octets = self._outgoing[number]
                octets.buffer = self._passage.answers[number].ctypes.data + ENCAPSULATION
                octets.length = octets.capacity = template.size
            self._line.publishers[number] = publisher.handle.pointer if publisher else 0
        self._kept = self._tracker.kernel_arguments()
        self._line.tracker[:] = [pack.ctypes.data for pack in self._kept]
        self._is_taught = True

    def frames(self):
        """Look at the frames that passed since the last look.

        Returns
        -------
        Frames or None
            None where there were none.
        """
        seen = another(self._kept[-1])
        kept, count, seconds, nanoseconds = _look(
            self._lines, self._passages, self._kept[-1], self._log, self._states, seen)
        if not kept:
            return None
        log = self._log[:kept]
        received, published, times = log[:, (RECEIVED, PUBLISHED, TIME)].T.tolist()
        if kept < count:
            times[0] = np.nan
        # Glimpses keep what they are given.
        return Frames(count, (seconds, nanoseconds), self._tracker.state_from_report(seen),
                      received, published, times, glimpses(log, self._states[:kept].copy()))

    def _serve(self):
        """Let what did not pass go the long way."""
        self._timer.cancel()
        if not self.is_used:
            return
        if not self._is_heard:
            # Not before: the timer must be the executor's when the middleware resets it.
            self._is_heard = True
            # Else the middleware might still call what Python has taken down.
            atexit.register(self.close)
            self._listen(self._callback.address)
        _set_open(self._lines, False)
        self._on_pause()
        for _ in range(TURN):
            data = self._next()
            if data is None:
                if self._is_taught:
                    _set_open(self._lines, True)
                return
            self._on_message(data)
        self._rcl.reset_timer(self._timer.handle.pointer)

    def _next(self):
        """Return the next message, or None; first the one that was taken already."""
        if self._line.is_left[0]:
            self._line.is_left[0] = 0
        elif self._rcl.take(self._subscription.handle.pointer, ctypes.byref(self._incoming),
                            None, None):
            self._rcl.reset_error()
            return None
        return self._incoming.text()


# Whoever waits here lets others have the interpreter.
@partial(jit, nogil=True)
def _set_open(lines, is_open):
    """Open or shut the short way, when no message is on it."""
    line = lines[0]
    call(line.lock, line.mutex, 0, 0, 0)
    line.is_open[0] = is_open
    call(line.unlock, line.mutex, 0, 0, 0)


@partial(jit, nogil=True)
def _look(lines, passages, reports, log, states, seen):
    """Look when no message is on its way; return also the last stamp."""
    line = lines[0]
    call(line.lock, line.mutex, 0, 0, 0)
    kept, count = look(passages, reports, log, states, seen)
    seconds, nanoseconds = passages[0].stamp[0], passages[0].stamp[1]
    call(line.unlock, line.mutex, 0, 0, 0)
    return kept, count, seconds, nanoseconds


@jit
def _now(line):
    """Return the time that Python's time.monotonic gives [s]."""
    call(line.get_time, STEADY, line.moment.ctypes.data, 0, 0)
    return line.moment[0] + 1e-9 * line.moment[1]


@jit
def _publish(line):
    """Publish the answers; shut the short way where one fails, for the long way to tell."""
    for i in range(ANSWERS):
        if line.publishers[i] and call(line.publish, line.publishers[i], line.outgoing[i], 0, 0):
            line.is_open[0] = 0


def _callback(*layouts):
    """Return what the middleware calls when messages have come, for packs of these layouts."""
    (of_line, of_passage, of_model, of_chains, of_options, of_clock, of_blank, of_state,
     of_report) = layouts

    @numba.cfunc('void(voidptr, uintp)', cache=CACHED, error_model='numpy')
    def on_messages(address, count):
        line = numba.carray(address, (1,), of_line)[0]
        passages = numba.carray(at(line.passage), (1,), of_passage)
        incoming = numba.carray(at(line.incoming), (2,), np.int64)
        taken = True
        while taken:
            call(line.lock, line.mutex, 0, 0, 0)
            taken = line.is_open[0] > 0 and call(
                line.take, line.subscription[0], line.incoming, 0, 0) == 0
            if taken:
                received = _now(line)
                tracker = line.tracker
                reports = numba.carray(at(tracker[6]), (1,), of_report)
                if pass_message(
                        passages, numba.carray(at(tracker[0]), (1,), of_model),
                        numba.carray(at(tracker[1]), (1,), of_chains),
                        numba.carray(at(tracker[2]), (1,), of_options),
                        numba.carray(at(tracker[3]), (1,), of_clock),
                        numba.carray(at(tracker[4]), (1,), of_blank),
                        numba.carray(at(tracker[5]), (1,), of_state), reports,
                        numba.carray(at(incoming[0]), (incoming[1],), np.uint8)):
                    _publish(line)
                    note(passages[0], reports[0], received, _now(line))
                else:
                    line.is_left[0] = 1
                    line.is_open[0] = 0
            is_open = line.is_open[0] > 0
            call(line.unlock, line.mutex, 0, 0, 0)
        call(line.reset_error, 0, 0, 0, 0)
        if not is_open:
            call(line.reset_timer, line.timer[0], 0, 0, 0)

    return on_messages
