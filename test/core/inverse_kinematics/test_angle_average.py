"""Digits with several markers: still, their angles are quiet; moving, they are not late."""

import math

import numpy as np
import pytest

from hand_tracker import Hand, HandTracker, TrackerOptions
from hand_tracker.core.inverse_kinematics.angle_average import average_angles, initial_average
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import marker_positions

RATE = 120.
NOISE = 3e-4        # [m]
MEASURED = [2, 3, 4, 7, 8, 9, 12, 13, 14, 17, 18, 19]


def tracked(hand, layout, angles, options=None):
    """Return the angles by markers with noise, at angles (n, 25) over time [rad]."""
    still = np.eye(3), np.zeros(3)
    pose = forward(joint_table(hand), angles)
    markers = marker_positions(layout.mounting(hand), pose, *still)
    markers = markers + np.random.default_rng(5).normal(scale=NOISE, size=markers.shape)
    tracker = HandTracker(hand, layout, options or TrackerOptions())
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


@pytest.mark.parametrize('rate', [120., 480.])
def test_noise_is_learned_and_averaged(rate):
    noise = np.random.default_rng(2).normal(scale=1e-3, size=(int(4 * rate), 5))
    factor = 100. * np.eye(5)
    state = initial_average(np.zeros(25))
    found = []
    for angles in noise:
        average_angles(state, 0, (0, 5), angles.copy(), factor, 1. / rate)
        found.append(state.angles[:5].copy())
    np.testing.assert_allclose(np.sqrt(state.noise_variance[:5]), .1, rtol=.35)
    assert np.array(found)[int(2 * rate):].std() < .4e-3


def test_a_drift_within_the_noise_is_followed():
    time = np.arange(1200) / RATE
    noise = np.random.default_rng(4).normal(scale=1e-3, size=(1200, 5))
    drift = 1e-3 * np.sin(.5 * np.pi * time)[:, None] * np.ones(5)
    found = averaged(noise + drift, 100. * np.eye(5))
    assert np.sqrt(((found - drift)[360:] ** 2).mean()) < .5e-3


def test_a_frame_of_the_same_time_neither_tells_noise_nor_begins_anew():
    noise = np.random.default_rng(6).normal(scale=1e-3, size=(240, 5))
    factor = 100. * np.eye(5)
    state = initial_average(np.zeros(25))
    for angles in noise:
        average_angles(state, 0, (0, 5), angles.copy(), factor, 1. / RATE)
    before, learned = state.angles[:5].copy(), state.noise_variance.copy()
    for sign in (1., -1., 1.):
        average_angles(state, 0, (0, 5), np.full(5, sign * 1e-3), factor, 0.)
    assert (state.noise_variance == learned).all()
    assert np.abs(state.angles[:5] - before).max() < .4e-3
    # What moves beyond the noise does so at the same time, too.
    average_angles(state, 0, (0, 5), np.full(5, .1), factor, 0.)
    np.testing.assert_allclose(state.angles[:5], .1, atol=.01)


@pytest.mark.parametrize('hidden', ['digit', 'hand'])
def test_averages_begin_anew_after_a_gap(hidden):
    hand, layout = Hand.scaled(.19, .088), preset_layout('sig18_19')
    pose = forward(joint_table(hand), hand.relaxed())
    markers = marker_positions(layout.mounting(hand), pose, np.eye(3), np.zeros(3))
    tracker = HandTracker(hand, layout)
    gone = [hidden == 'hand' or place.startswith('index_') and place != 'index_mcp'
            for place in layout.places]
    for number in range(60):
        frame = markers.copy()
        if number >= 40:
            frame[gone] = np.nan
        tracker.update(frame, number / RATE)
    consecutive = tracker._state.average.consecutive
    assert consecutive[1] == 0
    # The arch is kept, but no noise is learned across the gap.
    assert (consecutive[[0, 5, 10, 15]] == (1 if hidden == 'hand' else 3)).all()
    assert (consecutive[[6, 11, 16, 20]] == (0 if hidden == 'hand' else 3)).all()


def test_without_the_angle_filter_each_frame_counts_alone():
    hand, layout = Hand.scaled(.19, .088), preset_layout('sig18_19')
    angles = np.tile(hand.relaxed(), (240, 1))
    steps = [np.diff(tracked(hand, layout, angles, TrackerOptions(angle_filter=on)), axis=0)
             for on in (True, False)]
    filtered, alone = (np.sqrt((step[120:, MEASURED] ** 2).mean()) for step in steps)
    assert filtered < .6 * alone


def test_the_misfit_of_bones_goes_with_them():
    long, layout = Hand.scaled(.209, .0968), preset_layout('sig18_19')
    hand = Hand.scaled(.19, .088)
    bent = hand.relaxed()
    bent[[2, 3, 7, 8]], bent[[4, 9]] = .6, .4
    pose = forward(joint_table(hand), bent)
    markers = marker_positions(layout.mounting(hand), pose, np.eye(3), np.zeros(3))
    tracker = HandTracker(long, layout)
    for number in range(120):
        tracker.update(markers, number / RATE)
    assert tracker._state.rows.misfit[0] > 2.
    tracker.configure(hand=hand)
    assert (tracker._state.rows.misfit == 1.).all()
    fresh = HandTracker(hand, layout)
    for number in range(120, 240):
        state, other = (one.update(markers, number / RATE) for one in (tracker, fresh))
    assert tracker._state.rows.misfit.max() < 1.
    np.testing.assert_allclose(state.angles, other.angles, atol=np.radians(.2))


def test_a_fast_motion_at_a_low_rate_is_not_taken_for_noise():
    hand, layout = Hand.scaled(.19, .088), preset_layout('sig18_19')
    time = np.arange(180) / 30.
    angles = np.tile(hand.relaxed(), (180, 1))
    angles[:, [2, 3]] += .17 * np.sin(2. * np.pi * 4. * time)[:, None]
    pose = forward(joint_table(hand), angles)
    markers = marker_positions(layout.mounting(hand), pose, np.eye(3), np.zeros(3))
    markers = markers + np.random.default_rng(5).normal(scale=1e-4, size=markers.shape)
    off = []
    for is_averaged in (True, False):
        tracker = HandTracker(hand, layout, TrackerOptions(angle_filter=is_averaged))
        found = np.array([tracker.update(frame, t).angles for frame, t in zip(markers, time)])
        off.append((found - angles)[60:, 3].std())
    # Three times as far by third differences.
    assert off[0] < 1.3 * off[1]


@pytest.mark.parametrize('pause', [4, 8, 20])
def test_interruptions_of_a_moving_average_teach_no_noise(pause):
    factor = 100. * np.eye(5)
    solved = .05 * np.arange(900) + np.random.default_rng(3).normal(scale=1e-3, size=900)
    state = initial_average(np.zeros(25))
    for number, angle in enumerate(solved):
        if number > 480 and number % pause == 0:
            state.consecutive[0] = min(state.consecutive[0], 1)
        average_angles(state, 0, (0, 1), np.full(5, angle), factor, 1. / RATE)
    assert math.sqrt(state.noise_variance[0]) == pytest.approx(.1, rel=.35)
