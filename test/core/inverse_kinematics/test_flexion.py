"""Flexion in closed form: exact inside the limits, the nearest point of the box beyond."""

import numpy as np
import pytest

from hand_tracker.core.inverse_kinematics.flexion import (
    AVERAGE_SPREAD,
    MAX_SECOND_HINGE_SPEED,
    UNNATURAL_COST,
    Linkage,
    NaturalFlexion,
    aim_end,
    miss_distance,
    solve_bend,
    solve_two_bone,
)

LOWER, UPPER = np.radians((-10., -10.)), np.radians((85., 95.))
TWO_BONES = (.045, .026)
NATURAL = NaturalFlexion(1.5, 0., AVERAGE_SPREAD)
ON_SKIN = np.radians(-25.)  # droop of a marker on the dorsal skin


def end(first, second, droop=0., bones=TWO_BONES):
    bent = first + second + droop
    return (bones[0] * np.cos(first) + bones[1] * np.cos(bent),
            -bones[0] * np.sin(first) - bones[1] * np.sin(bent))


def linkage(droop=0.):
    return Linkage((*TWO_BONES, 0.), droop, (*LOWER, 0.), (*UPPER, 0.), 0., 0., 2)


def solve(along, height, droop=0., previous=0., step=1., natural=NATURAL):
    return solve_two_bone(along, height, linkage(droop), natural, previous, step)


def test_angles_come_back():
    rng = np.random.default_rng(1)
    for first, second in rng.uniform((LOWER[0], 1e-3), UPPER, size=(1000, 2)):
        assert solve(*end(first, second)) == pytest.approx((first, second), abs=1e-9)


def test_hyperextension_begins_without_a_jump_where_flexion_would_break_a_limit():
    # A straight finger at the extension limit of its MCP, its tip moving up past straight.
    headings = np.radians(np.linspace(-5., -12., 500))
    reach = sum(TWO_BONES) * .9995
    found = np.array([solve(reach * np.cos(h), -reach * np.sin(h)) for h in headings])
    assert found[0, 1] > 0. > found[-1, 1]
    assert np.abs(np.diff(found, axis=0)).max() < np.radians(.5)


def test_marker_on_the_skin_is_met_whichever_bend_is_taken():
    rng = np.random.default_rng(2)
    for first, second in rng.uniform((0., 0.), UPPER, size=(500, 2)):
        place = end(first, second, ON_SKIN)
        found = solve(*place, ON_SKIN, previous=second)
        assert end(*found, ON_SKIN) == pytest.approx(place, abs=1e-9)


def test_of_two_bends_that_fit_alike_the_natural_one_is_taken_and_kept():
    for first in np.radians((2., 10., 30., 50.)):
        truth = first, NATURAL.slope * first
        other = -2. * ON_SKIN - truth[1]
        for previous in (truth[1], other):
            assert solve(*end(*truth, ON_SKIN), ON_SKIN, previous) == pytest.approx(truth)
    # Between the one and the other nature is silent: the previous one tells.
    straight = -ON_SKIN / NATURAL.slope
    for bend in np.radians((-15., 15.)):
        truth = straight - .4 * bend, -ON_SKIN + bend
        assert solve(*end(*truth, ON_SKIN), ON_SKIN, truth[1]) == pytest.approx(truth)


def test_the_bend_that_is_natural_for_the_person_is_taken():
    bent_alone = np.radians((5., 40.))
    place = end(*bent_alone, ON_SKIN)
    other = solve(*place, ON_SKIN, previous=.2)
    assert other[1] < -ON_SKIN
    # One whose PIP bends first, and one whose PIP is bent even beside a straight MCP
    for natural in (NaturalFlexion(4., .1, AVERAGE_SPREAD), NaturalFlexion(0., .7, AVERAGE_SPREAD)):
        assert solve(*place, ON_SKIN, .2, natural=natural) == pytest.approx(bent_alone)
        # The average person's bend is theirs no more, whatever the previous one.
        assert solve(*place, ON_SKIN, other[1], natural=natural) == pytest.approx(bent_alone)


def test_a_narrow_spread_outweighs_the_previous_bend_and_a_wide_one_does_not():
    place = end(*np.radians((12., 32.)), ON_SKIN)
    bends = [solve(*place, ON_SKIN, previous, natural=NaturalFlexion(1.5, 0., spread))[1]
             for spread in np.radians((4., 80.)) for previous in np.radians((10., 40.))]
    assert bends[0] == bends[1]
    assert bends[2] < -ON_SKIN < bends[3]


