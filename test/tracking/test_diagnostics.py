"""What diagnostics say of the tracking: levels, one line, values, told when they change."""

import numpy as np
import pytest
from helpers.frames import RESTING, frame, hidden, state_of

from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.labels import LabelMap
from hand_tracker.tracking.diagnostics import QUIET_AFTER, STATUS_GAP, Diagnostics, Level
from hand_tracker.tracking.fit_check import FAR_OFF_AFTER, FIT_AFTER, OFF_HAND_AFTER
from hand_tracker.tracking.input_monitor import SILENT_AFTER, SLOW_LABELLING, InputMonitor


class Hand:
    """A watch and a diagnosis that hear the same."""

    def __init__(self, labels=None):
        self.watch = InputMonitor(0., '/markers', labels or LabelMap())
        self.diagnosis = Diagnostics(0., self.watch)

    def feed(self, now, state, positions=RESTING):
        """Take one tracked frame; return whether it is to be told."""
        self.watch.received(now, frame(positions))
        self.watch.tracked(now, state)
        return self.diagnosis.tracked(now, state, 1, False)

    def status(self, now):
        """Return what is told."""
        return self.diagnosis.status(now, lambda: 'nobody is there')


def test_nothing_came_yet():
    hand = Hand()
    level, text, values = hand.status(1.)
    assert (level, text) == (Level.STALE, 'no markers on /markers yet')
    assert values['palm'] == 'not seen yet'
    assert all(values[f'{marker} marker'] == 'absent' for marker in MARKERS)
    level, text, _ = hand.status(SILENT_AFTER + 1.)
    assert level is Level.STALE and 'for 4 s: nobody is there' in text


def test_a_tracked_hand():
    hand = Hand()
    state = HandTracker().update(RESTING)
    for i in range(121):
        hand.feed(i / 120., state)
    level, text, values = hand.status(1.)
    assert (level, text) == (Level.OK, 'tracking')
    assert values == {
        'palm': 'tracked', 'rate [Hz]': '121.0', 'frames': '121', 'frames on fast path': '0',
        'frames left out': '0', 'hand size': 'given',
        'mean residual [mm]': '0.00',
        'latency p50 [ms]': '', 'latency p99 [ms]': '', 'latency max [ms]': '',
        'frames late': '0', 'frames dropped': '0',
        **{f'{marker} marker': 'seen' for marker in MARKERS}}
    level, _, values = hand.status(1.01 + SILENT_AFTER)
    assert level is Level.STALE
    assert (values['palm'], values['index marker']) == ('last tracked', 'last seen')


@pytest.mark.parametrize('state, level, said, value', [
    (MarkerState.PREDICTED, Level.OK, 'tracking', 'predicted for 2.50 s'),
    (MarkerState.REJECTED, Level.WARN, 'tracking; rejected: index, ring', 'rejected for 2.50 s'),
    (MarkerState.SWAPPED, Level.WARN, 'tracking; swapped: index, ring', 'swapped for 2.50 s'),
    (MarkerState.STALE, Level.WARN, 'tracking; stale: index, ring', 'stale for 2.50 s'),
    (MarkerState.ABSENT, Level.WARN, 'tracking; never seen: index, ring', 'absent for 2.50 s')])
def test_states_of_markers(state, level, said, value):
    hand = Hand()
    hand.feed(1., state_of(index=state, ring=state))
    status = hand.status(1.)
    assert (status.level, status.text) == (level, said)
    assert status.values['index marker'] == status.values['ring marker'] == value
    assert status.values['thumb marker'] == 'seen'


def test_a_marker_that_is_not_worn_is_no_trouble():
    hand = Hand(LabelMap([*'0123456', '']))
    hand.feed(1., state_of(thumb=MarkerState.ABSENT))
    status = hand.status(1.)
    assert (status.level, status.text) == (Level.OK, 'tracking')
    assert status.values['thumb marker'] == 'not worn'


