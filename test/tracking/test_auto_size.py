"""The size is learned while a hand is tracked, and then kept."""

import numpy as np
import pytest

from hand_tracker.calibration.size import fit_size
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking.auto_size import LEARNING_TIMES, MOST_REFUSALS, AutoSize

RATE = 100.


def markers_of(hand, seconds):
    times = np.arange(0., seconds, 1. / RATE)
    angles, rotation, position = motion_named('demo', hand, 7).sample(times)
    pose = forward(joint_table(hand), angles, rotation, position)
    return times, marker_positions(MarkerLayout().mounting(hand), pose, rotation, position)


def learned(size, times, markers):
    """Return when hands were found, and those hands."""
    found = [(time, hand) for time, frame in zip(times, markers)
             if (hand := size.add(frame, time)) is not None]
    return [time for time, _ in found], [hand for _, hand in found]


def test_it_estimates_at_its_times_and_is_then_known():
    times, markers = markers_of(Hand.scaled(.2, .092), 7.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    when, hands = learned(size, times, markers)
    np.testing.assert_allclose(when, LEARNING_TIMES, atol=.05)
    assert not size.is_learning
    np.testing.assert_allclose(hands[-1].finger_bones, Hand.scaled(.2).finger_bones, rtol=.02)


def test_a_hidden_palm_and_unknown_times_do_not_count():
    times, markers = markers_of(Hand.scaled(.2, .092), 7.)
    markers[:300, 1] = np.nan
    size = AutoSize(Hand.scaled(), MarkerLayout())
    when, _ = learned(size, times, markers)
    np.testing.assert_allclose(when, np.add(LEARNING_TIMES, 3.)[:2], atol=.05)
    assert size.is_learning
    assert learned(AutoSize(Hand.scaled(), MarkerLayout()), [None] * 700, markers) == ([], [])


def test_in_the_background_the_same_hand_is_found_some_frames_later():
    times, markers = markers_of(Hand.scaled(.2, .092), 7.)
    size = AutoSize(Hand.scaled(), MarkerLayout(), in_background=True)
    hands = []
    for time, frame in zip(times, markers):
        hands.append(size.add(frame, time))
    while size.is_learning:
        hands.append(size.add(frame, time))
    last = [hand for hand in hands if hand is not None][-1]
    np.testing.assert_allclose(last.finger_bones, Hand.scaled(.2).finger_bones, rtol=.02)
    assert fit_size(markers[:2], Hand.scaled()) is None


@pytest.mark.parametrize('in_background', [False, True])
def test_a_size_that_is_refused_is_learned_anew(in_background):
    times, markers = markers_of(Hand.scaled(.2, .092), 9.)
    size = AutoSize(Hand.scaled(), MarkerLayout(), in_background)
    asked, hands = [], []

    def accepts(hand):
        asked.append(hand)
        return len(asked) > 2

    for time, frame in zip(times, markers):
        hands.append(size.add(frame, time, accepts))
        while size._fits:
            pass
    hands = [hand for hand in hands if hand is not None]
    # After 1, 1 and 1, 2.5, 5 s.
    assert hands == asked[2:] and len(hands) == 3 and not size.is_learning
    np.testing.assert_allclose(hands[-1].finger_bones, Hand.scaled(.2).finger_bones, rtol=.02)


def test_a_size_that_is_always_refused_is_given_up():
    times, markers = markers_of(Hand.scaled(.2, .092), 9.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    asked = []
    for time, frame in zip(times, markers):
        assert size.add(frame, time, asked.append) is None
    assert len(asked) == MOST_REFUSALS and not size.is_learning
