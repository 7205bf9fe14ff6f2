"""Decode serialized MarkerArrays without building messages of Python objects.

Building objects costs a hundred times what the tracking of a frame does. Kernels parse the bytes
instead, and Python looks at strings, ids and types only where their combination is new. The
encoding is plain CDR (XCDR1), DDS-XTypes 1.3, 7.4. Hostile bytes are refused.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MARKERS
from ..core.numerics.jit import COMPILED, jit, load_kernel, loaded_or_plain
from .labels import LabelMap
from .marker_array import (
    ADD,
    CUBE,
    CUBE_LIST,
    CYLINDER,
    LIST_TYPES,
    POINTS,
    SPHERE,
    SPHERE_LIST,
    Head,
    MarkerFrame,
    Sources,
    find_sources,
    placed,
    scaled,
)
from .stamps import Stamp, Time

ENCAPSULATION = 4  # [bytes] before the message proper, from which on alignment counts
LITTLE_ENDIAN = b'\0\1\0\0'
ORDERS = {b'\0\0': 'big', b'\0\1': 'little'}
SMALLEST_MARKER = 128  # [bytes], less than any has
INITIAL_CAPACITY = 2**14           # [bytes] for messages at first
SIGNATURES_KEPT = 256            # of messages that are remembered at most,
SIGNATURE_BYTES = 2**16     # and of so many bytes each


class MalformedMessage(HandTrackerError, ValueError):
    """Bytes that are no message of the expected type."""


class MessageSignature(NamedTuple):
    """Layout of a MarkerArray; messages with equal signatures are decoded alike.

    Attributes
    ----------
    heads : ndarray of int32, shape (n, 5)
    strings : ndarray of uint8, shape (m,)
        As `parse_marker_array` finds them.
    sources : Sources
        Where the hand's markers are in the message.
    """

    heads: np.ndarray
    strings: np.ndarray
    sources: Sources


class PointMarker(NamedTuple):
    """A point-like marker of a message.

    Attributes
    ----------
    stamp : Time
    frame_id, ns : str
    id : int
    position : ndarray, shape (3,)
    orientation : ndarray, shape (4,)
        x, y, z, w.
    points : ndarray, shape (n, 3), or None
        Of a list.
    """

    stamp: Time
    frame_id: str
    ns: str
    id: int
    position: np.ndarray
    orientation: np.ndarray
    points: np.ndarray | None


class MarkerReader:
    """Read MarkerArrays.

    Parameters
    ----------
    labels, frame_id, scale, zero_is_missing
        See `markers_from_message`.
    """

    def __init__(self, labels: LabelMap, frame_id: str = '', scale: float = 1.0,
                 zero_is_missing: bool = True) -> None:
        self._labels, self._frame_id = labels, frame_id
        self._scale, self._zero_is_missing = float(scale), bool(zero_is_missing)
        self._sources: dict[bytes, Sources] = {}
        self._reserve(INITIAL_CAPACITY)
        self._read: tuple[int, int, Sources] | None = None
        self.use_loaded_kernels()

    def load_kernels(self, folder: Path | None = None) -> None:
        """Load the compiled kernels of `read` from disk, as `HandTracker.load_kernels` does."""
        none = np.zeros(0, np.int64)
        load_kernel(parse_marker_array, (self._octets, self._words, 0, self._heads, self._places,
                           self._strings), folder)
        load_kernel(gather_positions, (self._numbers, self._places, none, none, 1., True,
                             np.empty((len(MARKERS), 3))), folder)

    def use_loaded_kernels(self) -> None:
        """Go on with the kernels that `load_kernels` has loaded, if it has."""
        self._parse = loaded_or_plain(parse_marker_array)
        self._gather = loaded_or_plain(gather_positions)
        # Plain Python reads single numbers of a memoryview five times as fast as of an array.
        is_compiled = COMPILED or self._parse is not parse_marker_array
        self._indexed: Any = np.asarray if is_compiled else memoryview

    def _reserve(self, size: int) -> None:
        self._numbers = np.zeros(size // 8 + 1)
        self._octets = self._numbers.view(np.uint8)
        self._memory = memoryview(self._octets)  # type: ignore[arg-type]
        self._words = self._numbers.view(np.int32)
        markers = size // SMALLEST_MARKER + 1
        self._heads = np.zeros((markers, 5), np.int32)
        self._places = np.zeros((markers, 3), np.int64)
        self._strings = np.zeros(size, np.uint8)

    def read(self, data: bytes) -> MarkerFrame:
        """Decode a serialized MarkerArray, as `markers_from_message` does a message.
        Parameters
        ----------
        data : bytes

        Returns
        -------
        MarkerFrame
            Its stamp is a `Stamp`.

        Raises
        ------
        MalformedMessage
        """
        words, numbers, count, used = self._parsed(data)
        kind = self._heads[:count].tobytes() + self._strings[:used].tobytes()
        sources = self._sources.get(kind) or self._learn(kind, count)
        self._read = count, used, sources
        rows = np.empty((len(self._labels.labels), 3))
        self._gather(self._indexed(numbers), self._places, sources.slots, sources.markers,
                     self._scale, self._zero_is_missing, rows)
        if sources.has_lists:
            self._place_lists(numbers, sources, rows)
        stamp = None
        if sources.first is not None:
            at = self._places[sources.first, 0]
            stamp = Stamp(int(words[at]), int(words[at + 1]) & 0xffffffff)
        return MarkerFrame(stamp, sources.frame_id, rows, sources.unknown, sources.foreign,
                           sources.doubled)

    def points(self, data: bytes) -> Iterator[PointMarker]:
        """Yield the point-like markers that a serialized MarkerArray adds, whatever their labels.

        Parameters
        ----------
        data : bytes

        Raises
        ------
        MalformedMessage
        """
        words, numbers, count, _ = self._parsed(data)
        for head, (at, pose, points) in zip(self._named_heads(count), self._places[:count]):
            listed = numbers[points:points + 3 * head.points].reshape(-1, 3)
            yield PointMarker(
                Stamp(int(words[at]), int(words[at + 1]) & 0xffffffff), head.frame_id, head.ns,
                head.id, numbers[pose:pose + 3].copy(), numbers[pose + 3:pose + 7].copy(),
                listed.copy() if head.type in LIST_TYPES else None)

    @property
    def signature(self) -> MessageSignature:
        """The `MessageSignature` of the last message."""
        assert self._read is not None, 'no message was read yet'
        count, used, sources = self._read
        return MessageSignature(self._heads[:count], self._strings[:used], sources)

    def _parsed(self, data: bytes) -> tuple[np.ndarray, np.ndarray, int, int]:
        """Parse a message into heads, places and strings.

        Returns
        -------
        words, numbers : ndarray
            The message by four bytes as integers and by eight as floats.
        count, used : int
            Of the markers, and of the bytes of their strings.

        Raises
        ------
        MalformedMessage
        """
        order = ORDERS.get(data[:2])
        size = len(data) - ENCAPSULATION
        if order is None or size < 0:
            raise MalformedMessage(f'{len(data)} bytes in an encoding other than plain CDR')
        if size > self._strings.size:
            self._reserve(2 * size)
        # In memory of its own the message is aligned, as the kernels are compiled for.
        self._memory[:size] = memoryview(data)[ENCAPSULATION:]
        words, numbers = self._words, self._numbers
        if order != sys.byteorder:
            words, numbers = words.byteswap(), numbers.byteswap()
        count, used = self._parse(self._octets, self._indexed(words), size, self._heads,
                                  self._places, self._strings)
        if count < 0:
            raise MalformedMessage(f'{len(data)} bytes that are no MarkerArray')
        return words, numbers, count, used

    def _learn(self, kind: bytes, count: int) -> Sources:
        """Find the markers' places in messages with a byte signature, and cache them."""
        sources = find_sources(self._named_heads(count), self._labels, self._frame_id)
        if len(kind) <= SIGNATURE_BYTES:
            if len(self._sources) == SIGNATURES_KEPT:
                self._sources.clear()
            self._sources[kind] = sources
        return sources

    def _named_heads(self, count: int) -> list[Head]:
        """Return the heads of the markers that were parsed."""
        heads, at = [], 0
        for frame_length, ns_length, number, type_, points in self._heads[:count].tolist():
            strings = self._strings[at:at + frame_length + ns_length].tobytes()
            at += frame_length + ns_length
            heads.append(Head(_text(strings[:frame_length]), _text(strings[frame_length:]),
                              number, type_, ADD, points))
        return heads

    def _place_lists(self, numbers: np.ndarray, sources: Sources, rows: np.ndarray) -> None:
        """Put the points of lists into the rows of their markers."""
        is_listed = sources.points >= 0
        for marker in np.unique(sources.markers[is_listed]):
            of_this = is_listed & (sources.markers == marker)
            _, pose, points = self._places[marker]
            at = points + 3 * sources.points[of_this]
            found = placed(numbers[at[:, None] + (0, 1, 2)], numbers[pose:pose + 3],
                           numbers[pose + 3:pose + 7], self._zero_is_missing)
            rows[sources.slots[of_this]] = scaled(found, self._scale, self._zero_is_missing)


