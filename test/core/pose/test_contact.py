"""Contact: no digit goes through another or the palm, and hidden digits are carried."""

import os
import subprocess
import sys

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize

from hand_tracker.core.inverse_kinematics.digit import THUMB
from hand_tracker.core.model.capsules import (
    blank_placement,
    hand_capsules,
    pair_gaps,
    place_capsules,
)
from hand_tracker.core.model.hand import (
    ABDUCTION_JOINTS,
    FLEXION_JOINTS,
    JOINTS,
    Hand,
    preset_limits,
)
from hand_tracker.core.numerics.packs import packed
from hand_tracker.core.pose.contact import (
    CONTACT_GAP,
    FRAME_ROUNDS,
    PENETRATION,
    TOLERANCE_SHARE,
    Mobility,
    drag_hidden,
    separate,
)
from hand_tracker.simulation.gestures import GRASPS, LETTER_SHAPES, grasp_shape, shape_angles
from hand_tracker.simulation.motions import MOTIONS, motion_named
from hand_tracker.simulation.poses import NAMED_POSES, pose_angles

settings.register_profile('contact', deadline=None, max_examples=100, derandomize=True)
settings.load_profile('contact')

HAND = Hand.scaled()
WIDE = Hand.scaled(limits=preset_limits('wide'))
ALIKE = np.ones(5)
SKIN_FRICTION = .5
INDEX, MIDDLE, RING, LITTLE = range(4)
FREE = np.column_stack((ABDUCTION_JOINTS, FLEXION_JOINTS[:, :2]))
shares = arrays(float, 25, elements=st.floats(0., 1.))


packs = {}


def pack_of(hand):
    """Return the hand's capsules for kernels, and the same for Python."""
    if id(hand) not in packs:
        packs[id(hand)] = packed(hand_capsules(hand))
    return packs[id(hand)]


def body_of(hand):
    return pack_of(hand)[1]


def overlap(hand, angles):
    return max(-pair_gaps(body_of(hand), angles).min(), 0.)


def apart(hand, angles, mobility=ALIKE, slope=None):
    """Return the separated angles and the rounds it took."""
    moved = np.array(angles)
    slope = hand.coupling[:, 0].copy() if slope is None else slope
    linkage = pack_of(hand)[0][0]
    weight = np.append(mobility, 0.)  # the palm's
    rounds = separate(linkage, moved, Mobility(*hand.limits.T.copy(), slope, weight),
                      PENETRATION, blank_placement())
    return moved, rounds


def wild(hand, seed, count):
    lower, upper = hand.limits.T
    rng = np.random.default_rng(seed)
    return [hand.coupled(lower + rng.random(25) * (upper - lower), hand.limits)
            for _ in range(count)]


def natural(hand):
    return [pose_angles(name, hand) for name in NAMED_POSES] + [
        shape_angles(shape, hand) for shape in LETTER_SHAPES.values()] + [
        shape_angles(grasp_shape(kind, size), hand) for kind in GRASPS for size in (0., .5, 1.)]


def mixed(hand, seed, count):
    """Return poses whose digits come from different hand shapes."""
    rng = np.random.default_rng(seed)
    known = np.array(natural(hand)).reshape(-1, 5, 5)
    picked = known[rng.integers(len(known), size=(count, 5)), np.arange(5)]
    return picked.reshape(count, 25)


def pressed(degrees):
    """Return a flat hand whose index and middle finger lean onto each other."""
    angles = np.zeros(25)
    angles[ABDUCTION_JOINTS[INDEX]] = -np.radians(degrees)
    angles[ABDUCTION_JOINTS[MIDDLE]] = np.radians(degrees)
    return angles


@pytest.mark.parametrize('poses', [
    lambda: natural(HAND), lambda: mixed(HAND, 1, 1500), lambda: wild(HAND, 2, 1500)],
    ids=['natural', 'mixed', 'wild'])
