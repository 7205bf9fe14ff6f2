"""One digit: its plane, its flexion and what it is coupled with, against forward kinematics."""

import numpy as np
import pytest

from hand_tracker.core.inverse_kinematics.abduction_plane import REFERENCE_STEP
from hand_tracker.core.inverse_kinematics.digit import (
    MEASURED_SPREAD,
    digit_chains,
    override_coupling,
    solve_digits,
)
from hand_tracker.core.inverse_kinematics.flexion import (
    MAX_SECOND_HINGE_SPEED,
    Linkage,
    straightest,
)
from hand_tracker.core.model.hand import (
    ABDUCTION_JOINTS,
    DIGITS,
    FLEXION_JOINTS,
    JOINTS,
    Hand,
)
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import (
    PALM_MARKERS,
    PAPER_PLACES,
    MarkerLayout,
    marker_positions,
)
from hand_tracker.core.numerics.packs import packed

HAND = Hand.scaled()
PAPER = MarkerLayout()
TIPS = MarkerLayout(places=(*PAPER_PLACES[:3], *(f'{digit}_tip' for digit in DIGITS)))
# Beside the middle of the bone, and a little to its palmar side.
BESIDE = MarkerLayout(offsets=np.vstack((np.zeros((3, 3)), np.tile((.001, .003, -.002), (5, 1)))))
LAYOUTS = pytest.mark.parametrize('layout', [PAPER, TIPS, BESIDE], ids=['paper', 'tips', 'beside'])
FIRSTS, SECONDS, THIRDS = FLEXION_JOINTS.T
MCP_ABDUCTION = JOINTS.index('thumb_mcp_abduction')


def poses(count, hand=HAND, seed=1):
    """Yield angles of open hands, as the chains tell them in full."""
    rng = np.random.default_rng(seed)
    lower, upper = hand.limits.T
    for share in rng.uniform(.05, .95, size=(count, 25)):
        angles = np.zeros(25)
        angles[ABDUCTION_JOINTS] = (lower + share * (upper - lower))[ABDUCTION_JOINTS]
        angles[FIRSTS] = .4 * share[FIRSTS] * upper[FIRSTS]
        angles[SECONDS] = np.radians(10.) + .5 * share[SECONDS] * upper[SECONDS]
        angles[SECONDS] = np.minimum(angles[SECONDS], upper[SECONDS])
        angles[THIRDS] = hand.coupling[:, 0] * angles[SECONDS] + hand.coupling[:, 1]
        yield angles


def markers_of(angles, layout=PAPER, hand=HAND):
    """Return the digits' markers in the wrist's frame, shape (5, 3)."""
    pose = forward(joint_table(hand), angles)
    return marker_positions(layout.mounting(hand), pose)[len(PALM_MARKERS):]


def solve(digits, markers, before=None, step=REFERENCE_STEP, by_fabrik=False, iterations=2000):
    """Return the angles of markers, and the iterations of FABRIK."""
    angles = np.zeros(25) if before is None else before.copy()
    used = solve_digits(digits, digits.root, markers, angles, step, by_fabrik, 1e-7, iterations)
    return angles, used


@LAYOUTS
def test_angles_of_an_open_hand_come_back(layout):
    digits = digit_chains(HAND, layout.mounting(HAND))
    for angles in poses(20):
        found, used = solve(digits, markers_of(angles, layout))
        np.testing.assert_allclose(found, angles, atol=1e-6)
        assert used == 0


@LAYOUTS
@pytest.mark.parametrize('roll, distance', [
    (0., 0.), (50., 0.), (0., .015), (60., .015), (-30., .01)])
def test_a_thumb_whose_phalanges_leave_its_plane_comes_back(layout, roll, distance):
    hand = HAND.replace(thumb_mcp_abduction=np.radians(-8.),
                        thumb_roll=np.radians(roll), thumb_axis_distance=distance)
    digits = digit_chains(hand, layout.mounting(hand))
    for angles in poses(20, hand):
        angles[MCP_ABDUCTION] = hand.thumb_mcp_abduction
        found, _ = solve(digits, markers_of(angles, layout, hand))
        np.testing.assert_allclose(found, angles, atol=2e-4)
        np.testing.assert_allclose(markers_of(found, layout, hand),
                                   markers_of(angles, layout, hand), atol=1e-5)


