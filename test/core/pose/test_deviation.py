"""Deviations of angles: how a marker moves with them, limits, hidden markers, couplings."""

import numpy as np
import pytest

from hand_tracker.core.filtering.tracks import initial_tracks
from hand_tracker.core.inverse_kinematics.digit import MEASURED_SPREAD, digit_chains
from hand_tracker.core.model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.model.palm_triangle import wrist_at_origin
from hand_tracker.core.pose.deviation import (
    ACROSS_DIGIT,
    HIDDEN_TIME,
    LIMITS_SHARE,
    MODEL_DEVIATION,
    REFUTING_MISFIT,
    SADDLE_DEVIATION,
    SHARED_ERROR,
    SHOWN_JOINTS,
    mean_confidence,
    unknown_deviation,
)
from hand_tracker.core.pose.report import blank_report, write_deviation, write_pose
from hand_tracker.core.tracker import HandTracker

HAND = Hand.scaled(thumb_axis_distance=.02)
LAYOUT = MarkerLayout()
MOUNTING = LAYOUT.principal_mounting(HAND)
UNKNOWN = unknown_deviation(HAND.limits)
NOTHING = np.zeros(len(JOINTS))
STEP = 1e-5  # [rad] of differences


def bent(degrees):
    """Return angles of a hand whose digits are all bent, the last joints coupled [rad]."""
    angles = HAND.relaxed()
    angles[FLEXION_JOINTS[:, :2]] = np.radians((.5 * degrees, degrees))
    return HAND.coupled(np.clip(angles, *HAND.limits.T), HAND.limits)


def deviations(angles, noise=0., palm_noise=0., hidden_for=0., several=NOTHING, offset=NOTHING,
               placed=True, change=lambda chains: chains, residuals=np.nan):
    """Return the deviations of a pose of the mean hand whose digits are known, (25,) [rad]."""
    report, chains = blank_report(), change(digit_chains(HAND, MOUNTING))
    write_pose(joint_table(HAND), angles, chains.lower, chains.upper, wrist_at_origin(),
               np.ones(3), report)
    report.residuals[:] = residuals
    palm, digits = initial_tracks(MOUNTING.position[:3]), initial_tracks(np.zeros((5, 3)))
    palm.covariance[:, :3, :3] = palm_noise ** 2 * np.eye(3)
    digits.covariance[:, :3, :3] = noise ** 2 * np.eye(3)
    digits.known[:], digits.seen[:], digits.hidden_for[:] = True, hidden_for == 0., hidden_for
    write_deviation(chains, MOUNTING, palm, digits, several, offset, placed, report)
    return report.deviation


def confidences(frames, tracker=None, first=0):
    """Return the confidence in each frame of markers at 120 Hz, from frame `first` on."""
    tracker, rows = tracker or HandTracker(HAND), np.arange(len(JOINTS))
    return [mean_confidence(tracker.update(markers, frame / 120.).deviation, rows, UNKNOWN)
            for frame, markers in enumerate(frames, first)]


def combined(variance, unknown):
    return 1. / np.sqrt(1. / variance + 1. / unknown ** 2)


def marker_at(digit, angles):
    """Return a digit's marker in the wrist's frame [m]."""
    return marker_positions(MOUNTING, forward(joint_table(HAND), angles))[3 + digit]


def derivative(digit, angles, change):
    """Return the derivative of the marker's place by a change of the angles [m/rad]."""
    return (marker_at(digit, angles + STEP * change)
            - marker_at(digit, angles - STEP * change)) / (2. * STEP)


