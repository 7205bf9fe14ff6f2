"""FABRIK with hinge limits: agrees with the closed form, and survives its known traps."""

import numpy as np
import pytest

from hand_tracker.core.inverse_kinematics.fabrik import fabrik
from hand_tracker.core.inverse_kinematics.flexion import (
    AVERAGE_SPREAD,
    Linkage,
    NaturalFlexion,
    coupled_angle,
    solve_two_bone,
)

TWO_BONES = np.array((.045, .026))
LOWER, UPPER = np.radians((-10., -10.)), np.radians((85., 95.))
TWO_HINGES = Linkage((*TWO_BONES, 0.), 0., (*LOWER, 0.), (*UPPER, 0.), 0., 0., 2)
THREE_BONES = np.array((.045, .026, .018))


def end(angles, bones=TWO_BONES):
    headings = np.cumsum(angles)
    return np.array((bones @ np.cos(headings), -bones @ np.sin(headings)))


def solve(target, start=(0., 0.), tolerance=1e-6, iterations=5000):
    *angles, used = fabrik(*target, TWO_HINGES, tuple(start), tolerance, iterations)
    return np.array(angles), used


def test_agrees_with_the_closed_form():
    rng = np.random.default_rng(1)
    for truth in rng.uniform((LOWER[0], np.radians(10.)), UPPER, size=(300, 2)):
        found, _ = solve(end(truth), start=rng.uniform(LOWER, UPPER))
        exact = solve_two_bone(
            *end(truth), TWO_HINGES, NaturalFlexion(0., 0., AVERAGE_SPREAD), 0., 0.)
        np.testing.assert_allclose(found, exact, atol=np.radians(.2))


def test_leaves_a_straight_chain_with_a_collinear_target():
    truth = np.radians((20., 60.))
    target = end(truth)
    heading = np.arctan2(-target[1], target[0])
    found, _ = solve(target, start=(heading, 0.))
    np.testing.assert_allclose(found, truth, atol=1e-3)


def test_bends_to_the_flexion_side_only():
    found, _ = solve((.06, .0), start=np.radians((20., -10.)))
    assert found[1] > 0.


def test_more_than_ninety_degrees_is_no_obstacle():
    truth = np.radians((80., 94.))
    found, _ = solve(end(truth))
    np.testing.assert_allclose(found, truth, atol=1e-3)


def test_unreachable_targets_stop_early_with_the_best_iterate():
    for target in ((.5, 0.), (-.5, 0.), (0., .2), (0., 0.)):
        found, used = solve(target, start=(.3, .5))
        assert ((LOWER <= found) & (found <= UPPER)).all()
        assert used <= 64
    # Straight towards what is out of reach.
    np.testing.assert_allclose(solve((.5, 0.))[0], (0., 0.), atol=.1)


def test_a_good_start_is_kept_when_the_iteration_cannot_better_it():
    truth = np.radians((30., 50.))
    found, used = solve(end(truth), start=truth)
    np.testing.assert_allclose(found, truth, atol=1e-9)
    assert used == 0


def test_needs_more_iterations_the_straighter_the_finger():
    used = [solve(end(np.radians((10., pip))), start=np.radians((10., pip + 5.)),
                  tolerance=1e-5)[1] for pip in (60., 30., 12.)]
    assert used[0] < used[1] < used[2]


@pytest.mark.parametrize('slope, offset, droop', [(.4, 0., 0.), (.8, 0., .1), (1., .1, -.1)])
def test_three_hinges_keep_their_coupling_in_every_iterate(slope, offset, droop):
    linkage = Linkage(tuple(THREE_BONES), droop, (*LOWER, LOWER[1]), (*UPPER, UPPER[1]), slope,
                      offset, 3)
    rng = np.random.default_rng(2)
    for first, second in rng.uniform((LOWER[0], .2), (UPPER[0], 1.4), size=(100, 2)):
        third = coupled_angle(linkage, second)
        target = end(np.array((first, second, third + droop)), THREE_BONES)
        near = (clip_to_limits(first + rng.normal(scale=.2), 0),
                clip_to_limits(second + rng.normal(scale=.2), 1))
        found1, found2, used = fabrik(*target, linkage, near, 1e-6, 500)
        np.testing.assert_allclose((found1, found2), (first, second), atol=np.radians(.1))
        assert used > 0


def clip_to_limits(angle, hinge):
    return float(np.clip(angle, LOWER[hinge], UPPER[hinge]))
