"""Digits with several markers: the chain that is fitted is the hand's own."""

import numpy as np
import pytest

from hand_tracker.calibration.landmarks import landmark_positions
from hand_tracker.core.inverse_kinematics.digit import THUMB, digit_chains
from hand_tracker.core.inverse_kinematics.digit_angles import new_digit_workspace, place_digit
from hand_tracker.core.model.hand import JOINTS, Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.model.marker_rows import marker_rows
from hand_tracker.core.tracker import HandTracker


@pytest.mark.parametrize('digit', range(5))
def test_a_digit_is_placed_where_forward_kinematics_places_it(digit):
    hand = Hand.scaled(.2, .095, phalanx_deviation=(.1, 0., -.05, -.15),
                       thumb_roll=.9, thumb_axis_distance=.015)
    layout = MarkerLayout()
    chains = digit_chains(hand, layout.mounting(hand))
    ends = marker_rows(hand, layout, 'flat').bone_ends
    random = np.random.default_rng(digit)
    workspace = new_digit_workspace()
    for _ in range(20):
        angles = random.uniform(*hand.limits.T)
        if digit != THUMB:
            angles[5 * digit] = 0.   # the palm is flat
        place_digit(chains, ends, digit, angles[5 * digit:5 * digit + 5], workspace)
        pose = forward(joint_table(hand), angles)
        # Of a finger's metacarpal nothing is measured, so that it is not placed.
        first = 0 if digit == THUMB else 1
        links = slice(5 * digit + first, 5 * digit + 5)
        np.testing.assert_allclose(
            workspace.frames[first:].transpose(0, 2, 1), pose.rotation[links], atol=1e-12)
        np.testing.assert_allclose(workspace.origins[first:], pose.position[links], atol=1e-12)


@pytest.mark.parametrize('side', ['right', 'left'])
def test_a_hand_whose_thumbs_axes_do_not_meet_is_found_from_its_own_joint_centres(side):
    hand = Hand.scaled(side=side, thumb_axis_distance=.012, limits=preset_limits('wide'))
    tracker, abduction = HandTracker(hand, preset_layout('mediapipe21')), JOINTS.index(
        'thumb_cmc_abduction')
    angles = hand.relaxed()
    for frame in range(30):
        angles[abduction] = np.radians(60.) * min(frame / 15., 1.)
        centres = landmark_positions(hand, forward(joint_table(hand), angles))
        state = tracker.update(centres, frame / 120.)
    assert np.abs(state.angles - angles).max() < np.radians(.5)
    assert np.linalg.norm(state.wrist_position) < 1e-4
    assert state.residuals[1] < 1e-4
    # The CMC alone does not show how the thumb bends: it grows ever less sure.
    centres[2:5] = np.nan
    flexion = JOINTS.index('thumb_cmc_flexion')
    seen, soon, later = state.deviation[flexion], *(
        tracker.update(centres, time).deviation[flexion] for time in (1., 2.))
    assert seen < soon < later


def test_a_marker_beside_the_thumbs_cmc_turns_with_its_saddle():
    layout = preset_layout('sig18_19')
    row = layout.places.index('thumb_cmc')
    hand = Hand.scaled(thumb_axis_distance=.012)
    angles = np.zeros(25)
    at_rest, turned = (marker_positions(layout.mounting(hand), forward(joint_table(hand), one))[row]
                       for one in (angles, np.where(np.arange(25) == JOINTS.index(
                           'thumb_cmc_abduction'), .5, angles)))
    np.testing.assert_allclose(
        at_rest, hand.resting_thumb_cmc() + layout.offsets[row], atol=1e-12)
    axis, root = hand.thumb_abduction_axis, hand.thumb_cmc
    ahead = at_rest - root
    expected = root + (np.cos(.5) * ahead + np.sin(.5) * np.cross(axis, ahead)
                       + (1. - np.cos(.5)) * (axis @ ahead) * axis)
    np.testing.assert_allclose(turned, expected, atol=1e-12)