@pytest.mark.parametrize('digit', range(5))
@pytest.mark.parametrize('degrees', [3., 30., 70.])
def test_a_marker_tells_of_angles_by_how_far_it_moves_with_them(digit, degrees):
    angles = bent(min(degrees, 25.) if digit == 4 else degrees)
    first, second, third = FLEXION_JOINTS[digit]
    abduction = ABDUCTION_JOINTS[digit]
    noise = 1e-3
    found = deviations(angles, noise)
    one = np.eye(len(JOINTS))
    bends = one[second] + HAND.coupling[digit, 0] * one[third]
    pose = forward(joint_table(HAND), angles)
    marker = marker_at(digit, angles) - pose.position[first]
    reach = np.linalg.norm(marker)
    along = noise ** 2 + MODEL_DEVIATION ** 2
    # The second by the reach: its first and, straight, its second derivative.
    change = derivative(digit, angles, bends) @ marker / reach
    bone = pose.position[second] - pose.position[first]
    curvature = max(bone @ (marker - bone), 0.) / reach
    variance = 1. / (change ** 2 / along + curvature / (2. * np.sqrt(along))
                     + HAND.natural_flexion[digit, 2] ** -2)
    assert found[second] == pytest.approx(combined(variance, UNKNOWN[second]), rel=1e-6)
    # The first by the direction, once the second is known.
    turned = derivative(digit, angles, one[first])
    lean = derivative(digit, angles, bends) @ turned / (turned @ turned)
    variance = along / (turned @ turned) + lean ** 2 * variance
    assert found[first] == pytest.approx(combined(variance, UNKNOWN[first]), rel=1e-6)
    aside = derivative(digit, angles, one[abduction])
    variance = (noise ** 2 + (ACROSS_DIGIT * MODEL_DEVIATION) ** 2) / (aside @ aside) + (
        SADDLE_DEVIATION ** 2 if digit == 4 else 0.)
    assert found[abduction] == pytest.approx(combined(variance, UNKNOWN[abduction]), rel=1e-6)
    variance = (HAND.coupling[digit, 0] * found[second]) ** 2 + HAND.coupling_spread[digit] ** 2
    assert found[third] == pytest.approx(combined(variance, UNKNOWN[third]), rel=1e-6)


def test_a_straight_finger_is_bent_less_surely_than_a_bent_one():
    pip = FLEXION_JOINTS[:4, 1]
    assert (deviations(bent(2.))[pip] > 1.8 * deviations(bent(80.))[pip]).all()


@pytest.mark.parametrize('marker', [1, 4])  # of the palm and of a finger
def test_angles_are_known_by_no_more_than_their_markers_fit(marker):
    off = np.full(8, 1e-5)
    close = deviations(bent(40.))
    assert deviations(bent(40.), residuals=off) == pytest.approx(close, rel=1e-4)
    off[marker] = 5e-3
    found = deviations(bent(40.), residuals=off)
    rows = ABDUCTION_JOINTS[1], *FLEXION_JOINTS[1]
    for row in rows:
        assert 1.02 * close[row] < found[row] < UNKNOWN[row]
    if marker == 4:
        others = np.delete(np.arange(len(JOINTS)), rows)
        assert found[others] == pytest.approx(close[others], rel=.04)


def test_a_marker_far_off_the_hand_tells_nothing_of_its_digit():
    off = np.full(8, 1e-3)
    off[4] = REFUTING_MISFIT
    found = deviations(bent(40.), residuals=off)
    rows = [ABDUCTION_JOINTS[1], *FLEXION_JOINTS[1, :2]]
    assert found[rows] == pytest.approx(UNKNOWN[rows], rel=1e-12)
    # An angle that still goes back to its marker is off by that.
    going_back = np.where(np.arange(len(JOINTS)) == rows[1], .05, 0.)
    found = deviations(bent(40.), residuals=off, offset=going_back)
    close = deviations(bent(40.), residuals=1e-3, offset=going_back)
    assert found[rows] == pytest.approx(close[rows], rel=.01)


def test_markers_far_off_the_hand_refute_a_digit_that_meets_its_own():
    off = np.array([1e-3, 1e-3, 1e-3, .04, .04, 1e-4, .04, .04])
    found = deviations(bent(40.), residuals=off)
    assert found[SHOWN_JOINTS] == pytest.approx(UNKNOWN[SHOWN_JOINTS], rel=1e-12)


