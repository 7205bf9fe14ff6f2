"""The demo motion moves as a hand can; the packaged recording is made again from it."""

import os
import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

from benchmarks.repository import REPOSITORY
from hand_tracker.calibration import LANDMARKS, landmark_positions
from hand_tracker.core.model.hand import FINGERS, JOINTS, SIDES, Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.evaluation.overlap import deepest_overlaps
from hand_tracker.files.bags import TYPE_STORE, open_bag
from hand_tracker.package_data import PACKAGED_RECORDINGS, packaged_recording
from hand_tracker.simulation import packaged_recordings as made
from hand_tracker.simulation.gestures import GRASPS, LETTER_SHAPES, grasp_shape, shape_angles
from hand_tracker.simulation.motion import DEMO_STEPS, demo_motion, minimum_jerk
from hand_tracker.simulation.poses import NAMED_POSES, Touch, pose_angles, thumb_gap

HAND = Hand.scaled()
SIZES = [HAND, Hand.scaled(.16, .07), Hand.scaled(.21, .10), HAND.mirrored(),
         HAND.replace(limits=preset_limits('wide'))]
STEP = .001  # [s]


@pytest.fixture(scope='module')
def motion():
    return demo_motion(HAND)


@pytest.fixture(scope='module')
def sampled(motion):
    return motion.sample(np.arange(0., motion.duration, STEP))


@pytest.fixture(scope='module')
def recording():
    return made.demo_recording()


def landmarks(angles):
    return landmark_positions(HAND, forward(joint_table(HAND), angles))


@pytest.mark.parametrize('hand', SIZES)
def test_angles_are_within_table_1_at_every_sample(hand):
    motion = demo_motion(hand)
    angles, _, _ = motion.sample(np.arange(0., motion.duration, 1. / 480.))
    lower, upper = preset_limits('paper').T
    assert (angles >= lower).all() and (angles <= upper).all()


def test_lasts_twenty_to_thirty_seconds_and_ends_where_it_starts(motion):
    assert 20. <= motion.duration <= 30.
    for start, end in zip(motion.sample([0.]), motion.sample([motion.duration])):
        np.testing.assert_allclose(start, end, atol=1e-12)


def test_shows_everything():
    shown = {step.pose for step in DEMO_STEPS}
    assert shown >= {'open', 'fist', 'spread', 'pinch', 'relaxed', 'one', 'two', 'three', 'four',
                     'five', *(f'oppose_{finger}' for finger in FINGERS)}
    assert shown <= NAMED_POSES.keys()


def test_dip_follows_pip_and_the_thumbs_ip_its_mcp(sampled):
    angles = sampled[0]
    for digit, (leader, follower) in enumerate(
            [(f'{finger}_pip_flexion', f'{finger}_dip_flexion') for finger in FINGERS]
            + [('thumb_mcp_flexion', 'thumb_ip_flexion')]):
        slope, offset = HAND.coupling[digit]
        np.testing.assert_allclose(
            angles[:, JOINTS.index(follower)],
            slope * angles[:, JOINTS.index(leader)] + offset, atol=1e-12)


def test_neighbours_hold_each_other_back(sampled):
    """The bounds on the difference of neighbouring MCPs of the interdependence of fingers."""
    flexion = np.degrees(
        sampled[0][:, [JOINTS.index(f'{finger}_mcp_flexion') for finger in FINGERS]])
    assert (np.abs(np.diff(flexion, axis=1)).max(axis=0) <= (60., 45., 45.)).all()


def test_every_joint_of_the_paper_moves(sampled):
    ranges = np.degrees(np.ptp(sampled[0], axis=0))
    for joint, span in zip(JOINTS, ranges):
        if '_cmc_' not in joint or 'thumb' in joint:
            assert span > 10., joint


def test_is_smooth(sampled):
    """Twice continuously differentiable: no jump of speed or acceleration between samples."""
    for values in (sampled[0], sampled[1].reshape(-1, 9), 10. * sampled[2]):
        speed = np.diff(values, axis=0) / STEP
        acceleration = np.diff(speed, axis=0) / STEP
        jerk = np.diff(acceleration, axis=0) / STEP
        # The fastest movement, 89 degrees in 0.45 s: speed 1.875 D/T, jerk 60 D/T^3.
        assert np.abs(speed).max() < 1.88 * 1.55 / .45
        assert np.abs(acceleration).max() < 5.8 * 1.55 / .45 ** 2
        assert np.abs(jerk).max() < 61. * 1.55 / .45 ** 3


def test_minimum_jerk_rests_at_both_ends():
    polynomial = np.polynomial.Polynomial((0., 0., 0., 10., -15., 6.))
    share = np.linspace(0., 1., 11)
    np.testing.assert_allclose(minimum_jerk(share), polynomial(share), atol=1e-15)
    for order in (1, 2):
        np.testing.assert_allclose(polynomial.deriv(order)([0., 1.]), 0., atol=1e-12)


