"""The size of a hand from the first seconds of its markers, against simulated hands."""

import numpy as np
import pytest

from hand_tracker.calibration.size import fit_size
from hand_tracker.core.model.hand import FINGERS, Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.visibility import skin_layout

RATE = 60.
NOISE = 3e-4  # [m]
SIZES = (.175, .08), (.205, .095)


def markers_of(hand, layout, name, seconds=5.):
    times = np.arange(0., seconds, 1. / RATE)
    angles, rotation, position = motion_named(name, hand, 7).sample(times)
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(layout.mounting(hand), pose, rotation, position)
    return markers + np.random.default_rng(1).normal(scale=NOISE, size=markers.shape)


@pytest.mark.parametrize('motion', ['demo', 'spelling', 'typing', 'power_grasp', 'shaking'])
@pytest.mark.parametrize('length, breadth', SIZES)
def test_five_seconds_of_any_motion_tell_the_size(length, breadth, motion):
    hand, layout = Hand.scaled(length, breadth), MarkerLayout()
    found = fit_size(markers_of(hand, layout, motion), Hand.scaled())
    np.testing.assert_allclose(found.finger_mcp[[0, 3]], hand.finger_mcp[[0, 3]], atol=1e-3)
    np.testing.assert_allclose(found.finger_bones, hand.finger_bones, rtol=.02)
    np.testing.assert_allclose(found.thumb_cmc, hand.thumb_cmc, atol=1.5e-3)


def test_markers_on_the_skin_tell_it_by_their_offsets():
    hand = Hand.scaled(.205, .095)
    layout = skin_layout(hand)
    found = fit_size(markers_of(hand, layout, 'demo'), Hand.scaled(), layout)
    np.testing.assert_allclose(found.finger_bones, hand.finger_bones, rtol=.02)


@pytest.mark.parametrize('name', ['mediapipe21', 'sig18_19', 'kyutech23'])
def test_the_principal_markers_of_any_layout_tell_it(name):
    hand, layout = Hand.scaled(.2, .095), preset_layout(name)
    found = fit_size(markers_of(hand, layout, 'demo'), Hand.scaled(), layout)
    np.testing.assert_allclose(found.finger_mcp[[0, 3]], hand.finger_mcp[[0, 3]], atol=2e-3)
    np.testing.assert_allclose(found.finger_bones, hand.finger_bones, rtol=.05)


def test_the_plate_of_a_glove_tells_no_size():
    layout = preset_layout('dfki13')
    assert fit_size(markers_of(Hand.scaled(), layout, 'demo'), Hand.scaled(), layout) is None


def test_side_limits_and_couplings_are_kept_and_a_left_hand_is_a_mirror_image():
    right = Hand.scaled(.2, .09)
    left = right.mirrored()
    given = Hand.scaled(side='left', limits=preset_limits('wide'), coupling=((.5, 0.),) * 5,
                        natural_flexion=((1., .1, .2),) * 5)
    found = fit_size(markers_of(left, MarkerLayout(), 'demo'), given)
    assert found.side == 'left'
    np.testing.assert_array_equal(found.limits, given.limits)
    np.testing.assert_array_equal(found.coupling, given.coupling)
    np.testing.assert_array_equal(found.natural_flexion, given.natural_flexion)
    np.testing.assert_allclose(found.finger_bones, right.finger_bones, rtol=.02)


def test_a_marker_behind_the_wrist_makes_the_palm_longer_and_no_finger():
    hand = Hand.scaled(finger_mcp=Hand.scaled().finger_mcp + (.025, 0., 0.))
    found = fit_size(markers_of(hand, MarkerLayout(), 'demo'), Hand.scaled())
    np.testing.assert_allclose(found.finger_bones[:, :2], hand.finger_bones[:, :2], rtol=.03)
    assert found.thumb_cmc[0] == pytest.approx(hand.thumb_cmc[0] + .025, abs=.006)


def test_hidden_fingers_follow_the_others_and_frames_without_palm_tell_nothing():
    hand, layout = Hand.scaled(.2, .092), MarkerLayout()
    markers = markers_of(hand, layout, 'demo')
    markers[:, 3] = np.nan
    found = fit_size(markers, Hand.scaled())
    np.testing.assert_allclose(found.finger_bones[0], hand.finger_bones[0], rtol=.03)
    markers[10:, 0] = np.nan
    assert fit_size(markers, Hand.scaled()) is None


def test_no_hand_of_any_size_is_made_of_a_palm_that_is_none():
    markers = np.random.default_rng(1).normal(size=(100, 8, 3)) * 1e-4
    assert fit_size(markers, Hand.scaled()) is None
    assert len(FINGERS) == 4
