"""Decode OptiTrack's NatNet packets, versions 3 and 4, little-endian.

Only what a frame of points needs is kept; the rest is skipped, and everything is checked against
the packet's size, so that a damaged packet ends in `MalformedFrame`. The layout is that of
NaturalPoint's PythonClient and PacketClient (NatNet SDK 3.1 and 4.1).
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from .point_frame import MalformedFrame

# Ids of messages.
CONNECT, SERVER_INFO, REQUEST_MODEL, MODEL, FRAME = 0, 1, 4, 5, 7
KEEP_ALIVE, ECHO_REQUEST, ECHO_RESPONSE = 10, 12, 13

HEADER = struct.Struct('<HH')           # id, bytes that follow
FLOATS = np.dtype(('<f4', 3))
RIGID_BODY = 38                         # [bytes]: id, pose, mean error, parameters
LABELLED_MARKER = np.dtype([('id', '<u4'), ('position', '<f4', 3), ('size', '<f4'),
                            ('parameters', '<u2'), ('residual', '<f4')])
OCCLUDED, UNLABELLED = 1, 16            # in a labelled marker's parameters
MODEL_SHIFT, MEMBER_MASK = 16, 0xffff   # of its id: the model, and the marker's number in it
MODELS_CHANGED = 2                      # in a frame's parameters
ALL_MARKERS = 'all'                     # name of the set that repeats the markers of the others
SERVER_NAME = 256                       # [bytes]
SUPPORTED_PROTOCOLS = 3, 4
# Kinds of a model's data sets.
MARKER_SET, RIGID_BODY_MODEL, SKELETON, FORCE_PLATE, DEVICE, CAMERA, ASSET = range(7)


class ServerInfo(NamedTuple):
    """Server description: name, protocol version, clock, where frames are sent.

    Attributes
    ----------
    name : str
    version : tuple of int
        Major and minor version of the protocol that it speaks.
    frequency : float
        Of its clock, which counts the exposures' times [Hz].
    data_port : int
    group : str
        Multicast address of the frames; empty where they are sent to each client.
    """

    name: str
    version: tuple[int, int]
    frequency: float
    data_port: int
    group: str


class DataDescriptions(NamedTuple):
    """Data descriptions: marker sets, rigid bodies, skeletons.

    Attributes
    ----------
    sets : dict of str to tuple of str
        Names of each marker set's markers.
    bodies : dict of int to str
        Name of each rigid body, skeleton and asset by its id; the set of its markers has it too.
    """

    sets: dict[str, tuple[str, ...]]
    bodies: dict[int, str]


class FramePacket(NamedTuple):
    """Frame of motion capture data.

    Attributes
    ----------
    number : int
    sets : tuple of (str, ndarray)
        Name of each marker set, and its markers' positions (n, 3), NaN where occluded [m].
    labelled : tuple of (int, int, ndarray)
        Labelled markers of bodies: the body's id, the marker's number in it, from 1 on, and its
        position, NaN where occluded [m].
    unlabelled : ndarray, shape (m, 3)
        [m]
    exposure, transmit : int
        Middle of the exposure, and when the packet was sent [ticks of the server's clock].
    models_changed : bool
    """

    number: int
    sets: tuple[tuple[str, np.ndarray], ...]
    labelled: tuple[tuple[int, int, np.ndarray], ...]
    unlabelled: np.ndarray
    exposure: int
    transmit: int
    models_changed: bool


class _Cursor:
    """A place in a packet that moves on as it is read."""

    def __init__(self, data: bytes, what: str) -> None:
        self._data, self._what = data, what
        self.at = HEADER.size

    def fail(self, expected: str) -> MalformedFrame:
        return MalformedFrame(f'NatNet {self._what} of {len(self._data)} bytes, at byte {self.at}: '
                              f'expected {expected}')

    def skip(self, count: int) -> int:
        """Move on; return the place before."""
        at, self.at = self.at, self.at + count
        if self.at > len(self._data):
            self.at = at
            raise self.fail(f'{count} more bytes')
        return at

    def read(self, form: str) -> Any:
        return struct.unpack_from(f'<{form}', self._data, self.skip(struct.calcsize(f'<{form}')))[0]

    def string(self) -> str:
        end = self._data.find(b'\0', self.at)
        if end < 0:
            raise self.fail('a string with its end')
        text = self._data[self.at:end].decode(errors='replace')
        self.at = end + 1
        return text

    def array(self, kind: np.dtype, count: int) -> np.ndarray:
        at = self.skip(count * kind.itemsize)
        return np.frombuffer(self._data, kind, count, at)

    def count(self, smallest: int) -> int:
        """Read the number of items that follow, none less than `smallest` bytes."""
        count = self.read('I')
        if count * smallest > len(self._data) - self.at:
            raise self.fail(f'{count} items of at least {smallest} bytes')
        return count


def message_id(data: bytes) -> int:
    """Return the id of a packet's message.

    Raises
    ------
    MalformedFrame
        If the packet has not the size that it says.
    """
    if len(data) < HEADER.size:
        raise MalformedFrame(f'NatNet packet of {len(data)} bytes; expected at least {HEADER.size}')
    number, size = HEADER.unpack_from(data)
    if HEADER.size + size != len(data):
        raise MalformedFrame(f'NatNet packet of {len(data)} bytes; expected {HEADER.size + size}, '
                             'as it says')
    return number


def message(number: int, payload: bytes = b'') -> bytes:
    """Return a packet."""
    return HEADER.pack(number, len(payload)) + payload


def server_info(data: bytes) -> ServerInfo:
    """Decode a server's answer to `CONNECT`.

    Raises
    ------
    MalformedFrame
        Also where the server speaks another version than 3 or 4.
    """
    cursor = _Cursor(data, 'server information')
    name = data[cursor.skip(SERVER_NAME):cursor.at].partition(b'\0')[0].decode(errors='replace')
    cursor.skip(4)  # version of the server
    major, minor, _, _ = data[cursor.skip(4):cursor.at]
    if major not in SUPPORTED_PROTOCOLS:
        raise MalformedFrame(f'NatNet server {name} speaks version {major}.{minor}; expected 3 '
                             'or 4 (Motive 2.0 or later)')
    frequency = float(cursor.read('Q'))
    if not frequency:
        raise cursor.fail("the frequency of the server's clock")
    port = cursor.read('H')
    is_multicast = cursor.read('?')
    group = '.'.join(map(str, data[cursor.skip(4):cursor.at]))
    return ServerInfo(name, (major, minor), frequency, port, group if is_multicast else '')


def echo_response(data: bytes) -> tuple[int, int]:
    """Decode the answer to an `ECHO_REQUEST`: the number in the request, and the server's ticks."""
    cursor = _Cursor(data, 'echo')
    return cursor.read('Q'), cursor.read('Q')


def model_definitions(data: bytes, version: tuple[int, int]) -> DataDescriptions:
    """Decode model definitions.

    Parameters
    ----------
    data : bytes
    version : tuple of int
        Of the protocol.

    Raises
    ------
    MalformedFrame
    """
    cursor = _Cursor(data, 'model definitions')
    sets: dict[str, tuple[str, ...]] = {}
    bodies: dict[int, str] = {}
    for _ in range(cursor.count(4)):
        kind = cursor.read('I')
        end = cursor.read('I') if version >= (4, 1) else None
        if end is not None:
            end += cursor.at
        if kind == MARKER_SET:
            name = cursor.string()
            sets[name] = tuple(cursor.string() for _ in range(cursor.count(1)))
        elif kind in (RIGID_BODY_MODEL, SKELETON, ASSET):
            name = cursor.string()
            if kind == ASSET:
                cursor.skip(4)  # its type
            bodies[cursor.read('I')] = name
        if end is None:
            _skip_rest(cursor, kind, version)
        else:
            cursor.skip(end - cursor.at)
    sets.pop(ALL_MARKERS, None)
    return DataDescriptions(sets, bodies)


def _skip_rest(cursor: _Cursor, kind: int, version: tuple[int, int]) -> None:
    """Skip the rest of a definition, of which the packet says its size only since 4.1."""
    if kind == RIGID_BODY_MODEL:
        _skip_body(cursor, version)
    elif kind == SKELETON:
        for _ in range(cursor.count(1)):
            cursor.string()
            cursor.skip(4)
            _skip_body(cursor, version)
    elif kind == FORCE_PLATE:
        cursor.skip(4)
        cursor.string()
        # Size, origin, calibration, corners, plate type and type of its channels' data.
        cursor.skip(4 * (2 + 3 + 144 + 12 + 2))
        _skip_strings(cursor)
    elif kind == DEVICE:
        cursor.skip(4)
        cursor.string()
        cursor.string()
        cursor.skip(8)
        _skip_strings(cursor)
    elif kind == CAMERA:
        cursor.string()
        cursor.skip(4 * 7)
    elif kind != MARKER_SET:
        raise cursor.fail(f'a data set of kind 0 to {CAMERA}, not {kind}')


def _skip_body(cursor: _Cursor, version: tuple[int, int]) -> None:
    """Skip a rigid body after its id."""
    cursor.skip(4 + 12)  # parent, offset
    count = cursor.count(16)
    cursor.skip(16 * count)
    if version >= (4, 0):
        for _ in range(count):
            cursor.string()


def _skip_strings(cursor: _Cursor) -> None:
    for _ in range(cursor.count(1)):
        cursor.string()


def frame_packet(data: bytes, version: tuple[int, int]) -> FramePacket:
    """Decode a frame.

    Parameters
    ----------
    data : bytes
    version : tuple of int
        Of the protocol.

    Raises
    ------
    MalformedFrame
    """
    cursor, has_sizes = _Cursor(data, 'frame'), version >= (4, 1)

    def section(smallest: int) -> int:
        count = cursor.count(smallest)
        if has_sizes:
            cursor.skip(4)
        return count

    def skip_section() -> None:
        cursor.skip(4)
        cursor.skip(cursor.read('I'))

    number = cursor.read('I')
    sets = [(cursor.string(), cursor.array(FLOATS, cursor.count(FLOATS.itemsize)))
            for _ in range(section(5))]
    unlabelled = cursor.array(FLOATS, section(FLOATS.itemsize))
    if has_sizes:
        for _ in range(3):  # rigid bodies, skeletons, assets
            skip_section()
    else:
        cursor.skip(RIGID_BODY * cursor.count(RIGID_BODY))
        for _ in range(cursor.count(8)):
            cursor.skip(4)
            cursor.skip(RIGID_BODY * cursor.count(RIGID_BODY))
    labelled = cursor.array(LABELLED_MARKER, section(LABELLED_MARKER.itemsize))
    for _ in range(2):      # force plates, devices
        if has_sizes:
            skip_section()
            continue
        for _ in range(cursor.count(8)):
            cursor.skip(4)
            for _ in range(cursor.count(4)):
                cursor.skip(4 * cursor.count(4))
    cursor.skip(8 + 8)      # timecode, seconds since the software started
    exposure, _, transmit = (cursor.read('Q') for _ in range(3))
    if has_sizes:
        cursor.skip(8)      # precision time
    parameters = cursor.read('H')
    is_free = (labelled['parameters'] & UNLABELLED > 0) | (labelled['id'] >> MODEL_SHIFT == 0)
    is_hidden = labelled['parameters'] & OCCLUDED > 0
    positions = labelled['position']
    # Of old, the markers of rigid bodies are among the unlabelled too.
    others = unlabelled[~_are_among(unlabelled, positions)]
    owned = positions[~is_free].astype(float)
    owned[is_hidden[~is_free]] = np.nan
    ids = labelled['id'][~is_free].tolist()
    return FramePacket(
        number, tuple((name, _without(rows, positions[is_hidden])) for name, rows in sets
                      if name != ALL_MARKERS),
        tuple((each >> MODEL_SHIFT, each & MEMBER_MASK, at) for each, at in zip(ids, owned)),
        np.concatenate((others, positions[is_free & ~is_hidden])).astype(float),
        exposure, transmit, bool(parameters & MODELS_CHANGED))


def _are_among(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return which of positions (n, 3) are among others, to the bit."""
    return (rows[:, None] == others).all(axis=2).any(axis=1)


def _without(rows: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Return a set's positions, NaN where occluded markers are, which Motive fills in.

    Sets do not say which of their markers are occluded; the list of labelled markers does, with
    the same position to the bit.
    """
    found = rows.astype(float)
    found[_are_among(rows, hidden)] = np.nan
    return found