@LAYOUTS
def test_fingers_whose_middle_phalanges_deviate_come_back(layout):
    hand = HAND.replace(phalanx_deviation=np.radians((3., 0., -2., -8.)))
    digits = digit_chains(hand, layout.mounting(hand))
    for angles in poses(20, hand):
        found, _ = solve(digits, markers_of(angles, layout, hand))
        np.testing.assert_allclose(found, angles, atol=1e-6)


def test_the_thumb_s_lean_stays_within_its_limits():
    limits = HAND.limits.copy()
    limits[MCP_ABDUCTION] = np.radians((-3., 3.))
    hand = HAND.replace(limits=limits, thumb_mcp_abduction=np.radians(-8.))
    found, _ = solve(digit_chains(hand, PAPER.mounting(hand)), markers_of(next(poses(1))))
    assert np.degrees(found[MCP_ABDUCTION]) == pytest.approx(-3.)


def test_a_person_s_own_flexion_finds_the_bends_that_an_average_one_s_misses():
    # With markers on the skin: the PIP bends beside a straight MCP, as in a hook grip.
    skin = MarkerLayout(offsets=np.tile((0., 0., .011), (8, 1)))
    own = HAND.replace(natural_flexion=((5., 0., np.radians(20.)),) * 5)
    bends = np.radians(30. - 30. * np.cos(np.linspace(0., 4. * np.pi, 240)))
    worst = []
    for hand in (HAND, own):
        digits, found, misses = digit_chains(hand, skin.mounting(hand)), np.zeros(25), []
        for bend in bends:
            angles = np.zeros(25)
            angles[FIRSTS[:4]], angles[SECONDS[:4]] = np.radians(5.), bend
            angles[THIRDS] = hand.coupling[:, 0] * angles[SECONDS]
            found, _ = solve(digits, markers_of(angles, skin), found)
            misses.append(np.abs(found - angles)[SECONDS[:4]])
        worst.append(np.degrees(np.max(misses)))
    assert worst[1] < 8. and worst[0] > 25.


@LAYOUTS
def test_fabrik_brings_every_marker_to_its_place(layout):
    digits = digit_chains(HAND, layout.mounting(HAND))
    for angles in poses(5, seed=2):
        markers = markers_of(angles, layout)
        found, used = solve(digits, markers, np.clip(angles + .02, *HAND.limits.T), by_fabrik=True)
        missed = np.linalg.norm(markers_of(found, layout) - markers, axis=1)
        # The thumb's short flexion and long bones are slow to converge.
        assert missed[:4].max() < 1e-4 and missed[4] < 2e-3
        np.testing.assert_allclose(found[ABDUCTION_JOINTS], angles[ABDUCTION_JOINTS], atol=1e-9)
        assert used > 0


def test_fabrik_takes_at_most_its_iterations_for_each_digit():
    digits = digit_chains(HAND, PAPER.mounting(HAND))
    markers = markers_of(next(poses(1)))
    assert solve(digits, markers, by_fabrik=True, iterations=1)[1] == len(DIGITS)


def test_digits_that_are_moved_with_their_roots_keep_their_angles():
    digits = digit_chains(HAND, PAPER.mounting(HAND))
    moved = np.random.default_rng(3).normal(scale=.01, size=(5, 3))
    for angles in poses(5):
        found = np.zeros(25)
        solve_digits(digits, digits.root + moved, markers_of(angles) + moved, found, REFERENCE_STEP,
                     False, 0., 0)
        np.testing.assert_allclose(found, angles, atol=1e-6)


@pytest.mark.parametrize('by_fabrik', [False, True], ids=['closed form', 'fabrik'])
@LAYOUTS
def test_every_joint_stops_at_its_own_limits(layout, by_fabrik):
    solved = np.concatenate((ABDUCTION_JOINTS, FLEXION_JOINTS.ravel()))
    rng = np.random.default_rng(4)
    reached = np.zeros((25, 2), dtype=bool)
    for i, wide in enumerate(poses(12, seed=5)):
        limits = HAND.limits.copy()
        limits[solved] = rng.uniform((-.15, .01), (-.01, .15), size=(len(solved), 2))
        hand = HAND.replace(limits=limits)
        # Bent far beyond the one limit and the other
        found, _ = solve(digit_chains(hand, layout.mounting(hand)), markers_of(
            wide if i % 2 else -wide, layout), by_fabrik=by_fabrik, iterations=50)
        assert (limits[solved, 0] <= found[solved]).all()
        assert (found[solved] <= limits[solved, 1]).all()
        reached |= found[:, None] == limits
    assert reached[ABDUCTION_JOINTS].all() and reached[FIRSTS].all()


