"""The palm's markers through occlusion."""

import numpy as np
import pytest
from helpers.palms import TEMPLATE
from scipy.spatial.transform import Rotation

from hand_tracker.core.filtering.tracks import initial_tracks
from hand_tracker.core.labelling.validity import check_palm
from hand_tracker.core.model.palm_triangle import (
    PalmLimits,
    Wrist,
    wrist_at_origin,
)
from hand_tracker.core.model.states import PalmState
from hand_tracker.core.occlusion.palm_markers import expected_markers, track_palm
from hand_tracker.core.occlusion.prediction import Observation, PredictionOptions

FINGER_POSITIONS = np.array(((.15, .025, -.02), (.16, .005, -.02), (.15, -.015, -.02),
                             (.13, -.035, -.02), (.09, .06, -.04)))
HAND = np.vstack((TEMPLATE, FINGER_POSITIONS))
STEP = 1. / 120.
LIMITS = PalmLimits(1.5, .3, .2)


class Palm:
    """Follows the palm of a hand whose digits do not move in it, frame by frame."""

    def __init__(self, by_fingers=True, longest=2., fading=.04):
        self.tracks, self.digits = initial_tracks(TEMPLATE), initial_tracks(FINGER_POSITIONS)
        self.wrist, self.shape = wrist_at_origin(), TEMPLATE.copy()
        self.options = PredictionOptions(False, fading, by_fingers, 0., longest, 0.)

    def see(self, rotation, position, hidden=(), digits=FINGER_POSITIONS):
        """Follow a frame; return its `PalmState` and the three places."""
        markers = np.vstack((TEMPLATE, digits)) @ rotation.T + position
        seen = np.ones(8, dtype=bool)
        seen[list(hidden)] = False
        markers[~seen] = np.nan
        state = track_palm(
            Observation(markers, seen, np.full(8, 1e-4)), STEP, self.tracks, self.digits,
            self.wrist, self.shape, self.options)
        if state != PalmState.WAITING:
            # The true pose, or what is left of it is measured with its own errors.
            self.wrist = Wrist(np.array(rotation), np.array(position), np.array((True,)))
            self.digits.seen[:] = seen[3:]
        return PalmState(state), self.tracks.mean[:, :3].copy()


def swing(frame, axis=(.5, -.3, .8)):
    """Return the pose of a hand that swings about."""
    turn = np.array(axis) * .4 * np.sin(.03 * frame)
    return Rotation.from_rotvec(turn).as_matrix(), np.array((.1, .2, .3)) * np.sin(.02 * frame)


@pytest.mark.parametrize('hidden', [(0,), (2, 4), (0, 1, 2)])
def test_before_the_first_whole_palm_it_waits(hidden):
    palm = Palm()
    rotation, position = swing(0)
    state, _ = palm.see(rotation, position, hidden)
    assert (state == PalmState.WAITING) == bool(set(hidden) & {0, 1, 2})
    assert palm.see(rotation, position)[0] == PalmState.TRACKED


@pytest.mark.parametrize('hidden, state', [
    ((), PalmState.TRACKED), ((1,), PalmState.CARRIED), ((0, 2), PalmState.CARRIED),
    ((0, 1, 2), PalmState.LOST)])
def test_the_state_shows_how_many_are_seen(hidden, state):
    palm = Palm()
    palm.see(*swing(0))
    assert palm.see(*swing(0), hidden)[0] == state


@pytest.mark.parametrize('hidden', [(0,), (1,), (2,), (0, 1), (1, 2), (0, 2)])
def test_hidden_markers_of_a_hand_that_moves_as_a_whole_are_found_from_the_fingers(hidden):
    errors = {}
    for by_fingers in (True, False):
        palm = Palm(by_fingers)
        for frame in range(60):
            palm.see(*swing(frame))
        for frame in range(60, 90):
            rotation, position = swing(frame)
            _, found = palm.see(rotation, position, hidden)
        errors[by_fingers] = np.linalg.norm(
            found - TEMPLATE @ rotation.T - position, axis=1).max()
    # What inertia says is weighed too, and is wrong by the turn's change in a frame.
    assert errors[True] < 1e-3
    assert errors[True] < errors[False]


@pytest.mark.parametrize('hidden', [(0,), (1,), (2,), (0, 1), (1, 2)])
def test_digits_tell_a_turn_from_how_they_usually_move(hidden):
    usual = np.array((-1., 0., -1.) * 4 + (-.3, -.8, -.3))
    palm = Palm()
    for _ in range(10):
        palm.see(*swing(0))
    palm.digits.own_motion[:] = 1e-4 * np.outer(usual, usual) / np.mean(usual ** 2)
    _, found = palm.see(*swing(0), hidden, FINGER_POSITIONS + .003 * usual.reshape(5, 3))
    assert np.linalg.norm(found - TEMPLATE, axis=1).max() < 3e-4
    rotation, position = swing(1)
    _, found = palm.see(rotation, position, hidden)
    away = np.linalg.norm(TEMPLATE @ rotation.T + position - TEMPLATE, axis=1).max()
    assert np.linalg.norm(found - TEMPLATE @ rotation.T - position, axis=1).max() < .2 * away


def test_how_much_the_palm_turns_is_learned():
    palm, spun = Palm(), 0.
    palm.options = palm.options._replace(transdigital_memory=1e6)
    for frame in range(200):
        palm.see(*swing(frame))
        spun += (.4 * .03 * np.cos(.03 * frame) / STEP) ** 2 * STEP * (.25 + .09 + .64) / 3.
    assert palm.tracks.turning[0] == pytest.approx(spun, rel=.35)


