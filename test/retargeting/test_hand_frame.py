"""A turned frame of a hand is found and named."""

import numpy as np
import pytest
from helpers.robots import human_robot, wide_hand

from hand_tracker.calibration.landmarks import landmark_positions
from hand_tracker.core.model.hand import LEFT_HAND_MIRROR
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.retargeting.hand_frame import (
    DEX_AXES,
    TurnedHandFrame,
    axes_in_words,
    palm_axes,
    require_wrist_frame,
)
from hand_tracker.retargeting.retargeter import Retargeter


def landmarks_of(side):
    hand = wide_hand(side)
    return landmark_positions(hand, forward(joint_table(hand), hand.relaxed()))


@pytest.mark.parametrize('side', ['right', 'left'])
def test_the_frame_of_the_wrist_is_right(side):
    landmarks = landmarks_of(side)
    require_wrist_frame(landmarks, side)
    np.testing.assert_allclose(palm_axes(landmarks, side), np.eye(3), atol=.2)
    assert axes_in_words(np.eye(3), side) == (
        f"x distal, y {'radial' if side == 'right' else 'ulnar'}, z dorsal")


def test_another_programs_frame_is_named():
    turned = landmarks_of('right') @ DEX_AXES
    with pytest.raises(TurnedHandFrame) as refusal:
        require_wrist_frame(turned, 'right')
    assert 'x palmar, y radial, z distal' in str(refusal.value)
    assert "dex-retargeting's frame" in str(refusal.value)


def test_a_hand_of_the_other_side_is_named():
    with pytest.raises(TurnedHandFrame, match='a hand of the other side'):
        require_wrist_frame(landmarks_of('right') * LEFT_HAND_MIRROR, 'right')


def test_retargeting_refuses_turned_landmarks_and_unknown_ones_not():
    solver = Retargeter(human_robot(), wide_hand())
    solver.update(np.full((21, 3), np.nan), .01)
    with pytest.raises(TurnedHandFrame, match='turned by'):
        solver.update(landmarks_of('right') @ DEX_AXES, .01)
