"""The palm's markers: rigid ones, their template, and the frame of the hand."""

import numpy as np
from helpers.skin_markers import EVERY_JOINT, simulated_take

from hand_tracker.calibration.palm_template import fit_palm, rigid_poses, rigid_set, to_palm
from hand_tracker.core.model.hand import Hand

PALM = ('wrist', 'index_mcp', 'little_mcp', 'middle_mcp', 'ring_mcp')


def palm_of(hand, **options):
    take, _ = simulated_take(hand, EVERY_JOINT, seconds=4., **options)
    return take.columns(PALM)


def test_size_and_places_are_found():
    hand = Hand.scaled(.20, .09)
    points = palm_of(hand)
    palm = fit_palm(PALM, points)
    assert palm.rigid.all()
    assert abs(palm.length - .20) < .012
    sides = palm.template[:, None] - palm.template
    expected = np.median(np.linalg.norm(points[:, :, None] - points[:, None], axis=3), axis=0)
    np.testing.assert_allclose(np.linalg.norm(sides, axis=2), expected, atol=2e-4)
    # Its frame is that of the hand: knuckles ahead, the index finger's on the thumb's side.
    np.testing.assert_allclose(palm.template[1:, 0], hand.finger_mcp[[0, 3, 1, 2], 0], atol=.01)
    assert palm.template[1, 1] > palm.template[2, 1]


def test_missing_markers_and_frames():
    points = palm_of(Hand.scaled())
    points[::2, 3] = np.nan
    points[5, :4] = np.nan
    palm = fit_palm(PALM, points)
    rotation, position = rigid_poses(points, palm.template)
    assert np.isnan(rotation[5]).all()
    local = to_palm(points, rotation, position)
    assert np.nanmax(np.linalg.norm(local - palm.template, axis=2)) < .002


def test_a_marker_that_moves_is_not_rigid():
    points = palm_of(Hand.scaled(), seed=4)
    points[:, 3] += .012 * np.sin(np.arange(len(points)) / 9.)[:, None] * (0., 1., 0.)
    assert rigid_set(points).tolist() == [True, True, True, False, True]
