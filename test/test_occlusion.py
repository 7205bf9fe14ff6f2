"""What is no measurement: not finite, not on earth, frozen."""

import numpy as np
import pytest
from hand_tracker.core.occlusion import reject_frozen, visible


@pytest.mark.parametrize('row, expected', [
    ((.1, .2, .3), True), ((0., 0., 0.), True), ((np.nan, 0., 0.), False),
    ((0., np.inf, 0.), False), ((0., 0., -np.inf), False), ((1e30, 0., 0.), False)])
def test_only_finite_places_on_earth_are_measurements(row, expected):
    seen = np.zeros(8, dtype=bool)
    markers = np.tile(row, (8, 1))
    visible(markers, seen)
    assert (seen == expected).all()


def frozen_after(move, patience=3, frames=6):
    """Return in which frames each marker counts as seen, when `move` says how all move."""
    markers = np.random.default_rng(1).normal(size=(8, 3))
    last, still = np.full((8, 3), np.nan), np.zeros(8, dtype=np.int64)
    rows = []
    for frame in range(frames):
        seen = np.ones(8, dtype=bool)
        reject_frozen(markers + frame * move, seen, last, still, patience)
        rows.append(seen)
    return np.array(rows)


def test_a_marker_that_repeats_while_the_palm_moves_counts_as_lost():
    move = np.full((8, 3), .001)
    move[4] = 0.
    seen = frozen_after(move)
    assert seen[:3].all() and not seen[3:, 4].any()
    assert np.delete(seen, 4, axis=1).all()
    assert frozen_after(move, patience=0).all(), 'switched off'


def test_a_wrist_may_rest_while_the_hand_turns_about_it():
    move = np.full((8, 3), .001)
    move[0] = 0.
    assert frozen_after(move).all()


def test_a_hand_at_rest_is_not_frozen():
    move = np.zeros((8, 3))
    move[3:] = .001
    assert frozen_after(move).all(), 'fingers move over a palm without noise'
    assert frozen_after(np.zeros((8, 3))).all(), 'recorded frames that repeat as a whole'


def test_a_marker_that_moves_again_is_seen_again():
    markers = np.random.default_rng(2).normal(size=(8, 3))
    last, still = np.full((8, 3), np.nan), np.zeros(8, dtype=np.int64)
    for frame in range(9):
        seen = np.ones(8, dtype=bool)
        frozen = markers + .001 * frame
        frozen[5] = markers[5] + (.5 if frame >= 6 else 0.)
        reject_frozen(frozen, seen, last, still, 3)
        assert seen[5] == (frame < 3 or frame in (6, 7, 8))
