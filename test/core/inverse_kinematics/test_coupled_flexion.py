"""Three hinges, the third following the second."""

import numpy as np
import pytest

from hand_tracker.core.inverse_kinematics import flexion
from hand_tracker.core.inverse_kinematics.flexion import (
    MAX_SECOND_HINGE_SPEED,
    Linkage,
    NaturalFlexion,
    choose_three_bone,
    coupled_angle,
    coupled_end,
    solve_three_bone,
    straightest,
)

THREE_BONES = (.046, .036, .029)
LIMITS = np.radians(((-20., 20.), (-5., 30.), (-10., 95.)))


def linkage(slope, offset=0., droop=0.):
    return Linkage(THREE_BONES, droop, tuple(LIMITS[:, 0]), tuple(LIMITS[:, 1]), slope, offset,
                   3)


def end(angles, droop=0.):
    x, y = coupled_end(linkage(0., droop=droop), angles[1], angles[2])
    return (x * np.cos(angles[0]) - y * np.sin(angles[0]),
            -x * np.sin(angles[0]) - y * np.cos(angles[0]))


def solve(target, slope, offset, droop=0.):
    chain = linkage(slope, offset, droop)
    return np.array(solve_three_bone(*target, chain, straightest(chain)))


@pytest.mark.parametrize('slope, offset, droop', [
    (1., 0., 0.), (2., .1, 0.), (.5, -.1, 0.), (1., 0., .2), (0., .3, 0.)])
def test_coupled_angles_come_back(slope, offset, droop):
    rng = np.random.default_rng(1)
    chain = linkage(slope, offset, droop)
    start = straightest(chain)
    for first, second in rng.uniform(
            (LIMITS[0, 0], start + 1e-3), LIMITS[:2, 1], size=(300, 2)):
        angles = (first, second, coupled_angle(chain, second))
        np.testing.assert_allclose(
            solve(end(angles, droop), slope, offset, droop), angles, atol=1e-7)


def test_a_bend_is_found_in_a_few_tries(monkeypatch):
    chain, tried = linkage(1.), []

    def count(*arguments):
        tried.append(arguments)
        return reach(*arguments)

    reach, upper = flexion.chain_reach, LIMITS[1, 1]
    monkeypatch.setattr(flexion, 'chain_reach', count)
    kernel = flexion._bend_of_reach
    find = getattr(kernel, 'py_func', kernel)
    for second in np.linspace(.01, upper - .01, 50):
        assert find(chain, reach(chain, second), 0., upper) == pytest.approx(second, abs=1e-9)
    # Halving the other end at every step took 36 each.
    assert len(tried) < 50 * 13


NAIL_ANGLE = -.35  # droop of a marker on the nail [rad]


def choose(angles, natural, previous=0., step=1.):
    chain = linkage(.5, droop=NAIL_ANGLE)
    return np.array(choose_three_bone(*end(angles, NAIL_ANGLE), chain, straightest(chain),
                                      NaturalFlexion(*natural), previous, step))


@pytest.mark.parametrize('second', [.02, .3])
def test_of_two_bends_of_a_digit_with_its_marker_on_the_nail_the_natural_one_is_taken(second):
    chain = linkage(.5, droop=NAIL_ANGLE)
    assert .1 < straightest(chain) < .35
    angles = (.05, second, coupled_angle(chain, second))
    # The person's own, from the other bend too; by another's it is the other one.
    for previous in (.0, .5):
        np.testing.assert_allclose(choose(angles, (0., second, .1), previous), angles, atol=1e-7)
    other = choose(angles, (0., .42 - second, .05), previous=.42 - second)
    assert abs(other[1] - second) > .2
    # It fits as well.
    np.testing.assert_allclose(end(other, NAIL_ANGLE), end(angles, NAIL_ANGLE), atol=1e-7)


def test_to_the_other_bend_a_digit_turns_no_faster_than_fingers_do():
    chain = linkage(.5, droop=NAIL_ANGLE)
    angles = (.05, .45, coupled_angle(chain, .45))
    found = choose(angles, (0., .45, .1), previous=.1, step=.01)
    assert found[1] == pytest.approx(.1 + .01 * MAX_SECOND_HINGE_SPEED)
    assert found[2] == pytest.approx(coupled_angle(chain, found[1]))