def test_a_palm_that_turned_much_turns_with_the_digits():
    turned = []
    for turning in (0., 100.):
        palm = Palm()
        for _ in range(10):
            palm.see(*swing(0))
        palm.digits.own_motion[:], palm.tracks.turning[:] = .1 * np.eye(15), turning
        rotation, position = swing(1)
        _, found = palm.see(rotation, position, (0,))
        off = np.linalg.norm(found[0] - TEMPLATE[0] @ rotation.T - position)
        turned.append(1. - off / np.linalg.norm(TEMPLATE[0] @ rotation.T + position - TEMPLATE[0]))
    assert turned[1] > turned[0] + .05


def test_a_palm_turns_about_the_line_of_further_markers():
    """Those that count as seen turn with it, as they are placed but for that turn."""
    palm = Palm()
    for _ in range(10):
        palm.see(*swing(0))
    ends = np.array(((.02, -.03, .01), (.03, .04, .01)))
    turn = Rotation.from_rotvec(.01 * (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0]))
    palm.tracks.line[:], palm.digits.own_motion[:] = ends, 1e-4 * np.eye(15)
    markers = np.vstack((TEMPLATE, turn.apply(FINGER_POSITIONS - ends[0]) + ends[0]))
    track_palm(Observation(markers, np.arange(8) != 2, np.full(8, 1e-4)), STEP, palm.tracks,
               palm.digits, palm.wrist, palm.shape, palm.options)
    np.testing.assert_allclose(
        palm.tracks.mean[:, :3], turn.apply(TEMPLATE - ends[0]) + ends[0], atol=1e-4)


def test_a_whole_palm_out_of_sight_is_found_from_the_fingers_while_predictions_hold():
    errors = []
    for longest in (2., 0.):
        palm = Palm(longest=longest)
        for frame in range(60):
            palm.see(*swing(frame))
        for frame in range(60, 80):
            rotation, position = swing(frame)
            state, found = palm.see(rotation, position, (0, 1, 2))
        assert state == PalmState.LOST
        errors.append(np.linalg.norm(found - TEMPLATE @ rotation.T - position, axis=1).max())
    assert errors[0] < .9 * errors[1]


def test_a_palm_out_of_sight_is_little_dragged_by_one_finger_after_the_other():
    palm = Palm()
    for _ in range(10):
        palm.see(*swing(0))
    stray = []
    for frame in range(120):
        digits = FINGER_POSITIONS.copy()
        digits[frame // 60, 2] -= .02 * (1. - np.cos(2. * np.pi * frame / 60.))
        _, found = palm.see(*swing(0), (0, 1, 2), digits)
        stray.append(np.linalg.norm(found - TEMPLATE, axis=1))
    assert np.max(stray) < .04 and np.mean(stray) < .013
    assert np.max(stray[-1]) < .004


def test_fingers_that_come_back_tell_nothing_yet():
    """What a finger did while hidden is no turn of the palm."""
    palm = Palm()
    for _ in range(10):
        palm.see(*swing(0))
    palm.see(*swing(0), hidden=(2, 3))
    moved = FINGER_POSITIONS + np.array(((.04, .0, -.04),) + 4 * ((0., 0., 0.),))
    _, found = palm.see(*swing(0), (2,), moved)
    np.testing.assert_allclose(found, TEMPLATE, atol=1e-9)


def test_what_is_seen_is_left_as_it_is():
    palm = Palm()
    for frame in range(5):
        palm.see(*swing(frame))
    rotation, position = swing(6)
    _, found = palm.see(rotation, position, (1,))
    np.testing.assert_allclose(found[[0, 2]], (TEMPLATE @ rotation.T + position)[[0, 2]],
                               atol=1e-12)


def test_a_palm_at_rest_stays_when_it_vanishes():
    palm = Palm()
    for _ in range(10):
        palm.see(*swing(0))
    for _ in range(200):
        _, found = palm.see(*swing(0), (0, 1, 2, 3, 4, 5, 6, 7))
    np.testing.assert_allclose(found, TEMPLATE, atol=1e-9)


def test_even_motion_is_expected_to_go_on():
    palm = Palm()
    speed = np.array((.5, -.2, .1))
    for frame in range(120):
        palm.see(np.eye(3), speed * STEP * frame)
    expected = np.empty((8, 3))
    palm.digits.mean[:, :3] = FINGER_POSITIONS
    expected_markers(palm.tracks, palm.digits, TEMPLATE, STEP, expected)
    np.testing.assert_allclose(expected, HAND + speed * STEP * 120, atol=2e-4)


@pytest.mark.parametrize('change, fault', [
    (lambda m: m, PalmState.TRACKED), (lambda m: 2. * m, PalmState.TOO_FAR_APART),
    (lambda m: .1 * m, PalmState.TOO_CLOSE), (lambda m: m[[0, 1, 1]], PalmState.COINCIDENT)])
def test_a_palm_of_no_hand_is_not_seen(change, fault):
    markers, seen = np.vstack((change(TEMPLATE), FINGER_POSITIONS)), np.ones(8, dtype=bool)
    found = check_palm(
        markers, seen, TEMPLATE, wrist_at_origin()._replace(placed=np.array((True,))), LIMITS)
    assert found == fault
    assert (seen[:3] == (fault == PalmState.TRACKED)).all() and seen[3:].all()
