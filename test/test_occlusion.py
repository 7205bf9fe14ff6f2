"""Missing markers: carried by the palm markers that are seen, held in the palm's frame."""

import numpy as np
import pytest
from hand_tracker.core.occlusion import (
    complete_palm, hold_digits, reject_frozen, visible)
from hand_tracker.core.palm import PalmState
from scipy.spatial.transform import Rotation

TEMPLATE = np.array(((0., 0., 0.), (.083, .021, -.003), (.068, -.034, -.006)))


def frame_of(seen_palm, rotation, position):
    markers = np.full((8, 3), np.nan)
    palm = TEMPLATE @ rotation.T + position
    seen = np.zeros(8, dtype=bool)
    seen[:3] = seen_palm
    markers[:3][list(seen_palm)] = palm[list(seen_palm)]
    return markers, seen, palm


@pytest.mark.parametrize('row, expected', [
    ((.1, .2, .3), True), ((0., 0., 0.), True), ((np.nan, 0., 0.), False),
    ((0., np.inf, 0.), False), ((0., 0., -np.inf), False), ((1e30, 0., 0.), False)])
def test_only_finite_places_on_earth_are_measurements(row, expected):
    seen = np.zeros(8, dtype=bool)
    markers = np.tile(row, (8, 1))
    visible(markers, seen)
    assert (seen == expected).all()


def test_a_first_frame_without_the_whole_palm_waits():
    markers, seen, _ = frame_of((True, True, False), np.eye(3), np.zeros(3))
    assert complete_palm(
        markers, seen, TEMPLATE, np.eye(3), np.zeros(3), False) == PalmState.WAITING


def test_no_palm_marker_is_lost():
    markers, seen, _ = frame_of((False, False, False), np.eye(3), np.zeros(3))
    assert complete_palm(
        markers, seen, TEMPLATE, np.eye(3), np.zeros(3), True) == PalmState.LOST


@pytest.mark.parametrize('hidden', [0, 1, 2])
def test_two_markers_carry_the_third_through_a_turn_of_their_line(hidden):
    rng = np.random.default_rng(hidden)
    before = Rotation.random(random_state=rng).as_matrix()
    pair = [i for i in range(3) if i != hidden]
    line = before @ (TEMPLATE[pair[1]] - TEMPLATE[pair[0]])
    # A rotation about an axis normal to the seen side is told by that side in full.
    axis = np.cross(line, rng.normal(size=3))
    after = Rotation.from_rotvec(.4 * axis / np.linalg.norm(axis)).as_matrix() @ before
    markers, seen, palm = frame_of([i != hidden for i in range(3)], after, np.array((.1, .2, .3)))
    state = complete_palm(markers, seen, TEMPLATE, before, rng.normal(size=3), True)
    assert state == PalmState.CARRIED
    np.testing.assert_allclose(markers[:3], palm, atol=1e-12)


@pytest.mark.parametrize('shown', [0, 1, 2])
def test_one_marker_carries_the_others_along(shown):
    rotation = Rotation.from_euler('xyz', (.1, .2, .3)).as_matrix()
    markers, seen, palm = frame_of([i == shown for i in range(3)], rotation, np.ones(3))
    complete_palm(markers, seen, TEMPLATE, rotation, np.zeros(3), True)
    np.testing.assert_allclose(markers[:3], palm, atol=1e-12)


def test_a_hidden_finger_moves_with_the_palm():
    rest = np.zeros((5, 3))
    local, known = rest.copy(), np.zeros(5, dtype=bool)
    seen = np.array((True, True, False, True, True))
    markers = np.random.default_rng(1).normal(size=(5, 3))
    rotation = Rotation.from_euler('xyz', (1., 2., 3.)).as_matrix()
    hold_digits(markers, seen, rotation, np.ones(3), rest + .5, local, known)
    np.testing.assert_allclose(local[seen], ((markers - 1.) @ rotation)[seen], atol=1e-12)
    np.testing.assert_array_equal(local[2], rest[2] + .5)
    assert known.tolist() == seen.tolist()
    held = local.copy()
    hold_digits(markers, ~seen, np.eye(3), np.zeros(3), rest, local, known)
    np.testing.assert_array_equal(local[seen], held[seen])
    np.testing.assert_array_equal(local[2], markers[2])


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


def test_a_palm_marker_freezes_too():
    move = np.full((8, 3), .001)
    move[0] = 0.
    assert not frozen_after(move)[3:, 0].any()


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
