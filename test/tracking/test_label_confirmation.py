"""Labels are confirmed by single frames, or contradicted."""

import numpy as np
import pytest
from helpers.hands import markers_of

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.point_labelling.natural_poses import model_prototype, natural_poses
from hand_tracker.tracking.label_confirmation import are_confirmed

USUAL = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS)
TRUE_PLACES = markers_of(Hand.scaled(.2, .092), natural_poses(Hand.scaled(), 12))
RIGHT = np.arange(len(MARKERS))
EXCHANGED = np.array([0, 1, 2, 4, 5, 6, 3, 7])   # four fingers have the next one's marker


def clouds(labels):
    """Return clouds of a hand with four ghosts; `labels` are its markers' rows in each."""
    random = np.random.default_rng(4)
    for places, rows in zip(TRUE_PLACES, labels):
        ghosts = places.mean(axis=0) + random.uniform(-.2, .2, (4, 3))
        yield random.permutation(np.vstack((places, ghosts))), places[rows]


def test_right_labels_are_confirmed_and_exchanged_ones_are_contradicted():
    assert are_confirmed(list(clouds([RIGHT] * 12)), USUAL) is True
    assert are_confirmed(list(clouds([EXCHANGED] * 12)), USUAL) is False


def test_hidden_markers_and_a_frame_of_wrong_labels_are_no_objection():
    frames = []
    for number, places in enumerate(TRUE_PLACES.copy()):
        places[3 + number % 5] = np.nan
        frames.append((places[np.isfinite(places).all(axis=1)],
                       places[EXCHANGED if number == 3 else RIGHT]))
    assert are_confirmed(frames, USUAL) is True


@pytest.mark.parametrize('points', [
    np.zeros((0, 3)), np.random.default_rng(1).uniform(size=(9, 3))], ids=['nothing', 'no hand'])
def test_what_shows_no_hand_tells_nothing(points):
    assert are_confirmed([], USUAL) is None
    assert are_confirmed([(points, np.full((8, 3), np.nan))], USUAL) is None


def test_frames_that_take_long_to_search_tell_nothing():
    layout, hand = preset_layout('kyutech23'), Hand.scaled()
    places = markers_of(hand, natural_poses(hand, 2), layout)
    assert are_confirmed([(one, one) for one in places],
                         model_prototype(hand, layout, tuple(layout.names))) is None
