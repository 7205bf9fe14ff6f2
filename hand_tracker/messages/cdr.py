"""Decode serialized messages of points without building messages of Python objects.

Building objects costs a hundred times what the tracking of a frame does. Kernels parse the bytes
instead, and Python looks at strings, ids and types only where their combination is new. The
encoding is plain CDR (XCDR1), DDS-XTypes 1.3, 7.4. Hostile bytes are refused.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.model.marker_layout import MARKERS
from ..core.numerics.jit import COMPILED, jit, load_kernel, loaded_or_plain
from .labels import LabelMap
from .landmark_parsers import parse_landmark_markers, parse_named_poses, parse_pose_array
from .marker_array import ADD, LIST_TYPES, Head, MarkerFrame, Sources, find_sources, placed, scaled
from .marker_array_parser import parse_marker_array
from .marker_ids import HandIds, MarkerIds, no_warning
from .message_kinds import (
    MARKER_ARRAY_KIND,
    PARSE_CLOUD,
    PARSE_MARKER_ARRAY,
    PARSE_MARKERS,
    PARSE_NAMED_POSES,
    PARSE_POSE_ARRAY,
    PARSE_RIGID_BODIES,
    MalformedMessage,
    MessageKind,
)
from .mocap4r2_parser import parse_mocap4r2_markers, parse_rigid_bodies
from .point_cloud_parser import MOST_MARKERS, parse_point_cloud
from .stamps import Stamp, Time

ENCAPSULATION = 4  # [bytes] before the message proper, from which on alignment counts
LITTLE_ENDIAN = b'\0\1\0\0'
ORDERS = {b'\0\0': 'big', b'\0\1': 'little'}
INITIAL_CAPACITY = 2**14           # [bytes] for messages at first
SIGNATURES_KEPT = 256            # of messages that are remembered at most,
SIGNATURE_BYTES = 2**16     # and of so many bytes each
SMALLEST_POINT = 32  # [bytes], less than any message needs for one, but for those of clouds


def point_capacity(size: int) -> int:
    """Return the greatest number of points of a message of `size` bytes."""
    return max(size // SMALLEST_POINT, MOST_MARKERS) + 1


def number_capacity(size: int) -> int:
    """Return the doubles that hold a message of `size` bytes and, behind it, a cloud's points."""
    return size // 8 + 2 + 3 * MOST_MARKERS


class MessageSignature(NamedTuple):
    """Layout of a message; messages with equal signatures are decoded alike.

    Attributes
    ----------
    parser : int
        Number of its parser.
    heads : ndarray of int32, shape (n, 5)
    strings : ndarray of uint8, shape (m,)
        As `parse_points` finds them.
    sources : Sources
        Where the hand's markers are in the message.
    """

    parser: int
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
        x, y, z, w; of a list.
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
    """Read messages of points of one kind.

    Parameters
    ----------
    labels, frame_id, scale, zero_is_missing
        See `markers_from_message`.
    kind : MessageKind, optional
        MarkerArrays when left out.
    warn_once : callable, optional
        Logs a warning (key, text) once for each key.
    ids : callable, optional
        Of the hand's markers in messages of names, see `MarkerIds`.
    """

    def __init__(self, labels: LabelMap, frame_id: str = '', scale: float = 1.0,
                 zero_is_missing: bool = True, kind: MessageKind = MARKER_ARRAY_KIND,
                 warn_once: Callable[[str, str], None] = no_warning,
                 ids: HandIds | None = None) -> None:
        self._labels, self._frame_id = labels, frame_id
        self._scale, self._zero_is_missing = float(scale), bool(zero_is_missing)
        self._kind, self._ids = kind, MarkerIds(warn_once, ids)
        # By the number of names, with which the ids of markers change, and the layout's bytes.
        self._sources: dict[tuple[int, bytes], Sources] = {}
        self._reserve(INITIAL_CAPACITY)
        self._read: tuple[int, int, Sources] | None = None
        self.use_loaded_kernels()

    def load_kernels(self, folder: Path | None = None) -> None:
        """Load the compiled kernels of `read` from disk, as `HandTracker.load_kernels` does."""
        none = np.zeros(0, np.int64)
        load_kernel(parse_points, (self._kind.parser, self._octets, self._words, self._numbers, 0,
                                   self._heads, self._places, self._strings), folder)
        load_kernel(gather_positions, (self._numbers, self._places, none, none, 1., True,
                             np.empty((len(MARKERS), 3))), folder)

    def use_loaded_kernels(self) -> None:
        """Go on with the kernels that `load_kernels` has loaded, if it has."""
        self._parse = loaded_or_plain(parse_points)
        self._gather = loaded_or_plain(gather_positions)
        # Plain Python reads single numbers of a memoryview five times as fast as of an array.
        is_compiled = COMPILED or self._parse is not parse_points
        self._indexed: Any = np.asarray if is_compiled else memoryview

    def _reserve(self, size: int) -> None:
        self._numbers = np.zeros(number_capacity(size))
        self._octets = self._numbers.view(np.uint8)
        self._memory = memoryview(self._octets)  # type: ignore[arg-type]
        self._words = self._numbers.view(np.int32)
        points = point_capacity(size)
        self._heads = np.zeros((points, 5), np.int32)
        self._places = np.zeros((points, 3), np.int64)
        self._strings = np.zeros(size, np.uint8)

    def read(self, data: bytes) -> MarkerFrame:
        """Decode a serialized message, as `markers_from_message` does a MarkerArray.

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
        layout = self._heads[:count].tobytes() + self._strings[:used].tobytes()
        sources = self._sources.get((len(self._ids.rows), layout)) or self._learn(
            layout, count, used)
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
        """Yield the points of a serialized message, of a list together, whatever their labels.

        Parameters
        ----------
        data : bytes

        Raises
        ------
        MalformedMessage
        """
        words, numbers, count, used = self._parsed(data)
        for head, (at, pose, points) in zip(self._named_heads(count, used), self._places[:count]):
            if head.action != ADD:
                continue
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
        return MessageSignature(
            self._kind.parser, self._heads[:count], self._strings[:used], sources)

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
        count, used = self._parse(self._kind.parser, self._octets, self._indexed(words), numbers,
                                  size, self._heads, self._places, self._strings)
        if count < 0:
            raise MalformedMessage(f'{len(data)} bytes that are no {self._kind.title}')
        return words, numbers, count, used

    def _learn(self, layout: bytes, count: int, used: int) -> Sources:
        """Find the markers' places in messages with a byte signature, and cache them."""
        sources = find_sources(self._named_heads(count, used), self._labels, self._frame_id)
        if len(layout) <= SIGNATURE_BYTES:
            if len(self._sources) == SIGNATURES_KEPT:
                self._sources.clear()
            self._sources[len(self._ids.rows), layout] = sources
        return sources

    def _named_heads(self, count: int, used: int) -> list[Head]:
        """Return the heads of the points that were parsed."""
        return self._kind.heads(
            self._heads[:count].tolist(), self._strings[:used].tobytes(), self._ids)

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


