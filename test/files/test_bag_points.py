"""rosbag2 recordings of every message of points that live sources send, read by the commands."""

import csv
import json

import numpy as np
import pytest
from helpers.point_bags import (
    FRAME_ID,
    MADE,
    RECORDED_PERIOD,
    RECORDING_START,
    cloud_message,
    header,
    marker,
    positions_of,
    stamp_ns,
    write_point_bag,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hand_tracker.__main__ import main
from hand_tracker.core.model.hand import LEFT_HAND_MIRROR
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.evaluation.captures import load_capture
from hand_tracker.files.bag_points import marker_messages, read_bag_points
from hand_tracker.files.bags import TYPE_STORE, BagError, open_bag
from hand_tracker.files.point_recording import RecordingError
from hand_tracker.files.recordings import ReadingOptions, read_recording
from hand_tracker.messages.joint_states import JointStateReader
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS
from hand_tracker.messages.marker_array import MARKER_ARRAY
from hand_tracker.messages.message_definitions import DEFINITIONS
from hand_tracker.messages.stamps import nanoseconds
from hand_tracker.tracking.opened_recording import is_marker_bag

LABELS = {
    'cloud': ('',) * 8, 'markers': tuple(MARKERS),
    'bodies': tuple(f'RHand:{name}' for name in MARKERS), 'poses': LANDMARK_ORDERS[21],
    'named': tuple(f'{side}_{name}' for side in ('left', 'right') for name in LANDMARK_ORDERS[21])}


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Recordings of 150 frames by the short name of their messages."""
    folder = tmp_path_factory.mktemp('point_bags')
    return {kind: write_point_bag(folder / kind, [kind], frames=150) for kind in MADE}


def angles_of(path):
    with open(path, newline='', encoding='utf-8') as file:
        header_row, *rows = csv.reader(file)
    return header_row, np.array(rows, dtype=float)


def test_what_is_wrong_with_a_definition_is_told_in_short(tmp_path):
    path = write_point_bag(tmp_path / 'take', ['bodies'])
    path.write_bytes(path.read_bytes().replace(b'uint32 frame_number', b'uint32 frame:number'))
    with pytest.raises(BagError, match='cannot be read .+ expected a complete recording') as raised:
        read_recording(path)
    assert len(str(raised.value)) < len(str(path)) + 400


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
@pytest.mark.parametrize('kind', MADE)
def test_every_kind_of_messages_is_read(tmp_path, kind, suffix):
    found = read_recording(write_point_bag(tmp_path / 'take', [kind], suffix))
    assert found.labels == LABELS[kind]
    assert found.origin == (MADE[kind][1], MADE[kind][0], FRAME_ID, RECORDING_START)
    assert found.is_landmarks == MADE[kind][3]
    np.testing.assert_allclose(found.stamps, 1e-9 * RECORDED_PERIOD * np.arange(60), atol=1e-12)
    expected = positions_of(kind, 60)
    if kind == 'named':
        expected = np.concatenate((LEFT_HAND_MIRROR * expected + .5, expected), axis=1)
        expected[:, -1] = np.nan      # of which `is_valid` is false
    for row, (points, positions) in enumerate(zip(found.points, expected)):
        if kind == 'cloud':           # in another order in each frame
            points = np.roll(points, -row, axis=0)
        np.testing.assert_allclose(points, positions, atol=1e-6)


@pytest.mark.parametrize('kind', MADE)
def test_inspect_names_messages_and_topic_and_its_command_tracks(bags, tmp_path, capsys, kind,
                                                                 monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['inspect', str(bags[kind])]) == 0
    name, topic, _, _ = MADE[kind]
    assert f'rosbag2 with {name} on {topic}, 150 frames, 120 Hz' in capsys.readouterr().out
    assert main(['inspect', str(bags[kind]), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found['topic'], found['message'], found['up']) == (topic, name, 'z')
    assert main(found['next'].split()[1:]) == 0
    assert 'tracked' in capsys.readouterr().out


def test_all_are_tracked_alike(bags, tmp_path):
    tables = {}
    for kind in MADE:
        path = tmp_path / f'{kind}.csv'
        assert main(['track', str(bags[kind]), '-o', str(path), '--side', 'right',
                     '--no-auto-size', *(['--labels', 'none'] * (kind == 'cloud'))]) == 0
        tables[kind] = angles_of(path)
    first, expected = tables['markers']
    assert len(expected) == 150
    for kind, (names, table) in tables.items():
        assert names == first
        # The joint centres are those of the hand that has no noise.
        is_same = kind in ('markers', 'bodies')
        reference = expected if is_same or kind == 'cloud' else tables['poses'][1]
        np.testing.assert_allclose(table, reference[-len(table):], atol=1e-9 if is_same else 1e-3)


def test_stamps_and_frame_stay_as_they_were_recorded(bags, tmp_path):
    path = tmp_path / 'angles.mcap'
    assert main(['track', str(bags['bodies']), '-o', str(path), '--wrist']) == 0
    reader = JointStateReader()
    with open_bag(path) as bag:
        stamps = [nanoseconds(reader.read(message.data).stamp)
                  for message in bag.messages(['/joint_states'])]
        transform = TYPE_STORE.deserialize_cdr(
            next(bag.messages(['/tf'])).data, 'tf2_msgs/msg/TFMessage').transforms[0]
    assert stamps == [stamp_ns(number) for number in range(150)]
    assert transform.header.frame_id == FRAME_ID


def write_clouds(path, points, and_markers=()):
    """Write a recording of a cloud in each of two messages, and of MarkerArrays beside them."""
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        name = 'sensor_msgs/msg/PointCloud2'
        clouds = writer.add_connection('/camera/depth', name, typestore=TYPE_STORE)
        arrays = writer.add_connection('/hand/markers', MARKER_ARRAY, typestore=TYPE_STORE)
        for number in range(2):
            writer.write(clouds, stamp_ns(number),
                         TYPE_STORE.serialize_cdr(cloud_message(points, number), name))
        for message in and_markers:
            writer.write(arrays, message.time, message.data)
    return path / f'{path.name}.mcap'


def test_marker_arrays_are_chosen_beside_the_cloud_of_a_camera(tmp_path):
    messages = list(marker_messages(np.zeros((3, 2, 3)), [10**9, 2 * 10**9, 3 * 10**9], 'ab'))
    path = write_clouds(tmp_path / 'take', np.ones((50, 3)), messages)
    assert is_marker_bag(path)
    assert read_recording(path, ReadingOptions(zero_is_missing=False)).labels == ('a/0', 'b/1')


def test_a_cloud_of_a_surface_is_refused(tmp_path):
    path = write_clouds(tmp_path / 'take', np.random.default_rng(0).normal(size=(1200, 3)))
    with pytest.raises(RecordingError, match='/camera/depth: a cloud of 1000 points or more'):
        read_recording(path, ReadingOptions(topic='/camera/depth'))


def test_several_topics_without_marker_arrays_are_not_played_as_they_are(tmp_path):
    assert not is_marker_bag(write_point_bag(tmp_path / 'both', ['cloud', 'poses']))


def test_convert_writes_the_points_of_the_topic_asked_for(tmp_path, capsys):
    both = write_point_bag(tmp_path / 'both', ['cloud', 'bodies', 'poses'])
    written = tmp_path / 'points.npz'
    assert main(['convert', str(both), str(written)]) == 1
    said = capsys.readouterr().err
    assert 'several topics of points; choose one (--topic): /landmarks (geometry_msgs/msg/Pos' in (
        said) and '/rigid_bodies (mocap4r2_msgs/msg/RigidBodies)' in said
    assert main(['convert', str(both), str(written), '--topic', 'rigid_bodies']) == 0
    found = read_recording(written)
    assert found.labels == LABELS['bodies']
    np.testing.assert_allclose(found.points, positions_of('bodies', 60), atol=1e-6)
    assert main(['track', str(both), '-o', str(tmp_path / 'angles.csv'), '--topic',
                 '/rigid_bodies']) == 0
    assert len(angles_of(tmp_path / 'angles.csv')[1]) == 60
    assert main(['track', str(both), '-o', str(tmp_path / 'angles.csv'), '--topic', '/none']) == 1
    assert 'no topic /none of visualization_msgs/msg/MarkerArray or ' in capsys.readouterr().err


def test_convert_names_the_points_that_messages_cannot_hold(tmp_path, capsys):
    points = np.ones((20, 3, 3))
    points[:, 1] = np.nan
    given = tmp_path / 'given.npz'
    np.savez(given, markers=points, marker_names=np.array(['a', 'b', 'c']), rate_hz=100.)
    assert main(['convert', str(given), str(tmp_path / 'points.mcap')]) == 0
    assert 'points.mcap: b is never seen, and left out' in capsys.readouterr().err
    assert main(['convert', str(given), str(tmp_path / 'points.trc')]) == 0
    assert 'never seen' not in capsys.readouterr().err


def test_convert_names_markers_by_the_labels_of_the_command_line(tmp_path):
    path = write_clouds(tmp_path / 'take', np.ones((1, 3)), marker_messages(
        np.arange(9.).reshape(1, 3, 3) + 1., [RECORDING_START], ['leds/a', 'leds/b', 'leds/c']))
    written = tmp_path / 'points.npz'
    assert main(['convert', str(path), str(written), '--label', 'thumb=leds/b/1',
                 '--label', 'wrist=2', '--label', 'little_mcp=']) == 0
    found = read_recording(written)
    assert found.labels == ('leds/a/0', 'thumb_tip', 'wrist')
    assert found.points[0, :, 0].tolist() == [1., 4., 7.]


def test_a_topic_called_markers_comes_first(tmp_path):
    path = tmp_path / 'named' / 'named.mcap'
    with Writer(path.parent, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, count in (('/markers', 2), ('/other', 3)):
            writer.write(writer.add_connection(topic, MADE['cloud'][0], typestore=TYPE_STORE),
                         RECORDING_START, TYPE_STORE.serialize_cdr(
                             cloud_message(np.ones((count, 3)), 0), MADE['cloud'][0]))
    assert read_recording(path).points.shape == (1, 2, 3)
    assert read_recording(path, ReadingOptions(topic='/other')).points.shape == (1, 3, 3)


def test_both_hands_of_named_landmarks_are_tracked(bags, tmp_path):
    path = tmp_path / 'angles.csv'
    assert main(['track', str(bags['named']), '-o', str(path), '--side', 'both']) == 0
    names, table = angles_of(path)
    assert len(names) == 51 and table.shape == (150, 51) and np.isfinite(table).all()


def test_a_hand_is_fitted_to_recorded_markers(tmp_path):
    path = write_point_bag(tmp_path / 'long', ['bodies'], frames=2400)
    assert main(['calibrate', str(path), '-o', str(tmp_path / 'hand.yaml')]) == 0
    assert 'side: right' in (tmp_path / 'hand.yaml').read_text()


def test_a_capture_is_judged_from_recorded_landmarks(tmp_path):
    capture = load_capture(write_point_bag(tmp_path / 'long', ['poses'], frames=600))
    assert capture.side == 'right' and not capture.missing
    np.testing.assert_allclose(capture.joints, positions_of('poses', 600), atol=1e-6)


def test_messages_without_points_have_the_time_of_the_others(tmp_path):
    path = tmp_path / 'gaps' / 'gaps.mcap'
    kind, topic, _, _ = MADE['cloud']
    with Writer(path.parent, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(topic, kind, typestore=TYPE_STORE)
        for number in range(5):
            message = cloud_message(np.ones((0 if number == 2 else 3, 3)), number)
            writer.write(connection, stamp_ns(number) + 4321,
                         TYPE_STORE.serialize_cdr(message, kind))
    found = read_recording(path)
    np.testing.assert_allclose(found.stamps, 1e-9 * RECORDED_PERIOD * np.arange(5), atol=1e-12)
    assert found.seen.sum(axis=1).tolist() == [3, 3, 0, 3, 3]


def of_other_definition(text):
    """Return types in which a marker of mocap4r2 is defined otherwise."""
    types = get_typestore(Stores.ROS2_JAZZY)
    types.register(get_types_from_msg(text, 'mocap4r2_msgs/msg/Marker'))
    types.register(get_types_from_msg(
        DEFINITIONS['mocap4r2_msgs/msg/Markers'], 'mocap4r2_msgs/msg/Markers'))
    return types


def write_of_other_definition(folder, text, suffix, **fields):
    types, kind = of_other_definition(text), 'mocap4r2_msgs/msg/Markers'
    storage = StoragePlugin.MCAP if suffix == '.mcap' else StoragePlugin.SQLITE3
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        own = types.types['mocap4r2_msgs/msg/Marker']
        message = types.types[kind](header(0), 0, [own(**fields)])
        writer.write(writer.add_connection('/mocap', kind, typestore=types), RECORDING_START,
                     types.serialize_cdr(message, kind))
    return folder / f'{folder.name}{suffix}'


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_a_definition_in_the_recording_is_heeded(tmp_path, suffix):
    text = ('float64 residual\nstring marker_name\nint32 marker_index\nint8 id_type\n'
            'geometry_msgs/Point translation\n')
    at = marker('index', (1., 2., 3.))
    path = write_of_other_definition(
        tmp_path / 'other', text, suffix, residual=.5, marker_name=at.marker_name, marker_index=4,
        id_type=0, translation=at.translation)
    found = read_recording(path)
    assert found.labels == ('index',)
    assert found.points.tolist() == [[[1., 2., 3.]]]


@pytest.mark.parametrize('kind', ['bodies', 'named'])
def test_a_definition_with_a_field_of_another_name_is_refused(tmp_path, kind):
    path = write_point_bag(tmp_path / 'other', [kind])
    path.write_bytes(path.read_bytes().replace(b'Header header', b'Header headed'))
    with pytest.raises(RecordingError, match='is no whole .*: defined there without fields'):
        read_recording(path)


def test_a_definition_without_a_field_is_refused(tmp_path):
    path = write_of_other_definition(
        tmp_path / 'other', 'geometry_msgs/Point translation\n', '.mcap',
        translation=marker('', (1., 2., 3.)).translation)
    with pytest.raises(RecordingError, match='is no whole .*: defined there without fields'):
        read_recording(path)


@pytest.mark.parametrize('kind', MADE)
def test_damaged_messages_are_refused(tmp_path, kind):
    path = tmp_path / 'cut' / 'cut.mcap'
    name, topic, make, _ = MADE[kind]
    data = bytes(TYPE_STORE.serialize_cdr(make(positions_of(kind, 1)[0], 0), name))
    with Writer(path.parent, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection(topic, name, typestore=TYPE_STORE), RECORDING_START,
                     data[:len(data) // 2])
    with pytest.raises(RecordingError, match=f'{topic}: the message of {stamp_ns(0)} ns is '
                                             f'no whole {name}: '):
        read_recording(path)


def test_poses_that_are_no_landmarks_are_refused(tmp_path):
    path = tmp_path / 'poses' / 'poses.mcap'
    name, topic, make, _ = MADE['poses']
    with Writer(path.parent, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection(topic, name, typestore=TYPE_STORE), RECORDING_START,
                     TYPE_STORE.serialize_cdr(make(np.ones((4, 3)), 0), name))
    with pytest.raises(RecordingError, match='PoseArray of 4 poses; expected are 21, 25, 26'):
        read_bag_points(path)


def test_a_named_pose_at_the_origin_is_seen(tmp_path):
    landmarks = positions_of('named', 1)[0]
    landmarks = landmarks - landmarks[0]
    path = tmp_path / 'origin' / 'origin.mcap'
    name, topic, make, _ = MADE['named']
    with Writer(path.parent, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection(topic, name, typestore=TYPE_STORE), RECORDING_START,
                     TYPE_STORE.serialize_cdr(make(landmarks, 0), name))
    found = read_recording(path)
    assert found.seen[0].tolist() == [True] * 41 + [False]
    np.testing.assert_allclose(found.points[0, 21:41], landmarks[:20], atol=1e-6)
