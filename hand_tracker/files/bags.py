"""rosbag2 recordings without ROS: read any of them, write single `.mcap` or `.db3` files.

A recording is a folder with `metadata.yaml`, a `.mcap` file or a `.db3` file. Messages
stay the bytes (CDR) they travel as; `bag_message` makes them of arrays.
"""

import os
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ..core.errors import HandTrackerError
from ..core.numerics.quaternion import quaternion

MARKER_ARRAY = 'visualization_msgs/msg/MarkerArray'
JOINT_STATE = 'sensor_msgs/msg/JointState'
TF = 'tf2_msgs/msg/TFMessage'
POSE = 'geometry_msgs/msg/PoseStamped'

# Metadata version 8 is what Humble and Jazzy read; its messages are the same on Lyrical.
METADATA_VERSION = 8
STORAGE = {'.mcap': StoragePlugin.MCAP, '.db3': StoragePlugin.SQLITE3}
EXPECTED = 'expected a rosbag2 folder with metadata.yaml, a .mcap file or a .db3 file'

TYPES = get_typestore(Stores.ROS2_JAZZY)
NO_BYTES = np.empty(0, np.uint8)
NO_NUMBERS = np.empty(0)


class BagError(HandTrackerError):
    """A recording cannot be read or written: which, what is wrong and what was expected."""


class BagMessage(NamedTuple):
    """One message as recorded.

    Attributes
    ----------
    topic : str
    type : str
        As 'sensor_msgs/msg/JointState'.
    time : int
        When it was recorded [ns].
    data : bytes
        The message in CDR.
    """

    topic: str
    type: str
    time: int
    data: bytes


class Bag:
    """An open recording; get one from `open_bag`.

    Attributes
    ----------
    path : Path
    topics : dict of str to str
        Type of each topic.
    counts : dict of str to int
        Number of messages of each topic.
    offered_qos : dict of str to list of rosbags.interfaces.Qos
        What the recorded publishers of each topic offered; may be empty.
    start : int
        Time of the first message [ns].
    duration : int
        Time from the first message to the last [ns].
    """

    def __init__(self, path, reader):
        self.path = path
        self._reader = reader
        self.topics, self.counts, self.offered_qos = {}, {}, {}
        for connection in reader.connections:
            topic = connection.topic
            # A topic recorded with two types is played with the first.
            if self.topics.setdefault(topic, connection.msgtype) != connection.msgtype:
                continue
            self.counts[topic] = self.counts.get(topic, 0) + connection.msgcount
            self.offered_qos.setdefault(topic, []).extend(connection.ext.offered_qos_profiles)
        self.start = reader.start_time
        self.duration = reader.end_time - 1 - reader.start_time

    def messages(self, topics=None, start=None):
        """Iterate over the messages in order of time.

        Parameters
        ----------
        topics : iterable of str, optional
            Only these topics.
        start : int, optional
            Only messages recorded then or later [ns].

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
        with _readable(self.path):
            for connection, time, data in self._reader.messages(connections, start=start):
                count += 1
                yield BagMessage(connection.topic, connection.msgtype, time, data)
        listed = sum(self.counts[topic] for topic in wanted)
        if count < listed and (start is None or start <= self.start):
            raise BagError(f'{self.path}: has {count} messages of {listed} that it lists; '
                           'expected a complete recording')


@contextmanager
def open_bag(path):
    """Open a recording for reading.

    Parameters
    ----------
    path : path-like
        A folder with `metadata.yaml`, a `.mcap` file or a `.db3` file.

    Yields
    ------
    Bag
        With at least one message.

    Raises
    ------
    BagError
        If there is no such recording, or it is of an unknown kind, cut off or empty.
    """
    path = Path(path)
    if not path.exists():
        raise BagError(f'{path}: no such file or folder; {EXPECTED}')
    if path.is_dir():
        if not (path / 'metadata.yaml').exists():
            raise BagError(f'{path}: a folder without metadata.yaml; {EXPECTED}')
    elif path.suffix not in STORAGE:
        raise BagError(f'{path}: unknown extension {path.suffix!r}; {EXPECTED}')
    elif not path.stat().st_size:
        raise BagError(f'{path}: the file has no bytes; {EXPECTED}')
    with _readable(path):
        reader = Reader(path)
        reader.open()
    try:
        if not reader.message_count:
            raise BagError(f'{path}: a recording without messages; expected at least one')
        yield Bag(path, reader)
    finally:
        reader.close()


def write_bag(path, messages):
    """Write a recording as one file, which `ros2 bag play` plays as it is.

    The same messages give the same bytes with the same releases of rosbags and zstd:
    there is no time in the file but the messages' own.

    Parameters
    ----------
    path : path-like
        Ending in `.mcap` (compressed by zstd) or `.db3`; replaced if it exists.
    messages : iterable of BagMessage
        In order of time. The types are those of ROS 2 Jazzy's common messages.

    Raises
    ------
    BagError
        If there are no messages, a type is unknown, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in STORAGE:
        raise BagError(f'{path}: unknown extension {path.suffix!r}; expected .mcap or .db3')
    if not path.parent.is_dir():
        raise BagError(f'{path}: no folder {path.parent}; expected one to write into')
    # The library writes folders; the file in it, named after it, is complete without it.
    with TemporaryDirectory(dir=path.parent) as scratch:
        folder = Path(scratch, path.stem)
        writer = Writer(folder, version=METADATA_VERSION, storage_plugin=STORAGE[path.suffix])
        if path.suffix == '.mcap':
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        connections = {}
        with writer:
            for topic, kind, time, data in messages:
                if topic not in connections:
                    if kind not in TYPES.types:
                        raise BagError(f'{path}: {topic} has the unknown type {kind!r}; '
                                       "expected one of Jazzy's common messages")
                    connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
                writer.write(connections[topic], time, data)
            if not connections:
                raise BagError(f'{path}: no messages to write; expected at least one')
        os.replace(folder / path.name, path)


