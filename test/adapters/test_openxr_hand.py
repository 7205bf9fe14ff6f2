"""The tracked hand as landmarks: where the joints are, with the axes of OpenXR."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.adapters.hand_landmarks import side_of_landmarks
from hand_tracker.adapters.openxr_hand import OpenXrHand
from hand_tracker.calibration.landmarks import LANDMARKS, landmark_positions
from hand_tracker.core.model.hand import SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS, OPENXR
from hand_tracker.simulation.poses import pose_angles

TURN = Rotation.from_euler('xyz', (.3, -1., 2.))
WRIST_POSITION = np.array((.1, -.2, 1.))


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('count', LANDMARK_ORDERS)
def test_landmarks_are_those_of_the_forward_kinematics(side, count):
    hand = Hand.scaled(side=side)
    angles = pose_angles('fist', hand)
    found = OpenXrHand(hand, count).poses(angles, TURN.as_quat(), WRIST_POSITION)
    pose = forward(joint_table(hand), angles, TURN.as_matrix(), WRIST_POSITION)
    expected = dict(zip(LANDMARKS, landmark_positions(hand, pose, WRIST_POSITION)))
    at = dict(zip(LANDMARK_ORDERS[count], found.positions))
    for name in LANDMARKS:
        np.testing.assert_allclose(at[name], expected[name], atol=1e-12)
    assert side_of_landmarks(at) == side
    assert found.names[0] == f"{side}_{'PALM' if count == 26 else 'WRIST'}"
    assert len(set(found.names)) == count
    assert {name.partition('_')[2] for name in found.names} <= set(OPENXR)


@pytest.mark.parametrize('side', SIDES)
def test_axes_are_those_of_openxr(side):
    hand = Hand.scaled(side=side)
    found = OpenXrHand(hand, 26).poses(pose_angles('relaxed', hand), TURN.as_quat(), WRIST_POSITION)
    at = dict(zip(OPENXR, found.positions))
    axes = dict(zip(OPENXR, Rotation.from_quat(found.orientations).as_matrix()))
    for bone, end in (('INDEX_PROXIMAL', 'INDEX_INTERMEDIATE'), ('RING_DISTAL', 'RING_TIP'),
                      ('THUMB_METACARPAL', 'THUMB_PROXIMAL'), ('LITTLE_TIP', None)):
        if end is None:
            begin, end = 'LITTLE_DISTAL', bone
        else:
            begin = bone
        along = (at[end] - at[begin]) / np.linalg.norm(at[end] - at[begin])
        np.testing.assert_allclose(-axes[bone][:, 2], along, atol=1e-6)
    # y is out of the back of the hand, and x to its right, for either hand.
    back = TURN.apply((0., 0., 1.))
    np.testing.assert_allclose(axes['WRIST'][:, 1], back, atol=1e-12)
    np.testing.assert_allclose(axes['WRIST'][:, 0], TURN.apply((0., -1., 0.)), atol=1e-12)
    palm = (at['PALM'] - WRIST_POSITION) @ TURN.apply((1., 0., 0.))
    assert 0. < palm < (at['MIDDLE_PROXIMAL'] - WRIST_POSITION) @ TURN.apply((1., 0., 0.))
