"""Labels are confirmed by single frames, or not."""

import numpy as np
import pytest
from helpers.hands import markers_of

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.point_labelling.natural_poses import model_prototype, natural_poses
from hand_tracker.tracking.recent_clouds import KEEPING_PERIOD, KEPT_CLOUDS, RecentClouds

USUAL = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS)
TRUE_PLACES = markers_of(Hand.scaled(.2, .092), natural_poses(Hand.scaled(), KEPT_CLOUDS))
RIGHT = np.arange(len(MARKERS))
EXCHANGED = np.array([0, 1, 2, 4, 5, 6, 3, 7])   # four fingers have the next one's marker


def recent_clouds(labels):
    """Return clouds of a hand with four ghosts; `labels` are its markers' rows in each."""
    random, recent = np.random.default_rng(4), RecentClouds()
    for number, (places, rows) in enumerate(zip(TRUE_PLACES, labels)):
        ghosts = places.mean(axis=0) + random.uniform(-.2, .2, (4, 3))
        points = random.permutation(np.vstack((places, ghosts)))
        recent.add(points, places[rows], number * KEEPING_PERIOD)
    return recent


def test_right_labels_are_confirmed_and_exchanged_ones_are_not():
    assert recent_clouds([RIGHT] * KEPT_CLOUDS).confirm(USUAL)
    assert not recent_clouds([EXCHANGED] * KEPT_CLOUDS).confirm(USUAL)


def test_hidden_markers_and_a_frame_of_wrong_labels_are_no_objection():
    places = TRUE_PLACES.copy()
    recent = RecentClouds()
    for number, one in enumerate(places):
        one[3 + number % 5] = np.nan
        rows = EXCHANGED if number == 3 else RIGHT
        recent.add(one[np.isfinite(one).all(axis=1)], one[rows], number * KEEPING_PERIOD)
    assert recent.confirm(USUAL)


@pytest.mark.parametrize('points', [
    np.zeros((0, 3)), np.random.default_rng(1).uniform(size=(9, 3))], ids=['nothing', 'no hand'])
def test_what_shows_no_hand_confirms_nothing(points):
    recent = RecentClouds()
    assert not recent.confirm(USUAL)
    recent.add(points, np.full((8, 3), np.nan), 1.)
    assert not recent.confirm(USUAL)


def test_frames_a_period_apart_are_kept_and_the_latest_of_them():
    recent = recent_clouds([EXCHANGED] * KEPT_CLOUDS)
    for number in range(KEPT_CLOUDS):
        too_soon = (KEPT_CLOUDS - 1 + .04 * number) * KEEPING_PERIOD
        recent.add(TRUE_PLACES[number], TRUE_PLACES[number], too_soon)
    assert not recent.confirm(USUAL)
    for number in range(KEPT_CLOUDS):
        recent.add(TRUE_PLACES[number], TRUE_PLACES[number], 5. + number * KEEPING_PERIOD)
    assert recent.confirm(USUAL)
    # Time has jumped back.
    recent.add(TRUE_PLACES[0], TRUE_PLACES[0][EXCHANGED], 1.)
    assert recent.confirm(USUAL) and recent._clouds[-1][1][3, 0] == TRUE_PLACES[0][4, 0]
