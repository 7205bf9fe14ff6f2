"""Hands of which too few markers of the palm are seen."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.natural_poses import natural_poses
from hand_tracker.core.point_labelling.pair_search import place_by_all
from hand_tracker.core.point_labelling.palm_search import blank_finding
from hand_tracker.core.point_labelling.prototypes import learn_prototype

HABIT = .4      # share of the natural bends that one person makes


def own_hand(side='right'):
    """Return the prototype of a hand that bends a little, and its frames, (T, 8, 3) [m]."""
    hand = Hand.scaled(side=side)
    frames = marker_positions(MarkerLayout().mounting(hand), forward(
        joint_table(hand), HABIT * natural_poses(hand, 400)))
    return learn_prototype(MARKERS, frames, (-1, -1, -1, 0, 1, 2, 3, 4), side), frames


def shuffled(frame, hidden, random, ghosts=0):
    """Return all points but the hidden markers, turned and in random order; each marker's row."""
    visible = np.setdiff1d(np.arange(8), hidden)
    points = np.concatenate((frame[visible], frame.mean(axis=0) + random.uniform(
        -.2, .2, (ghosts, 3))))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    order = random.permutation(len(points))
    rows = np.full(8, -1)
    rows[visible] = np.argsort(order)[:len(visible)]
    return points[order] @ turn.T + random.uniform(-1., 1., 3), rows


@pytest.mark.parametrize('side', ('right', 'left'))
@pytest.mark.parametrize('hidden', (0, 1, 2))
def test_a_hand_is_found_by_two_markers_of_its_palm(hidden, side):
    random = np.random.default_rng(1)
    prototype, frames = own_hand(side)
    labeller, right = CloudLabeller([prototype]), 0
    for frame in frames[::20]:
        points, rows = shuffled(frame, hidden, random)
        right += np.array_equal(labeller.label_frame(points).rows[0], rows)
    assert right >= 17  # of 20


def test_a_stream_begins_while_a_palm_marker_is_hidden():
    random = np.random.default_rng(2)
    prototype, frames = own_hand()
    labeller = CloudLabeller([prototype])
    points, rows = shuffled(frames[10], 1, random, ghosts=2)
    for number in range(12):
        found = labeller.update(points, number / 120.)
    assert np.array_equal(found.rows[0], rows)


def test_ghosts_and_hands_of_the_other_side_are_not_found_by_pairs():
    random = np.random.default_rng(3)
    labeller = CloudLabeller([own_hand()[0]])
    for number in range(60):
        ghosts = random.uniform(-.2, .2, (8, 3))
        assert not labeller.label_frame(ghosts).found[0], number
    other = own_hand('left')[1]
    for frame in other[::20]:
        points, _ = shuffled(frame, 0, random)
        for number in range(8):
            assert not labeller.update(points, number / 120.).found[0]
        labeller.reset()


def test_a_hand_is_placed_by_all_its_markers():
    prototype, frames = own_hand()
    statistics = prototype.statistics
    random = np.random.default_rng(4)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    position = np.array((.3, -.2, 1.))
    points = statistics.template @ turn.T + position
    found = blank_finding(8)
    found.rows[:] = np.arange(8)
    found.rows[1] = -1
    # 17 degrees and 2 cm off
    angle = .3
    found.rotation[:] = turn @ np.array(((np.cos(angle), -np.sin(angle), 0.),
                                         (np.sin(angle), np.cos(angle), 0.), (0., 0., 1.)))
    found.position[:] = position + .02
    found.size[0] = .97
    place_by_all(statistics, points, found)
    assert found.rotation == pytest.approx(turn, abs=.001)
    assert found.position == pytest.approx(position, abs=2e-4)
    assert found.size[0] == pytest.approx(1., abs=.002)