@jit
def parse_points(parser: int, octets: np.ndarray, words: np.ndarray, numbers: np.ndarray,
                 size: int, heads: np.ndarray, places: np.ndarray,
                 strings: np.ndarray) -> tuple[int, int]:
    """Find the points of a message.

    Nothing beyond the bytes is read, whatever lengths and counts they hold.

    Parameters
    ----------
    parser : int
        `PARSE_MARKER_ARRAY` or another of these.
    octets : ndarray of uint8, shape (>= size,)
        As received.
    words : ndarray of int32, shape (>= size // 4,)
    numbers : ndarray, shape (`number_capacity(size)`,)
        The same bytes in this machine's order; positions that a cloud holds are written behind
        them, and what is no position of a landmark is changed.
    size : int
        Bytes of the message.
    heads : ndarray of int32, shape (n, 5)
        Filled: what distinguishes the points, see each parser. Messages with equal heads and
        strings have equal points at the same places.
    places : ndarray of int64, shape (n, 3)
        Filled: where the stamp is in words; where position and the points of a list are in
        doubles, of landmarks instead of the latter which hand's they are.
    strings : ndarray of uint8, shape (>= size,)
        Filled: texts of which the heads have the lengths.

    Returns
    -------
    count : int
        Points found, -1 when the bytes are no such message or n is too small.
    used : int
        Bytes of ``strings``.
    """
    if parser == PARSE_MARKER_ARRAY:
        return parse_marker_array(octets, words, size, heads, places, strings)
    if parser == PARSE_MARKERS:
        return parse_mocap4r2_markers(octets, words, size, heads, places, strings)
    if parser == PARSE_RIGID_BODIES:
        return parse_rigid_bodies(octets, words, size, heads, places, strings)
    if parser == PARSE_POSE_ARRAY:
        return parse_pose_array(octets, words, numbers, size, heads, places, strings)
    if parser == PARSE_NAMED_POSES:
        return parse_named_poses(octets, words, numbers, size, heads, places, strings)
    if parser == PARSE_CLOUD:
        return parse_point_cloud(octets, words, numbers, size, heads, places, strings)
    return parse_landmark_markers(octets, words, numbers, size, heads, places, strings)


@jit
def gather_positions(numbers: np.ndarray, places: np.ndarray, slots: np.ndarray,
                     markers: np.ndarray, scale: float, zero_is_missing: bool,
                     rows: np.ndarray) -> None:
    """Copy the positions of the hand's markers out of a message, scaled to metres.

    Parameters
    ----------
    numbers : ndarray, shape (n,)
    places : ndarray of int64, shape (m, 3)
        See `parse_points`.
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
