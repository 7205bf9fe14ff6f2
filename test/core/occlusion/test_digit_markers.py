"""The digits' markers through occlusion: carried by the palm, by inertia, by each other."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.core.filtering.tracks import initial_tracks
from hand_tracker.core.model.palm_triangle import Wrist
from hand_tracker.core.occlusion.digit_markers import track_digits
from hand_tracker.core.occlusion.prediction import Observation, PredictionOptions
from hand_tracker.core.occlusion.transdigital import (
    DigitPrior,
    nothing_learned,
    prior_correlation,
)

REST = np.array(((.15, .025, 0.), (.16, .005, 0.), (.15, -.015, 0.), (.13, -.035, 0.),
                 (.09, .06, -.02)))
STEP = 1. / 120.
PRIOR = DigitPrior(REST, prior_correlation(.6, .8, .8))
STILL = np.eye(3), np.zeros(3)


class Digits:
    """Follows five markers frame by frame."""

    def __init__(self, memory=7., longest=2., relaxing=1., fading=.04):
        self.tracks, self.transdigital = initial_tracks(REST), nothing_learned()
        self.options = PredictionOptions(False, fading, True, memory, longest, relaxing)

    def see(self, local, hidden=(), pose=STILL, pushed=0., step=STEP):
        """Follow places in the palm's frame; return where they are in it, shape (5, 3)."""
        rotation, position = pose
        markers = local @ rotation.T + position
        seen = np.ones(5, dtype=bool)
        seen[list(hidden)] = False
        markers[~seen] = np.nan
        track_digits(
            Observation(markers, seen, np.full(5, 1e-4)), step, self.tracks,
            Wrist(rotation, position, np.array((True,))), self.transdigital, PRIOR,
            np.full((5, 3), pushed), self.options, True)
        return self.tracks.mean[:, :3].copy()


def wave(frame, swing=(1., 1., 1., 1., .5)):
    """Return places of digits that open and close together."""
    bend = .02 * (1. - np.cos(.05 * frame)) * np.array(swing)[:, None]
    return REST + bend * (-1., 0., -1.)


def test_seen_markers_are_taken_into_the_palms_frame():
    digits = Digits()
    pose = Rotation.from_euler('xyz', (1., 2., 3.)).as_matrix(), np.ones(3)
    local = np.random.default_rng(1).normal(scale=.1, size=(5, 3))
    np.testing.assert_allclose(digits.see(local, pose=pose), local, atol=1e-12)
    assert digits.tracks.known.all()


def test_a_hidden_marker_moves_with_the_palm():
    digits = Digits()
    local = REST + .01
    for _ in range(20):
        digits.see(local)
    pose = Rotation.from_euler('xyz', (1., 2., 3.)).as_matrix(), np.ones(3)
    np.testing.assert_allclose(digits.see(local, (2,), pose), local, atol=1e-9)


@pytest.mark.parametrize('memory', [0., 7.])
def test_a_hidden_marker_goes_on_and_its_own_motion_fades(memory):
    digits = Digits(memory)
    speed = np.zeros((5, 3))
    speed[1] = .2, 0., -.3
    for frame in range(60):
        places = REST + speed * STEP * frame
        digits.see(places)
    path = np.array([digits.see(places, (1,))[1] for _ in range(120)])
    steps = np.diff(np.vstack((places[1], path)), axis=0)
    np.testing.assert_allclose(steps[0], speed[1] * STEP, rtol=.3)
    assert (np.diff(steps @ speed[1]) <= 1e-12).all()
    assert np.linalg.norm(steps[-1]) < 1e-6


@pytest.mark.parametrize('hidden', [(1,), (1, 2), (0, 3)])
def test_hidden_digits_follow_those_that_they_moved_with(hidden):
    errors = {}
    for memory in (0., 7.):
        digits = Digits(memory)
        for frame in range(500):
            digits.see(wave(frame))
        found = [digits.see(wave(frame), hidden) - wave(frame) for frame in range(500, 560)]
        errors[memory] = np.linalg.norm(found, axis=2)[:, list(hidden)].max()
    assert errors[7.] < .003 and errors[7.] < .2 * errors[0.]


