"""Packs: nested named tuples of arrays as one argument of a kernel, a record array."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from .jit import COMPILED, jit, record_layout

Record = TypeVar('Record')
Pack = Sequence  # Pack[Record]: a sequence of one record, from `packed`


def packed(values: Record, as_record: bool = COMPILED) -> tuple[Any, Record]:
    """Return nested named tuples of arrays as one argument of a kernel.

    For compiled kernels this is a record array, which holds copies: arrays of a tuple would be
    passed one by one, and each would cost every call 0.1 µs and every compilation 50 ms. Booleans
    become bytes there. For plain Python it is a tuple of `values` as they are.

    Parameters
    ----------
    values : NamedTuple
        Of arrays, numbers and such tuples.
    as_record : bool, optional
        Whether for compiled kernels; as the kernels of this process when left out.

    Returns
    -------
    pack : sequence of one
        Its item has the fields of `values`.
    values : NamedTuple
        Of the same type; its arrays share memory with the pack.
    """
    if not as_record:
        return (values,), values
    record = np.zeros(1, record_layout(_layout(values)))
    return record, _filled(record[0], values)


def as_item(values: Record) -> Record:
    """Return nested named tuples of arrays as kernels get them from a pack: as a record."""
    return packed(values)[0][0]


def empty_like_pack(pack: Pack[Record]) -> Pack[Record]:
    """Return an uninitialised pack of the same layout."""
    return empty_packs(pack, 1)[0]


def empty_packs(pack: Pack[Any], count: int) -> list[Pack[Any]]:
    """Return uninitialised packs of the same layout, in one block where they are records.

    numpy takes as long to allocate one record of many fields as a thousand.
    """
    if isinstance(pack, np.ndarray):
        return list(np.empty((count, len(pack)), pack.dtype))
    return [(type(pack[0])(*(np.empty_like(part) for part in pack[0])),) for _ in range(count)]


def parts(pack: Pack[Any]) -> tuple[Any, ...]:
    """Return the arrays of a pack, in order."""
    return pack.item() if isinstance(pack, np.ndarray) else tuple(pack[0])


def _layout(values: Any) -> np.dtype:
    kinds: list[tuple[Any, ...]] = []
    for name, part in zip(values._fields, values):
        if hasattr(part, '_fields'):
            kinds.append((name, _layout(part)))
        else:
            part = np.asarray(part)
            is_mask = part.dtype == bool and part.ndim > 0  # numba has no such arrays in records
            kinds.append((name, np.uint8 if is_mask else part.dtype, part.shape))
    return np.dtype(kinds, align=True)


def _filled(record: Any, values: Any) -> Any:
    parts = []
    for name, part in zip(values._fields, values):
        if hasattr(part, '_fields'):
            parts.append(_filled(record[name], part))
            continue
        record[name] = part
        view = record[name]
        parts.append(view.view(bool) if np.asarray(part).dtype == bool else view)
    return type(values)(*parts)


if COMPILED:
    @jit
    def indexed(array: Any) -> Any:
        """Return an array in the form in which kernels read and write single numbers fastest."""
        return array

    @jit
    def overwrite(pack: Any, other: Pack[Any]) -> None:
        """Copy all values of one pack into another of the same layout."""
        pack[0] = other[0]
else:
    # Plain Python gets floats of a memoryview, twice as fast as numpy's scalars.
    indexed = memoryview  # type: ignore[assignment]

    def overwrite(pack: Any, other: Pack[Any]) -> None:
        """Copy all values of one pack into another of the same layout."""
        for part, new in zip(pack[0], other[0]):
            if hasattr(part, '_fields'):
                overwrite((part,), (new,))
            else:
                part[...] = new
