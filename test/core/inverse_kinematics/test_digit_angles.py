"""Digits with several markers: the chain that is fitted is the hand's own."""

import numpy as np
import pytest

from hand_tracker import HandTracker
from hand_tracker.core.inverse_kinematics.digit import THUMB, digit_chains
from hand_tracker.core.inverse_kinematics.digit_angles import local_digit_workspace, place_digit
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.model.marker_rows import marker_rows


@pytest.mark.parametrize('digit', range(5))
def test_a_digit_is_placed_where_forward_kinematics_places_it(digit):
    hand = Hand.scaled(.2, .095, phalanx_deviation=(.1, 0., -.05, -.15),
                       thumb_roll=.9, thumb_axis_distance=.015)
    layout = MarkerLayout()
    chains = digit_chains(hand, layout.mounting(hand))
    ends = marker_rows(hand, layout, 'flat').bone_ends
    random = np.random.default_rng(digit)
    workspace = getattr(
        local_digit_workspace, 'py_func', local_digit_workspace)()
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


@pytest.mark.parametrize('name', ['optitrack_hand', 'sig18_19'])
def test_bones_of_a_tenth_more_do_not_buckle_the_digits(name):
    hand, layout = Hand.scaled(.19, .088), preset_layout(name)
    time = np.arange(240) / 120.
    bend = .6 - .5 * np.cos(2. * np.pi * time)
    angles = np.tile(hand.relaxed(), (240, 1))
    for digit in range(4):
        angles[:, 5 * digit + 2:5 * digit + 5] = bend[:, None] * (.7, 1., .67)
    still = np.eye(3), np.zeros(3)
    markers = marker_positions(
        layout.mounting(hand), forward(joint_table(hand), angles), *still)
    tracker = HandTracker(Hand.scaled(.209, .0968), layout)
    found = np.array([tracker.update(frame, at).angles for frame, at in zip(
        markers, time, strict=True)])
    dip = [4, 9, 14, 19]
    # Where the last joint took up all that the bones are too long it was 30 to 60 degrees off.
    assert np.abs(np.degrees(found - angles))[60:, dip].max() < 20.
    assert np.abs(np.diff(found, axis=0))[60:, dip].max() * 120. < 12.