def bag_message(topic, time, message):
    """Make a message of rosbags' types ready for `write_bag`.

    Parameters
    ----------
    topic : str
    time : int
        When it was recorded [ns].
    message : object
        As from `marker_array_message`, `joint_state_message` or `pose_message`.

    Returns
    -------
    BagMessage
    """
    kind = message.__msgtype__
    data = bytes(TYPES.serialize_cdr(message, kind, little_endian=True))
    return BagMessage(topic, kind, time, data)


def marker_array_message(stamp, frame_id, labels, positions, diameter=.01):
    """Make a MarkerArray with one sphere for each marker that is there.

    Parameters
    ----------
    stamp : int
        [ns].
    frame_id : str
    labels : sequence of str, length n
        Written in each marker's `text`; its `ns` is 'hand', its `id` the index.
    positions : array-like, shape (n, 3)
        [m]; a marker with a NaN in it is left out.
    diameter : float
        Of the spheres [m].

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
            'visualization_msgs/msg/Marker', header, 'hand', index, sphere, add,
            _make('geometry_msgs/msg/Pose', point, upright), scale, white, forever, False,
            [], [], '', texture, [], label, '', mesh, False))
    return _make(MARKER_ARRAY, markers)


def joint_state_message(stamp, names, positions, frame_id=''):
    """Make a JointState of positions.

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
        If there are not as many positions as names.
    """
    positions = np.asarray(positions, float)
    if positions.shape != (len(names),):
        raise ValueError(f'positions: shape {positions.shape}; expected ({len(names)},), '
                         'one for each name')
    return _make(JOINT_STATE, _header(stamp, frame_id), list(names), positions,
                 NO_NUMBERS, NO_NUMBERS)


def pose_message(stamp, frame_id, position, rotation):
    """Make a PoseStamped.

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
        _make('geometry_msgs/msg/Point', *map(float, position)),
        _make('geometry_msgs/msg/Quaternion', *map(float, quaternion(rotation)))))


def _make(kind, *fields):
    return TYPES.types[kind](*fields)


def _header(stamp, frame_id):
    return _make('std_msgs/msg/Header',
                 _make('builtin_interfaces/msg/Time', *divmod(stamp, 10**9)), frame_id)


@contextmanager
def _readable(path):
    try:
        yield
    # Damaged bytes can raise anything in the library: one error says so.
    except Exception as error:
        reason = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
        raise BagError(f'{path}: cannot be read ({reason}); '
                       'expected a complete recording') from error