def test_a_hand_that_is_refuted_stays_so_while_its_markers_are_hidden():
    right = marker_positions(MOUNTING, forward(joint_table(HAND), bent(60.)))
    wrong = right * (1., 1., -1.)
    hidden = wrong.copy()
    hidden[3:7] = np.nan
    # A hand whose digits come and go, and one that is right again from 1.5 s on.
    found = confidences(60 * [right] + 40 * [wrong] + 8 * (4 * [hidden] + 6 * [wrong])
                        + 60 * [right])
    assert min(found[30:60]) > .5
    assert max(found[84:180]) < .05
    assert min(found[220:]) > .5


def test_markers_before_the_palm_is_placed_refute_nothing():
    markers = marker_positions(MOUNTING, forward(joint_table(HAND), bent(60.))) + 1.5
    first = markers.copy()
    first[1] = np.nan
    assert min(confidences([first] + 10 * [markers])[1:]) > .5


def test_what_was_far_off_and_is_hidden_is_forgotten():
    markers = marker_positions(MOUNTING, forward(joint_table(HAND), bent(60.)))
    hidden = markers.copy()
    hidden[1] = np.nan
    found = []
    for misfit in (0., .02):
        tracker = HandTracker(HAND)
        confidences(60 * [markers], tracker)
        tracker._state.palm.misfit[1] = misfit
        found.append(confidences(600 * [hidden], tracker, 60))
    never, once = found
    assert once[5] < .8 * never[5] and once[-1] == pytest.approx(never[-1], abs=.01)


def test_another_hand_is_not_refuted_by_the_former_ones_misfits():
    tracker = HandTracker(Hand.scaled(length=.15))
    markers = marker_positions(MOUNTING, forward(joint_table(HAND), bent(60.)))
    hidden = markers.copy()
    hidden[4] = np.nan
    confidences(120 * [markers] + [hidden], tracker)
    assert max(tracker._state.palm.misfit.max(), tracker._state.digits.misfit.max()) > .004
    tracker.configure(HAND)
    assert tracker._state.palm.misfit.max() == tracker._state.digits.misfit.max() == 0.


def test_noise_of_a_marker_and_of_the_palm_add():
    shown = np.concatenate((ABDUCTION_JOINTS, FLEXION_JOINTS.ravel()))
    quiet = deviations(bent(30.))[shown]
    np.testing.assert_allclose(deviations(bent(30.), .003, .004), deviations(bent(30.), .005))
    assert (deviations(bent(30.), .005)[shown] > quiet).all()


def test_what_nothing_shows_has_a_share_of_its_range():
    unknown = LIMITS_SHARE * np.ptp(HAND.limits, axis=1)
    np.testing.assert_allclose(UNKNOWN, unknown)
    np.testing.assert_allclose(deviations(bent(30.), placed=False), unknown)
    found = deviations(bent(30.))
    alone = [i for i, name in enumerate(JOINTS) if name == 'thumb_mcp_abduction'
             or name.endswith('cmc_flexion') and not name.startswith('thumb')]
    np.testing.assert_allclose(found[alone], unknown[alone])
    assert (found <= unknown + 1e-12).all()


def test_a_hidden_digit_goes_over_to_the_unknown():
    shown = np.concatenate((ABDUCTION_JOINTS, FLEXION_JOINTS[:, :2].ravel()))
    seen, long = deviations(bent(30.))[shown], deviations(bent(30.), hidden_for=9.)[shown]
    np.testing.assert_allclose(long, UNKNOWN[shown], rtol=1e-6)
    half = deviations(bent(30.), hidden_for=.5 * HIDDEN_TIME * np.log(2.))[shown]
    np.testing.assert_allclose(half ** 2, .5 * (seen ** 2 + UNKNOWN[shown] ** 2))


def test_a_last_joint_that_is_measured_is_known():
    def measured(chains):
        chains.coupling_spread[:], chains.coupling[:, 0] = MEASURED_SPREAD, 0.
        return chains
    assert (deviations(bent(30.), change=measured)[FLEXION_JOINTS[:, 2]] < .011).all()