@pytest.mark.parametrize('palm, said', [
    (PalmState.LOST, 'the palm is lost'), (PalmState.WAITING, 'waiting for the palm'),
    (PalmState.TOO_FAR_APART, 'too far apart')])
def test_without_a_palm_it_is_an_error(palm, said):
    hand = Hand()
    hand.feed(1., state_of(palm), hidden(0, 1, 2))
    status = hand.status(1.)
    assert status.level is Level.ERROR and said in status.text
    assert status.values['palm'] == palm.name.lower().replace('_', ' ')


def test_messages_without_a_marker_of_the_hand_are_an_error():
    hand = Hand()
    for i in range(10):
        hand.watch.received(i / 2., frame(stamp=False))
    status = hand.status(4.5)
    assert status.level is Level.ERROR and 'have held no marker of the hand' in status.text


def test_markers_off_the_hand_are_an_error():
    hand = Hand()
    off = state_of()._replace(residuals=np.full(8, .03))
    hand.feed(0., off)
    hand.feed(OFF_HAND_AFTER, off)
    status = hand.status(OFF_HAND_AFTER)
    assert status.level is Level.ERROR and '30 mm off the hand' in status.text
    assert status.values['mean residual [mm]'] == '30.00'


def test_markers_far_off_the_hand_are_warned_of_before_they_are_left_out():
    hand = Hand()
    off = state_of()._replace(residuals=np.full(8, .03))
    hand.feed(0., off)
    assert hand.status(0.)[:2] == (Level.OK, 'tracking')
    hand.feed(FAR_OFF_AFTER, off)
    assert hand.status(FAR_OFF_AFTER)[:2] == (Level.WARN, 'tracking; 30 mm off the hand')


@pytest.mark.parametrize('palm, quiet, text', [
    (PalmState.LOST, 0., SLOW_LABELLING), (PalmState.WAITING, 0., SLOW_LABELLING),
    (PalmState.TRACKED, 2. * SILENT_AFTER, SLOW_LABELLING),
    (PalmState.TRACKED, 0., f'tracking; {SLOW_LABELLING}')])
def test_what_too_few_frames_look_like_is_not_told_but_that_they_are_left_out(
        palm, quiet, text):
    hand = Hand()
    hand.watch.awaits_labelling = True
    assert hand.status(0.).level is Level.STALE     # nothing publishes
    hand.feed(0., state_of(palm))
    assert hand.status(quiet)[:2] == (Level.WARN, text)
    said = hand.watch.report(quiet, lambda: 'it is paused')
    assert said == ([(False, 'tracking')] if text.startswith('tracking') else [])


def test_why_no_hand_is_found_among_points_is_told_with_a_lost_palm():
    hand = Hand()
    hand.feed(0., state_of(PalmState.LOST))
    hand.watch.why_not_found = 'the points look like a left hand'
    status = hand.status(0.)
    assert status.level is Level.ERROR
    assert status.text.startswith('the palm is lost')
    assert status.text.endswith('; the points look like a left hand')


def test_a_hand_that_fits_badly_and_markers_that_have_just_ended_are_warned_of():
    hand, badly = Hand(), state_of()._replace(residuals=np.full(8, .008))
    for i in range(int(10. * FIT_AFTER) + 2):
        hand.feed(i / 10., badly)
    now = i / 10.
    assert hand.status(now)[:2] == (Level.OK, 'tracking')
    hand.watch.report(now, str)
    assert hand.status(now)[:2] == (Level.WARN, 'tracking; 8.0 mm off the hand on average')
    hand.watch.fit.forget()
    assert hand.status(now + QUIET_AFTER)[:2] == (Level.OK, 'tracking')
    assert hand.status(now + QUIET_AFTER + .2)[:2] == (
        Level.WARN, 'tracking; no markers for 1.2 s')


