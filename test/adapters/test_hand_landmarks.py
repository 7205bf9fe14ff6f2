"""Landmarks of every order: the same hand, the right side, the right names."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.capture_files import capture_file, capture_path

from hand_tracker.adapters.hand_landmarks import (
    SIDE_FRAMES,
    LandmarkChecks,
    landmarks_of_markers,
    landmarks_of_poses,
    named_landmarks,
    side_of_landmarks,
)
from hand_tracker.adapters.point_frame import MalformedFrame
from hand_tracker.calibration.landmarks import LANDMARKS, landmark_positions
from hand_tracker.core.model.hand import FINGERS, JOINTS, SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS
from hand_tracker.simulation.poses import pose_angles

WEBXR_BONES = ('metacarpal', 'phalanx-proximal', 'phalanx-intermediate', 'phalanx-distal', 'tip')


def header():
    return SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=2), frame_id='head')


def pose(at):
    return SimpleNamespace(position=SimpleNamespace(**dict(zip('xyz', map(float, at)))))


def poses(points):
    return SimpleNamespace(header=header(), poses=[pose(at) for at in points])


def named_poses(names, points, is_valid=None):
    return SimpleNamespace(header=header(), name=list(names), pose=[pose(at) for at in points],
                           is_valid=[True] * len(names) if is_valid is None else is_valid)


def marker(number, at, kind=2, action=0):
    return SimpleNamespace(header=header(), id=number, type=kind, action=action, pose=pose(at),
                           ADD=0, CUBE=1, SPHERE=2, CYLINDER=3)


def fist(side):
    """Return the landmarks of a fist, by name."""
    hand = Hand.scaled(side=side)
    pose = forward(joint_table(hand), pose_angles('fist', hand))
    return dict(zip(LANDMARKS, landmark_positions(hand, pose)))


@pytest.mark.parametrize('count', LANDMARK_ORDERS)
def test_poses_are_named_by_their_number(count):
    points = np.arange(3. * count).reshape(count, 3) + 1.
    points[[3, 5]] = 0.
    points[4, 1] = np.nan
    frame = landmarks_of_poses(poses(points))
    assert frame.names == LANDMARK_ORDERS[count] and len(set(frame.names)) == count
    expected = points.copy()
    expected[3:6] = np.nan
    np.testing.assert_array_equal(frame.markers, expected)
    assert frame.frame_id == 'head' and frame.stamp.nanosec == 2
    # Every order knows all that the tracker's eight markers are at.
    assert {'wrist', 'index_mcp', 'little_mcp', 'thumb_tip', 'ring_dip'} <= set(frame.names)


def test_the_orders_are_those_of_the_standards():
    # W3C, WebXR Hand Input Level 1, "skeleton joint": 25 names in this order.
    webxr = ['wrist', 'thumb-metacarpal', 'thumb-phalanx-proximal', 'thumb-phalanx-distal',
             'thumb-tip']
    webxr += [f'{finger}-finger-{bone}' for finger in ('index', 'middle', 'ring', 'pinky')
              for bone in WEBXR_BONES]
    ours = {'metacarpal': 'cmc', 'phalanx-proximal': 'mcp', 'phalanx-intermediate': 'pip',
            'phalanx-distal': 'dip', 'tip': 'tip'}
    for name, landmark in zip(webxr[5:], LANDMARK_ORDERS[25][5:]):
        finger, _, bone = name.partition('-finger-')
        assert landmark == f"{finger.replace('pinky', 'little')}_{ours[bone]}"
    assert LANDMARK_ORDERS[25][:5] == ('wrist', 'thumb_cmc', 'thumb_mcp', 'thumb_ip', 'thumb_tip')
    assert LANDMARK_ORDERS[26] == ('palm', *LANDMARK_ORDERS[25])
    assert LANDMARK_ORDERS[21] == LANDMARKS


def test_a_wrist_at_the_origin_is_no_missing_wrist():
    points = np.arange(63.).reshape(21, 3)
    points[0] = 0.
    wrist = landmarks_of_poses(poses(points)).markers[0]
    assert wrist.any() and np.linalg.norm(wrist) < 1e-6


def test_other_numbers_of_poses_are_refused():
    with pytest.raises(MalformedFrame, match='of 22 poses; expected are 21, 25, 26'):
        landmarks_of_poses(poses(np.ones((22, 3))))


@pytest.mark.parametrize('side', SIDES)
def test_a_message_of_both_hands_is_taken_by_its_names(side):
    # As IsaacTeleop: WRIST to LITTLE_TIP, left before right.
    bones = ['WRIST', 'THUMB_METACARPAL', 'THUMB_PROXIMAL', 'THUMB_DISTAL', 'THUMB_TIP']
    bones += [f'{finger.upper()}_{bone}' for finger in FINGERS
              for bone in ('METACARPAL', 'PROXIMAL', 'INTERMEDIATE', 'DISTAL', 'TIP')]
    names = [f'{hand}_{bone}' for hand in ('left', 'right') for bone in bones]
    points = np.arange(150.).reshape(50, 3)
    is_valid = [number % 7 > 0 for number in range(50)]
    frame = named_landmarks(named_poses(names, points, is_valid), side)
    assert frame.names == LANDMARK_ORDERS[25]
    expected = np.where(np.array(is_valid)[:, None], points, np.nan)
    np.testing.assert_array_equal(
        frame.markers, expected[:25] if side == 'left' else expected[25:])
    with pytest.raises(MalformedFrame, match='50 names, 50 poses, 49 validities'):
        named_landmarks(named_poses(names, points, is_valid[1:]), side)
    with pytest.raises(MalformedFrame, match=f"no name like '{side}_INDEX_TIP' among a, b"):
        named_landmarks(named_poses(['a', 'b'], points[:2]), side)


def test_markers_are_landmarks_by_their_ids():
    markers = [marker(5, (1., 2., 3.)), marker(20, (4., 5., 6.)), marker(0, (0., 0., 0.)),
               marker(3, (0., 0., 0.)),
               marker(21, (7., 7., 7.)), marker(1, (8., 8., 8.), kind=9),
               marker(2, (9., 9., 9.), action=2)]
    frame = landmarks_of_markers(SimpleNamespace(markers=markers), 21)
    seen = dict(zip(frame.names, frame.markers))
    np.testing.assert_array_equal(seen['index_mcp'], (1., 2., 3.))
    np.testing.assert_array_equal(seen['little_tip'], (4., 5., 6.))
    assert np.isfinite(frame.markers[:, 0]).sum() == 2
    with pytest.raises(MalformedFrame, match='ids 0 to 20'):
        landmarks_of_markers(SimpleNamespace(markers=markers[4:]), 21)


@pytest.mark.parametrize('side', SIDES)
def test_bent_fingers_tell_the_side_and_straight_ones_nothing(side):
    assert side_of_landmarks(fist(side)) == side
    mirrored = {name: at * (1., 1., -1.) for name, at in fist(side).items()}
    assert side_of_landmarks(mirrored) != side
    hand = Hand.scaled(side=side)
    flat = landmark_positions(hand, forward(joint_table(hand), np.zeros(25)))
    assert side_of_landmarks(dict(zip(LANDMARKS, flat))) is None
    assert side_of_landmarks({'wrist': np.zeros(3)}) is None


@pytest.mark.parametrize('side', SIDES)
def test_the_side_of_captured_hands(side):
    joints = np.load(capture_path(f'manipnet__cup1_{side}Hand'))['positions'][::20]
    found = [side_of_landmarks(dict(zip(LANDMARKS, points))) for points in joints]
    told = [each for each in found if each]
    assert len(told) > 100 and set(told) == {side}


@pytest.mark.parametrize('name, side', [('pinch', 'left'), ('relaxed', None)])
def test_the_hand_of_a_headset(name, side):
    text = capture_file(f'files/webxr_{name}.ts').read_text()
    matrices = re.findall(r'offsetMatrix: \[([^\]]*)\]', text)
    points = [[float(value) for value in each.split(',') if value.strip()][12:15]
              for each in matrices]
    frame = landmarks_of_poses(poses(points))
    np.testing.assert_array_equal(frame.markers, points)
    said = {}
    checks = LandmarkChecks('right', said.setdefault)
    for _ in range(SIDE_FRAMES):
        checks.check(frame)
    assert side_of_landmarks(dict(zip(frame.names, frame.markers))) == side
    assert list(said) == (['side'] if side else [])


@pytest.mark.parametrize('name, straight', [
    ('fist', ()), ('pointing_up', ('index',)), ('pointing_up_rotated', ('index',))])
def test_the_hand_of_a_camera(name, straight):
    text = capture_file(f'files/mediapipe_{name}_landmarks.pbtxt').read_text()
    block = re.search(r'^world_landmarks {(.*?)^}', text, re.DOTALL | re.MULTILINE)[1]
    points = np.array([float(value) for value in re.findall(r'[xyz]: (\S+)', block)])
    frame = landmarks_of_poses(poses(points.reshape(21, 3)))
    assert frame.names == LANDMARK_ORDERS[21]
    assert side_of_landmarks(dict(zip(frame.names, frame.markers))) == 'right'
    hand, layout = Hand.scaled(), preset_layout('mediapipe21')
    tracker = HandTracker(hand, layout)
    for _ in range(30):
        state = tracker.update(frame.markers)
    bends = {finger: np.degrees(state.angles[JOINTS.index(f'{finger}_pip_flexion')])
             for finger in FINGERS}
    assert {finger for finger, bend in bends.items() if bend < 45.} == set(straight)
    assert all(bend > 70. for finger, bend in bends.items() if finger not in straight)


def test_the_other_hand_is_told_once_and_only_if_it_stays():
    said = {}
    checks = LandmarkChecks('left', said.setdefault)
    frames = {side: landmarks_of_poses(poses(fist(side).values())) for side in SIDES}
    for _ in range(SIDE_FRAMES - 1):
        checks.check(frames['right'])
    checks.check(frames['left'])
    assert said == {}
    for _ in range(2):
        checks.check(frames['right'])
    assert 'bend as a right hand does, but side is left' in said['side']


def test_landmarks_of_an_image_are_not_taken_for_metres():
    said = {}
    checks = LandmarkChecks('right', said.setdefault)
    checks.check(landmarks_of_poses(poses([5. * at for at in fist('right').values()])))
    assert list(said) == ['length'] and 'world landmarks' in said['length']
