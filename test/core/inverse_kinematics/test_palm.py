"""The palm: the paper's construction against conformal algebra, the rigid fit against SciPy."""

import numpy as np
import pytest
from helpers.palms import TEMPLATE, random_palm, vectors

from hand_tracker.core.inverse_kinematics.palm import (
    place_palm,
    spheres_and_plane,
    spheres_joint,
    triad_palm,
)
from hand_tracker.core.model.palm_triangle import triad
from hand_tracker.core.numerics.vectors import vector

SOUND = (1.5, 0.3, 0.2)  # stretch, shrink, flatness


def placed(markers, by_spheres, roots=None):
    rotation, position = np.eye(3), np.zeros(3)
    roots = np.zeros((5, 3)) if roots is None else roots
    place_palm(markers, TEMPLATE, by_spheres, rotation, position, roots)
    return rotation, position, roots


def test_triad_normal_is_the_unit_normal_of_the_conformal_plane(conformal):
    rng = np.random.default_rng(1)
    for _ in range(100):
        markers, rotation, _ = random_palm(rng, noise=.002)
        normal, _, _ = conformal.plane_through(*markers)
        ours = np.array(triad(*vectors(*markers))[2])
        assert abs(ours @ normal) == pytest.approx(1., abs=1e-9)
        assert ours @ rotation[:, 2] > .9, 'points dorsally'


def test_spheres_and_plane_equals_conformal_algebra(conformal):
    rng = np.random.default_rng(2)
    met = missed = 0
    for _ in range(1000):
        p, q = rng.normal(scale=.05, size=(2, 3))
        radius_p, radius_q = rng.uniform(.02, .12, size=2)
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        offset = normal @ rng.normal(scale=.02, size=3)
        pair = conformal.spheres_and_plane(p, q, radius_p, radius_q, normal, offset)
        side = rng.normal(size=3)
        ours = np.array(spheres_and_plane(
            *vectors(p, q), radius_p, radius_q, vector(normal), offset, vector(side)))
        if pair is None:
            missed += 1
            continue
        met += 1
        expected = max(pair, key=lambda point: point @ side)
        np.testing.assert_allclose(ours, expected, atol=1e-9)
    assert met > 300 and missed > 100


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


def test_tangent_spheres_and_planes_are_the_limit_of_conformal_algebra(conformal):
    rng = np.random.default_rng(8)
    for _ in range(100):
        p, q = rng.normal(scale=.05, size=(2, 3))
        d = np.linalg.norm(q - p)
        u = (q - p) / d
        normal = np.cross(u, rng.normal(size=3))
        normal /= np.linalg.norm(normal)
        share = rng.uniform(.2, .8)
        # C² = 0: the spheres touch, in a plane through the point of contact.
        touch = p + share * d * u
        ours = spheres_and_plane(*vectors(p, q), share * d, (1. - share) * d, vector(normal),
                                 normal @ touch, (0., 0., 1.))
        np.testing.assert_allclose(ours, touch, atol=1e-8)
        # B² = 0: the plane touches the circle; conformal algebra just inside is near.
        radius = .7 * d
        center = (p + q) / 2.
        h = np.sqrt(radius ** 2 - d ** 2 / 4.)
        offset = normal @ center + h
        ours = np.array(spheres_and_plane(
            *vectors(p, q), radius, radius, vector(normal), offset, (0., 0., 1.)))
        np.testing.assert_allclose(ours, center + h * normal, atol=1e-8)
        pair = conformal.spheres_and_plane(p, q, radius, radius, normal, offset - 1e-7 * h)
        np.testing.assert_allclose(ours, np.mean(pair, axis=0), atol=1e-6)


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


def test_spheres_joint_equals_conformal_algebra_on_noisy_markers(conformal):
    rng = np.random.default_rng(6)
    joint = np.array((.024, .026, -.018))
    for _ in range(100):
        markers, _, _ = random_palm(rng, noise=.001)
        axes, origin = triad_palm(*vectors(*markers), *vectors(*TEMPLATE))
        local = (markers - np.array(origin)) @ np.array(axes).T
        ours = spheres_joint(*vectors(local[1], local[2], joint), *vectors(*TEMPLATE))
        normal, _, _ = conformal.plane_through(*local)
        pair = conformal.spheres_and_plane(
            local[1], local[2], np.linalg.norm(joint - TEMPLATE[1]),
            np.linalg.norm(joint - TEMPLATE[2]), normal,
            normal @ local[0] + normal @ (joint - TEMPLATE[0]))
        nearest = min(pair, key=lambda point: np.linalg.norm(point - joint))
        np.testing.assert_allclose(ours, nearest, atol=1e-9)


def test_spheres_put_the_joints_of_a_palm_that_gave_way_where_conformal_algebra_does(conformal):
    rng = np.random.default_rng(9)
    # Off the line of the knuckles, so that the spheres meet however it gives way.
    joints = np.array(((.08, .024, 0.), (.095, -.005, .001), (.062, -.005, -.001),
                       (.066, -.031, -.004), (.024, .026, -.018)))
    for _ in range(50):
        markers, _, _ = random_palm(rng, noise=.001)
        rotation, position, roots = placed(markers, True, joints.copy())
        _, p, q = (markers - position) @ rotation
        # Those beside a marker go with it.
        np.testing.assert_allclose(roots[0] - joints[0], p - TEMPLATE[1], atol=1e-12)
        np.testing.assert_allclose(roots[3] - joints[3], q - TEMPLATE[2], atol=1e-12)
        normal, _, _ = conformal.plane_through(*TEMPLATE)
        for digit in (1, 2, 4):
            pair = conformal.spheres_and_plane(
                p, q, np.linalg.norm(joints[digit] - TEMPLATE[1]),
                np.linalg.norm(joints[digit] - TEMPLATE[2]), normal, normal @ joints[digit])
            nearest = min(pair, key=lambda point: np.linalg.norm(point - joints[digit]))
            np.testing.assert_allclose(roots[digit], nearest, atol=1e-9)


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