def test_abduction_of_every_digit_goes_to_the_limit_on_its_side():
    narrow = HAND.limits.copy()
    narrow[ABDUCTION_JOINTS] = -.05, .1
    hand = HAND.replace(limits=narrow)
    digits = digit_chains(hand, PAPER.mounting(hand))
    angles = next(poses(1))
    for side, limit in ((-.2, -.05), (.2, .1)):
        angles[ABDUCTION_JOINTS] = side
        found, _ = solve(digits, markers_of(angles))
        np.testing.assert_array_equal(found[ABDUCTION_JOINTS], limit)


def test_measured_last_joints_take_the_place_of_their_coupling():
    coupled = digit_chains(HAND, TIPS.mounting(HAND))
    pack, _ = packed(coupled)
    copy, measured = packed(digit_chains(HAND, TIPS.mounting(HAND)))
    last = HAND.limits[THIRDS]
    override_coupling(pack, np.array((.3, np.nan, 9., -9., np.inf)), copy)
    np.testing.assert_array_equal(measured.measured, (True, False, True, True, False))
    np.testing.assert_array_equal(
        measured.coupling, ((0., .3), HAND.coupling[1], (0., last[2, 1]), (0., last[3, 0]),
                            HAND.coupling[4]))
    np.testing.assert_array_equal(measured.coupling_spread, np.where(
        measured.measured, MEASURED_SPREAD, HAND.coupling_spread))
    for digit in range(5):
        assert measured.start[digit] == straightest(Linkage(
            tuple(coupled.bones[digit]), coupled.droop[digit],
            tuple(HAND.limits[FLEXION_JOINTS[digit], 0]),
            tuple(HAND.limits[FLEXION_JOINTS[digit], 1]), *measured.coupling[digit],
            coupled.hinges[digit]))
    # And what was measured is forgotten where it no longer is.
    override_coupling(pack, np.full(5, np.nan), copy)
    for part, expected in zip(measured, coupled):
        np.testing.assert_array_equal(part, expected)


@pytest.mark.parametrize('layout', [PAPER, TIPS], ids=['paper', 'tips'])
def test_a_measured_last_joint_is_where_it_was_measured(layout):
    pack, _ = packed(digit_chains(HAND, layout.mounting(HAND)))
    copy, measured = packed(digit_chains(HAND, layout.mounting(HAND)))
    bent = np.array((.2, .9, .4, .1, .6))
    override_coupling(pack, bent, copy)
    for angles in poses(10, seed=6):
        angles[THIRDS] = bent
        found, _ = solve(measured, markers_of(angles, layout))
        np.testing.assert_allclose(found, angles, atol=1e-6)


def test_abduction_of_a_fist_follows_in_the_time_that_passed():
    digits = digit_chains(HAND, PAPER.mounting(HAND))
    angles = np.zeros(25)
    angles[FIRSTS[:4]], angles[SECONDS[:4]] = 1.2, 1.3
    angles[ABDUCTION_JOINTS[:4]] = .1
    markers = markers_of(angles)
    once, _ = solve(digits, markers, step=2. * REFERENCE_STEP)
    twice, _ = solve(digits, markers, solve(digits, markers)[0])
    fingers = ABDUCTION_JOINTS[:4]
    np.testing.assert_allclose(once[fingers], twice[fingers], atol=1e-9)
    assert (abs(once[fingers]) < .09).all() and (once[fingers] > 0.).all()


def test_a_second_hinge_turns_no_faster_than_its_step_allows():
    offsets = np.zeros((8, 3))
    offsets[3:7, 2] = .008
    layout = MarkerLayout(offsets=offsets)
    digits = digit_chains(HAND, layout.mounting(HAND))
    angles = next(poses(1))
    angles[SECONDS[:4]] = 1.
    before = np.zeros(25)
    before[SECONDS] = -digits.droop
    markers = markers_of(angles, layout)
    for step in (5e-4, 1e-3):
        found, _ = solve(digits, markers, before, step)
        np.testing.assert_allclose(abs(found - before)[SECONDS[:4]], MAX_SECOND_HINGE_SPEED * step)
