"""Read and write rosbag2 recordings without ROS.

A recording is a folder with `metadata.yaml`, a `.mcap` file or a `.db3` file; written ones are
single files. Messages stay serialized (CDR); `bag_message` serializes those built from arrays.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from textwrap import shorten
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    Reader,
    StoragePlugin,
    Writer,
    storage_mcap,
)
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ..core.errors import HandTrackerError
from ..core.numerics.quaternion import quaternion
from ..messages.marker_array import MARKER_ARRAY
from ..messages.message_definitions import DEFINITIONS
from ..messages.stamps import stamp_of
from ..output_files import folder_beside, require_folder, require_suffix
from .cut_mcap import MAX_CHUNK_BYTES, WholeRecords, is_cut
from .written_kinds import BAG_SUFFIXES, MCAP

JOINT_STATE = 'sensor_msgs/msg/JointState'
TF = 'tf2_msgs/msg/TFMessage'
POSE = 'geometry_msgs/msg/PoseStamped'

# Read by Humble and Jazzy.
BAG_METADATA_VERSION = 8
STORAGE = dict(zip(BAG_SUFFIXES, (StoragePlugin.MCAP, StoragePlugin.SQLITE3)))
BAG_CONTENTS = 'metadata.yaml'     # file by which a folder is a recording
EXPECTED = f'expected a rosbag2 folder with {BAG_CONTENTS}, a .mcap file or a .db3 file'
LONGEST_REASON = 300       # [characters] of an error of rosbags that are shown

TYPE_STORE = get_typestore(Stores.ROS2_JAZZY)
for known_type, text in DEFINITIONS.items():
    TYPE_STORE.register(get_types_from_msg(text, known_type))
DEFINITION_PARSERS = {
    MessageDefinitionFormat.MSG: get_types_from_msg,
    MessageDefinitionFormat.IDL: lambda text, _: get_types_from_idl(text)}
NO_BYTES = np.empty(0, np.uint8)
NO_NUMBERS = np.empty(0)


def _unpack_zstd(data: bytes, size: int) -> bytes:
    """Unpack a chunk of a .mcap, at most one byte beyond the size that it says."""
    return storage_mcap.zstd.ZstdDecompressor().decompress(data, size + 1)


def _bounded(unpack: Callable[[bytes, int], bytes]) -> Callable[[bytes, int], bytes]:
    """Return an unpacking function that refuses chunks that say to be too large."""
    def bounded(data: bytes, size: int) -> bytes:
        if size > MAX_CHUNK_BYTES:
            raise BagError(f'a chunk of {size} bytes; at most {MAX_CHUNK_BYTES} are read')
        return unpack(data, size)
    return bounded


# rosbags 0.11 unpacks whatever comes, and 33 kB of zstd may be a gigabyte; lz4 is 255 to 1 at most.
if hasattr(storage_mcap, 'DECOMPRESSORS') and hasattr(storage_mcap, 'zstd'):
    storage_mcap.DECOMPRESSORS.update(
        zstd=_bounded(_unpack_zstd), lz4=_bounded(storage_mcap.DECOMPRESSORS['lz4']))


class BagError(HandTrackerError):
    """A recording cannot be read or written; the message says which, why and what is expected."""


class _AnyCaseReader(Reader):
    """Reader of rosbags that knows a file by its extension in capitals, too."""

    def __init__(self, path: Path) -> None:
        if not path.is_dir():
            self.STORAGE_PLUGINS = {path.suffix: Reader.STORAGE_PLUGINS[path.suffix.lower()]}
        super().__init__(path)


class BagMessage(NamedTuple):
    """A recorded message.

    Attributes
    ----------
    topic : str
    type : str
        Such as 'sensor_msgs/msg/JointState'.
    time : int
        Time of recording [ns].
    data : bytes
        The message, serialized in CDR.
    """

    topic: str
    type: str
    time: int
    data: bytes


class Bag:
    """A recording opened by `open_bag`.

    Attributes
    ----------
    path : Path
    topics : dict of str to str
        Type of each topic.
    counts : dict of str to int
        Number of messages of each topic.
    offered_qos : dict of str to list of rosbags.interfaces.Qos
        QoS offered by the recorded publishers of each topic; may be empty.
    start : int
        Time of the first message [ns].
    duration : int
        Time from the first message to the last [ns].
    notes : tuple of str
        Notes on the recording, to print.
    zero : int or None
        Time at which the clock of a file of points is 0 [ns].
    stands_for : str
        Topic whose points are on another topic here; empty in a recording read as it is.
    """

    notes: tuple[str, ...] = ()
    zero: int | None = None
    stands_for = ''

    def __init__(self, path: Path, reader: Reader) -> None:
        self.path = path
        self._reader = reader
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.offered_qos: dict[str, list] = {}
        for connection in reader.connections:
            topic = connection.topic
            # A folder's metadata.yaml may hold anything.
            if not (isinstance(topic, str) and isinstance(connection.msgtype, str)
                    and isinstance(connection.msgcount, int)):
                raise BagError(f'topic {topic!r} of type {connection.msgtype!r} with '
                               f'{connection.msgcount!r} messages')
            # Of a topic recorded with two types, only messages of the first are read.
            if self.topics.setdefault(topic, connection.msgtype) != connection.msgtype:
                continue
            self.counts[topic] = self.counts.get(topic, 0) + connection.msgcount
            self.offered_qos.setdefault(topic, []).extend(connection.ext.offered_qos_profiles)
        self.start = int(reader.start_time)
        self.duration = int(reader.end_time) - 1 - self.start

    def types(self, topic: str) -> Any:
        """Return rosbags' types for the messages of a topic.

        Returns
        -------
        rosbags.typesys.store.Typestore
            `TYPE_STORE`, but where the recording defines a message that is not one of ROS 2's own
            otherwise than known here.

        Raises
        ------
        BagError
            If that definition is damaged.
        """
        connection = next(one for one in self._reader.connections if one.topic == topic)
        kind, definition = connection.msgtype, connection.msgdef
        parse = DEFINITION_PARSERS.get(definition.format)
        if kind not in DEFINITIONS or parse is None:
            return TYPE_STORE
        with _read_errors(self.path):
            defined = parse(definition.data, kind)
            if all(fields == TYPE_STORE.fielddefs.get(name, ([], None))[1]
                   for name, (_, fields) in defined.items()):
                return TYPE_STORE
            own = get_typestore(Stores.EMPTY)
            own.register(defined)
        return own

    def messages(self, topics: Iterable[str] | None = None,
                 start: int | None = None) -> Iterator[BagMessage]:
        """Iterate over the messages in order of time.

        Parameters
        ----------
        topics : iterable of str, optional
            All topics when left out.
        start : int, optional
            Only messages recorded at this time or later [ns].

        Yields
        ------
        BagMessage

        Raises
        ------
        BagError
            If a topic is not in the recording, or the recording is damaged.
        """
        wanted = set(self.topics if topics is None else topics)
        if unknown := wanted - self.topics.keys():
            raise BagError(f'{self.path}: no topic {", ".join(sorted(unknown))}; '
                           f'it has {", ".join(sorted(self.topics))}')
        connections = [connection for connection in self._reader.connections
                       if connection.topic in wanted
                       and connection.msgtype == self.topics[connection.topic]]
        if not connections:
            return
        count = 0
        with _read_errors(self.path):
            for connection, time, data in self._reader.messages(connections, start=start):
                count += 1
                # A damaged column of SQLite may have any type.
                if not isinstance(data, bytes) or not isinstance(time, int):
                    raise TypeError(f'a message on {connection.topic} has no time or no bytes')
                yield BagMessage(connection.topic, connection.msgtype, time, data)
        listed = sum(self.counts[topic] for topic in wanted)
        if count < listed and (start is None or start <= self.start):
            raise BagError(f'{self.path}: has {count} messages of {listed} that it lists; '
                           'expected a complete recording')


@contextmanager
def open_bag(path: str | PathLike[str], partial: bool = False) -> Iterator[Bag]:
    """Open a recording for reading.

    Parameters
    ----------
    path : path-like
        A folder with `metadata.yaml`, a `.mcap` file or a `.db3` file.
    partial : bool, optional
        Whether a `.mcap` file that is cut is read as far as it goes.

    Yields
    ------
    Bag
        With at least one message.

    Raises
    ------
    BagError
        If the recording is missing, of an unknown format, truncated or empty.
    """
    path = Path(path)
    if not path.exists():
        raise BagError(f'{path}: no such file or folder; {EXPECTED}')
    if path.is_dir():
        if not (path / BAG_CONTENTS).exists():
            raise BagError(f'{path}: a folder without {BAG_CONTENTS}; {EXPECTED}')
    elif path.suffix.lower() not in STORAGE:
        raise BagError(f'{path}: unknown extension {path.suffix!r}; {EXPECTED}')
    elif not path.stat().st_size:
        raise BagError(f'{path}: the file has no bytes; {EXPECTED}')
    with _read_errors(path):
        is_partial = path.is_file() and path.suffix.lower() == MCAP and is_cut(path)
    if is_partial and not partial:
        raise BagError(f'{path}: cannot be read (cut, or not closed); expected a complete '
                       'recording (--partial reads what is there)')
    with _read_errors(path):
        reader = _AnyCaseReader(path)
        if is_partial:
            reader.storage.path = WholeRecords(path)
        reader.open()
    try:
        if not reader.message_count:
            raise BagError(f'{path}: a recording without {"whole " * is_partial}messages; '
                           'expected at least one')
        with _read_errors(path):
            bag = Bag(path, reader)
        if is_partial:
            bag.notes = f'cut: {reader.message_count} whole messages are read',
        yield bag
    finally:
        reader.close()


def write_bag(path: str | PathLike[str], messages: Iterable[BagMessage]) -> None:
    """Write a recording as a single file, which `ros2 bag play` accepts.

    Reproducible: the same messages give the same bytes with the same releases of rosbags and
    zstd, as the file holds no time but the messages'.

    Parameters
    ----------
    path : path-like
        Ending in `.mcap` (compressed by zstd) or `.db3`; replaced if it exists.
    messages : iterable of BagMessage
        In order of time, of the types of ROS 2 Jazzy's common messages, or of points.

    Raises
    ------
    BagError
        If there are no messages, a type is unknown, or the file cannot be written.
    """
    path = Path(path)
    require_suffix(path, STORAGE, ' or '.join(STORAGE), BagError)
    require_folder(path, BagError)
    # rosbags writes a folder; the file in it is a complete recording by itself.
    with folder_beside(path, BagError) as scratch:
        folder, suffix = scratch / path.stem, path.suffix.lower()
        writer = Writer(folder, version=BAG_METADATA_VERSION, storage_plugin=STORAGE[suffix])
        if suffix == MCAP:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        connections = {}
        with writer:
            for topic, type_name, time, data in messages:
                if topic not in connections:
                    if type_name not in TYPE_STORE.types:
                        raise BagError(f'{path}: {topic} has the unknown type {type_name!r}; '
                                       "expected one of Jazzy's common messages")
                    connections[topic] = writer.add_connection(
                        topic, type_name, typestore=TYPE_STORE)
                writer.write(connections[topic], time, data)
            if not connections:
                raise BagError(f'{path}: no messages to write; expected at least one')
        os.replace(folder / f'{path.stem}{suffix}', path)


def bag_message(topic: str, time: int, message: Any) -> BagMessage:
    """Serialize a message of rosbags' types for `write_bag`.

    Parameters
    ----------
    topic : str
    time : int
        Time of recording [ns].
    message : object
        From `marker_array_message`, `joint_state_message` or `pose_message`.

    Returns
    -------
    BagMessage
    """
    type_name = message.__msgtype__
    data = bytes(TYPE_STORE.serialize_cdr(message, type_name, little_endian=True))
    return BagMessage(topic, type_name, time, data)


def marker_array_message(stamp: int, frame_id: str, labels: Sequence[str], positions: ArrayLike,
                         diameter: float = .01, namespace: str | None = 'hand') -> Any:
    """Build a MarkerArray with a sphere for each marker that is not missing.

    Parameters
    ----------
    stamp : int
        [ns].
    frame_id : str
    labels : sequence of str, length n
        The `text` of each marker; its `id` is the index.
    positions : array-like, shape (n, 3)
        [m]; a marker with a NaN is missing.
    diameter : float
        Of the spheres [m].
    namespace : str or None, optional
        Of all markers; None for that each has its label as its own.

    Returns
    -------
    visualization_msgs/msg/MarkerArray
        Of rosbags' types.
    """
    header = _header(stamp, frame_id)
    upright = _make('geometry_msgs/msg/Quaternion', 0., 0., 0., 1.)
    scale = _make('geometry_msgs/msg/Vector3', diameter, diameter, diameter)
    white = _make('std_msgs/msg/ColorRGBA', 1., 1., 1., 1.)
    forever = _make('builtin_interfaces/msg/Duration', 0, 0)
    texture = _make('sensor_msgs/msg/CompressedImage', _header(0, ''), '', NO_BYTES)
    mesh = _make('visualization_msgs/msg/MeshFile', '', NO_BYTES)
    sphere, add = 2, 0
    markers = []
    positions = np.asarray(positions, float)
    for index, (label, position) in enumerate(zip(labels, positions, strict=True)):
        if np.isnan(position).any():
            continue
        point = _make('geometry_msgs/msg/Point', *position.tolist())
        markers.append(_make(
            'visualization_msgs/msg/Marker', header,
            label if namespace is None else namespace, index, sphere, add,
            _make('geometry_msgs/msg/Pose', point, upright), scale, white, forever, False,
            [], [], '', texture, [], label, '', mesh, False))
    return _make(MARKER_ARRAY, markers)


def joint_state_message(stamp: int, names: Sequence[str], positions: ArrayLike,
                        frame_id: str = '') -> Any:
    """Build a JointState with positions only.

    Parameters
    ----------
    stamp : int
        [ns].
    names : sequence of str, length n
    positions : array-like, shape (n,)
        [rad].
    frame_id : str

    Returns
    -------
    sensor_msgs/msg/JointState
        Of rosbags' types.

    Raises
    ------
    ValueError
        If names and positions differ in number.
    """
    positions = np.asarray(positions, float)
    if positions.shape != (len(names),):
        raise ValueError(f'positions: shape {positions.shape}; expected ({len(names)},), '
                         'one for each name')
    return _make(JOINT_STATE, _header(stamp, frame_id), list(names), positions,
                 NO_NUMBERS, NO_NUMBERS)


def pose_message(stamp: int, frame_id: str, position: ArrayLike, rotation: ArrayLike) -> Any:
    """Build a PoseStamped.

    Parameters
    ----------
    stamp : int
        [ns].
    frame_id : str
    position : array-like, shape (3,)
        [m]
    rotation : array-like, shape (3, 3)
        From the posed frame to `frame_id`.

    Returns
    -------
    geometry_msgs/msg/PoseStamped
        Of rosbags' types.
    """
    return _make(POSE, _header(stamp, frame_id), _make(
        'geometry_msgs/msg/Pose',
        _make('geometry_msgs/msg/Point', *np.asarray(position, dtype=float).tolist()),
        _make('geometry_msgs/msg/Quaternion', *map(float, quaternion(rotation)))))


def _make(type_name: str, *fields: Any) -> Any:
    return TYPE_STORE.types[type_name](*fields)


def _header(stamp: int, frame_id: str) -> Any:
    return _make('std_msgs/msg/Header',
                 _make('builtin_interfaces/msg/Time', *stamp_of(stamp)), frame_id)


@contextmanager
def _read_errors(path: Path) -> Iterator[None]:
    """Turn any error of rosbags, which damaged bytes can raise, into a `BagError`."""
    try:
        yield
    except Exception as error:
        # Definitions of messages, which some errors quote, take pages.
        reason = shorten(str(error).rstrip('. \n'), LONGEST_REASON) or type(error).__name__
        raise BagError(f'{path}: cannot be read ({reason}); '
                       'expected a complete recording') from error