def _text(string: bytes) -> str:
    """Return a string of CDR as rclpy does: up to its first NUL."""
    return string.partition(b'\0')[0].decode(errors='replace')


# --- parsing of a MarkerArray

@jit
def _aligned(at: int, to: int) -> int:
    """Return the first place from ``at`` on that is a multiple of ``to``."""
    return (at + to - 1) // to * to


@jit
def _counted(words: np.ndarray, size: int, at: int) -> tuple[int, int]:
    """Read a sequence's length; return it and the offset of its items, `size` + 1 if cut off."""
    at = _aligned(at, 4)
    if at + 4 > size:
        return 0, size + 1
    count = words[at // 4]
    if count < 0:  # more than any buffer holds
        return 0, size + 1
    return count, at + 4


@jit
def _after(words: np.ndarray, size: int, at: int, width: int, alignment: int) -> int:
    """Return the offset of the end of a sequence of items ``width`` bytes wide."""
    count, at = _counted(words, size, at)
    if count > 0:
        at = _aligned(at, alignment) + count * width
    return at


@jit
def parse_marker_array(octets: np.ndarray, words: np.ndarray, size: int, heads: np.ndarray,
                       places: np.ndarray, strings: np.ndarray) -> tuple[int, int]:
    """Find the point-like markers that a MarkerArray adds.

    Nothing beyond the bytes is read, whatever lengths and counts they hold.

    Parameters
    ----------
    octets : ndarray of uint8, shape (>= size,)
    words : ndarray of int32, shape (>= size // 4,)
        The same bytes.
    size : int
        Bytes of the message.
    heads : ndarray of int32, shape (n, 5)
        Filled: lengths of frame and namespace, id, type, number of the list's points.
    places : ndarray of int64, shape (n, 3)
        Filled: where the stamp is in words; where pose and points are in doubles.
    strings : ndarray of uint8, shape (>= size,)
        Filled: frame and namespace of each.

    Returns
    -------
    count : int
        Markers found, -1 when the bytes are no MarkerArray.
    used : int
        Bytes of ``strings``.
    """
    found = used = 0
    markers, at = _counted(words, size, 0)
    for _ in range(markers):
        stamp = _aligned(at, 4)
        frame_length, frame = _counted(words, size, stamp + 8)
        ns_length, ns = _counted(words, size, frame + frame_length)
        head = _aligned(ns + ns_length, 4)  # id, type, action
        if head + 12 > size:
            return -1, 0
        number, kind, action = words[head // 4], words[head // 4 + 1], words[head // 4 + 2]
        pose = _aligned(head + 12, 8)
        # Of 7 + 3 doubles of pose and scale; 4 floats, a Duration and a flag.
        points_count, points = _counted(words, size, pose + 80 + 16 + 8 + 1)
        is_list = kind == CUBE_LIST or kind == SPHERE_LIST or kind == POINTS
        if points_count > 0:
            points = _aligned(points, 8)
        at = _after(words, size, points + 24 * points_count, 16, 4)  # colors
        at = _after(words, size, at, 1, 1)  # texture_resource
        at = _after(words, size, _aligned(at, 4) + 8, 1, 1)  # texture: stamp, frame
        at = _after(words, size, at, 1, 1)  # its format
        at = _after(words, size, at, 1, 1)  # its data
        at = _after(words, size, at, 8, 4)  # uv_coordinates
        at = _after(words, size, at, 1, 1)  # text
        at = _after(words, size, at, 1, 1)  # mesh_resource
        at = _after(words, size, at, 1, 1)  # mesh_file: its name
        at = _after(words, size, at, 1, 1)  # its data
        at += 1  # mesh_use_embedded_materials
        if at > size:
            return -1, 0
        if action != ADD or not (is_list or kind == CUBE or kind == SPHERE or kind == CYLINDER):
            continue
        heads[found, 0], heads[found, 1] = frame_length, ns_length
        heads[found, 2], heads[found, 3] = number, kind
        heads[found, 4] = points_count if is_list else 0
        places[found, 0], places[found, 1], places[found, 2] = stamp // 4, pose // 8, points // 8
        strings[used:used + frame_length] = octets[frame:frame + frame_length]
        used += frame_length
        strings[used:used + ns_length] = octets[ns:ns + ns_length]
        used += ns_length
        found += 1
    if at > size:
        return -1, 0
    return found, used


@jit
def gather_positions(numbers: np.ndarray, places: np.ndarray, slots: np.ndarray,
                     markers: np.ndarray, scale: float, zero_is_missing: bool,
                     rows: np.ndarray) -> None:
    """Put the positions of markers into the rows of those of the hand.

    Parameters
    ----------
    numbers : ndarray, shape (n,)
    places : ndarray of int64, shape (m, 3)
        See `parse_marker_array`.
    slots, markers : ndarray of int64
        See `Sources`.
    scale, zero_is_missing
        See `markers_from_message`.
    rows : ndarray, shape (n, 3)
        Filled: NaN where not seen.
    """
    rows[:] = np.nan
    for i in range(len(slots)):
        at = places[markers[i], 1]
        x, y, z = numbers[at], numbers[at + 1], numbers[at + 2]
        if not (zero_is_missing and x == 0. and y == 0. and z == 0.):
            row = slots[i]
            rows[row, 0], rows[row, 1], rows[row, 2] = scale * x, scale * y, scale * z
