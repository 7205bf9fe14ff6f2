"""Recordings tracked offline: the same hand as from arrays, by the node's rules, without ROS."""

import csv
import io
import os
import re
import signal
import subprocess
import sys
import time
from itertools import count, islice
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from helpers.hands import markers_of
from scipy.spatial.transform import Rotation

from benchmarks.offline import measure_one
from benchmarks.repository import REPOSITORY
from hand_tracker.cli.track import main
from hand_tracker.core.model.hand import JOINTS, SIDES, Hand, preset_coupling, preset_limits
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.numerics.vectors import unit_vectors
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.angle_table import WRIST_COLUMNS
from hand_tracker.files.bags import (
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
from hand_tracker.files.hand_file import save_hand
from hand_tracker.files.recordings import read_recording
from hand_tracker.messages import marker_array
from hand_tracker.messages.labels import LabelMap
from hand_tracker.package_data import packaged_recording
from hand_tracker.progress import Progress
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.packaged_recordings import (
    RECORDING_RATE,
    both_hands_messages,
    demo_recording,
    packaged_recordings,
    recording_messages,
)
from hand_tracker.tracking.monitor import Monitor
from hand_tracker.tracking.recording import MarkerReading, track

FRAMES = 150
STAMP_STEP = 10_000_000     # [ns]
ROS = ('builtin_interfaces', 'geometry_msgs', 'rclpy', 'sensor_msgs', 'std_msgs', 'tf2_msgs',
       'visualization_msgs')
PATIENCE = 240.  # [s], on a busy machine
GIVEN_SIZE = '--no-auto-size'  # the hand is the mean hand
RUN = 'import sys; from hand_tracker.__main__ import main; sys.exit(main(sys.argv[1:]))'
HALF_MILLIDEGREE = .0005  # of rounding in a table


@pytest.fixture(scope='module')
def recording():
    whole = demo_recording()
    middle = slice(850, 850 + FRAMES)  # with drop-outs
    part = whole._replace(stamps=whole.stamps[middle], markers=whole.markers[middle],
                          angles=whole.angles[middle])
    assert np.isnan(part.markers).any()
    return part


@pytest.fixture(scope='module')
def bag(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp('bag') / 'in.mcap'
    write_bag(path, recording_messages(recording, 'right'))
    return path


def states_of(recording, hand=None, layout=None, timed=True):
    tracker = HandTracker(hand, layout)
    return [tracker.update(markers, time_of(stamp) if timed else None)
            for stamp, markers in zip(recording.stamps.tolist(), recording.markers)]


def time_of(stamp):
    """Return the time of a frame with a stamp, as the node has it."""
    sec, nanosec = divmod(stamp, 10**9)
    return sec + 1e-9 * nanosec


def read_table(path):
    with open(path, newline='', encoding='utf-8') as file:
        header, *rows = csv.reader(file)
    return header, np.array(rows, dtype=float)


def message_of(positions, stamp=7 * 10**9, time=None, frame='mocap', numbers=MARKERS):
    """Return one message of markers as recorded."""
    return bag_message('/markers', stamp if time is None else time,
                       marker_array_message(stamp, frame, numbers, positions))


def run_in_process(*arguments, code=RUN):
    environment = {**os.environ, 'PYTHONPATH': str(REPOSITORY)}
    return subprocess.Popen(
        [sys.executable, '-c', code, 'track', *map(str, arguments)], env=environment,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


# --- what comes out

@pytest.mark.parametrize('wrist', [False, True])
def test_table_holds_what_the_tracker_says_of_the_arrays(recording, bag, wrist, tmp_path, capsys):
    output = tmp_path / 'out.csv'
    assert main([str(bag), '-o', str(output), GIVEN_SIZE] + ['--wrist'] * wrist) == 0
    assert f'{FRAMES} of {FRAMES} frames tracked' in capsys.readouterr().out
    header, table = read_table(output)
    assert header == ['time_s', *(f'right_{joint}_deg' for joint in JOINTS),
                      *(WRIST_COLUMNS if wrist else ())]
    states = states_of(recording)
    seconds = 1e-9 * (recording.stamps - recording.stamps[0])
    assert np.allclose(table[:, 0], seconds, rtol=0, atol=.6e-6)
    assert np.allclose(table[:, 1:26], np.degrees([state.angles for state in states]),
                       rtol=0, atol=1.01 * HALF_MILLIDEGREE)
    if wrist:
        assert np.allclose(table[:, 26:29], [state.wrist_position for state in states],
                           rtol=0, atol=.6e-6)
        assert np.allclose(Rotation.from_quat(table[:, 29:]).as_matrix(),
                           [state.wrist_rotation for state in states], rtol=0, atol=4e-6)
    assert list(tmp_path.iterdir()) == [output]


def test_a_table_tells_how_well_each_angle_is_known(recording, bag, tmp_path, capsys):
    output = tmp_path / 'out.csv'
    assert main([str(bag), '-o', str(output), GIVEN_SIZE, '--wrist', '--quality']) == 0
    header, table = read_table(output)
    assert header[33:] == [*(f'right_{joint}_sd_deg' for joint in JOINTS),
                           *(f'right_{marker}_residual_mm' for marker in MARKERS)]
    states = states_of(recording)
    residuals = np.array([state.residuals for state in states])
    assert np.isnan(residuals).any() and np.isfinite(residuals).any()
    assert np.allclose(table[:, 33:58], np.degrees([state.deviation for state in states]),
                       rtol=0, atol=1.01 * HALF_MILLIDEGREE)
    assert np.allclose(table[:, 58:], 1e3 * residuals, rtol=0, atol=6e-4, equal_nan=True)
    capsys.readouterr()
    assert main([str(bag), '-o', str(tmp_path / 'out.mcap'), '--quality']) == 1
    assert '--quality adds columns to a table; expected a name with .csv' in (
        capsys.readouterr().err)


def test_both_hands_of_a_recording_are_tracked_as_each_alone(tmp_path, capsys):
    recordings = {side: part._replace(stamps=part.stamps[:60], markers=part.markers[850:910],
                                      angles=part.angles[850:910])
                  for side, part in packaged_recordings('both').items()}
    recordings['left'].markers[20:30] = np.nan  # not in the messages at all
    write_bag(tmp_path / 'in.mcap', both_hands_messages(recordings))
    arguments = [str(tmp_path / 'in.mcap'), '--side', 'both', '--wrist', GIVEN_SIZE, '-o']
    assert main([*arguments, str(tmp_path / 'quality.csv'), '--quality']) == 0
    columns, quality = read_table(tmp_path / 'quality.csv')
    left = columns.index('left_index_cmc_flexion_sd_deg')
    assert [columns[left - 1], columns[-1]] == [
        f'{side}_thumb_residual_mm' for side in ('right', 'left')]
    assert np.isnan(quality[20:30, left:]).all() and np.isfinite(quality[20:30, left - 33]).all()
    capsys.readouterr()
    assert main([*arguments, str(tmp_path / 'out.csv')]) == 0
    said = capsys.readouterr().out
    # The right hand's palm is there in each.
    assert '60 of 60 frames tracked' in said and 'palm' not in said
    header, table = read_table(tmp_path / 'out.csv')
    assert header == ['time_s', *(f'{side}_{joint}_deg' for side in SIDES for joint in JOINTS),
                      *(f'{side}_{column}' for side in SIDES for column in WRIST_COLUMNS)]
    expected, seen = {}, {}
    for side, part in recordings.items():
        tracker = HandTracker(Hand.scaled(side=side))
        seen[side] = np.isfinite(part.markers).any(axis=(1, 2))
        expected[side] = [tracker.update(markers, time_of(stamp)) for stamp, markers in zip(
            part.stamps[seen[side]].tolist(), part.markers[seen[side]])]
    for number, side in enumerate(SIDES):
        columns = table[:, 1 + 25 * number:26 + 25 * number]
        assert np.array_equal(np.isfinite(columns).all(axis=1), seen[side])
        assert np.allclose(columns[seen[side]], np.degrees(
            [state.angles for state in expected[side]]), rtol=0, atol=1.01 * HALF_MILLIDEGREE)
        places = table[seen[side], 51 + 7 * number:54 + 7 * number]
        assert np.allclose(places, [state.wrist_position for state in expected[side]], rtol=0,
                           atol=.6e-6)
    assert main([*arguments, str(tmp_path / 'out.mcap')]) == 0
    with open_bag(tmp_path / 'out.mcap') as bag:
        states = [TYPE_STORE.deserialize_cdr(message.data, message.type)
                  for message in bag.messages(['/joint_states'])]
        transforms = [TYPE_STORE.deserialize_cdr(message.data, message.type).transforms
                      for message in bag.messages(['/tf'])]
    assert [len(state.name) for state in states] == [25 + 25 * bool(left) for left in seen['left']]
    assert np.array_equal(states[0].position, np.concatenate(
        [expected[side][0].angles for side in SIDES]))
    assert [[sent.child_frame_id for sent in sent_together] for sent_together in transforms] == [
        ['right_wrist', 'left_wrist'][:1 + bool(left)] for left in seen['left']]
    # The same hands as joint centres and as skeletons.
    centres = tmp_path / 'out.c3d', tmp_path / 'out.trc'
    for path in centres:
        assert main([*arguments, str(path)]) == 0
        found = read_recording(path)
        for side, states in expected.items():
            wrist = found.points[:, found.labels.index(f'{side}_wrist')]
            assert np.array_equal(np.isfinite(wrist).all(axis=1), seen[side])
            assert np.allclose(wrist[seen[side]], [state.wrist_position for state in states],
                               rtol=0, atol=1e-5)
    bvh, glb = tmp_path / 'out.bvh', tmp_path / 'out.glb'
    assert main([*arguments, str(bvh), '--names', 'mixamo', '--order', 'XYZ']) == 0
    found = read_recording(bvh)
    for side, states in expected.items():
        wrist = found.points[:, found.labels.index(f'mixamorig:{side.title()}Hand')]
        assert np.allclose(.01 * wrist[seen[side]], [state.wrist_position for state in states],
                           rtol=0, atol=1e-5)
    assert main([*arguments, str(glb), '--names', 'mixamo']) == 0
    assert b'mixamorig:LeftHandThumb3' in glb.read_bytes()


def test_each_of_both_hands_may_have_a_hand_file(tmp_path, capsys):
    recordings = {side: part._replace(stamps=part.stamps[:60], markers=part.markers[:60],
                                      angles=part.angles[:60])
                  for side, part in packaged_recordings('both').items()}
    write_bag(tmp_path / 'in.mcap', both_hands_messages(recordings))
    files = {side: str(tmp_path / f'{side}.yaml') for side in SIDES}
    for side, length in zip(SIDES, (.18, .2)):
        save_hand(files[side], Hand.scaled(length, side=side), MarkerLayout())

    def angles(name, *words):
        assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / name), *words]) == 0
        return read_table(tmp_path / name)[1][:, 1:]

    both = angles('both.csv', '--side', 'both', '--hand', files['right'], '--left-hand',
                  files['left'])
    assert 'mirror' not in capsys.readouterr().err
    for number, side in enumerate(SIDES):
        alone = angles('one.csv', '--hand', files[side], *(
            word for row, marker in enumerate(MARKERS)
            for word in ('--label', f'{marker}={side}/{row}')))
        assert np.array_equal(both[:, 25 * number:][:, :25], alone)
        capsys.readouterr()
        assert np.array_equal(alone, angles('one.csv', '--hand', files[side]))
        other = SIDES[1 - number]
        assert f"markers of namespace '{other}' are left out, as the {other} hand's" in (
            capsys.readouterr().err)
    assert not np.array_equal(both[:, 25:], angles(
        'mirrored.csv', '--side', 'both', '--hand', files['right'])[:, 25:])
    assert 'right.yaml is of a right hand: its mirror image is taken for the left one' in (
        capsys.readouterr().err)
    for words in (('--side', 'both'), ('--hand', files['right'])):
        assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'no.csv'), '--left-hand',
                     files['left'], *words]) == 1
        assert 'expected with --side both, and --hand for the right hand' in (
            capsys.readouterr().err)
    layout = preset_layout('tips5_palm3')
    save_hand(files['left'], Hand.scaled(side='left'), layout)
    assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'no.csv'), '--side', 'both',
                 '--hand', files['right'], '--left-hand', files['left']]) == 1
    assert 'other markers than those of' in capsys.readouterr().err


