"""The size is learned while a hand is tracked, and then kept."""

import threading
from threading import Event

import numpy as np
import pytest

from hand_tracker.calibration.size import fit_size
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking import auto_size as module
from hand_tracker.tracking.auto_size import (
    CHECKED_CLOUDS,
    CHECKED_POINTS,
    LEARNING_TIMES,
    MOST_REFUSALS,
    AutoSize,
)

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


def test_what_is_no_palm_teaches_nothing_and_learning_may_begin_anew():
    times, markers = markers_of(Hand.scaled(.2, .092), 7.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    # The label of the little finger's knuckle is on a marker beside the hand.
    wrong = markers.copy()
    wrong[:, 2] += markers[:, 2] - markers[:, 1]
    assert learned(size, times, wrong) == ([], [])
    assert not size.is_learning
    size = size.anew()
    assert size.is_learning and len(learned(size, times + 10., markers)[1]) == len(LEARNING_TIMES)


def verdicts(monkeypatch, *told):
    """Let the check of labels tell these verdicts, one by one; return what it was asked."""
    asked = []

    def are_confirmed(clouds, prototype):
        asked.append(clouds)
        return told[min(len(asked), len(told)) - 1]

    monkeypatch.setattr(module, 'are_confirmed', are_confirmed)
    return asked


def test_an_estimate_by_labels_that_are_contradicted_is_refused_and_learning_begins_anew(
        monkeypatch):
    asked = verdicts(monkeypatch, False, False, True)
    times, markers = markers_of(Hand.scaled(.2, .092), 9.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    found = []
    for time, frame in zip(times, markers):
        if (hand := size.add(frame, time, frame[::-1])) is not None:
            found.append((time, hand, size.is_confirmed))
    # Refused after 1 and 1 s, taken after 1, 2.5 and 5 s from there.
    np.testing.assert_allclose([time for time, *_ in found], np.add(LEARNING_TIMES, 2.), atol=.15)
    assert all(is_confirmed for *_, is_confirmed in found) and not size.is_learning
    np.testing.assert_allclose(found[-1][1].finger_bones, Hand.scaled(.2).finger_bones, rtol=.02)
    # The second knows none of the frames of the first.
    assert [len(clouds) for clouds in asked] == [CHECKED_CLOUDS] * 5
    assert not {id(points) for points, _ in asked[0]} & {id(points) for points, _ in asked[1]}
    for points, places in asked[0]:
        assert np.array_equal(points[::-1], places)


def test_estimates_that_are_always_refused_are_given_up(monkeypatch):
    asked = verdicts(monkeypatch, False)
    times, markers = markers_of(Hand.scaled(.2, .092), 9.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    for time, frame in zip(times, markers):
        assert size.add(frame, time, frame) is None
    assert len(asked) == MOST_REFUSALS and size.is_refused and not size.is_learning


def test_an_estimate_by_labels_that_no_frame_tells_of_is_taken_and_not_confirmed(monkeypatch):
    verdicts(monkeypatch, None)
    times, markers = markers_of(Hand.scaled(.2, .092), 2.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    found = [size.add(frame, time, frame) for time, frame in zip(times, markers)]
    assert sum(hand is not None for hand in found) == 1
    assert not size.is_confirmed and not size.is_refused


def test_frames_of_too_many_points_are_not_kept_to_be_checked(monkeypatch):
    asked = verdicts(monkeypatch, False)
    times, markers = markers_of(Hand.scaled(.2, .092), 2.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    cloud = np.zeros((CHECKED_POINTS + 1, 3))
    found = [size.add(frame, time, cloud) for time, frame in zip(times, markers)]
    assert sum(hand is not None for hand in found) == 1 and not size.is_confirmed
    assert not asked and not size._clouds


def test_a_refusal_that_comes_late_is_of_all_frames_before_it(monkeypatch):
    """Those that came while it was made, as in plain Python, may be by the same wrong labels."""
    begun, go_on, asked = Event(), Event(), []

    def are_confirmed(clouds, prototype):
        asked.append(clouds)
        begun.set()
        go_on.wait(10.)
        return len(asked) > 1

    monkeypatch.setattr(module, 'are_confirmed', are_confirmed)
    times, markers = markers_of(Hand.scaled(.2, .092), 9.)
    size = AutoSize(Hand.scaled(), MarkerLayout(), in_background=True)
    found = []
    for number, (time, frame) in enumerate(zip(times, markers)):
        found.append(size.add(frame, time, frame))
        if number == 300:   # the second estimate is due since 2.5 s
            assert begun.wait(10.) and len(asked) == 1 and size.is_learning
            go_on.set()
            wait_for_estimate()
    wait_for_estimate()
    assert not any(hand is not None for hand in found[:395])
    assert any(hand is not None for hand in [*found, size.add(frame, time, frame)])
    assert not ({id(points) for points, _ in asked[0]}
                & {id(points) for clouds in asked[1:] for points, _ in clouds})


def wait_for_estimate():
    for thread in threading.enumerate():
        if thread.name == 'fit size':
            thread.join()


def test_an_estimate_that_fails_leaves_the_next(monkeypatch):
    times, markers = markers_of(Hand.scaled(.2, .092), 7.)
    size = AutoSize(Hand.scaled(), MarkerLayout())
    fit, failures = module.fit_size, [ValueError('of no kind')]

    def fail_once(*arguments):
        if failures:
            raise failures.pop()
        return fit(*arguments)

    monkeypatch.setattr(module, 'fit_size', fail_once)
    with pytest.raises(ValueError, match='of no kind'):
        learned(size, times, markers)
    when, _ = learned(size, times[120:], markers[120:])
    np.testing.assert_allclose(when, LEARNING_TIMES[1:], atol=.25)
    assert not size.is_learning