def test_what_is_published_overlaps_by_a_millimetre_at_most(poses):
    left = []
    for angles in poses():
        moved, _ = apart(HAND, angles)
        assert (HAND.limits[:, 0] <= moved).all() and (moved <= HAND.limits[:, 1]).all()
        left.append(overlap(HAND, moved))
    left = np.array(left)
    print(f'{len(left)} poses, {(left > PENETRATION).sum()} above, {1e3 * left.max():.2f} mm')
    # A thumb put into the middle of a finger may find no way out.
    assert (left > PENETRATION).mean() <= .001


@pytest.mark.parametrize('name', MOTIONS)
def test_no_frame_of_a_natural_motion_overlaps(name):
    motion = motion_named(name, HAND)
    for angles in motion.sample(np.arange(0., min(motion.duration, 20.), .1))[0]:
        assert overlap(HAND, apart(HAND, angles)[0]) <= PENETRATION


@given(share=shares)
def test_what_does_not_overlap_is_untouched(share):
    angles = WIDE.limits[:, 0] + share * np.ptp(WIDE.limits, axis=1)
    moved, rounds = apart(WIDE, angles)
    if overlap(WIDE, angles) <= TOLERANCE_SHARE * PENETRATION:
        assert rounds == 0
        np.testing.assert_array_equal(moved, angles)
    else:
        assert rounds > 0


@pytest.mark.parametrize('name', ['open', 'relaxed', 'spread', 'four', 'five', 'ready'])
def test_easy_poses_stay(name):
    angles = pose_angles(name, HAND)
    assert apart(HAND, angles)[1] == 0
    assert apart(HAND, np.zeros(25))[1] == 0


def test_a_frame_takes_few_rounds_and_is_nearer_after_them():
    linkage = pack_of(HAND)[0][0]
    mobility = Mobility(*HAND.limits.T.copy(), HAND.coupling[:, 0].copy(), np.append(ALIKE, 0.))
    deep, rounds = np.empty((2, 300)), []
    for i, angles in enumerate(wild(HAND, 2, 300)):
        deep[0, i] = overlap(HAND, angles)
        rounds.append(separate(linkage, angles, mobility, PENETRATION, blank_placement(),
                               FRAME_ROUNDS))
        deep[1, i] = overlap(HAND, angles)
    assert max(rounds) == FRAME_ROUNDS
    assert deep[1].mean() < .3 * deep[0].mean()


def test_the_fingers_of_a_fist_stay():
    for flexions in ((80, 94), (84, 92), (70, 80)):
        angles = pose_angles('five', HAND)
        angles[ABDUCTION_JOINTS[:4]] = 0.
        angles[FLEXION_JOINTS[:4, 0]], angles[FLEXION_JOINTS[:4, 1]] = np.radians(flexions)
        assert apart(HAND, HAND.coupled(angles, HAND.limits))[1] == 0


@given(share=shares)
@settings(max_examples=30)
def test_it_is_deterministic_and_settled(share):
    angles = HAND.coupled(
        HAND.limits[:, 0] + share * np.ptp(HAND.limits, axis=1), HAND.limits)
    moved, _ = apart(HAND, angles)
    np.testing.assert_array_equal(apart(HAND, angles)[0], moved)
    if overlap(HAND, moved) <= PENETRATION:
        again, _ = apart(HAND, moved)
        # Within the rest between aim and tolerance.
        assert np.abs(again - moved).max() < np.radians(1.)


def test_pressed_fingers_part_by_their_abduction():
    angles = pressed(8.)
    assert overlap(HAND, angles) > .005
    moved, _ = apart(HAND, angles)
    change = np.degrees(moved - angles)
    assert overlap(HAND, moved) <= PENETRATION
    assert change[ABDUCTION_JOINTS[INDEX]] > 1. and change[ABDUCTION_JOINTS[MIDDLE]] < -1.
    # Their knuckles are not level, so that a little of it is flexion.
    aside = np.abs(change[ABDUCTION_JOINTS[[INDEX, MIDDLE]]]).min()
    change[ABDUCTION_JOINTS[[INDEX, MIDDLE]]] = 0.
    assert np.abs(change).max() < .5 * aside
    assert (change[5 * RING:] == 0.).all()