def test_a_digit_with_several_markers_is_as_sure_as_they_are():
    pip, dip = FLEXION_JOINTS[0, 1:]
    several = NOTHING.copy()
    several[pip] = .02
    found = deviations(bent(3.), several=several)
    assert found[pip] == pytest.approx(combined((SHARED_ERROR * .02) ** 2, UNKNOWN[pip]))
    assert found[dip] == deviations(bent(3.))[dip]
    # Of a hidden one they say nothing.
    assert deviations(bent(3.), several=several, hidden_for=.1)[pip] > .1


def test_an_angle_that_goes_back_to_its_marker_is_off_by_the_way():
    pip = FLEXION_JOINTS[1, 1]
    offset = NOTHING.copy()
    offset[pip] = -.4
    still = deviations(bent(30.))[pip]
    assert deviations(bent(30.), offset=offset)[pip] == pytest.approx(np.hypot(still, .4))
    hidden = deviations(bent(30.), hidden_for=.1)[pip]
    assert deviations(bent(30.), offset=offset, hidden_for=.1)[pip] == hidden


def test_an_angle_is_off_by_no_more_than_the_range_of_its_joint():
    pip = FLEXION_JOINTS[1, 1]
    offset = NOTHING.copy()
    # Limits that were set while it goes back leave it less.
    offset[pip] = 2. * np.ptp(HAND.limits[pip])
    assert deviations(bent(30.), offset=offset)[pip] == np.ptp(HAND.limits[pip])


def test_markers_at_all_joints_show_more_than_eight():
    joints = np.concatenate((FLEXION_JOINTS.ravel(), ABDUCTION_JOINTS))
    found = []
    for layout in (LAYOUT, preset_layout('kyutech23')):
        tracker = HandTracker(HAND, layout)
        markers = marker_positions(layout.mounting(HAND), forward(joint_table(HAND), bent(5.)))
        for frame in range(20):
            state = tracker.update(markers, frame / 120.)
        assert (state.deviation[joints] > 0.).all()
        found.append(state.deviation[FLEXION_JOINTS[:4, 1]])
    assert (found[1] < .65 * found[0]).all()


def test_confidence_is_the_share_of_the_variance_that_is_gone():
    rows = np.arange(len(JOINTS))
    assert mean_confidence(NOTHING, rows, UNKNOWN) == 1.
    assert mean_confidence(UNKNOWN, rows, UNKNOWN) == 0.
    assert mean_confidence(.5 * UNKNOWN, rows, UNKNOWN) == pytest.approx(.75)
    # More than unknown is not less than nothing, and a locked hand is known.
    assert mean_confidence(3. * UNKNOWN, rows, UNKNOWN) == 0.
    assert mean_confidence(NOTHING, rows, NOTHING) == 1.
    several, unknown = np.concatenate((UNKNOWN, NOTHING)), np.tile(UNKNOWN, 2)
    assert mean_confidence(several, rows + 25, unknown) == 1.
    assert mean_confidence(several, rows, unknown) == 0.
    one = NOTHING.copy()
    one[FLEXION_JOINTS[2, 0]] = UNKNOWN[FLEXION_JOINTS[2, 0]]
    assert mean_confidence(one, rows, UNKNOWN) == pytest.approx(14. / 15.)


@pytest.mark.parametrize('unknown', [np.nan, np.inf, 0., -1.])
def test_an_angle_without_a_deviation_of_the_unknown_is_unknown(unknown):
    rows = np.arange(len(JOINTS))
    given = UNKNOWN.copy()
    given[FLEXION_JOINTS[2, 0]] = unknown
    assert mean_confidence(.001 * UNKNOWN, rows, given) == pytest.approx(14. / 15.)
    given[:] = unknown
    assert mean_confidence(.001 * UNKNOWN, rows, given) == 0.
    assert mean_confidence(np.full(len(JOINTS), np.nan), rows, UNKNOWN) == 0.