def test_wrist_moves_and_turns_slowly(sampled):
    _, rotation, position = sampled
    np.testing.assert_allclose(
        rotation @ rotation.swapaxes(1, 2), np.broadcast_to(np.eye(3), rotation.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.)
    assert .15 < np.ptp(position, axis=0).max() < .30
    assert np.linalg.norm(np.diff(position, axis=0), axis=1).max() / STEP < .2
    cosine = (np.einsum('nij,ij->n', rotation, rotation[0]) - 1.) / 2.
    away = np.degrees(np.arccos(cosine.clip(-1., 1.)))
    assert 30. < away.max() < 90.


def test_holds_still_before_and_after(motion):
    for early, start in zip(motion.sample([-5.]), motion.sample([0.])):
        np.testing.assert_array_equal(early, start)
    for late, end in zip(motion.sample([motion.duration + 5.]), motion.sample([motion.duration])):
        np.testing.assert_array_equal(late, end)


def test_samples_do_not_depend_on_the_rate(motion):
    coarse, fine = (motion.sample(np.arange(0., 5., 1. / rate)) for rate in (30., 960.))
    for a, b in zip(coarse, fine):
        np.testing.assert_allclose(a, b[::32], atol=1e-12)


@pytest.mark.parametrize('finger', range(4))
def test_thumb_opposes_each_finger(finger):
    """Their flesh meets, close to the pads; no other tip is as near."""
    name = f'oppose_{FINGERS[finger]}'
    angles = pose_angles(name, HAND)
    pose = forward(joint_table(HAND), angles)
    gap = np.linalg.norm(thumb_gap(HAND, pose, Touch('tip', finger)))
    assert gap < (.005, .007, .008, .010)[finger]
    assert 0. < deepest_overlaps(HAND, angles[None])[0] < .001
    points = landmarks(angles)
    tips = [LANDMARKS.index(f'{digit}_tip') for digit in FINGERS]
    distances = np.linalg.norm(points[tips] - points[LANDMARKS.index('thumb_tip')], axis=1)
    assert distances[finger] < 1.3 * (HAND.radii[4, 2] + HAND.radii[finger, 2])
    assert np.argmin(distances) == finger


def test_thumb_touches_the_folded_fingers():
    for name, most in (('fist', .022), ('one', .008), ('two', .010), ('three', .015)):
        pose = forward(joint_table(HAND), pose_angles(name, HAND))
        gap = thumb_gap(HAND, pose, NAMED_POSES[name][1])
        assert np.linalg.norm(gap) < most, name


@pytest.mark.parametrize('length', [.165, .19, .21])
def test_no_pose_has_digits_in_each_other(length):
    hand = Hand.scaled(length)
    angles = np.array([pose_angles(name, hand) for name in NAMED_POSES] + [
        shape_angles(shape, hand) for shape in LETTER_SHAPES.values()] + [
        shape_angles(grasp_shape(kind, size), hand) for kind in GRASPS for size in (0., .5, 1.)])
    assert deepest_overlaps(hand, angles).max() < .001


def test_thumb_closes_over_the_fist_after_the_fingers(motion):
    fist = 1 + [step.pose for step in DEMO_STEPS].index('fist')
    arrival = motion.times[2 * fist - 2]
    assert arrival[4] > arrival[:4].max()


def test_recording_is_the_motions_markers_with_noise(motion, recording):
    assert recording.markers.shape == (len(recording.stamps), len(MARKERS), 3)
    times = (recording.stamps - recording.stamps[0]) / 1e9
    np.testing.assert_allclose(np.diff(times), 1. / 120., atol=1e-9)
    assert times[-1] == pytest.approx(motion.duration, abs=1. / 120.)
    angles, rotation, position = motion.sample(times)
    np.testing.assert_allclose(recording.angles, angles, atol=1e-6)
    pose = forward(joint_table(HAND), angles, rotation, position)
    true = marker_positions(MarkerLayout().mounting(HAND), pose, rotation, position)
    noise = (recording.markers - true)[np.isfinite(recording.markers)]
    assert noise.std() == pytest.approx(.0003, rel=.02)
    assert abs(noise.mean()) < .00001
    assert np.abs(noise).max() < .0018


def test_drop_outs_are_short_and_of_one_or_two(recording):
    lost = np.isnan(recording.markers).any(axis=2)
    assert not lost[:120].any()
    assert .005 < lost.mean() < .05
    assert lost.sum(axis=1).max() == 2
    assert lost.any(axis=0).all()
    for marker in lost.T:
        edges = np.diff(np.concatenate(([0], marker.astype(int), [0])))
        frames = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
        assert (frames >= 3).all()
        assert (frames <= 37).all()


def test_seed_makes_the_recording(recording):
    same, other = made.demo_recording(), made.demo_recording(seed=2)
    for a, b in zip(same, recording):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(other.markers, recording.markers, equal_nan=True)
    np.testing.assert_array_equal(other.angles, recording.angles)


def test_left_recording_is_of_a_left_hand():
    left = made.demo_recording(HAND.mirrored(), noise=0.)
    right = made.demo_recording(noise=0.)
    np.testing.assert_array_equal(left.angles, right.angles)
    # Distances between markers do not tell a hand from its mirror image; the palm's side does.
    a, b = (r.markers[0, [1, 2, 7]] - r.markers[0, 0] for r in (left, right))
    np.testing.assert_allclose(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1), atol=3e-6)
    assert np.linalg.det(a) * np.linalg.det(b) < 0.