@pytest.mark.parametrize('angles', [
    pressed(8.), pressed(5.), HAND.coupled(pressed(10.), HAND.limits)])
def test_the_change_is_the_least(angles):
    """SLSQP over the six free angles of the two fingers finds no smaller one."""
    moved, _ = apart(HAND, angles)
    joints = FREE[[INDEX, MIDDLE]].ravel()

    def put(x):
        other = angles.copy()
        other[joints] = x
        for digit in (INDEX, MIDDLE):
            third = FLEXION_JOINTS[digit, 2]
            other[third] += HAND.coupling[digit, 0] * (
                other[FLEXION_JOINTS[digit, 1]] - angles[FLEXION_JOINTS[digit, 1]])
        return other

    found = minimize(
        lambda x: ((x - angles[joints]) ** 2).sum(), moved[joints], method='SLSQP',
        bounds=HAND.limits[joints], options={'ftol': 1e-14},
        constraints={'type': 'ineq', 'fun': lambda x: 1e2 * (
            pair_gaps(body_of(HAND), put(x)).min() + TOLERANCE_SHARE * PENETRATION)})
    size = ((moved - angles) ** 2).sum()
    assert size <= 1.03 * found.fun + 1e-8


def test_a_seen_digit_moves_less_than_a_hidden_one():
    angles = pressed(8.)
    hidden = apart(HAND, angles, np.array((1., .1, .1, .1, .1)))[0] - angles
    assert abs(hidden[ABDUCTION_JOINTS[INDEX]]) > 5. * abs(hidden[ABDUCTION_JOINTS[MIDDLE]])
    fixed = apart(HAND, angles, np.array((1., 0., 0., 0., 0.)))[0]
    np.testing.assert_array_equal(fixed[5:], angles[5:])
    assert overlap(HAND, fixed) <= PENETRATION
    nothing, _ = apart(HAND, angles, np.zeros(5))
    np.testing.assert_array_equal(nothing, angles)


def test_third_flexion_follows_the_second_or_stays():
    poses = [angles for angles in mixed(HAND, 3, 300) if apart(HAND, angles)[1]]
    lower, upper = HAND.limits.T
    for angles in poses[:60]:
        moved, _ = apart(HAND, angles)
        third = FLEXION_JOINTS[:, 2]
        follows = angles[third] + HAND.coupling[:, 0] * (moved - angles)[FLEXION_JOINTS[:, 1]]
        np.testing.assert_allclose(
            moved[third], np.clip(follows, lower[third], upper[third]), atol=.02)
        held, _ = apart(HAND, angles, slope=np.zeros(5))
        np.testing.assert_array_equal(held[third], angles[third])


def test_the_change_starts_from_zero_and_grows_steadily():
    steps = np.linspace(0., 9., 901)
    changes = np.array([apart(HAND, pressed(step))[0] - pressed(step) for step in steps])
    assert np.abs(changes[0]).max() == 0. and np.abs(changes[-1]).max() > np.radians(5.)
    assert np.abs(np.diff(changes, axis=0)).max() < np.radians(.1)


def test_paths_jump_only_where_a_digit_passes_through_the_middle_of_another():
    rng = np.random.default_rng(4)
    shapes = natural(HAND)
    frames, jumps = 0, 0
    for _ in range(12):
        a, b = (shapes[i] for i in rng.choice(len(shapes), 2, replace=False))
        path = a + np.linspace(0., 1., 200)[:, None] * (b - a)
        change = np.array([apart(HAND, angles)[0] for angles in path]) - path
        steps = np.abs(np.diff(change, axis=0)).max(axis=1)
        depth = np.array([
            (-pair_gaps(body_of(HAND), angles) / body_of(HAND).apart).max() for angles in path])
        shallow = np.maximum(depth[1:], depth[:-1]) < .4
        frames += shallow.sum()
        jumps += (shallow & (steps > np.radians(1.5))).sum()
    assert frames > 1000
    assert jumps == 0


