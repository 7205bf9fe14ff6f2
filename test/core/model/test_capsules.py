"""The capsules of the hand: where they are, which meet, and how far apart they are."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize

from hand_tracker.core.model.capsules import (
    CAPSULE_COUNT,
    PAIR_COUNT,
    PALM_INDEX,
    WEB_SHARE,
    blank_placement,
    hand_capsules,
    may_touch,
    nearest_points,
    pair_gaps,
    place_capsules,
)
from hand_tracker.core.model.hand import DIGITS, FINGERS, LINKS, SIDES, Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.core.numerics.packs import packed

settings.register_profile('capsules', deadline=None, max_examples=100, derandomize=True)
settings.load_profile('capsules')

segments = arrays(float, (2, 2, 3), elements=st.floats(-.1, .1))
SHARES = np.linspace(0., 1., 41)


def distance_at(pair, s, t):
    (a, b), (c, d) = pair
    return np.linalg.norm(a + np.multiply.outer(s, b - a) - c - np.multiply.outer(t, d - c),
                          axis=-1)


def by_search(pair):
    """Return the distance of two segments by a bounded minimisation from a grid's best."""
    s, t = (grid.ravel() for grid in np.meshgrid(SHARES, SHARES))
    best = distance_at(pair, s, t).argmin()

    def squared(x):
        return 1e4 * distance_at(pair, *x) ** 2

    found = minimize(squared, (s[best], t[best]), bounds=((0., 1.), (0., 1.)), tol=1e-14)
    return min(distance_at(pair, s, t).min(), np.sqrt(found.fun) / 100.)


@given(pair=segments)
def test_no_two_points_of_segments_are_nearer(pair):
    s, t, distance = nearest_points(*pair)
    assert 0. <= s <= 1. and 0. <= t <= 1.
    np.testing.assert_allclose(distance_at(pair, s, t), distance, atol=1e-12)
    # The search itself may stop early, where segments nearly cross.
    assert distance <= by_search(pair) + 2e-6


@given(pair=segments)
def test_the_distance_is_the_same_from_either_side(pair):
    np.testing.assert_allclose(
        nearest_points(pair[0], pair[1])[2], nearest_points(pair[1], pair[0])[2], atol=1e-9)


@pytest.mark.parametrize('first, second, expected', [
    (((0, 0, 0), (1, 0, 0)), ((.5, -1, 0), (.5, 1, 0)), (.5, .5, 0.)),
    (((0, 0, 0), (1, 0, 0)), ((.25, -1, 2), (.25, 1, 2)), (.25, .5, 2.)),
    (((0, 0, 0), (1, 0, 0)), ((3, 0, 0), (4, 0, 0)), (1., 0., 2.)),
    (((0, 0, 0), (1, 0, 0)), ((0, 1, 0), (1, 1, 0)), (.5, .5, 1.)),
    (((0, 0, 0), (1, 0, 0)), ((2, 1, 0), (3, 1, 0)), (1., 0., 2. ** .5)),
    (((0, 0, 0), (0, 0, 0)), ((-1, 1, 0), (1, 1, 0)), (0., .5, 1.)),
    (((-1, 1, 0), (1, 1, 0)), ((0, 0, 0), (0, 0, 0)), (.5, 0., 1.)),
    (((0, 0, 0), (0, 0, 0)), ((3, 4, 0), (3, 4, 0)), (0., 0., 5.))],
    ids=['crossing', 'skew', 'in line', 'parallel', 'corner', 'point', 'to a point', 'points'])
def test_known_distances(first, second, expected):
    found = nearest_points(np.array(first, dtype=float), np.array(second, dtype=float))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize('deviation', [0., .15], ids=['straight', 'deviated'])
@pytest.mark.parametrize('side', SIDES)
def test_capsules_lie_on_the_bones(side, deviation):
    hand = Hand.scaled(side=side, phalanx_deviation=deviation * np.array((1., -1., .5, 1.)))
    rng = np.random.default_rng(1)
    angles = rng.uniform(*hand.limits.T)
    found = hand_capsules(hand)
    placement = blank_placement()
    place_capsules(found, angles, placement)
    ends = placement.ends
    right = hand.replace(side='right')
    pose = forward(joint_table(right), angles)
    for digit, name in enumerate(DIGITS):
        links = [LINKS.index(f'{name}_{bone}') for bone in (
            ('metacarpal', 'proximal', 'distal') if name == 'thumb'
            else ('proximal', 'middle', 'distal'))]
        points = pose.position[links]
        tip = points[2] + pose.rotation[links[2]] @ tip_offsets(right)[digit]
        rows = ends[3 * digit:3 * digit + 3]
        np.testing.assert_allclose(rows[:, 0], points, atol=1e-12)
        np.testing.assert_allclose(rows[:2, 1], points[1:], atol=1e-12)
        np.testing.assert_allclose(
            np.linalg.norm(tip - rows[2, 1]), hand.radii[digit, 2], atol=1e-12)
    knuckles = [LINKS.index(f'{finger}_knuckle') for finger in FINGERS]
    np.testing.assert_allclose(ends[15:19, 1], pose.position[knuckles], atol=1e-12)
    np.testing.assert_allclose(
        ends[19:, 0], (1. - WEB_SHARE) * ends[0:12:3, 0] + WEB_SHARE * ends[0:12:3, 1], atol=1e-12)


def test_only_strangers_meet():
    found = hand_capsules(Hand.scaled())
    pairs = list(zip(found.first, found.second))
    assert len(set(pairs)) == len(pairs) == PAIR_COUNT and len(found.link) == CAPSULE_COUNT
    assert (found.digits[:, 0] < found.digits[:, 1]).all(), 'none meets its own digit'
    palm = found.digits[:, 1] == PALM_INDEX
    own = [LINKS.index(f'{finger}_proximal') for finger in FINGERS] + [
        LINKS.index('thumb_metacarpal')]
    assert not np.isin(found.link[found.first[palm]], own).any(), 'the first bone is the palm\'s'
    adjacent = (found.digits[:, 1] - found.digits[:, 0] == 1) & (found.digits[:, 1] < 4)
    assert (found.first[adjacent] % 3 != 0).sum() >= 18


@given(share=arrays(float, 25, elements=st.floats(0., 1.)))
@settings(max_examples=30)
def test_pairs_far_apart_do_not_touch(share):
    hand = Hand.scaled(limits=preset_limits('wide'))
    found = hand_capsules(hand)
    angles = hand.limits[:, 0] + share * np.ptp(hand.limits, axis=1)
    placement = blank_placement()
    place_capsules(found, angles, placement)
    gaps = pair_gaps(found, angles)
    shapes = packed(found)[0][0]
    far = [pair for pair in range(len(gaps))
           if not may_touch(shapes, placement.ends, pair, .002)]
    assert (gaps[far] > .002).all()


@pytest.mark.parametrize('length, breadth', [(.185, .085), (.2, .07), (.16, .08), (.22, .1)])
def test_nothing_overlaps_at_zero_angles(length, breadth):
    hand = Hand.scaled(length, breadth)
    found = hand_capsules(hand)
    assert pair_gaps(found, np.zeros(25)).min() >= -1e-15
    thick = hand.replace(radii=2. * hand.radii)
    assert pair_gaps(hand_capsules(thick), np.zeros(25)).min() >= -1e-15