def test_both_hands_are_found_among_points_without_labels(tmp_path, capsys):
    recordings = {side: part._replace(stamps=part.stamps[:60], markers=part.markers[:60],
                                      angles=part.angles[:60])
                  for side, part in packaged_recordings('both').items()}
    write_bag(tmp_path / 'in.mcap', both_hands_messages(recordings))
    arguments = [str(tmp_path / 'in.mcap'), '--side', 'both', '--wrist', GIVEN_SIZE]
    for labels in ('source', 'none'):
        assert main([*arguments, '--labels', labels, '-o', str(tmp_path / f'{labels}.csv')]) == 0
    assert 'the left hand is found among 16 points' in capsys.readouterr().err
    assert (tmp_path / 'none.csv').read_bytes() == (tmp_path / 'source.csv').read_bytes()


def test_the_size_of_the_hand_is_learned_unless_it_is_given(tmp_path):
    hand = Hand.scaled(.205, .095)
    recording = demo_recording(hand)
    write_bag(tmp_path / 'large.mcap', recording_messages(recording, 'right'))
    pip = 1 + JOINTS.index('index_pip_flexion')

    def error(*more):
        assert main([str(tmp_path / 'large.mcap'), '-o', str(tmp_path / 'out.csv'), *more]) == 0
        _, table = read_table(tmp_path / 'out.csv')
        late = table[:, 0] > 5.5
        return np.abs(table[late, pip] - np.degrees(recording.angles[late, pip - 1])).mean()

    assert error() < 4. < 15. < error(GIVEN_SIZE)


