"""Which measurement is which marker: swaps put right, outliers refused, motion untouched."""

import os
import subprocess
import sys

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from hand_tracker.core.inverse_kinematics.digit import digit_chains, reach
from hand_tracker.core.labelling.association import (
    ACCEPTED,
    REJECTED,
    SWAPPED,
    LabellingOptions,
    associate,
    initial_association,
)
from hand_tracker.core.labelling.plausibility import typical_places
from hand_tracker.core.labelling.readings import ExpectedMarkers, HandBounds
from hand_tracker.core.labelling.validity import find_valid
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.numerics.packs import as_item, packed
from hand_tracker.simulation.motions import motion_named

GATE, MARGIN, PATIENCE = 5., 1.5, .3
STEP = 1. / 120.
HAND = Hand.scaled()
MOUNTING = MarkerLayout().mounting(HAND)
CHAINS = digit_chains(HAND, MOUNTING)
BOUNDS = HandBounds(CHAINS.root, reach(CHAINS), typical_places(HAND, MOUNTING))
PLACES = marker_positions(MOUNTING, forward(joint_table(HAND), np.radians(
    (0, 0, 20, 30, 24) * 4 + (0, 10, 0, 10, 10))))
PAIRS = [(i, j) for j in range(8) for i in range(j)]


class Frames:
    """The stage, fed frame by frame, that expects `PLACES` whatever it was given."""

    def __init__(self, spread=.001, known=True, expected=PLACES):
        self._pack, self.state = packed(initial_association())
        self.expected = expected
        self.spread = np.full(8, spread)
        self.speed = np.zeros(8)
        self.known = np.full(8, known)

    def give(self, markers, gate=GATE, margin=MARGIN, patience=PATIENCE, step=STEP):
        """Return markers, seen and verdict."""
        markers = np.array(markers)
        seen, verdict = np.empty(8, dtype=bool), np.zeros(8, dtype=np.int64)
        find_valid(markers, seen)
        expected = ExpectedMarkers(self.expected, self.spread, self.speed, self.known)
        associate(markers, seen, as_item(expected), step, as_item(BOUNDS), self._pack[0],
                  as_item(LabellingOptions(gate, margin, patience)), verdict)
        return markers, seen, verdict


def settled(**fields):
    frames = Frames(**fields)
    frames.give(frames.expected)
    return frames


def followed(expected):
    """Return the stage after labels, right or wrong, that nothing was held against."""
    frames = Frames(expected=expected)
    frames.state.sides[:] = np.linalg.norm(
        expected[:3] - np.roll(expected[:3], -1, axis=0), axis=1)
    return frames


def shifted(marker, by, places=PLACES):
    markers = places.copy()
    markers[marker] += by
    return markers


def exchanged(pair, places=PLACES):
    markers = places.copy()
    markers[list(pair)] = markers[list(pair[::-1])]
    return markers


def test_verdicts_are_states_of_markers():
    assert (ACCEPTED, REJECTED, SWAPPED) == (
        MarkerState.SEEN, MarkerState.REJECTED, MarkerState.SWAPPED)


def test_reach_is_that_of_straight_digits():
    straight = marker_positions(MOUNTING, forward(joint_table(HAND), np.zeros(25)))[3:]
    np.testing.assert_allclose(
        BOUNDS.reach[:4], np.linalg.norm(straight[:4] - HAND.finger_mcp, axis=1))
    assert BOUNDS.reach[4] == pytest.approx(HAND.thumb_bones.sum())


def test_a_frame_as_expected_stays_as_it_is():
    markers, seen, verdict = settled().give(PLACES + .0005)
    np.testing.assert_array_equal(markers, PLACES + .0005)
    assert seen.all() and (verdict == ACCEPTED).all()


@pytest.mark.parametrize('pair', PAIRS, ids=lambda pair: '-'.join(MARKERS[i] for i in pair))
def test_two_exchanged_labels_are_put_right_at_once(pair):
    frames = settled()
    for _ in range(80):
        markers, seen, verdict = frames.give(exchanged(pair))
        np.testing.assert_array_equal(markers, PLACES)
        assert seen.all() and (np.flatnonzero(verdict == SWAPPED) == sorted(pair)).all()
    assert (frames.give(PLACES)[2] == ACCEPTED).all(), 'ends at once'


