"""`hand_tracker simulate` writes recordings; the node of that name publishes them live."""

import csv
import os
import re
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.repository import REPOSITORY
from hand_tracker.__main__ import main as hand_tracker
from hand_tracker.cli.simulate import main
from hand_tracker.core.errors import InvalidLayout
from hand_tracker.core.model.hand import FINGERS, JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.bags import JOINT_STATE, MARKER_ARRAY, POSE, TYPE_STORE, open_bag
from hand_tracker.files.hand_file import load_hand, save_hand
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap, default_labels
from hand_tracker.simulation import layers
from hand_tracker.simulation.cameras import CameraRig
from hand_tracker.simulation.faults import Faults
from hand_tracker.simulation.motion import minimum_jerk
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.simulator import (
    COUPLING_OFFSET_ERROR,
    COUPLING_SLOPE_ERROR,
    LENGTH_ERROR,
    OFFSET_ERROR,
    InvalidRate,
    Simulation,
    calibrated,
    frame_messages,
    simulated_hand,
)
from hand_tracker.simulation.visibility import markers_inside, skin_layout

HAND = Hand.scaled()
LAYOUT = skin_layout(HAND)


def short(**fields):
    return Simulation('piano', **{'rate': 120., 'duration': 2., **fields})


def test_truth_and_markers_belong_together():
    simulation = short()
    recording = simulation.recording()
    assert len(recording.stamps) == len(recording.markers) == len(recording.angles) >= 241
    assert set(np.diff(recording.stamps)) <= {8333333, 8333334}
    # Fingertips' distances in the hand do not depend on the wrist's pose.
    pose = forward(joint_table(HAND), recording.angles)
    true = marker_positions(LAYOUT.mounting(HAND), pose)
    gaps = [np.linalg.norm(markers[:, 3] - markers[:, 4], axis=1)
            for markers in (recording.markers, true)]
    error = gaps[0] - gaps[1]
    assert np.nanstd(error) < .0005
    assert abs(np.nanmean(error)) < .0001


def test_the_same_again_for_the_same_seed_and_in_parts():
    one, same, other = (short(seed=seed, faults=Faults(1., 1., 1.)).recording()
                        for seed in (1, 1, 2))
    for a, b in zip(one, same):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one.markers, other.markers, equal_nan=True)
    parts = list(short().blocks())
    assert len(parts) > 3
    assert sum(len(part.stamps) for part in parts) == len(short().recording().stamps)


def test_fewer_cameras_lose_more():
    lost = [np.isnan(short(rig=CameraRig.ring(count)).recording().markers).mean()
            for count in (8, 2)]
    assert lost[1] > lost[0] + .05


def test_a_calibrated_hand_errs_by_what_is_stated_and_nothing_else():
    hands = [calibrated(HAND, LAYOUT, seed) for seed in range(200)]
    errors = np.array([hand.finger_bones / HAND.finger_bones - 1. for hand, _ in hands])
    assert errors.std() == pytest.approx(LENGTH_ERROR, rel=.1)
    assert abs(errors.mean()) < 3. * LENGTH_ERROR / np.sqrt(errors.size)
    offsets = np.array([layout.offsets - LAYOUT.offsets for _, layout in hands])
    assert offsets.std() == pytest.approx(OFFSET_ERROR, rel=.1)
    errors = np.array([hand.coupling for hand, _ in hands])
    slopes = errors[:, :, 0] / HAND.coupling[:, 0]
    assert slopes.std() == pytest.approx(COUPLING_SLOPE_ERROR, rel=.1)
    assert errors[:, :4, 1].std() == pytest.approx(COUPLING_OFFSET_ERROR, rel=.1)
    again, layout = calibrated(HAND, LAYOUT, 7)
    np.testing.assert_array_equal(again.finger_bones, hands[7][0].finger_bones)
    np.testing.assert_array_equal(layout.offsets, hands[7][1].offsets)
    np.testing.assert_array_equal(again.limits, HAND.limits)


def test_the_tracker_follows_what_the_cameras_see():
    recording = short(rate=60.).recording()
    tracker = HandTracker(HAND, LAYOUT)
    states = [tracker.update(markers) for markers in recording.markers]
    assert np.nanmean([state.residuals for state in states]) < .0005
    # Flexion is not asked: a marker on the skin near the bone's height fits two bends.
    abduction = [JOINTS.index(f'{finger}_mcp_abduction') for finger in FINGERS]
    error = np.degrees([state.angles for state in states] - recording.angles)[:, abduction]
    assert np.sqrt(np.mean(error ** 2)) < .5