def test_points_without_labels_of_a_hand_whose_size_is_learned_are_told_apart_by_a_usual_one(
        tmp_path, capsys):
    hand, layout = Hand.scaled(), preset_layout('vicon_production5')
    angles, *wrist = motion_named('demo', hand).sample(np.arange(60) / 60.)
    points = markers_of(hand, angles, layout, *wrist)
    np.savez(tmp_path / 'in.npz', markers=points, rate_hz=60.,
             marker_names=[str(row) for row in range(points.shape[1])])
    main([str(tmp_path / 'in.npz'), '-o', str(tmp_path / 'out.csv'), '--labels', 'none',
          '--layout', 'vicon_production5', '--side', 'right'])
    assert 'are told apart by the shape of a usual hand' in capsys.readouterr().err


def test_the_minute_in_which_the_size_is_learned_begins_with_the_hand(tmp_path, capsys):
    recording = demo_recording(Hand.scaled(.205, .095))
    messages = [*recording_messages(recording._replace(
        stamps=recording.stamps[:240], markers=recording.markers[:240],
        angles=recording.angles[:240]), 'right')]
    early = bag_message('/other', messages[0].time - 70 * 10**9,
                        marker_array_message(1, 'mocap', (), np.zeros((0, 3))))
    write_bag(tmp_path / 'in.mcap', (early, *messages))
    assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'out.csv')]) == 0
    said = capsys.readouterr().err
    assert said.index('the size of the hand is learned') < said.index('tracking')


@pytest.mark.parametrize('seconds', [1.5, 3.])
def test_all_frames_have_the_size_that_is_learned(seconds, tmp_path, capsys):
    hand = Hand.scaled(.205, .095)
    recording = demo_recording(hand)
    count = round(seconds * RECORDING_RATE)
    write_bag(tmp_path / 'large.mcap', recording_messages(recording._replace(
        stamps=recording.stamps[:count], markers=recording.markers[:count],
        angles=recording.angles[:count]), 'right'))
    found = []
    for given in ([], ['--no-auto-size']):
        assert main([str(tmp_path / 'large.mcap'), '-o', str(tmp_path / 'out.csv'), *given]) == 0
        _, table = read_table(tmp_path / 'out.csv')
        assert len(table) == count
        error = np.abs(table[:20, 1:] - np.degrees(recording.angles[:20]))
        found.append((error.mean(), 'the size of the hand is learned' in capsys.readouterr().err))
    (learned, is_said), (mean, is_said_of_mean) = found
    assert (is_said, is_said_of_mean) == (True, False) and 2. * learned < mean


@pytest.mark.parametrize('extension', ['.mcap', '.db3'])
def test_recording_holds_the_same_angles_with_the_markers_stamps(
        recording, bag, extension, tmp_path):
    output = tmp_path / f'out{extension}'
    assert main([str(bag), '-o', str(output), '--wrist', GIVEN_SIZE]) == 0
    with open_bag(output) as written:
        assert written.topics == {'/joint_states': 'sensor_msgs/msg/JointState',
                                  '/tf': 'tf2_msgs/msg/TFMessage'}
        messages = [(topic, time, TYPE_STORE.deserialize_cdr(data, kind))
                    for topic, kind, time, data in written.messages()]
    joints = [row for row in messages if row[0] == '/joint_states']
    poses = [row for row in messages if row[0] == '/tf']
    assert [time for _, time, _ in joints] == recording.stamps.tolist()
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
            for _, _, m in joints] == recording.stamps.tolist()
    states = states_of(recording)
    for state, (*_, joint_state), (*_, tf) in zip(states, joints, poses, strict=True):
        assert list(joint_state.name) == [f'right_{joint}' for joint in JOINTS]
        assert np.array_equal(joint_state.position, state.angles)
        transform, = tf.transforms
        assert transform.header.stamp == joint_state.header.stamp
        assert (transform.header.frame_id, transform.child_frame_id) == ('mocap', 'right_wrist')
        at, turn = transform.transform.translation, transform.transform.rotation
        assert np.array_equal((at.x, at.y, at.z), state.wrist_position)
        assert np.allclose(Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix(),
                           state.wrist_rotation, rtol=0, atol=1e-14)


