"""Planes and palms against the paper's conformal algebra."""

import numpy as np
import pytest
from helpers import conformal
from helpers.palms import TEMPLATE, placed, random_palm, vectors

from hand_tracker.core.inverse_kinematics.abduction_plane import (
    REFERENCE_STEP,
    in_plane,
    plane_abduction,
)
from hand_tracker.core.inverse_kinematics.palm import (
    spheres_and_plane,
    spheres_joint,
    triad_palm,
)
from hand_tracker.core.model.palm_triangle import triad
from hand_tracker.core.numerics.vectors import vector


def turn_of(target, previous=0.):
    turn = plane_abduction(
        tuple(target), 0., .07, -np.pi / 2, np.pi / 2, previous, REFERENCE_STEP)
    return turn, *in_plane(tuple(target), turn, 0.)


def test_plane_is_the_conformal_plane_through_joint_marker_and_normal():
    rng = np.random.default_rng(1)
    for _ in range(200):
        target = rng.uniform((.02, -.05, -.05), (.07, .05, .02))
        normal, _ = conformal.plane_through(np.zeros(3), target, (0., 0., 1.))
        turn, along, height = turn_of(target)
        assert abs(normal @ (-np.sin(turn), np.cos(turn), 0.)) == pytest.approx(1., abs=1e-9)
        assert (along, height) == pytest.approx((np.hypot(*target[:2]), target[2]))


def test_a_degenerate_conformal_plane_leaves_abduction_as_it_was():
    # Joint, marker and normal on one line span no plane: F ∧ M ∧ n̂ ∧ n vanishes.
    joint, marker, normal = np.zeros(3), np.array((0., 0., -.03)), np.array((0., 0., 1.))
    points = [conformal.up(point) for point in (joint, marker, normal)]
    plane = points[0] ^ points[1] ^ points[2] ^ conformal.INFINITY
    assert abs(plane) < 1e-12
    assert turn_of(marker, previous=.07)[0] == .07


def test_triad_normal_is_the_unit_normal_of_the_conformal_plane():
    rng = np.random.default_rng(1)
    for _ in range(100):
        markers, rotation, _ = random_palm(rng, noise=.002)
        normal, _ = conformal.plane_through(*markers)
        ours = np.array(triad(*vectors(*markers))[2])
        assert abs(ours @ normal) == pytest.approx(1., abs=1e-9)
        assert ours @ rotation[:, 2] > .9, 'points dorsally'


def test_spheres_and_plane_equals_conformal_algebra():
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


def test_tangent_spheres_and_planes_are_the_limit_of_conformal_algebra():
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


def test_spheres_joint_equals_conformal_algebra_on_noisy_markers():
    rng = np.random.default_rng(6)
    joint = np.array((.024, .026, -.018))
    for _ in range(100):
        markers, _, _ = random_palm(rng, noise=.001)
        axes, origin = triad_palm(*vectors(*markers), *vectors(*TEMPLATE))
        local = (markers - np.array(origin)) @ np.array(axes).T
        ours = spheres_joint(*vectors(local[1], local[2], joint), *vectors(*TEMPLATE))
        normal, _ = conformal.plane_through(*local)
        pair = conformal.spheres_and_plane(
            local[1], local[2], np.linalg.norm(joint - TEMPLATE[1]),
            np.linalg.norm(joint - TEMPLATE[2]), normal,
            normal @ local[0] + normal @ (joint - TEMPLATE[0]))
        nearest = min(pair, key=lambda point: np.linalg.norm(point - joint))
        np.testing.assert_allclose(ours, nearest, atol=1e-9)


def test_spheres_put_the_joints_of_a_palm_that_gave_way_where_conformal_algebra_does():
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
        normal, _ = conformal.plane_through(*TEMPLATE)
        for digit in (1, 2, 4):
            pair = conformal.spheres_and_plane(
                p, q, np.linalg.norm(joints[digit] - TEMPLATE[1]),
                np.linalg.norm(joints[digit] - TEMPLATE[2]), normal, normal @ joints[digit])
            nearest = min(pair, key=lambda point: np.linalg.norm(point - joints[digit]))
            np.testing.assert_allclose(roots[digit], nearest, atol=1e-9)