def test_the_hands_never_touch_whenever_their_recordings_start():
    rightmost, leftmost = (
        extreme(made.demo_recording(Hand.scaled(side=side)).markers[..., 1])
        for side, extreme in (('left', np.nanmin), ('right', np.nanmax)))
    flesh = .02
    assert rightmost - leftmost > flesh


@pytest.fixture(scope='module')
def remade(tmp_path_factory):
    """Return the packaged recordings, made again, by side."""
    folder = tmp_path_factory.mktemp('remade')
    (folder / 'recordings').mkdir()
    environment = {**os.environ, 'PYTHONPATH': str(REPOSITORY)}
    program = ('from hand_tracker.__main__ import main\n'
               'for options in [], ["--side", "left"], ["--side", "both"]:\n'
               '    main(["record", *options])')
    run = subprocess.run([sys.executable, '-c', program], cwd=folder, capture_output=True,
                         text=True, check=True, env=environment)
    assert run.stdout.count('frames at 120 Hz') == 3
    return {side: folder / name for side, name in PACKAGED_RECORDINGS.items()}


def packaged_messages(path):
    with open_bag(path) as bag:
        return list(bag.messages())


@pytest.mark.parametrize('side', PACKAGED_RECORDINGS)
def test_packaged_recording_is_remade_byte_for_byte(remade, side):
    packaged, remade = REPOSITORY / PACKAGED_RECORDINGS[side], remade[side]
    assert packaged_messages(remade) == packaged_messages(packaged)
    if writer_of(remade) != writer_of(packaged):
        pytest.skip('another release of rosbags compresses differently; the messages agree')
    assert remade.read_bytes() == packaged.read_bytes()


def writer_of(path):
    """Return the header of an MCAP file, which names the library that wrote it."""
    data = path.read_bytes()
    return data[8:17 + int.from_bytes(data[9:17], 'little')]


@pytest.mark.parametrize('side', SIDES)
def test_a_hand_is_on_the_packaged_recording_of_its_side(side):
    tracker = HandTracker(Hand.scaled(side=side))
    misses = []
    with open_bag(packaged_recording(side)) as bag:
        for message in islice(bag.messages(['/markers']), 0, None, 10):
            markers = np.full((len(MARKERS), 3), np.nan)
            for marker in TYPE_STORE.deserialize_cdr(message.data, message.type).markers:
                at = marker.pose.position
                markers[marker.id] = at.x, at.y, at.z
            state = tracker.update(markers, 1e-9 * message.time)
            misses.append(np.nanmean(state.residuals))
    # A hand of the other side misses by centimetres; one that comes back or touches, for a moment.
    assert np.quantile(misses, .95) < .004


def test_packaged_recording_is_small_and_holds_what_was_made(recording):
    assert all(packaged_recording(side).stat().st_size < 3e6 for side in PACKAGED_RECORDINGS)
    packaged = packaged_recording()
    with open_bag(packaged) as bag:
        assert bag.topics == {'/markers': 'visualization_msgs/msg/MarkerArray',
                              '/joint_states_truth': 'sensor_msgs/msg/JointState'}
        for topic in bag.topics:
            assert bag.counts[topic] == len(recording.stamps)
        for i, message in enumerate(bag.messages(['/markers'])):
            markers = TYPE_STORE.deserialize_cdr(message.data, message.type).markers
            assert {marker.header.frame_id for marker in markers} == {'mocap'}
            seen = np.isfinite(recording.markers[i]).all(axis=1)
            assert [marker.text for marker in markers] == [
                label for label, there in zip(MARKERS, seen) if there]
            at = [[getattr(marker.pose.position, axis) for axis in 'xyz'] for marker in markers]
            np.testing.assert_array_equal(at, recording.markers[i][seen])
            stamp = markers[0].header.stamp
            assert stamp.sec * 10 ** 9 + stamp.nanosec == message.time == recording.stamps[i]
        for i, message in enumerate(bag.messages(['/joint_states_truth'])):
            state = TYPE_STORE.deserialize_cdr(message.data, message.type)
            assert state.name == [f'right_{joint}' for joint in JOINTS]
            np.testing.assert_array_equal(state.position, recording.angles[i])


def test_command_says_why_it_cannot_write(tmp_path):
    run = subprocess.run(
        [sys.executable, '-m', 'hand_tracker', 'record', '-o', tmp_path / 'demo.txt'],
        cwd=REPOSITORY, capture_output=True, text=True)
    assert run.returncode == 1
    assert "unknown extension '.txt'" in run.stderr
    assert 'Traceback' not in run.stderr