@pytest.mark.parametrize('name', ['OUT.CSV', 'OUT.MCAP', 'OUT.BVH', 'OUT.TRC'])
def test_outputs_are_known_by_extensions_in_capitals_too(bag, name, tmp_path):
    (tmp_path / 'small').mkdir()
    usual = tmp_path / 'small' / f'OUT{name[3:].lower()}'
    for output in (tmp_path / name, usual):
        assert main([str(bag), '-o', str(output)]) == 0
    written = (tmp_path / name).read_bytes()
    assert written.replace(name.encode(), usual.name.encode()) == usual.read_bytes()


def test_hand_side_limits_and_coupling_are_those_asked_for(recording, bag, tmp_path):
    hand, layout = Hand.scaled(length=.2, breadth=.09), MarkerLayout()
    save_hand(tmp_path / 'hand.yaml', hand, layout)
    mirrored = recording._replace(markers=recording.markers * (1., -1., 1.))
    write_bag(tmp_path / 'left.mcap', recording_messages(mirrored, 'left'))
    assert main([str(tmp_path / 'left.mcap'), '-o', str(tmp_path / 'out.csv'), '--side', 'left',
                 '--limits', 'wide', '--coupling', 'paper',
                 '--hand', str(tmp_path / 'hand.yaml')]) == 0
    header, table = read_table(tmp_path / 'out.csv')
    assert header[1].startswith('left_')
    asked = hand.replace(
        side='left', limits=preset_limits('wide'), coupling=preset_coupling('paper'))
    states = states_of(mirrored, asked, layout)
    assert np.allclose(table[:, 1:], np.degrees([state.angles for state in states]),
                       rtol=0, atol=1.01 * HALF_MILLIDEGREE)


def test_topic_frame_labels_and_units_are_those_asked_for(recording, tmp_path):
    positions = 1000. * recording.markers
    others = [f'other{i}' for i in range(10)]

    def messages():
        for stamp, markers in zip(recording.stamps.tolist(), positions):
            # Ids 2 to 9, and a second set of markers in another frame.
            both = marker_array_message(stamp, 'mocap', others, np.vstack(
                (np.full((2, 3), np.nan), markers)))
            both.markers += marker_array_message(stamp, 'base', others, np.ones((10, 3))).markers
            yield bag_message('/a/markers', stamp, both)
            yield bag_message('/b/markers', stamp, marker_array_message(
                stamp, 'mocap', others, np.zeros((10, 3))))

    write_bag(tmp_path / 'in.mcap', messages())
    labels = [word for i, marker in enumerate(MARKERS)
              for word in ('--label', f'{marker}=hand/{i + 2}')]
    assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'out.csv'), *labels, '--topic',
                 'a/markers', '--frame', 'mocap', '--unit-scale', '.001', GIVEN_SIZE]) == 0
    _, table = read_table(tmp_path / 'out.csv')
    assert np.allclose(table[:, 1:], np.degrees([state.angles for state in states_of(recording)]),
                       rtol=0, atol=2. * HALF_MILLIDEGREE)


# --- the node's rules

def test_constants_are_those_of_the_message():
    marker = TYPE_STORE.types['visualization_msgs/msg/Marker']
    for name in ('ADD', 'CUBE', 'SPHERE', 'CYLINDER', 'CUBE_LIST', 'SPHERE_LIST', 'POINTS'):
        assert getattr(marker_array, name) == getattr(marker, name)


def test_nothing_comes_out_before_the_palm_was_seen_and_of_other_markers(recording):
    whole = recording.markers[0]
    palmless = whole.copy()
    palmless[0] = np.nan
    lost = palmless.copy()
    lost[:3] = 0.
    messages = [
        message_of(palmless, STAMP_STEP), message_of(whole, 2 * STAMP_STEP),
        message_of(np.vstack((np.full((8, 3), np.nan), whole)), 3 * STAMP_STEP,
                   numbers=['x'] * 16),
        message_of(palmless, 4 * STAMP_STEP), message_of(lost, 5 * STAMP_STEP)]
    frames = list(track(messages, HandTracker()))
    assert [frame.stamp for frame in frames] == [n * STAMP_STEP for n in (2, 4, 5)]
    tracker = HandTracker()
    lost[:3] = np.nan
    for frame, markers in zip(frames, (whole, palmless, lost)):
        expected = tracker.update(markers, time_of(frame.stamp))
        assert np.array_equal(frame.state.angles, expected.angles)
        assert frame.state.palm is expected.palm


def test_a_marker_at_zero_is_lost_unless_it_is_to_be_kept(recording):
    markers = recording.markers[0].copy()
    markers[7] = 0.
    message = message_of(markers)
    lost, = track([message], HandTracker())
    kept, = track([message], HandTracker(), MarkerReading(zero_is_missing=False))
    assert np.isnan(lost.state.residuals[7])
    assert np.isfinite(kept.state.residuals[7])


def test_markers_without_stamp_and_frame_get_those_of_the_node(recording):
    frame, = track([message_of(recording.markers[0], stamp=0, time=99, frame='')], HandTracker())
    assert (frame.time, frame.stamp, frame.frame_id) == (99, 99, 'world')


