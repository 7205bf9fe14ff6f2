"""A tracker fed with stamped frames tells when it has a hand, whatever the time does."""

import copy
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from hand_tracker.core.model.states import PalmState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.stamps import seconds
from hand_tracker.simulation.packaged_recordings import demo_recording

WHOLE = demo_recording(rate=30.).markers[0]
PALMLESS = np.where(np.arange(8)[:, None] == 1, np.nan, WHOLE)


@pytest.mark.parametrize('sec, nanosec, expected', [
    (0, 0, None), (0, 1, 1e-9), (12, 500_000_000, 12.5), (1_800_000_000, 0, 1.8e9)])
def test_a_zero_stamp_is_no_time(sec, nanosec, expected):
    assert seconds(SimpleNamespace(sec=sec, nanosec=nanosec)) == expected


def test_what_comes_out_is_a_hand_from_the_first_palm_on():
    stream = HandTracker()
    assert not stream.placed
    for time, markers, placed in ((1., PALMLESS, False), (1.1, WHOLE, True),
                                  (1.2, PALMLESS, True)):
        stream.update(markers, time)
        assert (stream.placed, stream.restarted) == (placed, False)


def test_what_comes_out_is_what_the_tracker_says():
    stream, tracker = HandTracker(), HandTracker()
    for time, markers in enumerate(demo_recording(rate=30.).markers[:30]):
        state = stream.update(markers, time / 30.)
        assert np.array_equal(state.angles, tracker.update(markers, time / 30.).angles)


@pytest.mark.parametrize('progress', [0., 1e-9])
def test_stamps_that_stand_do_not_freeze_the_hand(progress):
    tracker, true = HandTracker(), HandTracker()
    for frame, markers in enumerate(demo_recording(rate=120.).markers[:600]):
        state = tracker.update(markers, 5. + frame * progress)
        expected = true.update(markers, 5. + frame / 120.)
        np.testing.assert_array_equal(state.marker_states, expected.marker_states)
        np.testing.assert_allclose(state.markers, expected.markers, atol=2e-3)


@pytest.mark.parametrize('copied', [
    copy.deepcopy, lambda tracker: pickle.loads(pickle.dumps(tracker))], ids=['copy', 'pickle'])
def test_a_copy_goes_on_by_itself(copied):
    frames = demo_recording(rate=120.).markers
    tracker = HandTracker()
    for time, markers in enumerate(frames[:100]):
        tracker.update(markers, time / 120.)
    other = copied(tracker)
    assert other.placed
    expected = [tracker.update(markers, 3. + time / 120.)
                for time, markers in enumerate(frames[100:300])]
    for time, markers in enumerate(frames[100:300]):
        np.testing.assert_array_equal(
            other.update(markers, 3. + time / 120.).angles, expected[time].angles)
    for time in (0., .01):
        other.update(PALMLESS, time)
    assert other.restarted and not other.placed and tracker.placed


def test_a_hand_is_waited_for_again_when_time_jumps_back():
    stream = HandTracker()
    stream.update(WHOLE, 10.)
    assert stream.update(PALMLESS, 1.).palm is PalmState.CARRIED
    assert stream.update(PALMLESS, 1.01).palm is PalmState.WAITING
    assert stream.restarted and not stream.placed
    stream.update(WHOLE, 1.1)
    assert not stream.restarted and stream.placed


@pytest.mark.parametrize('time', [10., 9.9, None, 1e6, 0.])
def test_repeated_missing_and_stray_times_go_on(time):
    stream = HandTracker()
    stream.update(WHOLE, 10.)
    stream.update(PALMLESS, time)
    assert stream.placed and not stream.restarted
