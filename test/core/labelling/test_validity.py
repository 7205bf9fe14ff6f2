"""What is no measurement: not finite, not on earth, frozen."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.core.labelling.validity import find_valid, reject_frozen


@pytest.mark.parametrize('row, expected', [
    ((.1, .2, .3), True), ((0., 0., 0.), True), ((np.nan, 0., 0.), False),
    ((0., np.inf, 0.), False), ((0., 0., -np.inf), False), ((1e30, 0., 0.), False)])
def test_only_finite_places_on_earth_are_measurements(row, expected):
    seen = np.zeros(8, dtype=bool)
    markers = np.tile(row, (8, 1))
    find_valid(markers, seen)
    assert (seen == expected).all()


def states(given, patience=3):
    """Return in which frames each marker counts as seen, shape (n, 8)."""
    last, still = np.full((8, 3), np.nan), np.zeros(8, dtype=np.int64)
    stood = np.full((3, 3), np.nan)
    rows = []
    for markers in given:
        seen = np.empty(8, dtype=bool)
        find_valid(markers, seen)
        reject_frozen(markers, seen, last, still, stood, patience)
        rows.append(seen)
    return np.array(rows)


def frozen_after(move, patience=3, frames=6):
    """Return the same, when `move` says how all move in a frame."""
    markers = np.random.default_rng(1).normal(size=(8, 3))
    return states([markers + frame * move for frame in range(frames)], patience)


def test_a_marker_that_repeats_while_the_palm_moves_counts_as_lost():
    move = np.full((8, 3), .001)
    move[4] = 0.
    seen = frozen_after(move)
    assert seen[:3].all() and not seen[3:, 4].any()
    assert np.delete(seen, 4, axis=1).all()
    assert frozen_after(move, patience=0).all(), 'switched off'


@pytest.mark.parametrize('marker', range(3))
def test_a_palm_marker_that_repeats_is_frozen_once_the_palm_has_left_it(marker):
    markers = np.diag((.09, .07, .05))[[0, 1, 2] + [0] * 5]
    away = markers[marker] - markers[(marker + 1) % 3]
    move = np.tile(.0007 * away / np.linalg.norm(away), (8, 1))
    move[marker] = 0.
    given = [markers + frame * move for frame in range(12)]
    seen = states(given)
    assert np.flatnonzero(~seen[:, marker]).tolist() == list(range(5, 12)), 'beyond 3 mm'
    assert np.delete(seen, marker, axis=1).all()
    assert states(given, patience=0).all(), 'switched off'
    for frame in range(3, 12):
        given[frame] = given[3]
    assert states(given).all(), 'the palm stopped within 3 mm'


@pytest.mark.parametrize('moving', range(3))
def test_two_palm_markers_that_repeat_are_frozen_once_the_third_has_left_them(moving):
    markers = np.diag((.09, .07, .05))[[0, 1, 2] + [0] * 5]
    frozen = np.delete(np.arange(3), moving)
    away = 2. * markers[moving] - markers[frozen].sum(axis=0)
    move = np.tile(.002 * away / np.linalg.norm(away), (8, 1))
    move[frozen] = 0.
    seen = states([markers + frame * move for frame in range(8)])
    assert seen[:3].all() and not seen[4:, frozen].any() and seen[:, moving].all()
    assert seen[:, 3:].all()
    move[6] = 0.
    seen = states([markers + frame * move for frame in range(8)])
    assert not seen[4:, 6].any(), 'a digit frozen with them'
    move[3:] = 0.
    assert states([markers + frame * move for frame in range(8)]).all(), (
        'one marker alone is a stray')


@pytest.mark.parametrize('marker', range(3))
def test_a_palm_marker_may_rest_while_the_hand_turns_about_it(marker):
    markers = np.random.default_rng(1).normal(scale=.1, size=(8, 3))
    given = []
    for angle in np.linspace(0., 2., 50):
        turned = (markers - markers[marker]) @ Rotation.from_rotvec((0., 0., angle)).as_matrix()
        given.append(turned + markers[marker])
        given[-1][marker] = markers[marker]
    assert states(given).all()


@pytest.mark.parametrize('origin', [(0., 0., 0.), (1e-9, 0., 0.)])
def test_a_marker_that_is_the_origin_of_the_others_is_not_frozen(origin):
    markers = np.random.default_rng(1).normal(scale=.1, size=(8, 3))
    given = [markers * (1. + .01 * frame) for frame in range(20)]
    for frame in given:
        frame[0] = origin
    assert states(given).all()


def test_a_hand_at_rest_is_not_frozen():
    move = np.zeros((8, 3))
    move[3:] = .001
    assert frozen_after(move).all(), 'fingers move over a palm without noise'
    assert frozen_after(np.zeros((8, 3))).all(), 'recorded frames that repeat as a whole'


def test_a_marker_that_moves_again_is_seen_again():
    markers = np.random.default_rng(2).normal(size=(8, 3))
    given = [markers + .001 * frame for frame in range(9)]
    for frame in range(9):
        given[frame][5] = markers[5] + (.5 if frame >= 6 else 0.)
    assert states(given)[:, 5].tolist() == [True] * 3 + [False] * 3 + [True] * 3
