"""rcl, the C library below rclpy, for compiled code: its functions by their addresses."""

import ctypes
import os
import sys

from ...core.numerics.jit import COMPILED

if COMPILED:
    import numba
    from llvmlite import ir
    from numba.extending import intrinsic

LOADED = os.RTLD_NOLOAD | os.RTLD_NOW if sys.platform.startswith('linux') else None
MUTEX = 64  # [bytes], more than pthread_mutex_t has
POINTER, SIZE = ctypes.c_void_p, ctypes.c_size_t


class Unavailable(Exception):
    """It cannot be used here; the message says why."""


class Allocator(ctypes.Structure):
    """rcutils_allocator_t"""

    _fields_ = [(name, POINTER) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class Octets(ctypes.Structure):
    """rcutils_uint8_array_t, as which rcl takes and gives messages."""

    _fields_ = [('buffer', POINTER), ('length', SIZE), ('capacity', SIZE),
                ('allocator', Allocator)]

    def text(self):
        """Return what it holds, as bytes."""
        return ctypes.string_at(self.buffer, self.length)


class Rcl:
    """The libraries that the process has in use already.

    Raises
    ------
    Unavailable
    """

    def __init__(self):
        if LOADED is None or sys.maxsize < 2**32 or sys.byteorder != 'little':
            raise Unavailable('it was not tried on such a system')
        try:
            rcl = ctypes.CDLL('librcl.so', mode=LOADED)
            self._rcutils = rcutils = ctypes.CDLL('librcutils.so', mode=LOADED)
            system = ctypes.CDLL(None)
            self.take = _typed(rcl.rcl_take_serialized_message, *[POINTER] * 4)
            self.publish = rcl.rcl_publish_serialized_message
            self.listen = _typed(
                rcl.rcl_subscription_set_on_new_message_callback, *[POINTER] * 3)
            self.reset_timer = _typed(rcl.rcl_timer_reset, POINTER)
            self.reset_error = rcutils.rcutils_reset_error
            self.lock, self.unlock = system.pthread_mutex_lock, system.pthread_mutex_unlock
            self.get_time, self._new_mutex = system.clock_gettime, system.pthread_mutex_init
            self._allocator = _typed(rcutils.rcutils_get_default_allocator, result=Allocator)()
        except (OSError, AttributeError) as error:
            raise Unavailable(error) from None

    def octets(self, capacity=0):
        """Return room for a message, never given back; without a capacity none as yet."""
        octets = Octets(allocator=self._allocator)
        if capacity:
            make = _typed(self._rcutils.rcutils_uint8_array_init, POINTER, SIZE, POINTER)
            if make(ctypes.byref(octets), capacity, ctypes.byref(self._allocator)):
                raise Unavailable('there is no memory')
        return octets

    def mutex(self):
        """Return a mutex, as a buffer."""
        mutex = ctypes.create_string_buffer(MUTEX)
        self._new_mutex(mutex, None)
        return mutex


def address(function):
    """Return the address of a C function."""
    return ctypes.cast(function, POINTER).value


def _typed(function, *arguments, result=ctypes.c_int):
    function.argtypes, function.restype = arguments, result
    return function


if COMPILED:
    @intrinsic
    def call(typing, function, first, second, third, fourth):
        """Call a C function by its address.

        Numba knows those of ctypes too, but keeps no kernel on disk that has one in it.
        """
        def generate(context, builder, signature, arguments):
            pointer = ir.FunctionType(ir.IntType(32), [ir.IntType(64)] * 4).as_pointer()
            return builder.call(builder.inttoptr(arguments[0], pointer), arguments[1:])
        return numba.int32(*[numba.int64] * 5), generate

    @intrinsic
    def at(typing, address):
        """Return an address as a pointer."""
        def generate(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())
        return numba.types.voidptr(numba.int64), generate