@pytest.mark.parametrize('stamped', [True, False])
def test_time_is_that_of_the_stamps_else_of_the_recording(recording, stamped):
    whole = recording.markers[0]
    hidden = whole.copy()
    hidden[4] = np.nan
    times = (10**9, 1_100_000_000, 1_500_000_000, 1_500_000_000)
    frames = list(track((message_of(markers, time if stamped else 0, 7 if stamped else time)
                         for time, markers in zip(times, (whole, hidden, hidden, hidden))),
                        HandTracker()))
    assert [frame.stamp for frame in frames] == list(times)
    assert np.allclose([frame.state.hidden_for[4] for frame in frames], (0., .1, .5, .5))


def test_all_begins_anew_where_the_stamps_jump_back(recording):
    whole = recording.markers[0]
    palmless = whole.copy()
    palmless[0] = np.nan
    # The first that is earlier may be a stray one.
    messages = [message_of(whole, 9 * 10**9), message_of(palmless, 10**9),
                message_of(palmless, 11 * 10**8), message_of(whole, 2 * 10**9)]
    monitor = Monitor(0., '/markers', LabelMap())
    frames = list(track(messages, HandTracker(), monitor=monitor))
    assert [frame.stamp for frame in frames] == [9 * 10**9, 10**9, 2 * 10**9]
    said = [line for _, line in monitor.log_lines(1., str) if 'jumped back' in line]
    assert len(said) == 1


def test_points_of_a_list_count(recording):
    message = marker_array_message(1, 'mocap', MARKERS, recording.markers[0])
    cloud = message.markers[0]
    cloud.points = [marker.pose.position for marker in message.markers]
    point = TYPE_STORE.types['geometry_msgs/msg/Point']
    cloud.type, cloud.pose.position = cloud.POINTS, point(0., 0., 0.)
    message.markers = [cloud]
    frame, = track([bag_message('/markers', 1, message)], HandTracker())
    expected = HandTracker().update(recording.markers[0])
    assert np.array_equal(frame.state.angles, expected.angles)


def test_frames_stream(recording):
    taken = count()
    endless = (message_of(recording.markers[next(taken) % FRAMES]) for _ in iter(int, 1))
    assert len(list(islice(track(endless, HandTracker()), 5))) == 5
    assert next(taken) == 5


def test_memory_stays_flat():
    with TemporaryDirectory() as folder:
        short, long = (row['peak_mb'] for seconds in (5., 100.)
                       for row in measure_one(30., seconds, folder, ['csv']))
    # Twenty times the frames; what is kept of each would be 1 kB and more.
    assert long < short + 5.


def test_needs_no_ros(bag, tmp_path):
    blocked = f'''
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {ROS}:
            raise ModuleNotFoundError('blocked: ' + name)
sys.meta_path.insert(0, Blocked())
for name in list(sys.modules):
    if name.split('.')[0] in {ROS}:
        del sys.modules[name]
''' + RUN
    for output in (tmp_path / 'out.csv', tmp_path / 'out.mcap'):
        process = run_in_process(bag, '-o', output, code=blocked)
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors
        assert output.stat().st_size


def test_the_lines_of_the_readme_do_the_same(recording, tmp_path, monkeypatch):
    text = (REPOSITORY / 'README.md').read_text(encoding='utf-8')
    code, = (block for block in re.findall(r'```python\n(.*?)```', text, re.DOTALL)
             if 'markers.npy' in block)
    assert len([line for line in code.splitlines() if line]) <= 10
    monkeypatch.chdir(tmp_path)
    np.save('markers.npy', recording.markers)
    names = {}
    exec(code, names)
    hand = Hand.scaled(length=.19, breadth=.09)
    states = states_of(recording, hand, timed=False)
    assert np.array_equal(names['angles'], [state.angles for state in states])
    assert names['links'].shape == (FRAMES, 25, 3)
    written = np.loadtxt('angles.csv', delimiter=',')
    assert np.allclose(written, np.degrees(names['angles']), rtol=0, atol=1e-9)


def test_says_at_the_end_which_label_never_came(bag, tmp_path, capsys):
    assert main([str(bag), '-o', str(tmp_path / 'out.csv'), '--label', 'thumb=leds/9']) == 0
    said = capsys.readouterr().err
    assert said.count("never seen so far: 'leds/9' (thumb); there are 'hand/7'") == 1


# --- what goes wrong

def joint_states_only(path):
    write_bag(path, [bag_message('/joint_states', 1, joint_state_message(1, ['a'], [0.]))])


def two_topics(path):
    message = marker_array_message(1, 'mocap', MARKERS, np.ones((8, 3)))
    write_bag(path, [bag_message(topic, 1, message) for topic in ('/left', '/right')])


def no_palm(path):
    write_bag(path, [message_of(np.vstack((np.full((3, 3), np.nan), np.ones((5, 3)))))])


def no_hand(path):
    write_bag(path, [message_of(np.vstack((np.full((8, 3), np.nan), np.ones((1, 3)))),
                                numbers=['x'] * 9)])


@pytest.mark.parametrize('seen, is_said', [(29, True), (31, False)])
def test_the_end_says_where_few_frames_show_the_palm(seen, is_said, tmp_path, capsys):
    recording = demo_recording()
    markers = recording.markers[:60].copy()
    markers[seen:, :3] = np.nan
    write_bag(tmp_path / 'in.mcap', recording_messages(recording._replace(
        stamps=recording.stamps[:60], markers=markers, angles=recording.angles[:60]), 'right'))
    assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'out.csv'), GIVEN_SIZE]) == 0
    said = capsys.readouterr()
    assert '60 of 60 frames tracked' in said.out    # the last pose is kept
    assert f'tracked, {60 - seen} of them show no palm' in said.out
    assert (f'only {seen} of 60 frames show the palm' in said.err) == is_said