@given(order=st.permutations(range(8)), seed=st.integers(0, 2 ** 32 - 1))
@settings(deadline=None, max_examples=60, derandomize=True)
def test_any_order_is_put_right_wherever_the_hand_is(order, seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    places = PLACES @ rotation.T + np.random.default_rng(seed).normal(size=3)
    markers, seen, verdict = settled(expected=places).give(places[list(order)])
    np.testing.assert_array_equal(markers, places)
    assert seen.all()
    assert ((verdict == SWAPPED) == (np.array(order) != np.arange(8))).all()


# Neighbours, and a thumb before the fingers or the palm, look alike in many a pose.
ALIKE = [(3, 4), (4, 5), (5, 6), (1, 7), (3, 7), (4, 7), (5, 7), (6, 7)]


@pytest.mark.parametrize('size', [.8, 1., 1.25])
@pytest.mark.parametrize('pair', PAIRS, ids=lambda pair: '-'.join(MARKERS[i] for i in pair))
def test_first_labels_are_put_right_where_no_hand_looks_like_that(pair, size):
    frames = Frames(known=False)
    markers, seen, verdict = frames.give(size * exchanged(pair))
    wrong = [] if pair in ALIKE else sorted(pair)
    np.testing.assert_array_equal(markers, size * (exchanged(pair) if pair in ALIKE else PLACES))
    assert seen.all() and np.flatnonzero(verdict == SWAPPED).tolist() == wrong
    frames.expected, frames.known = markers.copy(), np.ones(8, dtype=bool)
    again, _, verdict = frames.give(size * exchanged(pair) + .002)
    np.testing.assert_array_equal(again, markers + .002)
    assert np.flatnonzero(verdict == SWAPPED).tolist() == wrong


@pytest.mark.parametrize('motion', ['spelling', 'piano', 'power_grasp', 'precision_grasp'])
@pytest.mark.parametrize('length, breadth', [(.16, .1), (.19, .09), (.22, .08)])
def test_right_labels_of_a_first_frame_are_kept_on_other_hands(motion, length, breadth):
    hand = Hand.scaled(length, breadth)
    angles, rotation, position = motion_named(motion, hand, 1, 20.).sample(np.arange(200) / 10.)
    places = marker_positions(MarkerLayout().mounting(hand), forward(
        joint_table(hand), angles, rotation, position), rotation, position)
    hidden = np.random.default_rng(1).random((200, 8)) < (0., 0., 0.) + (.2,) * 5
    places[hidden] = np.nan
    for markers in places:
        assert (Frames(known=False).give(markers)[2] == ACCEPTED).all()


@pytest.mark.parametrize('marker', range(8))
@pytest.mark.parametrize('by', [(1., 0., 0.), (0., -1., .5), (-.5, .2, -.5)])
def test_a_marker_of_no_hand_has_no_labels_exchanged_in_a_first_frame(marker, by):
    assert (Frames(known=False).give(shifted(marker, by))[2] != SWAPPED).all()


@pytest.mark.parametrize('pair', PAIRS, ids=lambda pair: '-'.join(MARKERS[i] for i in pair))
def test_labels_held_against_those_given_are_let_go_when_these_are_more_like_a_hand(pair):
    frames = followed(exchanged(pair))
    states = [(frames.give(PLACES)[2] == SWAPPED).any() for _ in range(37)]
    assert states == [True] * 36 + [False], '36 frames are 0.3 s'


def test_labels_that_are_clearly_wrong_are_put_right_later_too():
    # Nothing tells whether p and q are exchanged before the digits are seen.
    frames = followed(exchanged((1, 2)))
    given = exchanged((1, 2))
    states = [(frames.give(given)[2][1:3] == SWAPPED).all() for _ in range(100)]
    assert 36 <= states.index(True) <= 36 + len(PAIRS)


@pytest.mark.parametrize('marker', range(8))
@pytest.mark.parametrize('by', [(0., 0., .1), (-.05, .05, 0.), (.3, .3, .3)])
def test_an_outlier_is_refused_and_no_other(marker, by):
    _, seen, verdict = settled().give(shifted(marker, by))
    assert np.flatnonzero(~seen).tolist() == [marker]
    assert np.flatnonzero(verdict == REJECTED).tolist() == [marker]
    assert (np.delete(verdict, marker) == ACCEPTED).all()


def test_a_finger_goes_as_far_as_fingers_do_within_a_frame():
    # 12 mm and 120 m/s² over half the square of 1/120 s: 16.2 mm; over 1/30 s: 78.7 mm
    down = (BOUNDS.roots[1] - PLACES[4]) / np.linalg.norm(BOUNDS.roots[1] - PLACES[4])
    assert (settled().give(shifted(4, .0161 * down))[2] == ACCEPTED).all()
    assert settled().give(shifted(4, .0163 * down))[2][4] == REJECTED
    assert (settled().give(shifted(4, .0784 * down), step=1. / 30.)[2] == ACCEPTED).all()
    assert settled().give(shifted(4, .0790 * down), step=1. / 30.)[2][4] == REJECTED


def test_the_gate_is_in_standard_deviations():
    frames = settled(spread=np.sqrt(.01 ** 2 - .001 ** 2))  # 10 mm with the least error
    inward = (BOUNDS.roots[1] - PLACES[4]) / np.linalg.norm(BOUNDS.roots[1] - PLACES[4])
    assert frames.give(shifted(4, .0495 * inward))[2][4] == ACCEPTED
    assert frames.give(shifted(4, .0505 * inward))[2][4] == REJECTED


def test_what_a_digit_does_not_reach_is_refused():
    frames = settled(spread=.05)
    beyond = PLACES.copy()
    away = np.array((1., 0., 0.))
    for off, verdict in ((-.001, ACCEPTED), (.001, REJECTED)):
        beyond[5] = BOUNDS.roots[2] + (1.6 * BOUNDS.reach[2] + .012 + off) * away
        assert frames.give(beyond)[2][5] == verdict


def test_a_hand_that_is_elsewhere_at_once_is_believed():
    rotation = Rotation.from_euler('xyz', (1., 2., .5)).as_matrix()
    elsewhere = PLACES @ rotation.T + (2., -1., .5)
    markers, seen, verdict = settled().give(elsewhere)
    np.testing.assert_array_equal(markers, elsewhere)
    assert seen.all() and (verdict == ACCEPTED).all()


def test_a_digit_refused_in_one_place_is_believed_after_a_while():
    frames = settled()
    moved = shifted(4, (-.02, 0., -.02))
    verdicts = [frames.give(moved)[2][4] for _ in range(40)]
    assert verdicts == [REJECTED] * 35 + [ACCEPTED] + [REJECTED] * 4, '36 frames are 0.3 s'
    frames = settled()
    assert all(frames.give(moved, patience=0.)[2][4] == REJECTED for _ in range(100))


@pytest.mark.parametrize('others, verdict', [(1, REJECTED), (2, ACCEPTED)])
def test_where_most_digits_are_elsewhere_at_once_no_gate_counts(others, verdict):
    # As where a take was cut: 11 mm are within the gate, but not what a digit does in a step.
    moved = shifted(4, (-.02, 0., -.02))
    for label in (3, 6)[:others]:
        moved[label] += np.array((-.008, 0., -.008))
    assert settled().give(moved)[2][4] == verdict


def test_a_ghost_that_jumps_about_is_never_believed():
    frames, random = settled(), np.random.default_rng(1)
    for _ in range(200):
        by = random.normal(size=3)
        assert frames.give(shifted(4, .05 * by / np.linalg.norm(by)))[2][4] == REJECTED


def test_a_palm_that_slipped_is_learned_and_one_that_is_none_is_not():
    slipped, broken = shifted(0, (-.016, 0., 0.)), shifted(0, (0., 0., .1))
    frames = settled()
    verdicts = [frames.give(slipped)[2][0] for _ in range(60)]
    assert verdicts[:36] == [REJECTED] * 36 and verdicts[36:] == [ACCEPTED] * 24
    frames = settled()
    assert all(frames.give(broken)[2][0] == REJECTED for _ in range(200))


@pytest.mark.parametrize('palm_marker', range(3))
@pytest.mark.parametrize('height', (.022, -.022))
def test_a_ghost_above_or_below_a_palm_marker_is_refused_until_patience(palm_marker, height):
    # It leaves the palm's sides within 4 mm of the learned ones, as a roll would.
    ghost = shifted(palm_marker, (0., 0., height))
    for length in (30, 36):
        frames = settled()
        for _ in range(length):
            verdict = frames.give(ghost)[2]
            assert verdict[palm_marker] == REJECTED
            assert (np.delete(verdict, palm_marker) == ACCEPTED).all()
        assert (frames.give(PLACES if length < 36 else ghost)[2] == ACCEPTED).all()


def test_a_marker_back_after_a_second_is_believed_at_once():
    frames = settled()
    hidden = PLACES.copy()
    hidden[3] = np.nan
    for _ in range(120):
        assert (frames.give(hidden)[2] == ACCEPTED).all()
    assert (frames.give(shifted(3, (-.04, 0., -.04)))[2] == ACCEPTED).all()


def rolled(palm_marker, angle):
    """Return `PLACES` with a palm marker turned about the line through the other two."""
    start, other = (PLACES[i] for i in range(3) if i != palm_marker)
    axis = (other - start) / np.linalg.norm(other - start)
    markers = PLACES.copy()
    markers[palm_marker] = start + Rotation.from_rotvec(angle * axis).apply(
        PLACES[palm_marker] - start)
    return markers


@pytest.mark.parametrize('palm_marker', range(3))
@pytest.mark.parametrize('apart, verdict', [(0., ACCEPTED), (.012, REJECTED)])
def test_a_palm_marker_that_comes_back_shows_the_roll_of_a_fast_palm(palm_marker, apart, verdict):
    frames, hidden = followed(PLACES), shifted(palm_marker, (np.nan, 0., 0.))
    for _ in range(4):
        frames.give(hidden)
    markers = rolled(palm_marker, .3)
    # Where it is not the palm's, it is farther from one of the others.
    outwards = markers[palm_marker] - markers[(palm_marker + 1) % 3]
    markers[palm_marker] += apart * outwards / np.linalg.norm(outwards)
    assert np.linalg.norm(markers[palm_marker] - PLACES[palm_marker]) > .013
    _, _, told = frames.give(markers)
    assert told[palm_marker] == verdict and (np.delete(told, palm_marker) == ACCEPTED).all()


@pytest.mark.parametrize('palm_marker', range(3))
def test_a_hidden_palm_marker_is_believed_before_patience_where_skin_moved(palm_marker):
    frames, hidden = followed(PLACES), shifted(palm_marker, (np.nan, 0., 0.))
    frames.state.side_variances[:] = .0005 ** 2
    for _ in range(5):
        frames.give(hidden)
    markers = rolled(palm_marker, .35)
    outwards = markers[palm_marker] - markers[(palm_marker + 1) % 3]
    markers[palm_marker] += .005 * outwards / np.linalg.norm(outwards)
    assert ACCEPTED in [frames.give(markers)[2][palm_marker] for _ in range(20)]


def test_a_fast_digit_strays_farther_while_hidden():
    for speed, verdict in ((.2, REJECTED), (1., ACCEPTED)):
        frames = settled()
        for _ in range(3):
            frames.give(shifted(5, (np.nan, 0., 0.)))
        frames.speed[5] = speed
        assert frames.give(shifted(5, (0., 0., -.02)))[2][5] == verdict


def test_adjacent_fingers_keep_their_labels():
    beside = PLACES.copy()
    beside[4] = beside[3] + (0., -.012, 0.)
    frames = settled(expected=beside)
    random = np.random.default_rng(1)
    for _ in range(200):
        markers = beside + .001 * random.normal(size=(8, 3))
        assert (frames.give(markers)[2] == ACCEPTED).all()


def test_each_part_is_switched_off_by_zero():
    outlier, swap = shifted(4, (0., 0., -.05)), exchanged((3, 4))
    for gate, margin, frame in ((0., 0., outlier), (0., 0., swap), (0., MARGIN, outlier),
                                (GATE, 0., swap)):
        markers, seen, verdict = settled().give(frame, gate=gate, margin=margin)
        np.testing.assert_array_equal(markers, frame)
        assert (verdict != SWAPPED).all() and (gate > 0. or seen.all())
    assert (settled().give(swap, gate=0.)[2][3:5] == SWAPPED).all()


@pytest.mark.parametrize('motion', ['spelling', 'piano', 'shaking', 'power_grasp'])
@pytest.mark.parametrize('rate', [30., 120.])
def test_natural_motion_is_never_touched(motion, rate):
    moving = motion_named(motion, HAND, 1, 4.)
    angles, rotation, position = moving.sample(np.arange(int(4. * rate)) / rate)
    places = marker_positions(MOUNTING, forward(
        joint_table(HAND), angles, rotation, position), rotation, position)
    places += .0003 * np.random.default_rng(1).normal(size=places.shape)
    local = np.einsum('nji,nkj->nki', rotation, places - position[:, None])
    frames = Frames()
    for n in range(2, len(places)):
        # Even motion of the digits in the palm, and of the palm
        ahead = 2. * local[n - 1] - local[n - 2]
        frames.expected = ahead @ rotation[n - 1].T + 2. * position[n - 1] - position[n - 2]
        assert (frames.give(places[n], step=1. / rate)[2] == ACCEPTED).all()


numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-.2, .2)
rows = st.lists(st.tuples(numbers, numbers, numbers), min_size=8, max_size=8)


