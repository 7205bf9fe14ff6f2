"""Rigid fit of weighted points, against SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.core.numerics.rigid_fit import fit_rigid, step_rigidly


def test_the_pose_is_that_of_least_squares():
    random = np.random.default_rng(2)
    for _ in range(100):
        count = random.integers(3, 9)
        template, weights = random.normal(size=(count, 3)), random.uniform(.1, 2., count)
        turn, move = Rotation.random(random_state=random), random.normal(size=3)
        points = turn.apply(template) + move + .05 * random.normal(size=(count, 3))
        rotation, position = np.empty((3, 3)), np.empty(3)
        fit_rigid(template, points, weights, rotation, position)
        there, here = (np.average(p, axis=0, weights=weights) for p in (template, points))
        expected, _ = Rotation.align_vectors(points - here, template - there, weights)
        assert np.allclose(rotation, expected.as_matrix(), rtol=0, atol=1e-7)
        assert np.allclose(position, here - expected.apply(there), rtol=0, atol=1e-7)


@pytest.mark.filterwarnings('ignore:Optimal rotation is not uniquely')
@pytest.mark.parametrize('flip', ((1., 1., 1.), (-1., 1., 1.)))
def test_points_near_a_line_and_mirrored_ones_are_fitted_as_well(flip):
    random = np.random.default_rng(4)
    for trial in range(200):
        flat, thin = 10. ** random.uniform(-3., 0., 2) if trial else (0., 0.)
        template = random.normal(size=(random.integers(3, 6), 3)) * (1., flat, flat * thin)
        template -= template.mean(axis=0)
        points = flip * Rotation.random(random_state=random).apply(template)
        points += 1e-3 * flat * random.normal(size=points.shape)
        points -= points.mean(axis=0)
        rotation, position = np.empty((3, 3)), np.empty(3)
        fit_rigid(template, points, np.ones(len(points)), rotation, position)
        _, expected = Rotation.align_vectors(points, template)
        assert np.isclose(np.linalg.norm(points - template @ rotation.T), expected,
                          rtol=1e-6, atol=1e-8)
        assert np.allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=1e-10)
        assert np.isclose(np.linalg.det(rotation), 1.)


def test_the_size_is_told_apart_and_weightless_points_are_not_read():
    template = np.array(((0., 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)))
    points = 2. * template + 1.
    points[3] = np.nan
    rotation, position = np.empty((3, 3)), np.empty(3)
    size = fit_rigid(template, points, np.array((1., 1., 1., 0.)), rotation, position)
    assert np.isclose(size, 2.)
    assert np.allclose(rotation, np.eye(3), rtol=0, atol=1e-12)


def test_nothing_is_replaced_where_nothing_is_determined():
    rotation, position = np.full((3, 3), 7.), np.full(3, 7.)
    here = np.ones((3, 3))
    assert fit_rigid(here, here, np.ones(3), rotation, position) == 0.
    assert fit_rigid(here, here, np.zeros(3), rotation, position) == 0.
    assert (rotation == 7.).all() and (position == 7.).all()


def test_steps_towards_aims_keep_distances_and_end_at_the_rigid_fit():
    random = np.random.default_rng(3)
    for _ in range(20):
        count = random.integers(3, 9)
        start, weights = random.normal(size=(count, 3)), random.uniform(.1, 2., count)
        turn = Rotation.from_rotvec(.3 * random.normal(size=3))
        aims = turn.apply(start) + .1 + .02 * random.normal(size=(count, 3))
        points = start.copy()
        for _ in range(60):
            step_rigidly(points, aims, weights)
        rotation, position = np.empty((3, 3)), np.empty(3)
        fit_rigid(start, aims, weights, rotation, position)
        assert np.allclose(points, start @ rotation.T + position, rtol=0, atol=1e-7)


def test_a_step_of_points_on_a_line_only_moves_them():
    points = np.array(((0., 0, 0), (1, 0, 0), (2, 0, 0)))
    step_rigidly(points, points + (0., 1., 0.), np.ones(3))
    assert np.allclose(points, ((0, 1, 0), (1, 1, 0), (2, 1, 0)))
