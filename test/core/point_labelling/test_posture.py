"""Posture: marginal and conditional normal distributions by sweeping, against plain algebra."""

import numpy as np

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.point_labelling.natural_poses import model_prototype
from hand_tracker.core.point_labelling.posture import (
    HIDDEN_COST,
    chain_labels,
    hidden_places,
    posture_distance,
    reset_matrix,
    tail_cost,
)

PROTOTYPE = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS).statistics
SEEN_ROWS = np.array([0, 1, 2, 4, 5, 7])
HIDDEN = np.array([3, 6])


def coordinates(markers):
    """Return the coordinates of markers."""
    return (3 * markers[:, None] + np.arange(3)).ravel()


def swept():
    """Return points, rows of the markers, the swept matrix and its constant."""
    points = PROTOTYPE.template[SEEN_ROWS] + .02 * np.random.default_rng(3).normal(size=(6, 3))
    rows = np.full(8, -1)
    rows[SEEN_ROWS] = np.arange(6)
    matrix = np.empty((24, 24))
    constant, hidden = reset_matrix(PROTOTYPE, rows, matrix)
    assert hidden == 2
    return points, rows, matrix, constant


def test_hidden_markers_leave_the_marginal_distribution():
    points, rows, matrix, constant = swept()
    covariance = np.linalg.inv(PROTOTYPE.precision)
    seen = coordinates(SEEN_ROWS)
    marginal = covariance[np.ix_(seen, seen)]
    off = (points - PROTOTYPE.template[SEEN_ROWS]).ravel()
    distance = posture_distance(matrix, PROTOTYPE.template, points, rows, np.empty(24),
                                np.empty(24))
    assert np.isclose(distance, off @ np.linalg.solve(marginal, off), rtol=1e-8)
    assert np.isclose(constant, np.linalg.slogdet(marginal)[1], rtol=0, atol=1e-8)


def test_hidden_markers_are_expected_where_the_seen_ones_leave_them():
    points, rows, matrix, _ = swept()
    covariance = np.linalg.inv(PROTOTYPE.precision)
    seen, hidden = coordinates(SEEN_ROWS), coordinates(HIDDEN)
    off = (points - PROTOTYPE.template[SEEN_ROWS]).ravel()
    expected = PROTOTYPE.template[HIDDEN].ravel() + covariance[np.ix_(hidden, seen)] @ (
        np.linalg.solve(covariance[np.ix_(seen, seen)], off))
    places = np.empty((8, 3))
    hidden_places(PROTOTYPE, points, rows, matrix, places)
    assert np.allclose(places[HIDDEN].ravel(), expected, rtol=0, atol=1e-9)


def test_a_finger_labelled_one_too_far_is_put_right_by_a_chain():
    points = PROTOTYPE.template[[0, 1, 2, 4, 5, 6, 7]] + .002 * (
        np.random.default_rng(4).normal(size=(7, 3)))
    right = np.array([0, 1, 2, -1, 3, 4, 5, 6])
    shifted = np.array([0, 1, 2, 3, 4, 5, -1, 6])
    matrix, free = np.empty((24, 24)), np.ones(7, dtype=bool)
    assert not chain_labels(PROTOTYPE, points, free, right.copy(), matrix,
                            cost_of(points, right, matrix))
    found = shifted.copy()
    assert chain_labels(PROTOTYPE, points, free, found, matrix, cost_of(points, shifted, matrix))
    assert np.array_equal(found, right)


def cost_of(points, rows, matrix):
    """Return the cost of labels with one hidden marker."""
    constant, hidden = reset_matrix(PROTOTYPE, rows, matrix)
    assert hidden == 1
    distance = posture_distance(matrix, PROTOTYPE.template, points, rows, np.empty(24),
                                np.empty(24))
    return constant + tail_cost(distance, 21) + HIDDEN_COST