@given(first=rows, second=rows, expected=rows, spread=st.lists(numbers, min_size=8, max_size=8),
       known=st.lists(st.booleans(), min_size=8, max_size=8), step=st.floats(0., 1e6))
@settings(deadline=None, max_examples=200, derandomize=True)
def test_nothing_makes_it_fail(first, second, expected, spread, known, step):
    frames = Frames(expected=np.array(expected))
    frames.spread, frames.known = np.array(spread), np.array(known)
    for given_rows in (first, PLACES, second):
        markers, seen, verdict = frames.give(given_rows, step=step)
        assert np.isfinite(markers[seen]).all()
        assert not (seen & (verdict == REJECTED)).any()
        # Rows are exchanged, never made up.
        assert sorted(map(str, markers)) == sorted(map(str, np.array(given_rows, dtype=float)))
        assert all(np.isfinite(part).all() for part in frames.state[:-1])


def digest():
    """Return the numbers of a run that takes every branch, for any way to run the kernels."""
    random = np.random.default_rng(1)
    frames, told = Frames(), []
    for n in range(60):
        markers = PLACES + .003 * random.normal(size=(8, 3))
        if n % 3 == 1:
            markers = markers[random.permutation(8)]
        if n % 4 == 2:
            markers[random.integers(8)] += .1 * random.normal(size=3)
        markers[random.random(8) < .1] = np.nan
        frames.known[:] = n % 20 > 0
        markers, seen, verdict = frames.give(markers, step=.03)
        told.append(np.concatenate((markers[seen].ravel(), seen, verdict)))
    for _ in range(10):   # a ghost above the palm stays
        markers, seen, verdict = frames.give(shifted(0, (0., 0., .022)))
        told.append(np.concatenate((markers[seen].ravel(), seen, verdict)))
    return np.concatenate(told + [part.ravel() for part in frames.state[:-1]])


def test_plain_python_and_compiled_are_the_same():
    path = os.pathsep.join([os.path.dirname(__file__)] + sys.path)
    out = subprocess.run(
        [sys.executable, '-c', 'import numpy, test_association;'
         'print([float(x).hex() for x in test_association.digest()])'],
        capture_output=True, text=True, check=True,
        env={**os.environ, 'HAND_TRACKER_JIT': '0', 'PYTHONPATH': path})
    plain = np.array([float.fromhex(x.strip(" '\n[]")) for x in out.stdout.split(',')])
    np.testing.assert_allclose(plain, digest(), rtol=0., atol=1e-12)


def test_fingers_that_are_all_faster_than_expected_are_believed():
    frames = settled()
    step = np.zeros((8, 3))
    step[3:7] = (-.02, 0., -.02)
    assert (frames.give(PLACES + step)[2] == ACCEPTED).all()
