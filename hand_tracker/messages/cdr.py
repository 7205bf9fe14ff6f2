"""Bytes of messages to arrays and arrays to bytes, as DDS has them on the wire. No ROS.

Building messages of Python objects costs a hundred times what the tracking of a frame does.
A MarkerArray is walked instead: only its strings, ids and types are looked at by Python, and
only when they are new. A JointState and a TFMessage are templates, whose numbers are written
in place. The encoding is plain CDR (XCDR1), of DDS-XTypes 1.3, 7.4.
"""

import struct
import sys
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MARKERS
from ..core.numerics.jit import COMPILED, jit
from .marker_array import (
    ADD,
    CUBE,
    CUBE_LIST,
    CYLINDER,
    POINTS,
    SPHERE,
    SPHERE_LIST,
    TRIANGLE_LIST,
    Head,
    MarkerFrame,
    Sources,
    find_sources,
    placed,
    scaled,
)

ENCAPSULATION = 4  # [bytes] before the message proper, from which on alignment counts
LITTLE_ENDIAN = b'\0\1\0\0'
ORDERS = {b'\0\0': 'big', b'\0\1': 'little'}
SMALLEST_MARKER = 128  # [bytes], less than any has
ROOM = 2**14           # [bytes] for messages at first
KINDS = 256            # of messages that are remembered at most,
KIND_BYTES = 2**16     # and of so many bytes each


class MalformedMessage(HandTrackerError, ValueError):
    """Bytes that are no message of the expected type."""


class Stamp(NamedTuple):
    """A time, with the fields of builtin_interfaces/msg/Time."""

    sec: int
    nanosec: int


class Kind(NamedTuple):
    """What tells messages of markers apart that are read alike.

    Attributes
    ----------
    heads : ndarray of int32, shape (n, 5)
    strings : ndarray of uint8, shape (m,)
        As of `walk`.
    sources : Sources
        Where they have what they say.
    """

    heads: np.ndarray
    strings: np.ndarray
    sources: Sources


