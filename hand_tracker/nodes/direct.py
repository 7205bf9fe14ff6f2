"""The short way of a frame: from the middleware to the middleware without the interpreter.

The middleware's own thread takes a message, `pass_message` tracks it, and the answers are
published, all compiled. It never runs Python. What does not pass goes the long way, in the
executor's thread; until that has come to an end, the short way is shut. So one of the two
at a time has the tracker's state: this one while it is open, else the other.
"""

import atexit
import ctypes
import sys
import time
from typing import NamedTuple

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.utilities import get_rmw_implementation_identifier

from ..codec import ENCAPSULATION
from ..core.jit import CACHED, COMPILED, copied, jit, packed
from ..core.layout import MARKERS
from ..passage import (
    ANSWERS, KEPT, glimpses, look, new_passage, note, pass_message, teach_answer, teach_kind)

if COMPILED:
    import numba
    from llvmlite import ir
    from numba.extending import intrinsic

# Where messages may be taken and published in the thread that brings them; tried here.
MIDDLEWARES = 'rmw_fastrtps_cpp',
LONGEST = 2**16  # [bytes] of a message at first
AT_ONCE = 16     # messages that go the long way before others get their turn
MUTEX = 64       # [bytes], more than pthread_mutex_t has
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
    incoming, subscription, timer, mutex : int
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
    subscription: int
    timer: int
    mutex: int
    take: int
    publish: int
    reset_error: int
    reset_timer: int
    lock: int
    unlock: int
    get_time: int