def test_a_digit_that_moved_alone_is_not_dragged_along():
    digits = Digits()
    for frame in range(500):
        digits.see(wave(frame, (1., 0., 1., 1., 1.)))
    for frame in range(500, 560):
        found = digits.see(wave(frame, (1., 0., 1., 1., 1.)), (1,))
    np.testing.assert_allclose(found[1], REST[1], atol=.005)


@pytest.mark.parametrize('before, after', [((1,), (1, 2)), ((1, 2), (1,)), ((1, 3), (1, 0))])
def test_a_neighbour_that_vanishes_or_comes_back_makes_no_jump(before, after):
    digits = Digits()
    for frame in range(500):
        digits.see(wave(frame))
    path = [wave(499)[1]]
    for frame in range(500, 560):
        # The neighbour comes back elsewhere than it was predicted.
        local = wave(frame)
        local[2] += .02 * (frame - 500) / 60.
        path.append(digits.see(local, before if frame < 530 else after)[1])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    fastest = np.linalg.norm(np.diff([wave(frame)[1] for frame in range(500)], axis=0), axis=1)
    assert steps.max() < 1.5 * fastest.max()


def test_no_digit_in_sight_holds_all():
    digits = Digits()
    for _ in range(60):
        digits.see(REST + .01)
    for _ in range(60):
        found = digits.see(REST, range(5))
    np.testing.assert_allclose(found, REST + .01, atol=1e-6)


def test_what_touches_a_hidden_digit_carries_it():
    digits = Digits(0.)
    digits.see(REST)
    found = digits.see(REST, (2,), pushed=.001)
    np.testing.assert_allclose(found - REST, np.outer((0, 0, 1, 0, 0), np.full(3, .001)),
                               atol=1e-9)


@pytest.mark.parametrize('relaxing, share', [(.5, 1.), (0., 0.)])
def test_a_stale_digit_relaxes_or_holds(relaxing, share):
    digits = Digits(longest=.5, relaxing=relaxing)
    raised = REST + np.array((0., 0., .03)) * (np.arange(5) == 1)[:, None]
    # Usual is rest, where it was for long.
    for _ in range(1200):
        digits.see(REST)
    for _ in range(60):
        digits.see(raised)
    for _ in range(58):
        found = digits.see(REST, (1,))
    np.testing.assert_allclose(found[1], raised[1], atol=.002)
    path = [digits.see(REST, (1,))[1] for _ in range(600)]
    gone = (raised[1] - path[-1])[2] / .03
    # Where it was raised is usual too, a little.
    assert gone == pytest.approx(share, abs=.15)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < .03 * 1.1 * STEP / .5


def test_one_that_was_never_seen_is_where_its_neighbours_tell():
    digits = Digits()
    bent = REST + (-.03, 0., -.03)
    for _ in range(1200):
        found = digits.see(bent, (2,))
    assert not digits.tracks.known[2]
    assert np.linalg.norm(found[2] - bent[2]) < .35 * np.linalg.norm(bent[2] - REST[2])


def test_while_one_is_hidden_nothing_is_learned():
    digits = Digits()
    for frame in range(100):
        digits.see(wave(frame))
    weight = digits.transdigital.statistics.weight[0]
    for frame in range(100, 200):
        digits.see(wave(frame), (3,))
    assert weight > 0. and digits.transdigital.statistics.weight[0] == weight


@pytest.mark.parametrize('wrong', [0, 1, 2])
def test_seconds_of_jumps_do_not_spoil_what_was_learned(wrong):
    """Those of the digit that is hidden later, or of a neighbour that tells of it."""
    rng = np.random.default_rng(wrong)
    errors = {}
    for memory in (0., 7.):
        digits = Digits(memory)
        for frame in range(800):
            local = wave(frame)
            if 400 <= frame < 700 and frame // 12 % 2:
                local[wrong] += .06 * rng.choice((-1., 1.), 3)
            digits.see(local)
        found = [digits.see(wave(frame), (1,))[1] - wave(frame)[1] for frame in range(800, 860)]
        errors[memory] = np.linalg.norm(found, axis=1).max()
    assert errors[7.] < .005 and errors[7.] < .4 * errors[0.]
