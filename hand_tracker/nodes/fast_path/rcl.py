"""rcl, the C library below rclpy: its functions by their addresses, for compiled code."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any

from ...core.numerics.jit import COMPILED

if COMPILED:
    import numba
    from llvmlite import ir
    from numba.extending import intrinsic

ALREADY_LOADED = os.RTLD_NOLOAD | os.RTLD_NOW if sys.platform.startswith('linux') else None
MUTEX_SIZE = 64  # [bytes], more than pthread_mutex_t has
POINTER, SIZE_T = ctypes.c_void_p, ctypes.c_size_t


class FastPathUnavailable(Exception):
    """There can be no fast path here; the message says why."""


class Allocator(ctypes.Structure):
    """rcutils_allocator_t"""

    _fields_ = [(name, POINTER) for name in (
        'allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')]


class Octets(ctypes.Structure):
    """rcutils_uint8_array_t, in which rcl takes and publishes serialized messages."""

    _fields_ = [('buffer', POINTER), ('length', SIZE_T), ('capacity', SIZE_T),
                ('allocator', Allocator)]

    def content(self) -> bytes:
        """Return the message."""
        return ctypes.string_at(self.buffer, self.length)


class Rcl:
    """C functions of libraries that the process has loaded already.

    Raises
    ------
    FastPathUnavailable
    """

    def __init__(self) -> None:
        if ALREADY_LOADED is None or sys.maxsize < 2**32 or sys.byteorder != 'little':
            raise FastPathUnavailable('it was not tried on such a system')
        try:
            rcl = ctypes.CDLL('librcl.so', mode=ALREADY_LOADED)
            self._rcutils = rcutils = ctypes.CDLL('librcutils.so', mode=ALREADY_LOADED)
            system = ctypes.CDLL(None)
            self.take = _typed(rcl.rcl_take_serialized_message, *[POINTER] * 4)
            self.publish = rcl.rcl_publish_serialized_message
            self.set_callback = _typed(
                rcl.rcl_subscription_set_on_new_message_callback, *[POINTER] * 3)
            self._resize = _typed(rcutils.rcutils_uint8_array_resize, POINTER, SIZE_T)
            self.reset_timer = _typed(rcl.rcl_timer_reset, POINTER)
            self.reset_error = rcutils.rcutils_reset_error
            self.lock, self.unlock = system.pthread_mutex_lock, system.pthread_mutex_unlock
            self.get_time, self._new_mutex = system.clock_gettime, system.pthread_mutex_init
            self.poll, self.receive = system.poll, system.recv
            self._allocator = _typed(rcutils.rcutils_get_default_allocator, result=Allocator)()
        except (OSError, AttributeError) as error:
            raise FastPathUnavailable(error) from None

    def octets(self, capacity: int = 0) -> Octets:
        """Return a buffer for a message, never freed; without a capacity it has no memory yet."""
        octets = Octets(allocator=self._allocator)
        if capacity:
            make = _typed(self._rcutils.rcutils_uint8_array_init, POINTER, SIZE_T, POINTER)
            if make(ctypes.byref(octets), capacity, ctypes.byref(self._allocator)):
                raise FastPathUnavailable('there is no memory')
        return octets

    def resize(self, octets: Octets, capacity: int) -> None:
        """Give a buffer another capacity; its message is lost."""
        self._resize(ctypes.byref(octets), capacity)

    def mutex(self) -> ctypes.Array[ctypes.c_char]:
        """Return the memory of an initialised mutex."""
        mutex = ctypes.create_string_buffer(MUTEX_SIZE)
        self._new_mutex(mutex, None)
        return mutex


def address(function: Any) -> int:
    """Return the address of a C function."""
    return ctypes.cast(function, POINTER).value or 0


def _typed(function: Any, *arguments: Any, result: Any = ctypes.c_int) -> Any:
    function.argtypes, function.restype = arguments, result
    return function


if COMPILED:
    @intrinsic
    def call(typing: Any, function: Any, first: Any, second: Any, third: Any, fourth: Any) -> Any:
        """Call a C function by its address.

        Numba can call functions of ctypes, but keeps no kernel on disk that does.
        """
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pointer = ir.FunctionType(ir.IntType(32), [ir.IntType(64)] * 4).as_pointer()
            return builder.call(builder.inttoptr(arguments[0], pointer), arguments[1:])
        return numba.int32(*[numba.int64] * 5), generate

    @intrinsic
    def at(typing: Any, address: Any) -> Any:
        """Return an address as a pointer."""
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())
        return numba.types.voidptr(numba.int64), generate