def carried(before, after, hidden, gap=CONTACT_GAP, friction=SKIN_FRICTION):
    """Return how the hidden digits are carried from one pose to another, shape (5, 3) [m]."""
    body = body_of(HAND)
    last, now = blank_placement(), blank_placement()
    place_capsules(body, before, last)
    place_capsules(body, after, now)
    displacement = np.full((5, 3), np.nan)
    seen = ~np.isin(np.arange(5), hidden)
    drag_hidden(body, last.ends, now.ends, seen, gap, friction, displacement)
    return displacement


def touching():
    """Return a flat hand whose index and middle finger touch."""
    return pressed(2.2)


def turned(angles, joint, degrees):
    moved = np.array(angles)
    moved[JOINTS.index(joint)] += np.radians(degrees)
    return moved


def test_a_hidden_finger_is_dragged_along_the_skin_of_its_neighbour():
    before = touching()
    assert -pair_gaps(body_of(HAND), before).min() > -CONTACT_GAP
    after = turned(before, 'index_mcp_flexion', 3.)
    moved = carried(before, after, [MIDDLE])
    assert moved[MIDDLE, 2] < -.0002, 'down with the index finger'
    np.testing.assert_array_equal(moved[[INDEX, RING, LITTLE, THUMB]], 0.)
    more = carried(before, after, [MIDDLE], friction=1.)
    np.testing.assert_allclose(more[MIDDLE, 2], moved[MIDDLE, 2] / SKIN_FRICTION, rtol=.05)


def test_a_neighbour_pushes_and_does_not_pull():
    before = touching()
    pushed = carried(before, turned(before, 'index_mcp_abduction', -1.), [MIDDLE])
    assert pushed[MIDDLE, 1] < -.0003
    away = carried(before, turned(before, 'index_mcp_abduction', 1.), [MIDDLE], friction=0.)
    np.testing.assert_allclose(away, 0., atol=1e-12)


def test_nothing_carries_where_nothing_touches_or_moves_or_is_hidden():
    spread = pose_angles('spread', HAND)
    np.testing.assert_array_equal(
        carried(spread, turned(spread, 'index_mcp_flexion', 5.), [MIDDLE]), 0.)
    before = touching()
    np.testing.assert_array_equal(carried(before, before, [MIDDLE]), 0.)
    after = turned(before, 'index_mcp_flexion', 3.)
    np.testing.assert_array_equal(carried(before, after, []), 0.)
    np.testing.assert_array_equal(carried(before, after, [INDEX, MIDDLE]), 0.)


def test_contact_begins_without_a_jump():
    sizes = []
    for degrees in np.linspace(0., 3., 601):
        before = pressed(degrees)
        sizes.append(np.linalg.norm(
            carried(before, turned(before, 'index_mcp_flexion', 3.), [MIDDLE])[MIDDLE]))
    assert sizes[0] == 0. and max(sizes) > .0005
    assert np.abs(np.diff(sizes)).max() < .0002


PLAIN = '''
import sys
import numpy as np
sys.path.insert(0, sys.argv[2])
from hand_tracker.core.numerics import jit
assert jit.COMPILED == (sys.argv[1] == '1'), jit.COMPILED
from test_contact import HAND, MIDDLE, apart, carried, mixed, natural, touching, turned
rows = [apart(HAND, angles)[0] for angles in natural(HAND)[::6] + list(mixed(HAND, 5, 3))]
before = touching()
rows.append(carried(before, turned(before, 'index_mcp_flexion', 3.), [MIDDLE]).ravel())
np.save(sys.argv[3], np.concatenate(rows))
'''


def test_compiled_and_plain_kernels_agree(tmp_path):
    pytest.importorskip('numba', reason='numba is not installed: there is only plain Python')
    found = []
    for switch in '10':
        path = tmp_path / f'{switch}.npy'
        subprocess.run(
            [sys.executable, '-c', PLAIN, switch, os.path.dirname(__file__), path], check=True,
            env={**os.environ, 'HAND_TRACKER_JIT': switch,
                 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
        found.append(np.load(path))
    np.testing.assert_allclose(*found, atol=1e-6)
