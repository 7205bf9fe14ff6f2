"""The filter of a digit's angles: quiet where markers tell little, quick where they tell all."""

import numpy as np
import pytest

from hand_tracker.core.inverse_kinematics.abduction_plane import REFERENCE_STEP
from hand_tracker.core.inverse_kinematics.angle_filter import (
    FLEXION_BOUND,
    LARGEST_MISS,
    filter_angles,
    initial_angle_filter,
    observe_angle,
    pull_angle,
)
from hand_tracker.core.inverse_kinematics.digit import digit_chains, solve_digits
from hand_tracker.core.model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.occlusion.prediction import Observation

HAND = Hand.scaled()
LAYOUTS = {'paper': MarkerLayout(), 'skin': MarkerLayout(offsets=np.tile((0., 0., .011), (8, 1)))}
SECOND = FLEXION_JOINTS[:4, 1]
NOISE = 3e-4  # [m]


def posture(mcp, pip, abduction=0.):
    """Return angles with all fingers alike, coupled [rad]."""
    angles = HAND.relaxed()
    angles[FLEXION_JOINTS[:4, 0]] = mcp
    angles[SECOND] = pip
    angles[ABDUCTION_JOINTS[:4]] = abduction
    angles[FLEXION_JOINTS[:, 2]] = (
        HAND.coupling * np.column_stack((angles[FLEXION_JOINTS[:, 1]], np.ones(5)))).sum(axis=1)
    return angles


def markers_of(angles, layout):
    """Return the digits' markers in the wrist's frame, shape (5, 3) [m]."""
    return marker_positions(layout.mounting(HAND), forward(joint_table(HAND), angles))[3:]


class Filtered:
    """Angles by inverse kinematics and by the filter, frame after frame."""

    def __init__(self, layout='paper', start=None, hand=HAND):
        self.layout = LAYOUTS[layout]
        self.chains = digit_chains(hand, self.layout.mounting(hand))
        self.solved = HAND.relaxed() if start is None else start.copy()
        self.state = initial_angle_filter(self.solved)
        self.first = True

    def frame(self, markers, seen=(True,) * 5, step=REFERENCE_STEP, noise=NOISE, changed=False):
        """Return the solved and the estimated angles of a frame."""
        for _ in range(100 if self.first else 1):
            solve_digits(self.chains, self.chains.root, markers, self.solved, step, False, 0., 0)
        before = self.solved if self.first else self.state.angles.copy()
        self.first = False
        filter_angles(self.chains, self.chains.root, Observation(
            markers, np.array(seen), np.full(5, noise)), self.solved, before,
            np.full(5, changed), step, self.state)
        return self.solved.copy(), self.state.angles.copy()


def test_an_innovation_is_believed_by_as_much_as_it_exceeds_its_noise():
    gains = [observe_angle(size, 1., 1., 1., 0.)[0] / size for size in (.1, .5, .9)]
    assert gains == sorted(gains) and gains[0] < .02
    # An innovation n times its noise: the gain is n² / (n² + 1).
    correction, variance = observe_angle(.02, -2., 1e-4, 1., 0.)
    assert correction == pytest.approx(-.01 * 4. / 5.)
    assert variance == pytest.approx(1e-4 / 5.)


@pytest.mark.parametrize('slope', [0., 1e-300, -1e-12])
def test_an_observation_without_information_changes_nothing(slope):
    correction, variance = observe_angle(1e-3, slope, 1e-7, 1., .01)
    assert abs(correction) < 1e-6 and np.isfinite(variance)


def test_a_natural_angle_weighs_by_time():
    once = pull_angle(.1, 1e-3, .02, .01)
    first, variance = pull_angle(.1, 1e-3, .01, .01)
    second, variance = pull_angle(.1 - first, 1e-3, .01, variance)
    assert first + second == pytest.approx(once[0]) and variance == pytest.approx(once[1])
    assert pull_angle(.1, 1e-3, 0., .01) == (0., .01)


@pytest.mark.parametrize('layout', LAYOUTS)
@pytest.mark.parametrize('pip', [.2, .6, 1.4])
def test_a_still_marker_is_met(layout, pip):
    angles = posture(.4, pip, .05)
    filtered = Filtered(layout, angles)
    markers = markers_of(angles, filtered.layout)
    for _ in range(120):
        _, found = filtered.frame(markers, noise=1e-5)
    missed = np.linalg.norm(markers_of(found, filtered.layout) - markers, axis=1)
    assert missed.max() < 3e-5


