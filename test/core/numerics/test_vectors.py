"""Vector functions of kernels, against NumPy's and SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.core.numerics.vectors import (
    off_way,
    rotate_about,
    rotate_about_y,
    solve_symmetric,
)


def test_rotations_are_those_of_scipy():
    random = np.random.default_rng(4)
    for _ in range(20):
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        angle, v = random.uniform(-4., 4.), random.normal(size=3)
        np.testing.assert_allclose(
            rotate_about(tuple(axis), angle, tuple(v)),
            Rotation.from_rotvec(angle * axis).apply(v), rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            rotate_about_y(tuple(v), angle),
            Rotation.from_euler('y', angle).apply(v), rtol=0, atol=1e-14)


def test_a_symmetric_system_is_solved_and_a_singular_one_gives_zero():
    random = np.random.default_rng(5)
    for _ in range(20):
        root = random.normal(size=(3, 3))
        matrix, m = root @ root.T + .1 * np.eye(3), random.normal(size=3)
        found = solve_symmetric(*map(tuple, matrix), tuple(m))
        np.testing.assert_allclose(found, np.linalg.solve(matrix, m), rtol=1e-9)
    flat = ((1., 0., 0.), (0., 1., 0.), (0., 0., 0.))
    assert solve_symmetric(*flat, (1., 2., 3.)) == (0., 0., 0.)


def test_a_motion_is_off_the_way_ahead_by_its_distance_from_a_segment():
    ahead = (2., 0., 0.)
    for moved, off in (((1., 3., 0.), 3.), ((2., 0., 1.), 1.), ((5., 4., 0.), 5.),
                       ((-3., 0., 4.), 5.), ((1., 0., 0.), 0.)):
        assert off_way(moved, ahead) == pytest.approx(off)
    assert off_way((3., 4., 0.), (0., 0., 0.)) == 5.