@pytest.mark.parametrize('first, is_said', [(5, False), (20, True)])
def test_the_end_says_how_much_is_left_out(first, is_said, tmp_path, capsys):
    recording = demo_recording()
    markers = recording.markers[:60].copy()
    markers[:first, :3] = np.nan
    write_bag(tmp_path / 'in.mcap', recording_messages(recording._replace(
        stamps=recording.stamps[:60], markers=markers, angles=recording.angles[:60]), 'right'))
    assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'out.csv'), GIVEN_SIZE]) == 0
    assert ('20 of 60 frames (33%) are left out: no hand is found in most' in (
        capsys.readouterr().err)) == is_said


def test_limits_of_a_wearer_whose_motion_is_not_known_are_told(tmp_path, capsys):
    ranged = tmp_path / 'my.yaml'
    save_hand(ranged, Hand.scaled().replace(range_of_motion=preset_limits('paper')),
              MarkerLayout())
    for given, is_told in (((GIVEN_SIZE,), True), (('--hand', str(ranged)), False)):
        assert main([str(packaged_recording()), '-o', str(tmp_path / 'out.csv'), '--limits',
                     'wearer', *given]) == 0
        assert ("limits 'wearer' are Table 1 of the paper" in capsys.readouterr().err) is is_told


def test_the_end_says_where_the_hand_does_not_fit_the_markers(tmp_path, capsys):
    recording = demo_recording()
    markers = np.repeat(recording.markers[:1], 720, axis=0)
    # Farther than the fingers reach.
    markers[:, 3:] += .04 * unit_vectors(markers[:, 1:2] - markers[:, :1])
    write_bag(tmp_path / 'in.mcap', recording_messages(recording._replace(
        stamps=recording.stamps[:720], markers=markers, angles=recording.angles[:720]), 'right'))
    assert main([str(tmp_path / 'in.mcap'), '-o', str(tmp_path / 'out.csv'), GIVEN_SIZE]) == 0
    said = capsys.readouterr().err
    assert 'of 720 frames the hand is left out, as it does not fit the markers' in said
    assert 'show the palm' not in said


def hand_at_rest(path):
    write_bag(path, [message_of(demo_recording(rate=1.).markers[0] + (.1, 0., 0.))])


def damaged(path):
    write_bag(path, [BagMessage('/markers', MARKER_ARRAY, 5, b'\0\1\0\0\7\0\0\0')])


def cut_off(path):
    write_bag(path, [message_of(np.ones((8, 3)))])
    path.write_bytes(path.read_bytes()[:-100])


@pytest.mark.parametrize('make, arguments, said', [
    (None, (), 'in.mcap: no such file or folder'),
    (joint_states_only, (), r'in.mcap: no topic of visualization_msgs/msg/MarkerArray or .*; '
     r'it has /joint_states \(sensor_msgs'),
    (two_topics, (), r'choose one \(--topic\): /left \(visual.*, /right \('),
    (two_topics, ('--topic', '/up'), r'no topic /up of .*; it has /left \(visual'),
    (no_palm, (), r"no frame of /markers shows the palm: .* not seen yet '0' \(wrist\)"),
    (no_hand, (), r"the palm: expected are the labels '0' \(wrist\).*; there are 'hand/8'"),
    (hand_at_rest, ('--unit-scale', '.001'), 'the palm: .* too close together .* --unit-scale'),
    (hand_at_rest, ('--units', 'mm'), 'the palm: .* too close together .* --unit-scale'),
    (hand_at_rest, ('--unit-scale', '10'), 'shows the palm: .* too far apart .* --unit-scale'),
    (hand_at_rest, ('--unit-scale', '1e5'), 'shows the palm: .* a kilometre away; .* --unit-scale'),
    (hand_at_rest, ('--up=-y',), r'in.mcap: --up: -y; expected for files of points only: Marker'),
    (hand_at_rest, ('--handed', 'left'), r'in.mcap: --handed: left; expected for files of points'),
    (hand_at_rest, ('--frame-rate', '60'), r'in.mcap: --frame-rate: 60.0; expected for files of'),
    (hand_at_rest, ('--subject', 'Ann'), r'in.mcap: --subject: Ann; expected for files of points'),
    (damaged, (), '/markers: the message of 5 ns is no whole visualization_msgs/msg/MarkerArray'),
    (cut_off, (), 'in.mcap: cannot be read'),
    (two_topics, ('--label', 'nose=3'), "label: 'nose=3'; expected MARKER=LABEL, .* wrist, "),
    (two_topics, ('--label', 'index=x'), "labels.index: 'x'; expected an id"),
    (two_topics, ('--hand', 'absent.yaml'), 'absent.yaml: No such file'),
    (two_topics, ('-o', 'out.txt'), "unknown extension '.txt'; expected .csv, .mcap, .db3"),
    (two_topics, ('--names', 'unity'), 'out.(csv|mcap): --names: unity; expected for outputs .bvh'),
    (two_topics, ('--order', 'XYZ'), '--order: XYZ; expected for outputs .bvh only'),
    (two_topics, ('-o', 'w.glb', '--order', 'XYZ'), 'w.glb: --order: XYZ; expected for outputs'),
    (two_topics, ('-o', 'w.trc', '--names', 'xsens'), '--names: xsens; .* outputs .bvh, .glb only'),
    (two_topics, ('-o', 'w', '--format', 'glb', '--order', 'ZXY'), 'w: --order: ZXY; expected for'),
    (two_topics, ('-o', 'w', '--format', 'csv', '--names', 'unity'), 'w: --names: unity; expected'),
    (two_topics, ('-o', 'in.mcap'), 'in.mcap: would replace the recording'),
    (two_topics, ('--topic', 'left', '-o', 'absent/out.csv'), 'no folder absent'),
    (two_topics, ('--topic', 'left', '-o', 'absent/out.mcap'), 'no folder absent')])