def test_of_an_average_spread_the_cost_is_that_of_an_average_person():
    assert UNNATURAL_COST * (AVERAGE_SPREAD / NATURAL.spread) == UNNATURAL_COST


def test_a_bend_that_hardly_misses_is_not_left_for_a_far_one_that_fits():
    # A straight finger, seen a little nearer to its root than its hyperextension allows.
    x, z = end(0., LOWER[1], ON_SKIN)
    _, second = solve(.995 * x, .995 * z, ON_SKIN, previous=LOWER[1])
    assert second == pytest.approx(LOWER[1])


def test_straight_fingers_with_skin_markers_turn_no_faster_than_fingers_do():
    truth = np.radians((30., 45.))
    place = end(*truth, ON_SKIN)
    _, straight = solve(*place, ON_SKIN, previous=-ON_SKIN, step=.01)
    assert straight == pytest.approx(-ON_SKIN + .01 * MAX_SECOND_HINGE_SPEED)
    assert solve(*place, ON_SKIN, previous=-ON_SKIN, step=.1) == pytest.approx(truth)


@pytest.mark.parametrize('pip, previous', [(60., 50.), (60., 70.)])
def test_while_the_second_hinge_turns_slowly_the_first_aims_at_the_target(pip, previous):
    place, step = end(*np.radians((30., pip)), ON_SKIN), .001
    first, second = solve(*place, ON_SKIN, np.radians(previous), step)
    turned = second - np.radians(previous)
    assert turned == pytest.approx(np.copysign(step * MAX_SECOND_HINGE_SPEED, pip - previous))
    x, z = end(first, second, ON_SKIN)
    assert np.arctan2(z, x) == pytest.approx(np.arctan2(place[1], place[0]))


def test_a_second_hinge_that_is_where_it_was_does_not_turn():
    truth = np.radians((30., 60.))
    assert solve(*end(*truth, ON_SKIN), ON_SKIN, truth[1], .001) == pytest.approx(truth)


@pytest.mark.parametrize('first, second, share, previous, flexed', [
    (29., -9., .97, -2., True),     # the other side would need more extension than there is
    (-5., 88., .90, -2., True),     # both miss, the other one three times as far
    (6.5, 25.5, .905, 0., False),   # less bend than flexion beside an extended first hinge
    (-5., 67., 1.01, 35., True),
    (-1., 37., .924, 90., True)])
def test_of_two_bends_that_do_not_fit_alike_the_cheaper_one_is_taken(
        first, second, share, previous, flexed):
    place = share * np.array(end(*np.radians((first, second)), ON_SKIN))
    _, found = solve(*place, ON_SKIN, np.radians(previous))
    assert (found > -ON_SKIN) == flexed


def test_the_miss_of_an_aimed_end_is_its_distance_whatever_the_limits():
    rng = np.random.default_rng(5)
    for _ in range(1000):
        lower, upper = np.sort(rng.uniform(-1.5, 1.5, 2))
        chain = linkage()._replace(lower=(lower, 0., 0.), upper=(upper, 0., 0.))
        along, height, x, y = rng.uniform(-.1, .1, 4)
        first, miss = aim_end(along, height, chain, x, y)
        c, s = np.cos(first), np.sin(first)
        assert miss == pytest.approx(
            np.hypot(along - x * c + y * s, height + x * s + y * c), abs=1e-9)


@pytest.mark.parametrize('droop', [0., -.2, .2])
def test_nothing_in_the_box_is_nearer(droop):
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*(
        np.linspace(low, high, 161) for low, high in zip(LOWER, UPPER)), indexing='ij'), axis=-1)
    ends = np.stack(end(grid[..., 0], grid[..., 1], droop), axis=-1)
    sides = [(1., LOWER[1], UPPER[1])] if droop >= 0. else [
        (1., -droop, UPPER[1]), (-1., LOWER[1], -droop)]
    for target in rng.uniform(-.1, .1, size=(200, 2)):
        found = solve(*target, droop)
        assert (LOWER <= found).all() and (found <= UPPER).all()
        bends = [solve_bend(*target, linkage(droop), sign, low, high)
                 for sign, low, high in sides]
        assert found in [bend[:2] for bend in bends]
        first, second, miss = min(bends, key=lambda bend: bend[2])
        assert miss == pytest.approx(
            miss_distance(*target, linkage(droop), first, second), abs=1e-12)
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
