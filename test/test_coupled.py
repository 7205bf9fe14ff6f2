"""Three hinges, the third following the second."""

import numpy as np
import pytest
from hand_tracker.core.coupled import coupled_angle, coupled_end, coupled_form, straightest

BONES = (.046, .036, .029)
LIMITS = np.radians(((-20., 20.), (-5., 30.), (-10., 95.)))


def end(angles, droop=0.):
    x, y = coupled_end(*BONES, droop, angles[1], angles[2])
    return (x * np.cos(angles[0]) - y * np.sin(angles[0]),
            -x * np.sin(angles[0]) - y * np.cos(angles[0]))


def solve(target, slope, offset, droop=0.):
    start = straightest(*BONES, droop, slope, offset, *LIMITS[1], *LIMITS[2])
    return np.array(coupled_form(
        *target, *BONES, droop, slope, offset, start, *LIMITS.ravel()))


@pytest.mark.parametrize('slope, offset, droop', [
    (1., 0., 0.), (2., .1, 0.), (.5, -.1, 0.), (1., 0., .2), (0., .3, 0.)])
def test_coupled_angles_come_back(slope, offset, droop):
    rng = np.random.default_rng(1)
    start = straightest(*BONES, droop, slope, offset, *LIMITS[1], *LIMITS[2])
    for first, second in rng.uniform(
            (LIMITS[0, 0], start + 1e-3), LIMITS[:2, 1], size=(300, 2)):
        angles = (first, second, coupled_angle(second, slope, offset, *LIMITS[2]))
        np.testing.assert_allclose(
            solve(end(angles, droop), slope, offset, droop), angles, atol=1e-7)


def test_third_hinge_bends_on_alone_where_the_second_is_at_its_limit():
    angles = (.1, LIMITS[1, 1], 1.2)
    np.testing.assert_allclose(solve(end(angles), 1., 0.), angles, atol=1e-9)


@pytest.mark.parametrize('slope', [0., .8, 2.])
def test_nothing_coupled_in_the_box_is_nearer_when_the_first_is_at_its_limit(slope):
    rng = np.random.default_rng(2)
    second = np.linspace(*LIMITS[1], 400)
    third = np.array([coupled_angle(angle, slope, 0., *LIMITS[2]) for angle in second])
    tried = 0
    for _ in range(100):
        direction = rng.choice((-1, 1)) * rng.uniform(.6, 1.2)
        target = rng.uniform(.06, .11) * np.array((np.cos(direction), -np.sin(direction)))
        found = solve(target, slope, 0.)
        if found[0] not in LIMITS[0]:
            continue
        tried += 1
        miss = np.hypot(*np.subtract(end(found), target))
        best = min(np.hypot(*np.subtract(end((found[0], a, b)), target))
                   for a, b in zip(second, third))
        assert miss <= best + 1e-6
    assert tried > 30


@pytest.mark.parametrize('target', [(0., 0.), (.111, 0.), (5., 0.), (-5., 0.), (0., 1e-9)])
def test_singular_targets_are_finite_and_inside_the_limits(target):
    found = solve(target, 1., 0.)
    assert ((LIMITS[:, 0] <= found) & (found <= LIMITS[:, 1])).all()