def test_markers_of_a_hand_file_stay_where_it_has_them(tmp_path):
    hand, layout = simulated_hand()
    np.testing.assert_array_equal(layout.offsets, LAYOUT.offsets)
    own = MarkerLayout(offsets=LAYOUT.offsets + (.001, 0., 0.))
    save_hand(tmp_path / 'own.yaml', HAND, own)
    hand, layout = simulated_hand(tmp_path / 'own.yaml', 'left')
    np.testing.assert_allclose(layout.offsets, own.offsets, atol=1e-12)
    assert hand.side == 'left'


def test_markers_without_an_offset_are_put_on_the_skin_and_none_may_be_inside(tmp_path):
    offsets = np.zeros((8, 3))
    offsets[0] = .001, 0., .02
    save_hand(tmp_path / 'own.yaml', HAND, MarkerLayout(offsets=offsets))
    _, layout = simulated_hand(tmp_path / 'own.yaml')
    np.testing.assert_allclose(layout.offsets[0], offsets[0], atol=1e-12)
    np.testing.assert_allclose(layout.offsets[1:], LAYOUT.offsets[1:], atol=1e-12)
    offsets[4] = 0., 0., .002
    save_hand(tmp_path / 'own.yaml', HAND, MarkerLayout(offsets=offsets))
    with pytest.raises(InvalidLayout, match='own.yaml: offset of middle: inside the hand'):
        simulated_hand(tmp_path / 'own.yaml')


def test_markers_a_little_inside_as_calibrations_find_them_are_seen(tmp_path, capsys):
    offsets = LAYOUT.offsets - (0., 0., .006)
    worn = MarkerLayout(offsets=offsets)
    assert markers_inside(HAND, worn).any()
    save_hand(tmp_path / 'own.yaml', HAND, worn)
    assert main(['demo', '--hand', str(tmp_path / 'own.yaml'), '--rate', '20',
                 '-o', str(tmp_path / 'out.mcap')]) == 0
    said = capsys.readouterr().out
    lost = float(re.search(r'([\d.]+) % of the markers lost', said).group(1))
    assert lost < 5. and f'track it with --hand {tmp_path / "own.yaml"}' in said
    assert main(['demo', '--hand', str(tmp_path / 'own.yaml'), '--side', 'left', '--rate', '2',
                 '-o', str(tmp_path / 'out.mcap')]) == 0
    assert 'track it with --hand HAND.yaml' in capsys.readouterr().out


def test_help_tells_the_defaults_that_there_are(capsys):
    with pytest.raises(SystemExit):
        main(['--help'])
    shown = capsys.readouterr().out
    assert '(default: 480.0)' in shown and 'None' not in shown
    words = ' '.join(shown.split())
    assert 'with random errors' in words and 'in range_of_motion, which are always' in words


def test_a_seed_changes_the_noise_of_a_range_of_motion_but_not_its_fingers():
    one, other = (next(Simulation('range_of_motion', HAND, LAYOUT, rate=30., seed=seed).blocks())
                  for seed in (1, 2))
    np.testing.assert_array_equal(one.angles, other.angles)
    assert not np.array_equal(one.markers, other.markers, equal_nan=True)


def test_a_recording_of_another_layout_names_its_markers(tmp_path, capsys):
    path = str(tmp_path / 'out.mcap')
    assert main(['power_grasp', '--layout', 'dfki13', '--side', 'left', '--rate', '20',
                 '--duration', '5', '-o', path]) == 0
    assert hand_tracker(['inspect', path]) == 0
    assert capsys.readouterr().out.rstrip().endswith('--layout dfki13 --side left')


@pytest.mark.parametrize('name', ['mediapipe21', 'dfki13'])
def test_other_layouts_are_simulated_on_the_skin(name):
    hand, layout = simulated_hand(side='left', layout=name)
    preset = preset_layout(name)
    assert layout.names == preset.names and not markers_inside(hand, layout).any()
    lifted = layout.offsets - preset.offsets
    np.testing.assert_array_equal(lifted[:, :2], 0.)
    assert (lifted[:, 2] >= 0.).all() and (name == 'dfki13') == (not lifted.any())
    part = next(Simulation('demo', hand, layout, rate=30.).blocks())
    assert part.markers.shape == part.places.shape == (15, len(layout.names), 3)
    markers, *_ = next(frame_messages(part, 'left', names=layout.names))
    reader = MarkerReader(LabelMap(default_labels(layout.names), layout.names))
    np.testing.assert_array_equal(reader.read(markers.data).positions, part.markers[0])
    found, erred = calibrated(hand, layout, 1)
    assert erred.names == layout.names and not np.array_equal(erred.offsets, layout.offsets)


def test_refuses_impossible_rates():
    with pytest.raises(InvalidRate, match='rate: 1000 Hz; allowed is 1 to 960 Hz'):
        short(rate=1000.)