def test_says_what_is_wrong_and_writes_nothing(
        make, arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    if make:
        make(tmp_path / 'in.mcap')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for output in ('out.csv', 'out.mcap'):
        assert main(['in.mcap', '-o', output, *arguments]) == 1
        assert re.search(said, capsys.readouterr().err)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize('arguments, said', [
    (('-o', 'a.csv'), 'required: IN'),
    (('in.mcap',), 'required: -o'),
    (('in.mcap', '-o', 'a.csv', '--side', 'up'), "--side: invalid choice: 'up'"),
    (('in.mcap', '-o', 'a.csv', '--unit-scale', '0'), "'0'; expected a positive number"),
    (('in.mcap', '-o', 'a.csv', '--unit-scale', 'nan'), "'nan'; expected a positive number"),
    (('in.mcap', '-o', 'a.csv', '--unit-scale', 'mm'), "'mm'; expected a positive number")])
def test_refuses_a_wrong_command_line(arguments, said, capsys):
    with pytest.raises(SystemExit, match='2'):
        main(arguments)
    assert said in capsys.readouterr().err


def test_damage_in_the_middle_is_an_error(recording):
    whole = message_of(recording.markers[0])
    frames = track([whole, whole._replace(data=whole.data[:60])], HandTracker())
    next(frames)
    with pytest.raises(BagError, match='is no whole'):
        next(frames)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', ['out.csv', 'out.mcap'])
def test_an_interruption_leaves_what_was_there(bag, name, number, tmp_path):
    with open_bag(bag) as source:
        frames = list(source.messages(['/markers']))
    span = frames[-1].time - frames[0].time + 10**7
    (tmp_path / 'in').mkdir()
    write_bag(tmp_path / 'in' / 'long.mcap', (
        frame._replace(time=frame.time + turn * span) for turn in range(300) for frame in frames))
    folder = tmp_path / 'out'
    folder.mkdir()
    output = folder / name
    output.write_bytes(b'of yesterday')
    process = run_in_process(tmp_path / 'in' / 'long.mcap', '-o', output)
    try:
        until = time.monotonic() + PATIENCE
        # Until frames are written to the unfinished file, in a folder beside.
        while not any(one.is_file() and one.stat().st_size for one in folder.rglob('*')
                      if one != output) and process.poll() is None:
            assert time.monotonic() < until
            time.sleep(.01)
        process.send_signal(number)
        _, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert 'interrupted; no unfinished file is left' in errors
    assert 'Traceback' not in errors
    assert list(folder.iterdir()) == [output]
    assert output.read_bytes() == b'of yesterday'


# --- several recordings

@pytest.mark.parametrize('jobs', [1, 2])
def test_several_recordings_become_the_files_of_a_folder(bag, jobs, tmp_path, capsys):
    (tmp_path / 'in').mkdir()
    names = 'one', 'two', 'three'
    recordings = [tmp_path / 'in' / f'{name}.mcap' for name in names]
    for recording in recordings:
        recording.write_bytes(bag.read_bytes())
    main([str(bag), '-o', str(tmp_path / 'alone.csv')])
    capsys.readouterr()
    folder = tmp_path / 'new' / 'out'
    assert main([*map(str, recordings), '-o', str(folder), '--jobs', str(jobs)]) == 0
    said, lines = capsys.readouterr()
    assert said.endswith(f'\n{folder}: 3 recordings tracked\n')
    assert [line.split()[:3] for line in said.splitlines()[1:4]] == [
        [name, str(FRAMES), '100.0'] for name in names]
    assert f'three.mcap: {folder / "three.csv"}: {FRAMES} of {FRAMES} frames tracked' in lines
    assert {path.name for path in folder.iterdir()} == {f'{name}.csv' for name in names}
    for path in folder.iterdir():
        assert path.read_bytes() == (tmp_path / 'alone.csv').read_bytes()


def test_the_table_of_a_folder_says_residuals_and_what_begins_late(bag, tmp_path, capsys):
    folder = tmp_path / 'in'
    folder.mkdir()
    recording = demo_recording()
    markers = recording.markers[:60].copy()
    markers[:6, :3] = np.nan
    stamps = recording.stamps[:60]
    write_bag(folder / 'late.mcap', recording_messages(recording._replace(
        stamps=stamps, markers=markers, angles=recording.angles[:60]), 'right'))
    (folder / 'whole.mcap').write_bytes(bag.read_bytes())
    given = [str(folder), '-o', str(tmp_path / 'out'), '--format', 'bvh']
    save_hand(tmp_path / 'large.yaml', Hand.scaled(.22, .1), MarkerLayout())
    assert main([*given, '--hand', str(tmp_path / 'large.yaml')]) == 0
    head, late, whole, _ = capsys.readouterr().out.splitlines()
    where = head.index('residual mm'), head.index('frames/s')
    far = [float(line[slice(*where)]) for line in (late, whole)]
    assert late.endswith(f'late.bvh, begins {1e-9 * (stamps[6] - stamps[0]):.2f} s late')
    assert whole.endswith('whole.bvh')
    assert main(given) == 0
    near = [float(line[slice(*where)]) for line in capsys.readouterr().out.splitlines()[1:3]]
    assert 0. < min(near) and max(near) < 3. < min(far)


def test_what_is_wrong_with_one_recording_leaves_the_others_alone(bag, tmp_path, capsys):
    cut_off(tmp_path / 'bad.mcap')
    (tmp_path / 'good.mcap').write_bytes(bag.read_bytes())
    recordings = [str(tmp_path / f'{name}.mcap') for name in ('bad', 'absent', 'good')]
    assert main([*recordings, '-o', str(tmp_path / 'out'), '--format', 'db3']) == 1
    lines = capsys.readouterr().err
    assert 'only 1 of 3 recordings tracked' in lines
    assert 'bad.mcap: cannot be read' in lines and lines.count('bad.mcap') == 1
    assert 'absent.mcap: no such file' in lines
    assert [path.name for path in (tmp_path / 'out').iterdir()] == ['good.db3']


def test_a_folder_of_recordings_is_resumed_where_it_stopped(bag, tmp_path, capsys):
    (tmp_path / 'in').mkdir()
    for name in ('one', 'two'):
        (tmp_path / 'in' / f'{name}.mcap').write_bytes(bag.read_bytes())
    (tmp_path / 'in' / 'notes.txt').write_text('no recording')
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'one.csv').write_text('of yesterday')
    assert main([str(tmp_path / 'in'), '-o', str(tmp_path / 'out'), '--resume']) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[1].split() == ['one', 'already', 'there'] and 'two.csv' in table[2]
    assert (tmp_path / 'out' / 'one.csv').read_text() == 'of yesterday'
    assert (tmp_path / 'out' / 'two.csv').stat().st_size > 1000
    assert main([str(tmp_path / 'out'), '-o', str(tmp_path / 'further')]) == 1
    capsys.readouterr()
    assert main([str(bag), '-o', str(tmp_path / 'one.csv'), '--resume']) == 1
    assert 'fill a folder' in capsys.readouterr().err


