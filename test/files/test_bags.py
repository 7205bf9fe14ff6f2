"""Recordings: what is written is read again; damage is named."""

import re
import sqlite3
from contextlib import closing
from itertools import islice

import numpy as np
import pytest
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from hand_tracker.files import bags
from hand_tracker.files.bags import (
    JOINT_STATE,
    MARKER_ARRAY,
    TYPE_STORE,
    BagError,
    BagMessage,
    bag_message,
    joint_state_message,
    marker_array_message,
    open_bag,
    write_bag,
)

FIRST_STAMP_NS = 1_700_000_000_000_000_000
PERIOD = 8_333_333
LABELS = ('wrist', 'index', 'thumb')
NAMES = ('index_mcp', 'index_pip')


def frames(count=30):
    """Yield messages of two topics, the second marker missing in every third frame."""
    for frame in range(count):
        time = FIRST_STAMP_NS + frame * PERIOD
        positions = np.arange(9.).reshape(3, 3) + frame
        if frame % 3 == 0:
            positions[1] = np.nan
        yield bag_message('/markers', time, marker_array_message(time, 'mocap', LABELS, positions))
        yield bag_message('/truth', time, joint_state_message(time, NAMES, (.1 * frame, -.1)))


def write_folder(path, messages, storage=StoragePlugin.SQLITE3, offers=()):
    with Writer(path, version=8, storage_plugin=storage) as writer:
        connections = {}
        for message in messages:
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(
                    message.topic, message.type, typestore=TYPE_STORE, offered_qos_profiles=offers)
            writer.write(connections[message.topic], message.time, message.data)


