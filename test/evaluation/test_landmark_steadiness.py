"""Landmarks as given and tracked: bones that breathe, and points that jitter."""

import numpy as np
import pytest

from hand_tracker.calibration import LANDMARKS
from hand_tracker.evaluation.landmark_steadiness import (
    BONES,
    GIVEN,
    STEADIED,
    TRUE_JOINTS,
    breathing,
    jitter,
    judge,
    simulated_camera,
    tables,
)


def test_bones_join_each_landmark_to_the_one_before_it():
    assert sorted(BONES[:, 1]) == list(range(1, len(LANDMARKS)))
    names = [(LANDMARKS[a], LANDMARKS[b]) for a, b in BONES]
    assert ('wrist', 'thumb_cmc') in names and ('ring_dip', 'ring_tip') in names


def test_measures_of_known_noise():
    rng = np.random.default_rng(2)
    still = np.tile(rng.normal(0., .1, (len(LANDMARKS), 3)), (4000, 1, 1))
    noisy = still + rng.normal(0., .002, still.shape)
    everywhere = np.ones(len(still), dtype=bool)
    assert breathing(still) < 1e-12 and jitter(still, everywhere) < 1e-12
    assert jitter(noisy, everywhere) == pytest.approx(.002, rel=.02)
    # Two ends of a bone, each with the same noise.
    assert breathing(noisy) == pytest.approx(.002 * 2.**.5, rel=.05)
    # A jump between frames that are not judged is no jitter.
    noisy[2000:] += 1.
    everywhere[2000] = False
    assert jitter(noisy, everywhere) == pytest.approx(.002, rel=.02)


def test_a_tracked_hand_has_steady_bones_and_is_nearer_to_the_truth():
    camera, truth = simulated_camera(1)
    part = slice(0, 600)
    rows = {row['method']: row for row in judge(
        (camera._replace(joints=camera.joints[part]), truth[part]))}
    assert rows[GIVEN]['breathing_mm'] > 2. and rows[STEADIED]['breathing_mm'] < .1
    assert rows[TRUE_JOINTS]['breathing_mm'] < 1e-6
    assert rows[STEADIED]['jitter_mm'] < rows[GIVEN]['jitter_mm']
    assert rows[STEADIED]['truth_mm'] < rows[GIVEN]['truth_mm']
    table, = tables(list(rows.values()))
    assert len(table.lines) == 1 and len(table.lines[0]) == len(table.header)