class Allocator(ctypes.Structure):
    """rcutils_allocator_t"""

    _fields_ = [(name, ctypes.c_void_p) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class Octets(ctypes.Structure):
    """rcutils_uint8_array_t, as which rcl takes and gives messages."""

    _fields_ = [('buffer', ctypes.c_void_p), ('length', ctypes.c_size_t),
                ('capacity', ctypes.c_size_t), ('allocator', Allocator)]


class Unavailable(Exception):
    """There is no short way here; the message says why."""


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
        if get_rmw_implementation_identifier() not in MIDDLEWARES:
            raise Unavailable(f'not tried with {get_rmw_implementation_identifier()}')
        self._rcl, self._rcutils, system = _libraries()
        self._tracker, self._kept = tracker, tracker.kernel_arguments()
        self._subscription = self._timer = None
        self._is_taught = False
        self._passages, self._passage = packed(new_passage())
        self._templates = {}
        self._log, self._states = np.zeros((KEPT, 5)), np.zeros((KEPT, len(MARKERS)), np.int8)

        allocator = self._rcutils.rcutils_get_default_allocator()
        self._incoming = Octets()
        if self._rcutils.rcutils_uint8_array_init(
                ctypes.byref(self._incoming), LONGEST, ctypes.byref(allocator)):
            raise Unavailable('no memory')
        self._outgoing = [Octets(allocator=allocator) for _ in range(ANSWERS)]
        self._mutex = ctypes.create_string_buffer(MUTEX)
        system.pthread_mutex_init(self._mutex, None)
        self._lines, self._line = packed(Line(
            *np.zeros((2, 1), np.int64), np.zeros(2, np.int64), self._passages.ctypes.data,
            np.zeros(7, np.int64), np.zeros(ANSWERS, np.int64), np.zeros(ANSWERS, np.int64),
            ctypes.addressof(self._incoming), 0, 0, ctypes.addressof(self._mutex),
            *map(_address, (
                self._rcl.rcl_take_serialized_message, self._rcl.rcl_publish_serialized_message,
                self._rcutils.rcutils_reset_error, self._rcl.rcl_timer_reset,
                system.pthread_mutex_lock, system.pthread_mutex_unlock, system.clock_gettime))))
        self._line.outgoing[:] = [ctypes.addressof(octets) for octets in self._outgoing]
        self._callback = _callback(
            self._lines.dtype, self._passages.dtype, *(pack.dtype for pack in self._kept))
        # Compiled before the first frame waits for them.
        self.frames()
        _shut(self._lines)

    def open(self, node, subscription, on_looked, on_message):
        """Let messages come, to go the long way at first.

        Parameters
        ----------
        node : rclpy.node.Node
        subscription : rclpy.subscription.Subscription
            To be kept from the executors; it stays until `close`.
        on_looked : callable
            Called in the executor's thread before messages go the long way.
        on_message : callable
            The long way: called there with a message, as bytes.
        """
        self._on_looked, self._on_message = on_looked, on_message
        # To reset a timer is what wakes every executor from another thread.
        self._timer = node.create_timer(
            NOW, self._serve, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._subscription = subscription
        self._lines['timer'] = self._timer.handle.pointer
        self._lines['subscription'] = subscription.handle.pointer
        self._listen(self._callback.address)
        # Else the middleware might still call what Python has taken down.
        atexit.register(self.close)

    def close(self):
        """Let none come any more; done at the end of the process at the latest."""
        atexit.unregister(self.close)
        _shut(self._lines)
        # Waits for a message that is on its way.
        self._listen(None)
        self._timer.cancel()

    def _listen(self, callback):
        self._rcl.rcl_subscription_set_on_new_message_callback(
            self._subscription.handle.pointer, callback, self._lines.ctypes.data)

    def shut(self):
        """Let the next message go the long way."""
        self._is_taught = False
        _shut(self._lines)

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
                self._passage.wanted[number] = False
                if template is not None and not teach_answer(self._passage, number, template):
                    return
                self._templates[number] = template
            if template is not None:
                # What goes before the message is the first half of a double.
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
        report = self._kept[-1]
        seen = copied(report)
        kept, count, seconds, nanoseconds = _look(
            self._lines, self._passages, report, self._log, self._states, seen)
        if not kept:
            return None
        log = self._log[:kept]
        return Frames(count, (seconds, nanoseconds), self._tracker.told(seen),
                      *log[:, :3].T.tolist(), glimpses(log, self._states[:kept].copy()))

    def _serve(self):
        """Let what did not pass go the long way."""
        self._timer.cancel()
        is_left = _shut(self._lines)
        self._on_looked()
        for _ in range(AT_ONCE):
            data = self._next(is_left)
            if data is None:
                break
            is_left = self._is_taught = False
            self._on_message(data)
        else:
            # Others have their turn.
            self._rcl.rcl_timer_reset(self._timer.handle.pointer)
            return
        if self._is_taught:
            _open(self._lines)

    def _next(self, is_left):
        if not is_left and self._rcl.rcl_take_serialized_message(
                self._subscription.handle.pointer, ctypes.byref(self._incoming), None, None):
            self._rcutils.rcutils_reset_error()
            return None
        return ctypes.string_at(self._incoming.buffer, self._incoming.length)


class Frames(NamedTuple):
    """Frames that passed.

    Attributes
    ----------
    count : int
        Of all, more than there are rows of when they were not looked at for long.
    stamp : tuple of int
        Seconds and nanoseconds of the last.
    state : HandState
        After the last.
    received, published, times : list of float
        [s]
    glimpses : list of (float, Glimpse)
    """

    count: int
    stamp: tuple
    state: NamedTuple
    received: list
    published: list
    times: list
    glimpses: list


def _libraries():
    """Return rcl, rcutils and the system's library, which the process has in use already."""
    if not sys.platform.startswith('linux'):
        raise Unavailable(f'not tried on {sys.platform}')
    try:
        rcl, rcutils = ctypes.CDLL('librcl.so'), ctypes.CDLL('librcutils.so')
        system = ctypes.CDLL(None)
        for function, count in ((rcl.rcl_take_serialized_message, 4), (rcl.rcl_timer_reset, 1),
                                (rcl.rcl_subscription_set_on_new_message_callback, 3)):
            function.argtypes = [ctypes.c_void_p] * count
    except (OSError, AttributeError) as error:
        raise Unavailable(error) from None
    rcutils.rcutils_get_default_allocator.restype = Allocator
    rcutils.rcutils_uint8_array_init.argtypes = [
        ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p]
    return rcl, rcutils, system


def _address(function):
    return ctypes.cast(function, ctypes.c_void_p).value


if COMPILED:
    @intrinsic
    def _call(typing, function, first, second, third, fourth):
        """Call a C function by its address: kernels with such a number in them are not cached."""
        def generate(context, builder, signature, arguments):
            words = [ir.IntType(64)] * 4
            pointer = ir.FunctionType(ir.IntType(32), words).as_pointer()
            return builder.call(builder.inttoptr(arguments[0], pointer), arguments[1:])
        return numba.int32(*[numba.int64] * 5), generate

    @intrinsic
    def _at(typing, address):
        """Return an address as a pointer."""
        def generate(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())
        return numba.types.voidptr(numba.int64), generate


@jit
def _now(line, address):
    """Return the time that Python's time.monotonic gives [s]."""
    _call(line.get_time, STEADY, address, 0, 0)
    return line.moment[0] + 1e-9 * line.moment[1]


@jit
def _shut(lines):
    """Shut the short way when no message is on it; return whether one was left."""
    line = lines[0]
    _call(line.lock, line.mutex, 0, 0, 0)
    line.is_open[0] = 0
    is_left, line.is_left[0] = line.is_left[0], 0
    _call(line.unlock, line.mutex, 0, 0, 0)
    return is_left > 0


@jit
def _open(lines):
    line = lines[0]
    _call(line.lock, line.mutex, 0, 0, 0)
    line.is_open[0] = 1
    _call(line.unlock, line.mutex, 0, 0, 0)


@jit
def _look(lines, passages, report, log, states, seen):
    """Look while no message is on its way; return also the last stamp."""
    line = lines[0]
    _call(line.lock, line.mutex, 0, 0, 0)
    kept, count = look(passages, report, log, states, seen)
    seconds, nanoseconds = passages[0].stamp[0], passages[0].stamp[1]
    _call(line.unlock, line.mutex, 0, 0, 0)
    return kept, count, seconds, nanoseconds


def _callback(*layouts):
    """Return what the middleware calls when messages have come, for packs of these layouts."""
    of_line, of_passage, of_model, of_chains, of_choices, of_clock, of_blank, of_state, of_report \
        = layouts

    @numba.cfunc('void(voidptr, uintp)', cache=CACHED, error_model='numpy')
    def on_messages(address, count):
        line = numba.carray(address, (1,), of_line)[0]
        _call(line.lock, line.mutex, 0, 0, 0)
        passages = numba.carray(_at(line.passage), (1,), of_passage)
        tracker = line.tracker
        report = numba.carray(_at(tracker[6]), (1,), of_report)
        incoming = numba.carray(_at(line.incoming), (2,), np.int64)
        moment = line.moment.ctypes.data
        while line.is_open[0] and _call(
                line.take, line.subscription, line.incoming, 0, 0) == 0:
            received = _now(line, moment)
            if not pass_message(
                    passages, numba.carray(_at(tracker[0]), (1,), of_model),
                    numba.carray(_at(tracker[1]), (1,), of_chains),
                    numba.carray(_at(tracker[2]), (1,), of_choices),
                    numba.carray(_at(tracker[3]), (1,), of_clock),
                    numba.carray(_at(tracker[4]), (1,), of_blank),
                    numba.carray(_at(tracker[5]), (1,), of_state), report,
                    numba.carray(_at(incoming[0]), (incoming[1],), np.uint8)):
                line.is_left[0] = 1
                line.is_open[0] = 0
                break
            for i in range(ANSWERS):
                if line.publishers[i] and _call(
                        line.publish, line.publishers[i], line.outgoing[i], 0, 0):
                    _call(line.reset_error, 0, 0, 0, 0)
            note(passages[0], report[0], received, _now(line, moment))
        is_shut = line.is_open[0] == 0
        _call(line.unlock, line.mutex, 0, 0, 0)
        if is_shut:
            _call(line.reset_timer, line.timer, 0, 0, 0)

    return on_messages
