"""The palm: the paper's construction and the rigid fit."""

import numpy as np
import pytest
from helpers.palms import placed, random_palm, vectors

from hand_tracker.core.inverse_kinematics.palm import (
    spheres_and_plane,
)
from hand_tracker.core.numerics.vectors import vector

SOUND = (1.5, 0.3, 0.2)  # stretch, shrink, flatness


def test_spheres_that_do_not_meet_give_the_centre_of_their_circle():
    point = spheres_and_plane(
        (0., 0., 0.), (.1, 0., 0.), .03, .04, (0., 0., 1.), 0., (0., 1., 0.))
    a = (.1 ** 2 + .03 ** 2 - .04 ** 2) / .2
    np.testing.assert_allclose(point, (a, 0., 0.), atol=1e-15)


def test_a_plane_that_misses_the_circle_gives_its_nearest_point():
    rng = np.random.default_rng(3)
    turn = np.linspace(0., 2. * np.pi, 100001)
    for _ in range(50):
        p, q = rng.normal(scale=.05, size=(2, 3))
        d = np.linalg.norm(q - p)
        radius = .6 * d
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        offset = normal @ p + rng.choice((-1, 1)) * 3. * d
        ours = np.array(spheres_and_plane(
            *vectors(p, q), radius, radius, vector(normal), offset, (0., 0., 1.)))
        u = (q - p) / d
        v = np.cross(u, (.3, .5, .7))
        v /= np.linalg.norm(v)
        w = np.cross(u, v)
        h = np.sqrt(radius ** 2 - d ** 2 / 4)
        circle = (p + q) / 2 + h * (np.cos(turn)[:, None] * v + np.sin(turn)[:, None] * w)
        nearest = circle[np.argmin(np.abs(circle @ normal - offset))]
        np.testing.assert_allclose(ours, nearest, atol=1e-5)


@pytest.mark.parametrize('gap', [0., 1e-300, 1e-150, 1e-20])
def test_coincident_centres_give_the_centre(gap):
    point = spheres_and_plane(
        (0., 0., 0.), (gap, 0., 0.), .04, .04, (0., 0., 1.), .02, (0., 1., 0.))
    np.testing.assert_allclose(point, (0., 0., 0.), atol=1e-12)


@pytest.mark.parametrize('tilt', [0., 1e-300, 1e-160, 1e-20])
def test_a_plane_along_the_circle_gives_its_point_on_the_side_asked_for(tilt):
    point = spheres_and_plane(
        (0., 0., 0.), (.05, 0., 0.), .04, .04, (1., tilt, 0.), .025, (0., 1., 0.))
    np.testing.assert_allclose(point, (.025, np.sqrt(.04 ** 2 - .025 ** 2), 0.), atol=1e-12)


@pytest.mark.parametrize('by_spheres', [False, True])
def test_exact_markers_give_the_exact_palm(by_spheres):
    rng = np.random.default_rng(5)
    joints = np.array(((.083, .021, -.003), (.083, 0., .001), (.076, -.018, -.001),
                       (.068, -.034, -.006), (.024, .026, -.018)))
    for _ in range(50):
        markers, rotation, position = random_palm(rng)
        found = placed(markers, by_spheres, joints.copy())
        np.testing.assert_allclose(found[0], rotation, atol=1e-9)
        np.testing.assert_allclose(found[1], position, atol=1e-9)
        # The thumb's CMC and the middle MCP lie on either side of the line pq.
        np.testing.assert_allclose(found[2], joints, atol=1e-7)


def test_rigid_fit_leaves_the_joints_where_they_are_on_the_hand():
    rng = np.random.default_rng(10)
    joints = rng.normal(scale=.05, size=(5, 3))
    markers, _, _ = random_palm(rng, noise=.001)
    np.testing.assert_array_equal(placed(markers, False, joints.copy())[2], joints)


def test_rigid_fit_is_steadier_than_the_spheres_at_the_middle_mcp():
    rng = np.random.default_rng(7)
    middle = np.array((.083, 0., .001))
    errors = {False: [], True: []}
    for _ in range(2000):
        markers, rotation, position = random_palm(rng, noise=.0003)
        truth = rotation @ middle + position
        for by_spheres, row in errors.items():
            turned, moved, roots = placed(markers, by_spheres, np.tile(middle, (5, 1)))
            row.append(np.linalg.norm(turned @ roots[1] + moved - truth))
    assert np.mean(errors[False]) < .5 * np.mean(errors[True])
