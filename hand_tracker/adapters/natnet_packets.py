"""Decode OptiTrack's NatNet packets, versions 3 and 4, little-endian.

Only what a frame of points needs is kept; the rest is skipped, and everything is checked against
the packet's size, so that a damaged packet ends in `MalformedFrame`. The layout is that of
NaturalPoint's PythonClient and PacketClient (NatNet SDK 3.1 and 4.1).
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

from .packet_structure import POINT_SIZE, PacketStructure, point_places, points_at
from .point_frame import MalformedFrame

# Ids of messages.
CONNECT, SERVER_INFO, REQUEST_MODEL, MODEL, FRAME = 0, 1, 4, 5, 7
KEEP_ALIVE, ECHO_REQUEST, ECHO_RESPONSE = 10, 12, 13

HEADER = struct.Struct('<HH')           # id, bytes that follow
FRAME_NUMBER = struct.Struct('<I')      # of a frame
FRAME_TIMES = struct.Struct('<QQQ')     # exposure, receipt of the cameras' data, sending
RIGID_BODY = 38                         # [bytes]: id, pose, mean error, parameters
LABELLED_MARKER = 26                    # [bytes]: id, position, size, parameters, residual
POSITION, PARAMETERS = 4, 20            # in it
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


class FrameStructure(NamedTuple):
    """Byte layout of a NatNet frame: marker sets, ids and offsets of its numbers.

    Attributes
    ----------
    common : PacketStructure
        Frames with other markers occluded are not alike.
    sets : tuple of (str, int)
        Name of each marker set, and how many markers it has.
    labelled : tuple of (int, int)
        Labelled markers of bodies: the body's id, and the marker's number in it, from 1 on.
    places : ndarray of int, shape (n, POINT_SIZE)
        Of the positions: the sets' markers, labelled ones of bodies, labelled ones of none,
        unlabelled ones.
    free, unlabelled : int
        From which of them on they are of no body, and are unlabelled.
    parameters : ndarray of int
        Places of the labelled markers' parameters.
    times, end : int
        Place of `FRAME_TIMES`, and of the frame's parameters.
    """

    common: PacketStructure
    sets: tuple[tuple[str, int], ...]
    labelled: tuple[tuple[int, int], ...]
    places: np.ndarray
    free: int
    unlabelled: int
    parameters: np.ndarray
    times: int
    end: int


class FramePacket(NamedTuple):
    """Frame of motion capture data.

    Attributes
    ----------
    number : int
    structure : FrameStructure
        The same object while frames are alike.
    markers : ndarray, shape (n, 3)
        Of its sets, one after the other, and then the labelled ones of bodies; NaN where
        occluded [m].
    points : ndarray, shape (m, 3)
        Unlabelled ones, and labelled ones of no body [m].
    exposure, transmit : int
        Middle of the exposure, and when the packet was sent [ticks of the server's clock].
    models_changed : bool
    """

    number: int
    structure: FrameStructure
    markers: np.ndarray
    points: np.ndarray
    exposure: int
    transmit: int
    models_changed: bool


class _Cursor:
    """A place in a packet that moves on as it is read.

    Attributes
    ----------
    at : int
    mask : bytearray
        Ones in the bytes that have decided what follows: counts, sizes and strings.
    """

    def __init__(self, data: bytes, what: str) -> None:
        self._data, self._what = data, what
        self.at = HEADER.size
        self.mask = bytearray(b'\xff' * self.at).ljust(len(data), b'\0')

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

    def decides(self, start: int, end: int) -> None:
        """Note bytes that decide how the packet is read."""
        self.mask[start:end] = b'\xff' * (end - start)

    def string(self) -> str:
        end = self._data.find(b'\0', self.at)
        if end < 0:
            raise self.fail('a string with its end')
        self.decides(self.at, end + 1)
        text = self._data[self.at:end].decode(errors='replace')
        self.at = end + 1
        return text

    def size(self) -> int:
        """Read how many bytes or items follow."""
        found: int = self.read('I')
        self.decides(self.at - 4, self.at)
        return found

    def count(self, smallest: int) -> int:
        """Read the number of items that follow, none less than `smallest` bytes."""
        count = self.size()
        if count * smallest > len(self._data) - self.at:
            raise self.fail(f'{count} items of at least {smallest} bytes')
        return count

    def items(self, count: int, size: int) -> range:
        """Move past items of a size; return their places."""
        at = self.skip(count * size)
        return range(at, self.at, size)


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
        end = cursor.size() if version >= (4, 1) else None
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


def frame_packet(data: bytes, version: tuple[int, int],
                 last: FrameStructure | None = None) -> FramePacket:
    """Decode a frame.

    Parameters
    ----------
    data : bytes
    version : tuple of int
        Of the protocol.
    last : FrameStructure, optional
        Of another frame of this version, by which one that is alike is read sooner.

    Raises
    ------
    MalformedFrame
    """
    found = last if last is not None and last.common.matches(data) else _structure(data, version)
    octets = np.frombuffer(data, np.uint8)
    positions = points_at(octets, found.places)
    is_hidden = octets[found.parameters] & OCCLUDED > 0
    named, free, end = found.unlabelled - len(is_hidden), found.free, found.unlabelled
    markers, lonely = positions[:free].astype(float), positions[free:end]
    if is_hidden.any():
        # Sets do not say which of their markers are occluded; the list of labelled markers does,
        # with the same position to the bit, as Motive fills them in.
        markers[:named][_are_among(positions[:named], positions[named:end][is_hidden])] = np.nan
        markers[named:][is_hidden[:free - named]] = np.nan
        lonely = lonely[~is_hidden[free - named:]]
    unlabelled = positions[end:]
    if len(unlabelled):
        # Of old, the markers of rigid bodies are among the unlabelled too.
        unlabelled = unlabelled[~_are_among(unlabelled, positions[named:end])]
    exposure, _, transmit = FRAME_TIMES.unpack_from(data, found.times)
    return FramePacket(
        FRAME_NUMBER.unpack_from(data, HEADER.size)[0], found, markers,
        np.concatenate((unlabelled, lonely)).astype(float), exposure, transmit,
        bool(data[found.end] & MODELS_CHANGED))


def _structure(data: bytes, version: tuple[int, int]) -> FrameStructure:
    """Return the structure of a frame; raise MalformedFrame where it has none."""
    cursor, has_sizes = _Cursor(data, 'frame'), version >= (4, 1)

    def section(smallest: int) -> int:
        count = cursor.count(smallest)
        if has_sizes:
            cursor.skip(4)
        return count

    def skip_section() -> None:
        cursor.skip(4)
        cursor.skip(cursor.size())

    cursor.skip(FRAME_NUMBER.size)
    sets = [(cursor.string(), cursor.items(cursor.count(POINT_SIZE), POINT_SIZE))
            for _ in range(section(5))]
    unlabelled = cursor.items(section(POINT_SIZE), POINT_SIZE)
    if has_sizes:
        for _ in range(3):  # rigid bodies, skeletons, assets
            skip_section()
    else:
        cursor.skip(RIGID_BODY * cursor.count(RIGID_BODY))
        for _ in range(cursor.count(8)):
            cursor.skip(4)
            cursor.skip(RIGID_BODY * cursor.count(RIGID_BODY))
    labelled = cursor.items(section(LABELLED_MARKER), LABELLED_MARKER)
    for _ in range(2):      # force plates, devices
        if has_sizes:
            skip_section()
            continue
        for _ in range(cursor.count(8)):
            cursor.skip(4)
            for _ in range(cursor.count(4)):
                cursor.skip(4 * cursor.count(4))
    cursor.skip(8 + 8)      # timecode, seconds since the software started
    times = cursor.skip(FRAME_TIMES.size)
    if has_sizes:
        cursor.skip(8)      # precision time
    end = cursor.skip(2)
    cursor.mask[end] |= MODELS_CHANGED
    owned: dict[int, int] = {}
    free = []
    for at in labelled:
        number = int.from_bytes(data[at:at + 4], 'little')
        cursor.decides(at, at + 4)
        cursor.mask[at + PARAMETERS] |= UNLABELLED | OCCLUDED
        if data[at + PARAMETERS] & UNLABELLED or not number >> MODEL_SHIFT:
            free.append(at)
        else:
            owned[at] = number
    kept = [(name, items) for name, items in sets if name != ALL_MARKERS]
    places = [at for _, items in kept for at in items]
    labels = [*owned, *free]
    first_free = len(places) + len(owned)
    places += [at + POSITION for at in labels]
    return FrameStructure(
        PacketStructure(data, bytes(cursor.mask)),
        tuple((name, len(items)) for name, items in kept),
        tuple((each >> MODEL_SHIFT, each & MEMBER_MASK) for each in owned.values()),
        point_places([*places, *unlabelled]), first_free, len(places),
        np.array(labels, int) + PARAMETERS, times, end)


def _are_among(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return which of positions (n, 3) are among others, to the bit."""
    return (rows[:, None] == others).all(axis=2).any(axis=1)