def test_hidden_digits_stay_where_they_were_estimated_then_go_over_to_the_solved_angles():
    filtered, random = Filtered(), np.random.default_rng(1)
    place = markers_of(posture(.3, .1), filtered.layout)
    for _ in range(20):
        markers = place + random.normal(scale=NOISE, size=(5, 3))
        _, before = filtered.frame(markers)
    seen = np.array((True, False, True, False, True))
    for frame in range(600):
        solved, found = filtered.frame(markers, seen)
        for digit in np.flatnonzero(~seen):
            joints = [ABDUCTION_JOINTS[digit], *FLEXION_JOINTS[digit]]
            if frame == 0:
                np.testing.assert_allclose(found[joints], before[joints], atol=.01)
    np.testing.assert_allclose(found[SECOND[[1, 3]]], solved[SECOND[[1, 3]]], atol=1e-4)


@pytest.mark.parametrize('layout', LAYOUTS)
def test_near_straight_an_angle_is_quiet_and_its_marker_met_within_the_noise(layout):
    angles = posture(.1, .12)
    filtered, random = Filtered(layout, angles), np.random.default_rng(1)
    place = markers_of(angles, filtered.layout)
    solved, found, missed = [], [], []
    for _ in range(400):
        markers = place + random.normal(scale=.7 * NOISE, size=(5, 3))
        for kept, new in zip((solved, found), filtered.frame(markers)):
            kept.append(new[SECOND])
        missed.append([
            np.linalg.norm(markers_of(of, filtered.layout) - markers, axis=1)[:4]
            for of in (filtered.state.angles, filtered.solved)])
    steps = [np.sqrt(np.mean(np.diff(kept, axis=0)[20:] ** 2)) for kept in (solved, found)]
    assert steps[1] < .35 * steps[0]
    excess = np.array(missed)[:, 0] - np.array(missed)[:, 1]
    # The reach's bound and the plane's, which are at right angles
    assert excess.max() < min(1.5 * NOISE, LARGEST_MISS)


@pytest.mark.parametrize('offset', [.05, -.1])
def test_near_straight_a_person_s_own_flexion_decides_the_more_the_narrower_it_is(offset):
    angles = posture(.1, .1)
    place = markers_of(angles, LAYOUTS['paper'])
    shares = []
    for spread in np.radians((5., 20.)):
        random, pulled = np.random.default_rng(1), []
        usual, own = (Filtered(start=angles, hand=HAND.replace(
            natural_flexion=((0., natural, spread),) * 5)) for natural in (.1, .1 + offset))
        for _ in range(240):
            markers = place + random.normal(scale=NOISE, size=(5, 3))
            pulled.append(own.frame(markers)[1][SECOND] - usual.frame(markers)[1][SECOND])
        shares.append(np.mean(pulled) / offset)
    assert shares[0] > 1.2 * shares[1] > 0.


@pytest.mark.parametrize('beyond, share', [(0., 1.), (.003, .5)])
def test_an_estimate_that_is_far_off_stops_at_its_bound_which_is_tighter_beyond_reach(
        beyond, share):
    angles = posture(.1, .02)
    filtered = Filtered(start=angles)
    place, roots = markers_of(angles, filtered.layout), filtered.chains.root
    place[:4] += beyond * (place - roots)[:4] / np.linalg.norm(place - roots, axis=1)[:4, None]
    filtered.frame(place)
    filtered.state.angles[SECOND] = .4
    filtered.state.variance[:] = 1e-9
    missed = [np.linalg.norm(markers_of(found, filtered.layout) - place, axis=1)[:4]
              for found in filtered.frame(place, step=1e-4)]
    of_bound = (missed[1] - missed[0]) / (share * FLEXION_BOUND * NOISE)
    assert (of_bound > .7).all() and (of_bound < 1.02).all()


