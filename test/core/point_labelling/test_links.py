"""Links: the distances of a digit's neighbouring markers tell touching digits apart."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.links import (
    exchange_gain,
    links_cost,
    marker_links_cost,
)
from hand_tracker.core.point_labelling.natural_poses import model_prototype, natural_poses

LAYOUT = preset_layout('sig18_19')
NAMES = tuple(LAYOUT.names)
PROTOTYPE = model_prototype(Hand.scaled(), LAYOUT, NAMES, is_measured=True)
RING, LITTLE = NAMES.index('RingTip'), NAMES.index('PinkyTip')
RATE = 120.


def markers_of(pose):
    """Return the 19 markers in one of the natural poses, (19, 3) [m]."""
    hand = Hand.scaled()
    return marker_positions(LAYOUT.mounting(hand), forward(
        joint_table(hand), natural_poses(hand, 20)[pose:pose + 1]))[0]


def test_links_join_neighbours_of_digits_with_several_markers():
    statistics = PROTOTYPE.statistics
    linked = {tuple(NAMES[i] for i in pair) for pair in statistics.links}
    assert {('RingPIP', 'RingTip'), ('ThumbIP', 'ThumbTip'), ('IndexMCP', 'IndexPIP')} <= linked
    assert not any('BackHand' in name for pair in linked for name in pair)
    places = markers_of(5)
    for (one, other), (mean, deviation) in zip(statistics.links, statistics.lengths):
        assert np.linalg.norm(places[one] - places[other]) == pytest.approx(
            mean, abs=4. * deviation)
    eight = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS).statistics
    assert eight.links.shape == (0, 2)


def test_an_exchange_gains_what_the_links_cost_less():
    statistics, places = PROTOTYPE.statistics, markers_of(5)
    rows = np.arange(len(NAMES))
    right = links_cost(statistics, places, rows)
    exchanged = rows.copy()
    exchanged[[RING, LITTLE]] = LITTLE, RING
    wrong = links_cost(statistics, places, exchanged)
    assert wrong > right + 10.
    assert exchange_gain(statistics, places, exchanged, RING, LITTLE) == pytest.approx(
        wrong - right)
    assert exchanged[RING] == LITTLE  # as before
    exchanged[RING] = -1
    assert links_cost(statistics, places, exchanged) < wrong


def test_a_place_costs_what_its_links_to_seen_markers_do():
    statistics, places = PROTOTYPE.statistics, markers_of(5)
    hidden_for = np.zeros(len(NAMES))
    own = marker_links_cost(statistics, places, hidden_for, RING, places[RING])
    assert marker_links_cost(statistics, places, hidden_for, RING, places[LITTLE]) > own + 5.
    hidden_for[NAMES.index('RingPIP')] = .1
    assert marker_links_cost(statistics, places, hidden_for, RING, places[LITTLE]) == 0.


def test_labels_of_tips_whose_points_cross_are_exchanged_within_frames():
    labeller = CloudLabeller([PROTOTYPE])
    places, random = markers_of(5), np.random.default_rng(1)
    wrong = 0
    for frame in range(180):
        points = places + random.normal(0., .0005, places.shape)
        # One glides into the other's place, each step like those of fast fingers.
        share = min(max((frame - 100) / 8., 0.), 1.)
        points[[RING, LITTLE]] += share * (points[[LITTLE, RING]] - points[[RING, LITTLE]])
        order = random.permutation(len(points))
        rows = labeller.update(points[order], frame / RATE).rows[0]
        right = np.argsort(order)
        if share == 1.:
            # The point that ends as the tip of the ring finger is the little one's first.
            right[[RING, LITTLE]] = right[[LITTLE, RING]]
            wrong += not np.array_equal(rows, right)
        elif share == 0. and frame > 30:
            assert np.array_equal(rows, right)
    assert wrong <= 4