def test_the_command_writes_a_recording_with_truth_and_a_hand_file(tmp_path):
    command = [sys.executable, '-m', 'hand_tracker', 'simulate', 'typing', '-o', 'out.mcap',
               '--rate', '60', '--duration', '2', '--cameras', '4', '--dropouts', '2',
               '--seed', '3', '--side', 'left', '--calibration', 'hand.yaml',
               '--truth', 'truth.csv']
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True,
                          env={**os.environ, 'PYTHONPATH': str(REPOSITORY)})
    assert done.returncode == 0, done.stderr
    assert 'frames at 60 Hz' in done.stdout
    with open_bag(tmp_path / 'out.mcap') as bag:
        assert bag.topics == {'/markers': MARKER_ARRAY, '/joint_states_truth': JOINT_STATE,
                              '/wrist_truth': POSE, '/markers_truth': MARKER_ARRAY}
        messages = list(bag.messages())
        assert len(set(bag.counts.values())) == 1 and bag.counts['/markers'] >= 121
    first = next(message for message in messages if message.topic == '/markers')
    markers = TYPE_STORE.deserialize_cdr(first.data, first.type).markers
    assert {marker.text for marker in markers} <= set(MARKERS)
    truth = next(message for message in messages if message.type == JOINT_STATE)
    assert TYPE_STORE.deserialize_cdr(truth.data, truth.type).name[0] == f'left_{JOINTS[0]}'
    check_truth(messages[:4], HAND.mirrored())
    with open(tmp_path / 'truth.csv', encoding='utf-8') as file:
        header, *rows = csv.reader(file)
    assert header == ['time_s', *(f'left_{joint}_deg' for joint in JOINTS)]
    angles = [TYPE_STORE.deserialize_cdr(message.data, message.type).position
              for message in messages if message.type == JOINT_STATE]
    table = np.array(rows, dtype=float)
    np.testing.assert_allclose(table[:, 1:], np.degrees(angles), atol=6e-4)
    np.testing.assert_allclose(table[:, 0], np.arange(len(angles)) / 60., atol=1e-6)
    hand, layout = load_hand(tmp_path / 'hand.yaml')
    expected, places = calibrated(HAND.mirrored(), LAYOUT, 3)
    np.testing.assert_allclose(hand.finger_bones, expected.finger_bones, atol=1e-12)
    np.testing.assert_allclose(layout.offsets, places.offsets, atol=1e-12)


def check_truth(messages, hand):
    """Check that joints and wrist of a frame lead to the true places of its markers."""
    truth = {message.topic: TYPE_STORE.deserialize_cdr(message.data, message.type)
             for message in messages}
    pose = truth['/wrist_truth'].pose
    turn = pose.orientation
    rotation = Rotation.from_quat((turn.x, turn.y, turn.z, turn.w)).as_matrix()
    position = np.array((pose.position.x, pose.position.y, pose.position.z))
    links = forward(joint_table(hand), truth['/joint_states_truth'].position, rotation, position)
    places = [(marker.pose.position.x, marker.pose.position.y, marker.pose.position.z)
              for marker in truth['/markers_truth'].markers]
    np.testing.assert_allclose(marker_positions(
        skin_layout(hand).mounting(hand), links, rotation, position), places, atol=1e-6)


def test_the_entry_of_the_node_records_when_it_is_given_a_motion(tmp_path):
    for arguments, code, said in ((['tremor', '-o', 'out.mcap', '--rate', '30',
                                    '--duration', '1'], 0, 'out.mcap: '),
                                  (['clapping'], 2, 'clapping')):
        done = subprocess.run(
            [sys.executable, '-m', 'hand_tracker.entry', 'simulate', *arguments],
            cwd=tmp_path, capture_output=True, text=True,
            env={**os.environ, 'PYTHONPATH': str(REPOSITORY)})
        assert done.returncode == code and said in done.stdout + done.stderr


def test_one_file_for_two_outputs_is_refused(tmp_path, capsys):
    same = str(tmp_path / 'same.csv')
    with pytest.raises(SystemExit, match='2'):
        main(['typing', '-o', str(tmp_path / 'out.mcap'), '--truth', same,
              '--calibration', same])
    assert 'expected a file each' in capsys.readouterr().err and not any(tmp_path.iterdir())
    hand = tmp_path / 'hand.yaml'
    save_hand(hand, Hand.scaled(), MarkerLayout())
    before = hand.read_bytes()
    with pytest.raises(SystemExit, match='2'):
        main(['typing', '-o', str(tmp_path / 'out.mcap'), '--hand', str(hand),
              '--calibration', str(hand)])
    assert 'expected a file each' in capsys.readouterr().err and hand.read_bytes() == before


