"""Further markers of digits: ghosts are refused, true ones are not, evidence is believed."""

import numpy as np
import pytest
from helpers.worn_layouts import SEVERAL_A_DIGIT, WEARER, WORN_RATE, markers_of, tracked

from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_rows import layout_rows, marker_rows
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.tracker import HandTracker

OTHER_HAND = WEARER.replace(**{name: 1.1 * getattr(WEARER, name) for name in (
    'finger_cmc', 'finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones')})


def further(layout):
    """Return the further markers of the digits, one digit after the other."""
    rows = marker_rows(WEARER, layout, 'observed')
    order = layout_rows(layout)
    return [[int(order[row]) for row in range(8, len(order)) if rows.digit[row] == digit]
            for digit in range(5)]


def one_of_each_digit(layout):
    return [markers[-1] for markers in further(layout) if markers]


def directions(count):
    found = np.random.default_rng(3).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1)[:, None]


@pytest.mark.parametrize('frames', [1, 24])
@pytest.mark.parametrize('size', [.015, .02, .04])
@pytest.mark.parametrize('name', SEVERAL_A_DIGIT)
def test_a_ghost_moves_a_digit_no_more_than_a_hidden_marker(name, size, frames):
    layout = preset_layout(name)
    true = markers_of(layout)
    chosen, bad = one_of_each_digit(layout), slice(150, 150 + frames)
    ghost, hidden = true.copy(), true.copy()
    ghost[bad, chosen] += size * directions(len(chosen))
    hidden[bad, chosen] = np.nan
    by_ghost, states = tracked(layout, ghost)
    by_hidden, _ = tracked(layout, hidden)
    assert (states[bad, chosen] == MarkerState.REJECTED).all()
    assert np.abs(by_ghost - by_hidden)[:bad.stop].max() < 1e-6
    # Back in place it is seen at once.
    assert (states[bad.stop:, chosen] == MarkerState.SEEN).all()


def test_ghosts_would_bend_the_digits():
    layout = preset_layout('dfki13')
    frames = markers_of(layout)
    ghost, chosen = frames.copy(), one_of_each_digit(layout)
    ghost[150, chosen] += .02 * directions(len(chosen))
    off = tracked(layout, ghost, outlier_gate=0.)[0] - tracked(layout, frames)[0]
    assert np.abs(off)[150].max() > 20.


@pytest.mark.parametrize('rate', [30., 120., 480.])
@pytest.mark.parametrize('motion', ['demo', 'piano', 'shaking'])
@pytest.mark.parametrize('name', SEVERAL_A_DIGIT)
def test_true_markers_are_not_refused(name, motion, rate):
    layout = preset_layout(name)
    frames = markers_of(layout, motion, rate)
    offset = layout.with_offsets(layout.offsets + np.where(
        np.abs(layout.offsets) < .05, .005 * directions(len(layout.names)), 0.))
    for hand, worn in ((WEARER, layout), (OTHER_HAND, layout), (WEARER, offset)):
        _, states = tracked(worn, frames, rate, hand)
        assert (states[:, sum(further(layout), [])] == MarkerState.SEEN).all()


@pytest.mark.parametrize(('hand', 'share'), [(WEARER, .002), (OTHER_HAND, .02)])
@pytest.mark.parametrize('name', SEVERAL_A_DIGIT)
def test_true_markers_that_come_and_go_are_hardly_ever_refused(name, hand, share):
    layout = preset_layout(name)
    frames = markers_of(layout, 'piano')
    frames[np.random.default_rng(1).random(frames.shape[:2]) < .2] = np.nan
    _, states = tracked(layout, frames, hand=hand)
    chosen = sum(further(layout), [])
    seen = np.isfinite(frames[:, chosen, 0])
    assert (states[:, chosen][seen] == MarkerState.REJECTED).mean() < share


def test_a_marker_that_stays_elsewhere_is_believed_after_the_patience():
    layout = preset_layout('sig18_19')
    frames, chosen = markers_of(layout), one_of_each_digit(layout)
    frames[150:, chosen] += .02 * directions(len(chosen))
    _, states = tracked(layout, frames, patience=.2)
    assert (states[150:150 + 22, chosen] == MarkerState.REJECTED).all()
    assert (states[150 + 26:, chosen] == MarkerState.SEEN).all()
    _, states = tracked(layout, frames, patience=0.)
    assert (states[150:, chosen] == MarkerState.REJECTED).mean() > .9


def test_a_refused_marker_is_hidden_for_as_long_as_it_was_before():
    layout = preset_layout('kyutech23')
    frames, marker = markers_of(layout), one_of_each_digit(layout=preset_layout('kyutech23'))[1]
    frames[150:154, marker] = np.nan
    frames[154:156, marker] += (0., 0., .04)
    tracker = HandTracker(WEARER, layout)
    hidden_for = [tracker.update(frame, i / WORN_RATE).hidden_for[marker]
                  for i, frame in enumerate(frames[:158])]
    assert hidden_for[148:] == pytest.approx(
        [0., 0., *(np.arange(1, 7) / WORN_RATE), 0., 0.], abs=1e-9)


def test_another_hand_makes_no_marker_an_outlier():
    layout = preset_layout('optitrack_hand')
    frames = markers_of(layout)
    tracker = HandTracker(WEARER, layout)
    for i, frame in enumerate(frames):
        if i in (120, 200):
            tracker.configure(hand=OTHER_HAND if i == 120 else WEARER)
        state = tracker.update(frame, i / WORN_RATE)
        assert (state.marker_states == MarkerState.SEEN).all()


def test_the_digits_of_a_palm_that_leaps_as_it_loses_a_marker_are_believed():
    layout = preset_layout('dfki13')
    frames = markers_of(layout)
    # Without principal markers nothing else tells that the palm leapt.
    frames[150:, list(layout.principal[3:])] = np.nan
    wrong = layout.with_offsets(layout.offsets + np.where(
        np.arange(len(layout.names))[:, None] == layout.principal[0], .01, 0.))
    frames[180:, layout.principal[0]] = np.nan
    _, states = tracked(wrong, frames)
    assert (states[180, sum(further(layout), [])] == MarkerState.SEEN).all()
