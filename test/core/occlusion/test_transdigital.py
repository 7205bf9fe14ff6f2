"""How digits move together, learned and not yet learned."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.occlusion.transdigital import (
    MOVE_FLOOR,
    PRIOR_MOTION,
    PRIOR_MOVE,
    VELOCITY_HORIZON,
    learn,
    limit_neighbour_difference,
    nothing_learned,
    prior_correlation,
    regress_hidden,
    write_own_motion,
)

PRIOR_LINKS = .6, .8, .7
STEP = 1. / 60.
PLACES = np.random.default_rng(1).normal(scale=.05, size=(5, 3))


def history(seed, frames=200):
    """Return places and velocities of correlated digits, shape (n, 5, 3) each."""
    rng = np.random.default_rng(seed)
    mix = rng.normal(size=(15, 15))
    waves = np.sin(rng.uniform(.02, .2, 15) * np.arange(frames)[:, None] + rng.uniform(0., 6., 15))
    places = (.01 * waves @ mix).reshape(frames, 5, 3)
    return PLACES + places, np.gradient(places, axis=0) / STEP


def learned(places, velocities, memory=7.):
    statistics = nothing_learned().statistics
    for x, v in zip(places, velocities):
        learn(statistics, x, v, STEP, memory)
    return statistics


def coefficients_of(statistics, hidden, places=PLACES, links=PRIOR_LINKS):
    found = np.full((15, 15), 7.)
    mask = np.zeros(5, dtype=bool)
    mask[list(hidden)] = True
    regress_hidden(statistics, prior_correlation(*links), places, mask, found)
    return found


def rows_of(digits):
    return np.array([3 * digit + k for digit in digits for k in range(3)], dtype=int)


@pytest.mark.parametrize('hidden', [(2,), (0, 4), (1, 2), (0, 1, 2, 3)])
@pytest.mark.parametrize('memory', [.5, 7., 600.])
def test_shares_are_those_of_an_explicit_ridge_regression_on_the_history(hidden, memory):
    places, velocities = history(3)
    now = places[-1] + .004
    coefficients = coefficients_of(learned(places, velocities, memory), hidden, now)

    # Every past frame twice, as a move to now and as a velocity over the horizon, and the prior
    # as moves of its own.
    weight = STEP * np.exp(-STEP / memory * np.arange(len(places))[::-1])
    root = np.linalg.cholesky(prior_correlation(*PRIOR_LINKS) + 1e-15 * np.eye(15))
    rows = np.vstack((
        np.sqrt(weight)[:, None] * (places - now).reshape(-1, 15),
        np.sqrt(weight)[:, None] * VELOCITY_HORIZON * velocities.reshape(-1, 15),
        PRIOR_MOVE * root.T))
    unseen = rows_of(hidden)
    seen = np.setdiff1d(np.arange(15), unseen)
    ridge = np.sqrt(weight.sum() + 1.) * MOVE_FLOOR * np.eye(len(seen))
    expected = np.linalg.lstsq(np.vstack((rows[:, seen], ridge)), np.vstack((
        rows[:, unseen], np.zeros((len(seen), len(unseen))))), rcond=None)[0]
    np.testing.assert_allclose(coefficients[np.ix_(unseen, seen)], expected.T, atol=1e-8)
    assert (coefficients[seen] == 0.).all() and (coefficients[:, unseen] == 0.).all()


def test_before_anything_is_learned_the_prior_alone_counts():
    coefficients = coefficients_of(nothing_learned().statistics, (3,))
    kept = PRIOR_MOVE ** 2 / (PRIOR_MOVE ** 2 + MOVE_FLOOR ** 2)
    ring, middle, index = (coefficients[9:12, rows_of((digit,))] for digit in (2, 1, 0))
    np.testing.assert_allclose(ring, PRIOR_LINKS[2] * kept * np.eye(3), atol=.02)
    # What lies beyond the neighbour adds little to it.
    assert abs(middle).max() < .02 and abs(index).max() < .02
    assert (coefficients[9:12, 12:] == 0.).all(), 'the thumb tells nothing of fingers'


def test_before_anything_is_learned_the_thumb_is_free():
    assert (coefficients_of(nothing_learned().statistics, (4,)) == 0.).all()


def test_links_of_fingers_multiply():
    prior = prior_correlation(*PRIOR_LINKS)
    np.testing.assert_array_equal(prior[:3, :3], np.eye(3))
    np.testing.assert_allclose(prior[0:3, 3:6], .6 * np.eye(3))
    np.testing.assert_allclose(prior[9:12, 0:3], .6 * .8 * .7 * np.eye(3))
    assert (prior[12:, :12] == 0.).all()
    np.testing.assert_array_equal(prior, prior.T)


@pytest.mark.parametrize('hidden', [(), (0, 1, 2, 3, 4)])
def test_without_a_marker_seen_or_one_hidden_there_are_no_shares(hidden):
    assert (coefficients_of(learned(*history(4)), hidden) == 0.).all()


def test_what_is_learned_prevails():
    """The ring finger moves against its neighbours for a while."""
    rng = np.random.default_rng(5)
    waves = np.cumsum(rng.normal(scale=.01, size=(600, 1, 3)), axis=0)
    places = PLACES + waves * np.array((1., 1., -.5, 1., 0.))[:, None]
    coefficients = coefficients_of(
        learned(places, np.gradient(places, axis=0) / STEP), (2,), places[-1])
    move = np.tile((.01, -.02, .005), (5, 1)) * np.array((1., 1., 0., 1., 0.))[:, None]
    np.testing.assert_allclose((coefficients @ move.ravel())[6:9], (-.005, .01, -.0025), atol=.001)


def test_what_is_old_is_forgotten():
    old, new = history(6), history(7, frames=900)
    both = (np.concatenate(parts) for parts in zip(old, new))
    remembered = coefficients_of(learned(*both, memory=1.), (1,), new[0][-1])
    alone = coefficients_of(learned(*new, memory=1.), (1,), new[0][-1])
    np.testing.assert_allclose(remembered, alone, atol=1e-4)


def test_a_stuck_history_is_safe():
    still = np.tile(PLACES, (500, 1, 1))
    for scale in (1., 1e3):
        coefficients = coefficients_of(learned(scale * still, 0. * still), (1, 3), scale * PLACES)
        assert np.isfinite(coefficients).all() and abs(coefficients).max() < 2.


@pytest.mark.parametrize('far', [3., 1e3, 1e6, 1e9])
def test_places_of_no_hand_give_shares_all_the_same(far):
    coefficients = coefficients_of(learned(*history(8)), (1, 3), PLACES + far)
    assert np.isfinite(coefficients).all() and abs(coefficients).max() < 10.


@pytest.mark.parametrize('far, fast', [(1e3, 0.), (0., 5.), (0., 1e5), (np.nan, 0.)])
def test_frames_of_no_hand_teach_nothing(far, fast):
    places, velocities = history(8)
    odd = places[:20] + far, velocities[:20] + fast
    statistics = learned(np.concatenate((places, odd[0])), np.concatenate((velocities, odd[1])))
    for part, expected in zip(statistics, learned(places, velocities)):
        np.testing.assert_array_equal(part, expected)


HAND = Hand.scaled()
BOUNDS = np.array((1.05, .79, .6))
MCP = [JOINTS.index(f'{finger}_mcp_flexion') for finger in ('index', 'middle', 'ring', 'little')]


def kept(flexion, seen, apart=(0., 0., 0.)):
    """Return the MCP flexions after, and the differences that were last seen."""
    angles = np.zeros(25)
    angles[MCP] = flexion
    apart = np.array(apart)
    limit_neighbour_difference(angles, np.array(seen), BOUNDS, apart, *HAND.limits.T.copy())
    assert (np.delete(angles, MCP) == 0.).all()
    return angles[MCP], apart


@pytest.mark.parametrize('flexion, seen, expected', [
    ((0., 1.4, 0., 0.), (1, 1, 1, 1), (0., 1.4, 0., 0.)),       # all are seen
    ((0., .5, .2, .3), (1, 0, 1, 1), (0., .5, .2, .3)),         # within the space
    ((0., 1.4, .8, .8), (1, 0, 1, 1), (0., 1.05, .8, .8)),      # index + 1.05
    ((1.2, 0., 1.2, 1.2), (1, 0, 1, 1), (1.2, .41, 1.2, 1.2)),  # ring - .79
    ((0., 0., 0., 1.4), (1, 1, 1, 0), (0., 0., 0., .6)),        # ring + .6
    ((1.4, 0., 0., 0.), (0, 1, 1, 1), (1.05, 0., 0., 0.)),      # middle + 1.05
    ((1.3, 0., 0., 0.), (1, 0, 0, 0), (1.3, .25, 0., 0.)),      # one follows, the next within
    ((1.48, -.17, -.17, -.17), (1, 0, 0, 0), (1.48, .43, -.17, -.17)),
    ((0., 0., 0., 1.4), (0, 0, 0, 1), (0., .01, .8, 1.4))])     # and from the other end
def test_hidden_fingers_go_to_the_nearest_point_of_their_space(flexion, seen, expected):
    found, _ = kept(flexion, np.array(seen, dtype=bool))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_fingers_seen_farther_apart_may_stay_so():
    seen = np.ones(4, dtype=bool)
    _, apart = kept((0., 1.4, .2, .2), seen)
    np.testing.assert_allclose(apart, (1.4, 1.2, 0.))
    seen[1] = False
    found, _ = kept((0., 1.4, .2, .2), seen, apart)
    np.testing.assert_allclose(found, (0., 1.4, .2, .2))


def test_limits_prevail():
    tight = HAND.limits.copy()
    tight[MCP[1]] = 0., .3
    angles = np.zeros(25)
    angles[MCP] = 1.4, .1, 1.4, 1.4
    limit_neighbour_difference(angles, np.array((True, False, True, True, True)), BOUNDS,
                               np.zeros(3), *tight.T.copy())
    assert angles[MCP[1]] == .3


def test_own_motion_is_that_learned_beside_the_prior():
    places, velocities = history(5)
    statistics, found = learned(places, velocities), np.full((15, 15), 7.)
    prior = PRIOR_MOTION * prior_correlation(*PRIOR_LINKS)
    write_own_motion(statistics, prior_correlation(*PRIOR_LINKS), found)
    np.testing.assert_allclose(found, statistics.motion + prior)
    write_own_motion(nothing_learned().statistics, prior_correlation(*PRIOR_LINKS), found)
    np.testing.assert_allclose(found, prior)