def test_strokes_of_a_long_motion_cost_no_more(monkeypatch):
    motion = motion_named('typing', HAND, 1, 600.)
    # All strokes at once, as they add up anywhere.
    times = np.linspace(300., 301., 50)
    every = np.append(times, (0., motion.duration))
    np.testing.assert_array_equal(motion.strokes.sample(times), motion.strokes.sample(every)[:50])

    looked_at = []
    monkeypatch.setattr(layers, 'minimum_jerk',
                        lambda share: looked_at.append(share) or minimum_jerk(share))
    counts = []
    for strokes in (motion.strokes, motion_named('typing', HAND, 1, 310.).strokes):
        looked_at.clear()
        strokes.sample(times)
        counts.append(len(looked_at))
    assert 0 < counts[0] < 3 * counts[1]


def test_the_same_command_gives_the_same_bytes(tmp_path):
    written = []
    for _ in range(2):
        assert main(['tremor', '-o', str(tmp_path / 'out.mcap'), '--rate', '30',
                     '--duration', '1']) == 0
        written.append((tmp_path / 'out.mcap').read_bytes())
    assert written[0] == written[1]


@pytest.mark.parametrize('arguments, message', [
    (['--cameras', '1'], 'cameras: 1; allowed is 2 to 24'),
    (['--rate', '2000'], 'rate: 2000 Hz'),
    (['--duration', '0'], 'duration: 0 s'),
    (['--ghosts', '-1'], 'ghosts: -1'),
    (['--hand', 'none.yaml'], 'none.yaml: No such file')])
def test_the_command_says_what_is_wrong_in_one_line(tmp_path, capsys, arguments, message):
    assert main(['piano', '-o', str(tmp_path / 'out.mcap'), *arguments]) == 1
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
    assert not (tmp_path / 'out.mcap').exists()


@pytest.mark.ros
@pytest.mark.parametrize('rate', [120.])
def test_the_node_publishes_at_its_rate_and_ends_cleanly(rate):
    pytest.importorskip('rclpy')
    from helpers.ros_process import NodeProcess, watching_node
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import MarkerArray

    start = time.time_ns()
    with watching_node() as watch, NodeProcess(
            'hand_tracker.nodes.simulate_node',
            {'motion': 'typing', 'rate': rate, 'duration': 1., 'truth': True}) as process:
        frames = watch.collect(MarkerArray, 'markers', qos_profile_sensor_data)
        truth = watch.collect(JointState, 'joint_states_truth')
        watch.spin_until(lambda: len(frames) > 20 and len(truth) > 1.8 * rate)
        now = time.time_ns()
        assert process.interrupt() == 0, process.output
        assert 'Traceback' not in process.output
    stamps = np.array([message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                       for message in truth])
    # Each lap of one second is followed by the next without a gap, at the rate. The truth is
    # reliable, and its queues hold more than is waited for: nothing is lost.
    np.testing.assert_allclose(np.diff(stamps) * rate / 1e9, 1., atol=1e-3)
    assert start < stamps[0] and stamps[-1] < now
    assert len(truth[0].name) == len(truth[0].position) == len(JOINTS)
    assert {marker.text for marker in frames[0].markers} <= set(MARKERS)
    assert frames[0].markers[0].header.frame_id == 'mocap'


@pytest.mark.ros
def test_the_node_publishes_the_whole_truth_and_logs_when_it_begins_again():
    pytest.importorskip('rclpy')
    from geometry_msgs.msg import PoseStamped
    from helpers.ros_process import NodeProcess, watching_node
    from visualization_msgs.msg import MarkerArray

    with watching_node() as watch, NodeProcess(
            'hand_tracker.nodes.simulate_node',
            {'motion': 'tremor', 'rate': 30., 'duration': 1., 'truth': True}) as process:
        wrists = watch.collect(PoseStamped, 'wrist_truth')
        places = watch.collect(MarkerArray, 'markers_truth')
        watch.spin_until(lambda: len(wrists) > 40 and len(places) > 40)
        assert process.interrupt() == 0, process.output
        assert 'it begins again after 1 s' in process.output
        assert 'tremor begins again, lap 2' in process.output
    assert {len(message.markers) for message in places} == {len(MARKERS)}
    assert {message.header.frame_id for message in wrists} == {'mocap'}


@pytest.mark.ros
def test_the_node_says_what_is_wrong():
    pytest.importorskip('rclpy')
    from helpers.ros_process import NodeProcess

    for parameters, message in (({'motion': 'clapping'}, 'clapping'),
                                ({'hand_file': 'none.yaml'}, 'none.yaml: No such file')):
        with NodeProcess('hand_tracker.nodes.simulate_node', parameters) as process:
            assert process.wait() == 1
            assert message in process.output and 'Traceback' not in process.output
            assert '[simulate]' in process.output