def test_third_hinge_bends_on_alone_where_the_second_is_at_its_limit():
    for first in (.1, LIMITS[0, 1] - 1e-6, LIMITS[0, 1]):
        angles = (first, LIMITS[1, 1], 1.2)
        np.testing.assert_allclose(solve(end(angles), 1., 0.), angles, atol=1e-6)


def test_passing_the_limit_of_the_first_hinge_changes_nothing_at_once():
    beyond = solve(end((LIMITS[0, 1] + 1e-6, LIMITS[1, 1], 1.2)), 1., 0.)
    np.testing.assert_allclose(beyond, (LIMITS[0, 1], LIMITS[1, 1], 1.2), atol=1e-5)


@pytest.mark.parametrize('slope', [0., .8, 2.])
def test_nothing_curled_is_nearer_when_the_first_is_at_its_limit(slope):
    rng = np.random.default_rng(2)
    chain = linkage(slope)
    full = coupled_angle(chain, LIMITS[1, 1])
    start = straightest(chain)
    curled = [(a, coupled_angle(chain, a))
              for a in np.linspace(start, LIMITS[1, 1], 400)]
    curled += [(LIMITS[1, 1], a) for a in np.linspace(full, LIMITS[2, 1], 400)]
    tried = 0
    for _ in range(400):
        direction = rng.choice((-1, 1)) * rng.uniform(.3, 1.4)
        target = rng.uniform(.04, .11) * np.array((np.cos(direction), -np.sin(direction)))
        found = solve(target, slope, 0.)
        miss = np.hypot(*np.subtract(end(found), target))
        # Far out of reach two points may be as near as each other.
        if found[0] not in LIMITS[0] or miss > .01:
            continue
        tried += 1
        best = min(np.hypot(*np.subtract(end((found[0], a, b)), target)) for a, b in curled)
        assert miss <= best + 1e-5
    assert tried > 15


@pytest.mark.parametrize('slope', [0., .8, 2.])
def test_a_slow_target_never_makes_the_chain_jump(slope):
    rng = np.random.default_rng(3)
    for _ in range(100):
        ends = rng.uniform((.02, -.09), (.1, .03), size=(2, 2))
        line = ends[0] + np.linspace(0., 1., 400)[:, None] * (ends[1] - ends[0])
        angles = np.array([solve(target, slope, 0.) for target in line])
        misses = [np.hypot(*np.subtract(end(found), target))
                  for found, target in zip(angles, line)]
        jumps = np.abs(np.diff(angles, axis=0)).max(axis=1)[np.less(misses[1:], .01)]
        # A quarter of a millimetre at a time: most where the chain is nearly straight.
        assert jumps.max(initial=0.) < np.radians(8.)


@pytest.mark.parametrize('target', [(0., 0.), (.111, 0.), (5., 0.), (-5., 0.), (0., 1e-9)])
def test_singular_targets_are_finite_and_inside_the_limits(target):
    found = solve(target, 1., 0.)
    assert ((LIMITS[:, 0] <= found) & (found <= LIMITS[:, 1])).all()


@pytest.mark.parametrize('offset, droop', [(0., 0.), (.3, 0.), (1.2, .2), (-.1, -.2)])
def test_rigid_behind_the_second_hinge_is_straightest_where_the_search_finds_it(offset, droop):
    rigid = straightest(linkage(0., offset, droop))
    searched = straightest(linkage(1e-12, offset, droop))
    assert rigid == pytest.approx(searched, abs=np.ptp(LIMITS[1]) / 1000.)


def test_extended_beyond_straightest_a_nail_marker_is_met_with_the_first_at_its_limit():
    chain = linkage(1., droop=NAIL_ANGLE)
    for second in np.linspace(LIMITS[1, 0], straightest(chain), 20):
        angles = LIMITS[0, 0], second, coupled_angle(chain, second)
        np.testing.assert_allclose(
            solve(end(angles, NAIL_ANGLE), 1., 0., NAIL_ANGLE), angles, atol=1e-6)