class MarkerReader:
    """Read MarkerArrays.

    Parameters
    ----------
    labels, frame_id, scale, zero_is_missing
        See `markers_from_message`.
    """

    def __init__(self, labels, frame_id='', scale=1., zero_is_missing=True):
        self._labels, self._frame_id = labels, frame_id
        self._scale, self._zero_is_missing = float(scale), bool(zero_is_missing)
        self._kinds = {}
        self._reserve(ROOM)
        self._read = None

    def _reserve(self, size):
        self._numbers = np.zeros(size // 8 + 1)
        self._octets = self._numbers.view(np.uint8)
        self._memory = memoryview(self._octets)
        self._words = self._numbers.view(np.int32)
        markers = size // SMALLEST_MARKER + 1
        self._heads = np.zeros((markers, 5), np.int32)
        self._places = np.zeros((markers, 3), np.int64)
        self._strings = np.zeros(size, np.uint8)

    def read(self, data):
        """Return what `markers_from_message` returns of the same message.

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
        words, numbers, size = self._take(data)
        count, used = walk(self._octets, _indexed(words), size, self._heads, self._places,
                           self._strings)
        if count < 0:
            raise MalformedMessage(f'{len(data)} bytes that are no MarkerArray')
        kind = self._heads[:count].tobytes() + self._strings[:used].tobytes()
        sources = self._kinds.get(kind) or self._learn(kind, count)
        self._read = count, used, sources
        rows = np.empty((len(MARKERS), 3))
        gather(_indexed(numbers), self._places, sources.slots, sources.markers, self._scale,
               self._zero_is_missing, rows)
        if sources.has_lists:
            self._place_lists(numbers, sources, rows)
        stamp = None
        if sources.first is not None:
            at = self._places[sources.first, 0]
            stamp = Stamp(int(words[at]), int(words[at + 1]) & 0xffffffff)
        return MarkerFrame(stamp, sources.frame_id, rows, sources.unknown, sources.foreign,
                           sources.doubled)

    @property
    def kind(self):
        """The `Kind` of the last message."""
        count, used, sources = self._read
        return Kind(self._heads[:count], self._strings[:used], sources)

    def _take(self, data):
        """Return a message by four bytes as integers and by eight as floats, and its size."""
        order = ORDERS.get(data[:2])
        size = len(data) - ENCAPSULATION
        if order is None or size < 0:
            raise MalformedMessage(f'{len(data)} bytes in an encoding other than plain CDR')
        if size > self._strings.size:
            self._reserve(2 * size)
        # In memory of its own the message is aligned, as the kernels are compiled for.
        self._memory[:size] = memoryview(data)[ENCAPSULATION:]
        if order == sys.byteorder:
            return self._words, self._numbers, size
        return self._words.byteswap(), self._numbers.byteswap(), size

    def _learn(self, kind, count):
        """Return where messages of a kind have what they say, and remember it."""
        heads, at = [], 0
        for frame_length, ns_length, number, type_, points in self._heads[:count].tolist():
            strings = self._strings[at:at + frame_length + ns_length].tobytes()
            at += frame_length + ns_length
            heads.append(Head(_text(strings[:frame_length]), _text(strings[frame_length:]),
                              number, type_, ADD, points))
        sources = find_sources(heads, self._labels, self._frame_id)
        if len(kind) <= KIND_BYTES:
            if len(self._kinds) == KINDS:
                self._kinds.clear()
            self._kinds[kind] = sources
        return sources

    def _place_lists(self, numbers, sources, rows):
        """Put the points of lists into the rows of their markers."""
        is_listed = sources.points >= 0
        for marker in np.unique(sources.markers[is_listed]):
            of_this = is_listed & (sources.markers == marker)
            _, pose, points = self._places[marker]
            at = points + 3 * sources.points[of_this]
            found = placed(numbers[at[:, None] + (0, 1, 2)], numbers[pose:pose + 3],
                           numbers[pose + 3:pose + 7], self._zero_is_missing)
            rows[sources.slots[of_this]] = scaled(found, self._scale, self._zero_is_missing)


def _indexed(array):
    # Plain Python reads single numbers of a memoryview five times as fast as of an array.
    return array if COMPILED else memoryview(array)


def _text(string):
    """Return a string of CDR as rclpy does: up to its first NUL."""
    return string.partition(b'\0')[0].decode(errors='replace')


# --- the walk through a MarkerArray

@jit
def _aligned(at, to):
    """Return the first place from ``at`` on that is a multiple of ``to``."""
    return (at + to - 1) // to * to


@jit
def _counted(words, size, at):
    """Return a length and where what it counts begins; behind the end where it is cut off."""
    at = _aligned(at, 4)
    if at + 4 > size:
        return 0, size + 1
    count = words[at // 4]
    if count < 0:  # more than any buffer holds
        return 0, size + 1
    return count, at + 4


@jit
def _after(words, size, at, width, alignment):
    """Return where a sequence of things ``width`` bytes wide ends."""
    count, at = _counted(words, size, at)
    if count > 0:
        at = _aligned(at, alignment) + count * width
    return at


@jit
def walk(octets, words, size, heads, places, strings):
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
def gather(numbers, places, slots, markers, scale, zero_is_missing, rows):
    """Put the positions of markers into the rows of those of the hand.

    Parameters
    ----------
    numbers : ndarray, shape (n,)
    places : ndarray of int64, shape (m, 3)
        See `walk`.
    slots, markers : ndarray of int64
        See `Sources`.
    scale, zero_is_missing
        See `markers_from_message`.
    rows : ndarray, shape (8, 3)
        Filled: NaN where not seen.
    """
    rows[:] = np.nan
    for i in range(len(slots)):
        at = places[markers[i], 1]
        x, y, z = numbers[at], numbers[at + 1], numbers[at + 2]
        if not (zero_is_missing and x == 0. and y == 0. and z == 0.):
            row = slots[i]
            rows[row, 0], rows[row, 1], rows[row, 2] = scale * x, scale * y, scale * z


# --- templates

class Template:
    """A message whose stamps and numbers alone change.

    Parameters
    ----------
    data : bytes
        The message.
    stamps : sequence of int
        Where the stamps are, in bytes.
    numbers : sequence of int
        Where the numbers are, in bytes.

    Attributes
    ----------
    body : ndarray
        The message after half a double, so that all behind its encapsulation is aligned.
    size : int
        Of the message, in bytes.
    stamps, numbers : ndarray of int
        Where they are in the body, by four bytes and by eight.
    """

    def __init__(self, data, stamps, numbers):
        self.body = np.zeros(-(-len(data) // 8) + 1)
        self.size = len(data)
        self.stamps = (np.array(stamps, int) + ENCAPSULATION) // 4
        self.numbers = (np.array(numbers, int) + ENCAPSULATION) // 8
        self._data = self.body.view(np.uint8)[ENCAPSULATION:][:self.size]
        self._data[:] = np.frombuffer(data, np.uint8)
        self._seconds, self._doubles = self.body.view('<u4'), self.body.view('<f8')
        self._seconds_at, self._nanoseconds_at = _at(self.stamps), _at(self.stamps + 1)
        self._numbers_at = _at(self.numbers)

    def fill(self, stamp, numbers):
        """Return the message with a stamp and with numbers.

        Parameters
        ----------
        stamp : Stamp or Time
        numbers : ndarray, n of any shape

        Returns
        -------
        bytes
        """
        self._seconds[self._seconds_at] = stamp.sec & 0xffffffff
        self._seconds[self._nanoseconds_at] = stamp.nanosec
        self._doubles[self._numbers_at] = np.ravel(numbers)
        return self._data.tobytes()


def _at(places):
    """Return an index of places; of those in a row a slice, five times as fast."""
    in_a_row = len(places) > 0 and (np.diff(places) == 1).all()
    return slice(places[0], places[-1] + 1) if in_a_row else places


class _Writer:
    """Write plain CDR, and note where the stamps and the numbers are."""

    def __init__(self):
        self._data = bytearray(LITTLE_ENDIAN)
        self._stamps, self._numbers = [], []

    def _align(self, to):
        self._data += bytes(-(len(self._data) - ENCAPSULATION) % to)

    def count(self, number):
        self.pack('I', number)

    def pack(self, form, *values):
        """Write values of one size, in a form of `struct`."""
        self._align(struct.calcsize(form[-1]))
        self._data += struct.pack(f'<{form}', *values)

    def string(self, text):
        octets = text.encode() + b'\0'
        self.count(len(octets))
        self._data += octets

    def header(self, frame_id):
        self._align(4)
        self._stamps.append(len(self._data))
        self._data += bytes(8)
        self.string(frame_id)

    def numbers(self, count):
        self._align(8)
        self._numbers += range(len(self._data), len(self._data) + 8 * count, 8)
        self._data += bytes(8 * count)

    def template(self):
        return Template(bytes(self._data), self._stamps, self._numbers)


def joint_state_template(names):
    """Return the template of a JointState with positions alone.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    Template
        Of as many numbers.
    """
    writer = _Writer()
    writer.header('')
    writer.count(len(names))
    for name in names:
        writer.string(name)
    writer.count(len(names))
    writer.numbers(len(names))
    writer.count(0)
    writer.count(0)
    return writer.template()


def transforms_template(frames):
    """Return the template of a TFMessage.

    Parameters
    ----------
    frames : sequence of (str, str)
        Parent and child of each transform.

    Returns
    -------
    Template
        Of seven numbers for each: x, y, z of the translation; x, y, z, w of the rotation.
    """
    writer = _Writer()
    writer.count(len(frames))
    for parent, child in frames:
        writer.header(parent)
        writer.string(child)
        writer.numbers(7)
    return writer.template()


def triangles_template(frame_id, namespace, colour, lifetime, corners):
    """Return the template of a Marker of triangles that stays with its frame.

    Parameters
    ----------
    frame_id, namespace : str
    colour : tuple of float
        Red, green, blue, opacity.
    lifetime : int
        [s]
    corners : int
        Three for each triangle.

    Returns
    -------
    Template
        Of three numbers for each corner.
    """
    writer = _Writer()
    writer.header(frame_id)
    writer.string(namespace)
    writer.pack('3i', 0, TRIANGLE_LIST, ADD)
    writer.pack('10d', 0., 0., 0., 0., 0., 0., 1., 1., 1., 1.)  # pose and scale
    writer.pack('4f', *colour)
    writer.pack('2i', lifetime, 0)
    writer.pack('?', True)
    writer.count(corners)
    writer.numbers(3 * corners)
    writer.count(0)             # colours
    writer.string('')           # texture
    writer.pack('2i', 0, 0)
    writer.string('')
    writer.string('')
    writer.count(0)
    writer.count(0)             # its coordinates
    for _ in range(3):          # text, mesh and its file
        writer.string('')
    writer.count(0)
    writer.pack('?', False)
    return writer.template()
