"""Scratch arrays of kernels: compiled, they lie on the stack, without heap allocation."""

import math
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from .jit import COMPILED


def local_floats(shape: int | tuple[int, ...]) -> np.ndarray:
    """Return zeros that a kernel uses until it returns; compiled, they lie on its stack.

    Parameters
    ----------
    shape : int or tuple of int
        Of the result; constants.
    """
    return np.zeros(shape)


def local_integers(shape: int | tuple[int, ...]) -> np.ndarray:
    """Return integer zeros that a kernel uses until it returns, as `local_floats` does."""
    return np.zeros(shape, dtype=np.int64)


def local_flags(shape: int | tuple[int, ...]) -> np.ndarray:
    """Return False flags that a kernel uses until it returns, as `local_floats` does."""
    return np.zeros(shape, dtype=np.bool_)


def _put_on_stack(function: Callable[[Any], np.ndarray], kind: str) -> None:
    """Compile a function that makes zeros of a constant shape as memory of its caller's stack."""
    extending: Any = import_module('numba.extending')
    core: Any = import_module('numba.core')
    arrays: Any = import_module('numba.np.arrayobj')
    item_type = getattr(core.types, kind)

    def constants(shape: Any) -> tuple[int | None, ...]:
        sizes = shape if isinstance(shape, core.types.BaseTuple) else (shape,)
        return tuple(getattr(size, 'literal_value', None) for size in sizes)

    @extending.type_callable(function)
    def _type(context: Any) -> Callable[[Any], Any]:
        def array_type(shape: Any) -> Any:
            sizes = constants(shape)
            return None if None in sizes else core.types.Array(item_type, len(sizes), 'C')

        return array_type

    @extending.lower_builtin(function, core.types.Any)
    def _lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def number(value: int) -> Any:
            return context.get_constant(core.types.intp, value)

        sizes: tuple[Any, ...] = constants(signature.args[0])
        stored = context.get_data_type(item_type)
        width = context.get_abi_sizeof(stored)
        count = math.prod(sizes)
        memory = core.cgutils.alloca_once(builder, stored, size=count)
        core.cgutils.memset(builder, memory, number(width * count), 0)
        array = arrays.make_array(signature.return_type)(context, builder)
        strides = [number(width * math.prod(sizes[axis + 1:])) for axis in range(len(sizes))]
        arrays.populate_array(
            array, memory, [number(size) for size in sizes], strides, number(width), None)
        return array._getvalue()


if COMPILED:
    for _function, _kind in (
            (local_floats, 'float64'), (local_integers, 'int64'), (local_flags, 'bool_')):
        _put_on_stack(_function, _kind)