@pytest.mark.parametrize('suffix', ['.mcap', '.db3', '.MCAP', '.Db3'])
def test_reads_what_it_writes(tmp_path, suffix):
    path = tmp_path / f'bag{suffix}'
    write_bag(path, frames())
    with open_bag(path) as bag:
        assert bag.topics == {'/markers': MARKER_ARRAY, '/truth': JOINT_STATE}
        assert bag.counts == {'/markers': 30, '/truth': 30}
        assert (bag.start, bag.duration) == (FIRST_STAMP_NS, 29 * PERIOD)
        assert list(bag.messages()) == list(frames())
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize('storage', StoragePlugin)
def test_reads_folders(tmp_path, storage):
    write_folder(tmp_path / 'bag', frames(), storage)
    with open_bag(tmp_path / 'bag') as bag:
        assert list(bag.messages()) == list(frames())


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_same_messages_give_the_same_bytes(tmp_path, suffix):
    paths = [tmp_path / folder / f'demo{suffix}' for folder in ('a', 'b')]
    for path in paths:
        path.parent.mkdir()
        write_bag(path, frames())
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_write_replaces(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(path, frames(5))
    write_bag(path, frames(2))
    with open_bag(path) as bag:
        assert bag.counts['/markers'] == 2


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(path, frames(2))
    before = path.read_bytes()

    def failing():
        yield from frames(1)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_bag(path, failing())
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_topics_and_start_select_messages(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(path, frames())
    start = FIRST_STAMP_NS + 20 * PERIOD
    with open_bag(path) as bag:
        selected = list(bag.messages(['/truth'], start))
        assert selected == [m for m in frames() if m.topic == '/truth' and m.time >= start]
        assert list(bag.messages([])) == []
        with pytest.raises(BagError, match='no topic /nothing; it has /markers, /truth'):
            next(bag.messages(['/nothing']))


def test_reads_offered_qos(tmp_path):
    offer = Qos(QosHistory.KEEP_LAST, 5, QosReliability.BEST_EFFORT, QosDurability.VOLATILE,
                QosTime(0, 0), QosTime(0, 0), QosLiveliness.AUTOMATIC, QosTime(0, 0), False)
    write_folder(tmp_path / 'bag', frames(2), offers=[offer])
    with open_bag(tmp_path / 'bag') as bag:
        assert bag.offered_qos == {'/markers': [offer], '/truth': [offer]}


def test_file_is_a_rosbag2_file_of_the_right_version(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(path, frames(2))
    with Reader(path) as reader:
        definitions = {c.msgtype: c.msgdef.data for c in reader.connections}
    assert 'visualization_msgs/Marker' in definitions[MARKER_ARRAY]
    assert b'serialized_metadata' in path.read_bytes()


def test_marker_array_leaves_missing_markers_out():
    positions = [[1, 2, 3], [np.nan, 0, 0], [4, 5, 6]]
    message = marker_array_message(FIRST_STAMP_NS + 7, 'mocap', LABELS, positions, diameter=.02)
    assert [(m.ns, m.id, m.text) for m in message.markers] == [
        ('hand', 0, 'wrist'), ('hand', 2, 'thumb')]
    last = message.markers[1]
    assert (last.type, last.action) == (last.SPHERE, last.ADD)
    assert (last.header.stamp.sec, last.header.stamp.nanosec) == divmod(FIRST_STAMP_NS + 7, 10**9)
    assert last.header.frame_id == 'mocap'
    point = last.pose.position
    assert (point.x, point.y, point.z) == (4, 5, 6)
    assert (last.scale.x, last.color.a) == (.02, 1)


def test_shapes_are_checked():
    with pytest.raises(ValueError, match=r'positions: shape \(3,\); expected \(2,\)'):
        joint_state_message(0, NAMES, [1, 2, 3])
    with pytest.raises(ValueError, match='zip'):
        marker_array_message(0, 'mocap', LABELS, np.zeros((2, 3)))


def test_ros_reads_the_bytes():
    serialization = pytest.importorskip('rclpy.serialization')
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import MarkerArray

    markers, truth = islice(frames(2), 2, 4)
    array = serialization.deserialize_message(markers.data, MarkerArray)
    assert [marker.text for marker in array.markers] == list(LABELS)
    assert array.markers[2].pose.position.z == 9.
    assert list(serialization.deserialize_message(truth.data, JointState).position) == [.1, -.1]


def test_missing(tmp_path):
    with pytest.raises(BagError, match=r'none\.mcap: no such file or folder; expected a rosbag2'):
        with open_bag(tmp_path / 'none.mcap'):
            pass


def test_folder_without_metadata(tmp_path):
    with pytest.raises(BagError, match=r'a folder without metadata\.yaml; expected'):
        with open_bag(tmp_path):
            pass


@pytest.mark.parametrize('text', ['', 'rosbag2_bagfile_information: {version: 99}', '{', 'a: 1'])
def test_folder_with_bad_metadata(tmp_path, text):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=r'cannot be read \(.+\); expected a complete recording'):
        with open_bag(tmp_path):
            pass


def test_unknown_extension(tmp_path):
    path = tmp_path / 'hand.bag'
    path.write_bytes(b'#ROSBAG V2.0')
    with pytest.raises(BagError, match="unknown extension '.bag'; expected a rosbag2 folder"):
        with open_bag(path):
            pass
    with pytest.raises(BagError, match="unknown extension '.bag'; expected .mcap or .db3"):
        write_bag(path, frames())


def test_empty_file(tmp_path):
    path = tmp_path / 'bag.mcap'
    path.touch()
    with pytest.raises(BagError, match='the file has no bytes; expected'):
        with open_bag(path):
            pass


def test_no_messages(tmp_path):
    write_folder(tmp_path / 'bag', [])
    with pytest.raises(BagError, match='a recording without messages; expected at least one'):
        with open_bag(tmp_path / 'bag'):
            pass
    with pytest.raises(BagError, match='no messages to write; expected at least one'):
        write_bag(tmp_path / 'new.mcap', [])


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
@pytest.mark.parametrize('part', [1e-9, .01, .5, .9])
def test_cut_off_file(tmp_path, suffix, part):
    path = tmp_path / f'bag{suffix}'
    write_bag(path, frames(300))
    data = path.read_bytes()
    path.write_bytes(data[:1 + int(part * len(data))])
    with pytest.raises(BagError, match=r'cannot be read \(.+\); expected a complete recording'):
        with open_bag(path) as bag:
            list(bag.messages())


def test_damage_inside(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(path, frames(300))
    data = bytearray(path.read_bytes())
    data[2000:2100] = bytes(100)
    path.write_bytes(data)
    with pytest.raises(BagError, match=r'cannot be read \(.+\); expected a complete recording'):
        with open_bag(path) as bag:
            list(bag.messages())


def test_damaged_index(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(path, frames(3))
    data = path.read_bytes()
    first_index = data.index(b'\x07', data.index(b'\x28\xb5\x2f\xfd'))  # after the zstd chunk
    message = 'cannot be read|messages of 6 that it lists; expected a complete recording'
    for start in range(first_index, len(data) - 100, 50):
        path.write_bytes(data[:start] + bytes(100) + data[start + 100:])
        try:
            with open_bag(path) as bag:
                assert [m.topic for m in bag.messages()] == ['/markers', '/truth'] * 3
        except BagError as error:
            assert re.search(message, str(error))


@pytest.mark.parametrize('change', ['data = 5', "data = 'text'", "timestamp = 'text'"])
def test_columns_of_another_type_are_named(tmp_path, change):
    path = tmp_path / 'a.db3'
    write_bag(path, frames())
    with closing(sqlite3.connect(path)) as table, table:
        table.execute(f'UPDATE messages SET {change} WHERE id = 9')
    with pytest.raises(BagError, match='a.db3: .*expected a complete recording'):
        with open_bag(path) as bag:
            list(bag.messages())


def test_a_chunk_that_unpacks_without_end_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'chunk.mcap'
    write_bag(path, frames(30))
    monkeypatch.setattr(bags, 'MAX_CHUNK_BYTES', 10)
    with pytest.raises(BagError, match=r'chunk.mcap: .*a chunk of \d+ bytes; at most 10 are read'):
        with open_bag(path) as bag:
            list(bag.messages())


def test_unknown_type(tmp_path):
    with pytest.raises(BagError, match="/x has the unknown type 'no_msgs/msg/Nothing'; expected"):
        write_bag(tmp_path / 'bag.mcap', [BagMessage('/x', 'no_msgs/msg/Nothing', 0, b'')])


def test_no_folder(tmp_path):
    with pytest.raises(BagError, match='no folder .*; expected one to write into'):
        write_bag(tmp_path / 'none' / 'bag.mcap', frames())