def test_resuming_with_other_options_tracks_again(bag, tmp_path, capsys):
    folder, hand = tmp_path / 'out', tmp_path / 'my_hand.yaml'
    save_hand(hand, Hand.scaled(.2), MarkerLayout())
    command = [str(bag), '--format', 'csv', '-o', str(folder), '--resume']

    def run(*options):
        assert main([*command, *options]) == 0
        said = capsys.readouterr()
        return 'already there' in said.out, said.err, (folder / 'in.csv').read_bytes()

    is_kept, said, first = run()
    assert not is_kept and 'options' not in said
    assert run() == (True, '', first)
    is_kept, said, second = run('--hand', str(hand))
    assert not is_kept and second != first
    assert (f'{folder}: made with other options (--hand: not given, now {hand}): tracked again'
            in said)
    assert run('--hand', str(hand)) == (True, '', second)
    said = run('--hand', str(hand), '--quality', '--label', 'thumb=7')[1]
    assert '(--label: not given, now thumb=7; --quality: not given, now given)' in said
    assert run('--hand', str(hand))[1].count('now not given') == 2
    second = (folder / 'in.csv').read_bytes()
    later = (folder / 'in.csv').stat().st_mtime + 1.
    os.utime(hand, (later, later))
    assert not run('--hand', str(hand))[0]
    # Without --resume, too, another run leaves its options.
    os.utime(hand, (0., 0.))
    assert main([*command[:-1]]) == 0
    capsys.readouterr()
    assert run() == (True, '', first)
    (folder / 'track_options.json').unlink()
    is_kept, said, _ = run('--side', 'right')
    assert is_kept and 'with which options the files in it were made is not known' in said
    # It stays unknown, and is said again, until the folder is begun anew.
    assert run('--side', 'right')[:2] == (True, said)
    assert not (folder / 'track_options.json').exists()


def test_recordings_of_one_name_are_refused(bag, tmp_path, capsys):
    other = tmp_path / 'other' / bag.name
    assert main([str(bag), str(other), '-o', str(tmp_path / 'out')]) == 1
    assert f'in.mcap.csv: would be written for {bag} and {other}; expected different names' in (
        capsys.readouterr().err)
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('arguments', [('more.mcap',), ('--format', 'mcap')])
def test_a_folder_with_the_name_of_a_file_is_refused(bag, arguments, tmp_path, capsys):
    output = tmp_path / 'many.csv'
    assert main([str(bag), *arguments, '-o', str(output)]) == 1
    assert 'many.csv: several recordings, or --format, fill a folder' in capsys.readouterr().err
    assert not output.exists()


def test_an_interruption_of_several_leaves_whole_files_alone(bag, tmp_path):
    with open_bag(bag) as source:
        frames = list(source.messages(['/markers']))
    span = frames[-1].time - frames[0].time + 10**7
    write_bag(tmp_path / 'long.mcap', (
        frame._replace(time=frame.time + turn * span) for turn in range(300) for frame in frames))
    (tmp_path / 'longer.mcap').write_bytes((tmp_path / 'long.mcap').read_bytes())
    folder = tmp_path / 'out'
    process = run_in_process(tmp_path / 'long.mcap', tmp_path / 'longer.mcap', bag,
                             '-o', folder, '--jobs', 2)
    try:
        until = time.monotonic() + PATIENCE
        while len(list(folder.glob('*'))) < 2 and process.poll() is None:
            assert time.monotonic() < until
            time.sleep(.01)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert 'Traceback' not in errors
    assert not [path for path in folder.iterdir() if path.suffix != '.csv']
    assert not (folder / 'long.csv').exists()


# --- progress

class Terminal(io.StringIO):
    """A stream that says it is one."""

    def isatty(self):
        return True


def test_bar_on_a_terminal():
    stream = Terminal()
    progress = Progress(4, 'frames', stream)
    for item in progress.over(range(4)):
        if item == 1:
            progress.say('half')
    assert '\r\x1b[Khalf\n' in stream.getvalue()
    last = stream.getvalue().splitlines()[-1]
    assert f'[{"#" * 24}] 100 %  4 of 4 frames' in last
    assert last.endswith('0:00 left')


def test_quick_work_says_nothing_elsewhere():
    stream = io.StringIO()
    assert list(Progress(4, 'frames', stream).over(range(4))) == [0, 1, 2, 3]
    assert not stream.getvalue()


def test_a_single_long_piece_does_not_fall_silent(monkeypatch):
    monkeypatch.setattr('hand_tracker.progress.PROGRESS_LOG_PERIOD', .02)
    stream = io.StringIO()
    for piece in Progress(2, 'motions', stream).over(range(2)):
        until = time.monotonic() + PATIENCE
        while stream.getvalue().count(f'{piece} of 2 motions') < 3:
            assert time.monotonic() < until
            time.sleep(.01)
    lines = stream.getvalue().splitlines()
    assert '0 %  0 of 2 motions' in lines[0] and '50 %  1 of 2 motions' in lines[-1]