@pytest.mark.parametrize('pip', [.65, .75])
def test_a_marker_that_moves_with_the_skin_is_believed_less_where_it_is_blind(pip):
    # Straightest at 19 to 27 degrees: beside it a millimetre of skin is much of the bend.
    layout, angles = LAYOUTS['skin'], posture(.3, pip)
    natural = pip + .1
    hand = HAND.replace(natural_flexion=((0., natural, .15),) * 5)
    found = []
    for skin in (0., .0002, .001):
        filtered = Filtered('skin', angles, hand)
        filtered.chains = digit_chains(hand, MarkerLayout(
            layout.places, layout.offsets, np.full(8, skin)).mounting(hand))
        for _ in range(60):
            _, estimated = filtered.frame(markers_of(angles, layout), noise=1e-5)
        found.append(estimated[SECOND])
        missed = np.linalg.norm(markers_of(estimated, layout) - markers_of(angles, layout), axis=1)
        assert missed[:4].max() < max(skin, 3e-5)
    assert (np.abs(found[0] - pip) < .01).all()
    assert (found[0] < found[1]).all() and (found[1] < found[2]).all()
    assert (found[2] < natural).all()


def test_an_extended_cmc_of_the_thumb_does_not_stretch_its_mcp():
    cmc, mcp, ip = FLEXION_JOINTS[4]
    angles = posture(0., .3)
    angles[[cmc, mcp, ip]] = np.radians((-8., 4., 4.))
    still, filtered = markers_of(angles, LAYOUTS['paper']), Filtered(start=angles)
    random = np.random.default_rng(3)
    found = [filtered.frame(still + NOISE * random.standard_normal((5, 3)))[1][mcp]
             for _ in range(360)]
    # It went to 0 and stayed there.
    assert np.degrees(np.mean(found[120:])) > 2.


def test_a_bent_finger_that_moves_is_followed_at_once():
    filtered = Filtered()
    for frame in range(60):
        angles = posture(.3, .9 + .3 * np.sin(.5 * frame))
        _, found = filtered.frame(markers_of(angles, filtered.layout))
        if frame > 5:
            np.testing.assert_allclose(found[SECOND], angles[SECOND], atol=np.radians(2.5))


def test_a_digit_that_comes_back_starts_from_where_it_was_published():
    filtered = Filtered()
    open_, hidden = posture(.1, .1), (False, True, True, True, True)
    for seen in (5 * [(True,) * 5]) + 5 * [hidden]:
        filtered.frame(markers_of(open_, filtered.layout), seen)
    # Near straight its reach hardly tells: it goes on from there, rather than leap.
    _, found = filtered.frame(markers_of(posture(.1, .16), filtered.layout))
    assert abs(found[SECOND[0]] - .1) < .05
    assert np.isfinite(filtered.state.variance).all()


@pytest.mark.parametrize('hidden_frames', [0, 5])
def test_a_digit_begins_where_it_goes_on(hidden_frames):
    angles = posture(.5, .45)
    filtered, random = Filtered('skin', HAND.relaxed()), np.random.default_rng(2)
    place = markers_of(angles, filtered.layout)
    # A millimetre farther than it is: the reach alone would begin with a straight finger.
    place[:4] += .001 * place[:4] / np.linalg.norm(place[:4], axis=1)[:, None]
    for _ in range(hidden_frames):
        filtered.frame(place, (False,) * 5)
    found = [filtered.frame(place + random.normal(scale=1e-4, size=(5, 3)), noise=1e-3)[1][SECOND]
             for _ in range(12)]
    assert np.degrees(np.abs(np.diff(found, axis=0))).max() < 5.


def test_an_exactly_straight_finger_bends_to_either_side():
    for bend in (-.2, .2):
        filtered = Filtered('skin')
        straight = -filtered.chains.droop[0]
        angles = posture(.3, straight + bend)
        filtered.solved[:] = angles
        filtered.frame(markers_of(angles, filtered.layout))
        filtered.state.angles[SECOND[0]] = straight
        for _ in range(60):
            _, found = filtered.frame(markers_of(angles, filtered.layout), noise=5e-4)
        assert (found[SECOND[0]] - straight) / bend > .1


def test_no_time_passes_without_harm():
    filtered = Filtered()
    markers = markers_of(posture(.3, .5), filtered.layout)
    for step in (REFERENCE_STEP, 0., 0., 10.):
        _, found = filtered.frame(markers, step=step)
        assert np.isfinite(found).all()
        np.testing.assert_allclose(found[SECOND], .5, atol=.06)
