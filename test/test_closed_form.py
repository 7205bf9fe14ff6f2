"""Flexion in closed form: exact inside the limits, the nearest point of the box beyond."""

import numpy as np
import pytest
from hand_tracker.core.closed_form import closed_form, miss_distance

LOWER, UPPER = np.radians((-10., -10.)), np.radians((85., 95.))
BONES = (.045, .026)


def end(first, second, droop=0., bones=BONES):
    bent = first + second + droop
    return (bones[0] * np.cos(first) + bones[1] * np.cos(bent),
            -bones[0] * np.sin(first) - bones[1] * np.sin(bent))


def solve(along, height, droop=0., previous=0.):
    return closed_form(along, height, *BONES, droop,
                       LOWER[0], UPPER[0], LOWER[1], UPPER[1], previous)


def test_angles_come_back():
    rng = np.random.default_rng(1)
    for first, second in rng.uniform((LOWER[0], 1e-3), UPPER, size=(1000, 2)):
        assert solve(*end(first, second)) == pytest.approx((first, second), abs=1e-9)


def test_hyperextension_begins_without_a_jump_where_flexion_would_break_a_limit():
    # A straight finger at the extension limit of its MCP, its tip moving up past straight.
    headings = np.radians(np.linspace(-5., -12., 500))
    reach = sum(BONES) * .9995
    found = np.array([solve(reach * np.cos(h), -reach * np.sin(h)) for h in headings])
    assert found[0, 1] > 0. > found[-1, 1]
    assert np.abs(np.diff(found, axis=0)).max() < np.radians(.5)


def test_marker_offset_from_the_bone_is_exact_and_follows_the_previous_pose():
    rng = np.random.default_rng(2)
    droop = np.radians(-15.)  # a marker on the dorsal skin
    for first, second in rng.uniform((0., 0.), UPPER, size=(500, 2)):
        found = solve(*end(first, second, droop), droop, previous=second)
        assert found == pytest.approx((first, second), abs=1e-8)


@pytest.mark.parametrize('droop', [0., -.2, .2])
def test_nothing_in_the_box_is_nearer(droop):
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*(
        np.linspace(low, high, 161) for low, high in zip(LOWER, UPPER)), indexing='ij'), axis=-1)
    ends = np.stack(end(grid[..., 0], grid[..., 1], droop), axis=-1)
    for target in rng.uniform(-.1, .1, size=(200, 2)):
        found = solve(*target, droop)
        assert (LOWER <= found).all() and (found <= UPPER).all()
        miss = miss_distance(*target, *BONES, droop, *found)
        # Hyperextension on both sides of the limit is the one thing not searched.
        assert miss <= np.linalg.norm(ends - target, axis=-1).min() + 5e-4


@pytest.mark.parametrize('target', [(0., 0.), (.071, 0.), (.5, 0.), (-.5, 0.), (0., .5)])
def test_singular_targets_are_finite_and_inside_the_limits(target):
    found = np.array(solve(*target))
    assert (LOWER <= found).all() and (found <= UPPER).all()


def test_noise_sensitivity_of_an_open_hand_is_that_of_the_geometry():
    # dPIP/dD in degrees per mm at PIP 5, 10, 20, 45, 90 (docs/method of the paper's bones).
    for pip, expected in ((20., 12.), (45., 5.3), (90., 3.)):
        x, z = end(0., np.radians(pip))
        shorter = .9999
        found = np.degrees(solve(x * shorter, z * shorter)[1])
        per_mm = (found - pip) / (np.hypot(x, z) * (1. - shorter) * 1e3)
        assert per_mm == pytest.approx(expected, rel=.2)
