"""Digits with several markers: still, their angles are quiet; moving, they are not late."""

import numpy as np
import pytest

from hand_tracker import Hand, HandTracker
from hand_tracker.core.inverse_kinematics.angle_average import average_angles, initial_average
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import marker_positions

RATE = 120.
NOISE = 3e-4        # [m]
MEASURED = [2, 3, 4, 7, 8, 9, 12, 13, 14, 17, 18, 19]


def tracked(hand, layout, angles):
    """Return the angles by markers with noise, at angles (n, 25) over time [rad]."""
    still = np.eye(3), np.zeros(3)
    pose = forward(joint_table(hand), angles)
    markers = marker_positions(layout.mounting(hand), pose, *still)
    markers = markers + np.random.default_rng(5).normal(scale=NOISE, size=markers.shape)
    tracker = HandTracker(hand, layout)
    return np.array([tracker.update(frame, i / RATE).angles for i, frame in enumerate(markers)])


@pytest.mark.parametrize('name', ['optitrack_hand', 'sig18_19'])
def test_a_still_hand_is_quiet(name):
    hand = Hand.scaled(.19, .088)
    angles = np.tile(hand.relaxed(), (480, 1))
    found = tracked(hand, preset_layout(name), angles)[240:]
    steps = np.degrees(np.diff(found, axis=0))[:, MEASURED]
    # Each frame by itself they are 1.2 degrees.
    assert np.sqrt((steps ** 2).mean()) < .5
    assert np.abs(np.degrees(found - angles[240:]))[:, MEASURED].mean() < .6


def test_a_tapping_finger_is_followed():
    hand, layout = Hand.scaled(.19, .088), preset_layout('sig18_19')
    time = np.arange(480) / RATE
    angles = np.tile(hand.relaxed(), (480, 1))
    angles[:, 2] += .3 * np.sin(2. * np.pi * 6. * time)
    found = tracked(hand, layout, angles)
    phase = np.exp(2j * np.pi * 6. * time[240:])
    truth, answer = (phase @ (a[240:, 2] - a[240:, 2].mean()) for a in (angles, found))
    assert abs(answer / truth) == pytest.approx(1., abs=.05)
    assert abs(np.angle(answer / truth)) / (2. * np.pi * 6.) < .002


def averaged(solved, factor, step=1. / RATE):
    """Return averages of a digit's angles (n, 5), all components of a fit with this factor."""
    state = initial_average(np.zeros(25))
    found = []
    for angles in solved:
        average_angles(state, 0, (0, 5), angles.copy(), factor, step)
        found.append(state.angles[:5].copy())
    return np.array(found)


def test_what_joints_do_together_is_followed_though_each_is_uncertain():
    # Noise of a tenth of the fit's deviations: two joints against each other are known badly.
    jacobian = np.array(((1., 1., 1., 1., 1.), (0., .1, 0., .2, 1.)))
    matrix = 1e4 * jacobian.T @ jacobian + np.eye(5)
    factor = np.linalg.cholesky(matrix)
    noise = .1 * np.random.default_rng(1).normal(size=(600, 5)) @ np.linalg.inv(factor)
    move = np.where(np.arange(600) < 400, 0., .02)[:, None] * np.ones(5)
    found = averaged(noise + move, factor)
    before, after = slice(300, 400), slice(400, 405)
    assert found[before].std(axis=0).max() < .4 * noise.std(axis=0).max()
    np.testing.assert_allclose(found[after].sum(axis=1), .1, atol=.01)


def test_averaging_begins_anew_after_a_gap():
    factor = 100. * np.eye(5)
    state = initial_average(np.zeros(25))
    for number in range(20):
        average_angles(state, 2, (0, 5), np.full(5, .3 + 1e-3 * (number % 2)), factor, .01)
    state.consecutive[10:15] = 0
    average_angles(state, 2, (0, 5), np.full(5, .3007), factor, .01)
    assert (state.angles[10:15] == .3007).all()
    assert (state.angles[:10] == 0.).all()


def test_frames_of_one_time_do_not_learn_noise():
    factor = 100. * np.eye(5)
    state = initial_average(np.zeros(25))
    before = state.noise_variance.copy()
    for number in range(9):
        average_angles(state, 0, (0, 5), np.full(5, 1e-2 * (number % 2)), factor, 0.)
    assert (state.noise_variance == before).all()
    assert (state.angles[:5] == 0.).all()
