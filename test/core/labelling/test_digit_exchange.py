"""Labels exchanged within a digit: put right, unless the digit met its markers less before."""

from itertools import combinations

import numpy as np
import pytest
from helpers.worn_layouts import SEVERAL_A_DIGIT, markers_of, tracked

from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import PALM_LANDMARKS
from hand_tracker.core.model.states import MarkerState


def pairs_of(layout, digit):
    return list(combinations([
        row for row, place in enumerate(layout.places)
        if place.startswith(digit) and place not in PALM_LANDMARKS], 2))


def exchanged(frames, pairs, part):
    found = frames.copy()
    for one, other in pairs:
        found[part, [one, other]] = frames[part, [other, one]]
    return found


@pytest.mark.parametrize(('motion', 'rate'), [
    ('demo', 30.), ('demo', 120.), ('piano', 120.), ('piano', 480.)])
@pytest.mark.parametrize('name', SEVERAL_A_DIGIT)
def test_markers_exchanged_within_a_digit_are_exchanged_back(name, motion, rate):
    layout = preset_layout(name)
    frames = markers_of(layout, motion, rate)
    part = slice(len(frames) // 3, 2 * len(frames) // 3)
    true, true_states = tracked(layout, frames, rate)
    for pairs in zip(pairs_of(layout, 'index'), pairs_of(layout, 'ring')):
        angles, states = tracked(layout, exchanged(frames, pairs, part), rate)
        assert np.abs(angles - true).max() < 1e-9
        assert (states[part][:, np.ravel(pairs)] == MarkerState.SWAPPED).all()
        others = np.setdiff1d(np.arange(len(layout.names)), pairs)
        assert np.array_equal(states[:, others], true_states[:, others])


def test_exchanged_markers_bend_a_digit_where_no_labels_are_exchanged_back():
    layout = preset_layout('sig18_19')
    frames = markers_of(layout)
    wrong = exchanged(frames, pairs_of(layout, 'index'), slice(120, 240))
    off = np.abs(tracked(layout, wrong, swap_margin=0., outlier_gate=0.)[0]
                 - tracked(layout, frames)[0])
    assert off[120:240].max() > 20.


def test_labels_that_were_wrong_from_the_start_are_believed_once_they_are_right():
    layout = preset_layout('sig18_19')
    frames = markers_of(layout)
    wrong = exchanged(frames, pairs_of(layout, 'index'), slice(0, 120))
    angles, states = tracked(layout, wrong)
    assert np.abs(angles - tracked(layout, frames)[0])[-60:].max() < 2.
    assert (states[-60:] == MarkerState.SEEN).all()


def test_markers_exchanged_while_they_come_and_go_are_exchanged_back():
    layout = preset_layout('kyutech23')
    frames = markers_of(layout)
    frames[np.random.default_rng(1).random(frames.shape[:2]) < .1] = np.nan
    true, _ = tracked(layout, frames)
    angles, _ = tracked(
        layout, exchanged(frames, pairs_of(layout, 'middle')[:1], slice(120, 240)))
    assert np.percentile(np.abs(angles - true)[120:240].max(axis=1), 90) < 3.


def test_a_ghost_behind_its_neighbour_is_refused_not_exchanged():
    layout = preset_layout('kyutech23')
    frames = markers_of(layout)
    (near, far), = pairs_of(layout, 'index')[:1]
    ghost, hidden = frames.copy(), frames.copy()
    ghost[150:160, far] = (2.2 * frames[:, near] - 1.2 * frames[:, far])[150:160]
    hidden[150:160, far] = np.nan
    angles, states = tracked(layout, ghost)
    assert (states[150:160, far] == MarkerState.REJECTED).all()
    assert (states[150:160, near] == MarkerState.SEEN).all()
    assert np.abs(angles - tracked(layout, hidden)[0])[:160].max() < 1e-6