def test_the_rate_is_counted_anew_each_period_whatever_changed_meanwhile():
    hand = Hand()
    for i in range(10):
        hand.feed(i / 10., state_of())
    assert hand.status(.5).values['rate [Hz]'] == '0.0'
    assert hand.status(1.).values['rate [Hz]'] == '10.0'
    assert hand.status(1.5).values['rate [Hz]'] == '10.0'
    assert hand.status(2.).values['rate [Hz]'] == '0.0'


def test_latency_is_reported_for_each_period():
    hand = Hand()
    for i in range(100):
        hand.diagnosis.latency.add(1e-3 * (1 + (i == 50)), 5. + i / 100.)
    values = hand.status(1.).values
    assert values['latency p50 [ms]'] == '1.000'
    assert values['latency max [ms]'] == '2.000'
    assert (values['frames late'], values['frames dropped']) == ('0', '0')
    hand.diagnosis.latency.add(.02, 6.03)
    assert hand.status(1.5).values == values
    values = hand.status(2.).values
    assert values['latency p99 [ms]'] == '20.000'
    assert hand.status(3.).values['latency p50 [ms]'] == ''


def test_frames_on_the_fast_path_count():
    hand = Hand()
    hand.feed(0., state_of())
    hand.diagnosis.tracked(.5, state_of(), 48, True)
    values = hand.status(1.).values
    assert (values['frames'], values['rate [Hz]']) == ('49', '49.0')
    assert values['frames on fast path'] == '48'


def test_changes_are_reported_at_once_and_only_changes():
    hand = Hand()
    assert hand.feed(1., state_of())
    hand.status(1.)
    assert not hand.feed(2., state_of())
    assert hand.feed(2.1, state_of(index=MarkerState.PREDICTED))
    hand.status(2.1)
    assert not hand.feed(2.15, state_of())
    assert hand.feed(2.1 + 2. * STATUS_GAP, state_of())


def test_flickering_is_reported_at_a_bounded_rate():
    hand = Hand()
    told = 0
    for i in range(1000):
        state = state_of(index=MarkerState.PREDICTED) if i % 2 else state_of()
        if hand.feed(i / 200., state):
            hand.status(i / 200.)
            told += 1
    assert 20 < told <= 1. + 5. / STATUS_GAP


def test_only_troubles_that_came_and_went_bring_about_a_status():
    hand = Hand()
    now = state_of()
    hand.feed(0., now)
    hand.status(0.)
    ordinary = [(.2, now), (.21, state_of(index=MarkerState.PREDICTED)), (.22, now)]
    assert not hand.diagnosis.tracked(.22, now, 3, True, ordinary)
    lost = (.4, state_of(PalmState.LOST))
    assert hand.diagnosis.tracked(.42, now, 2, True, [lost, (.42, now)])


def test_what_came_and_went_between_two_statuses_is_told_once():
    hand = Hand()
    now = state_of()
    hand.diagnosis.tracked(0., now, 1, True, [(0., now)])
    hand.status(0.)
    assert not hand.diagnosis.tracked(.2, now, 1, True, [(.2, now)])
    # A batch of the fast path, whose last frame is as the one before.
    gone = [(.3, now), (.32, state_of(PalmState.LOST)),
            (.34, state_of(little=MarkerState.REJECTED)), (.36, now)]
    assert hand.diagnosis.tracked(.36, now, 9, True, gone)
    values = hand.status(.36).values
    assert values['little marker'] == 'seen, rejected since the last status'
    assert values['palm'] == 'tracked, lost since the last status'
    assert values['index marker'] == 'seen'
    # What flickers is told with each status, but does not bring them about.
    assert not hand.diagnosis.tracked(.6, now, 9, True, gone)
    assert hand.status(1.36).values['little marker'] == 'seen, rejected since the last status'
    assert not hand.diagnosis.tracked(1.6, now, 1, True, [(1.6, now)])
    assert hand.status(2.36).values['little marker'] == 'seen'
