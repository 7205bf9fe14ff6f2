"""What the tracker says of its input: changes in time, each cause once, never too much."""

import re

import numpy as np
import pytest
from helpers.frames import RESTING, frame, hidden, state_of

from hand_tracker.core.model.hand import MEAN_BREADTH, MEAN_LENGTH, Hand
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.stamps import Stamp
from hand_tracker.simulation.packaged_recordings import demo_recording
from hand_tracker.simulation.simulator import calibrated
from hand_tracker.simulation.visibility import skin_layout
from hand_tracker.tracking.fit_check import FIT_AFTER, OFF_HAND_AFTER, REFIT_AFTER
from hand_tracker.tracking.input_monitor import (
    NEVER_SEEN_AFTER,
    SENDS_NOTHING,
    SILENT_AFTER,
    STANDING_STAMPS,
    START_UP,
    UNDISCOVERED,
    InputMonitor,
)
from hand_tracker.tracking.marker_events import RECOVERED_AFTER
from hand_tracker.tracking.rate_limit import KEYS_LOGGED, LOG_LINES, LOG_WINDOW


class Input:
    """A tracker and its watch, fed with markers."""

    def __init__(self, labels=None):
        self.watch = InputMonitor(0., '/markers', labels or LabelMap())
        # Nothing is refused: what is wrong with the palm is to be said here.
        self.tracker = HandTracker(options=TrackerOptions(outlier_gate=0., swap_margin=0.))

    def feed(self, now, positions=RESTING, **causes):
        """Take one message."""
        self.watch.received(now, frame(positions, **causes))
        if causes.get('stamp', True):
            self.watch.tracked(now, self.tracker.update(positions))

    def fare(self, now, palm=PalmState.TRACKED, **states):
        """Take one message of which the tracker makes these states of markers."""
        self.watch.received(now, frame())
        self.watch.tracked(now, state_of(palm, **states))

    def said(self, now):
        """Return the lines that are to be logged."""
        return [line for _, line in self.watch.report(now, lambda: 'nobody is there')]


@pytest.mark.parametrize('unknown, is_asked', [(8, True), (9, False)])
def test_ids_that_begin_with_one_are_asked_for(unknown, is_asked):
    hand = Input()
    positions = RESTING.copy()
    positions[0] = np.nan
    hand.feed(.1, positions, unknown=(('', unknown),))
    line, = hand.said(.1)
    assert f"not seen yet '0' (wrist); there are '/{unknown}'" in line
    assert ('do the ids begin with 1? Then set labels.*' in line) == is_asked


def test_says_when_tracking_starts_and_no_more():
    hand = Input()
    assert hand.said(0.) == []
    hand.feed(.1)
    assert hand.watch.report(.1, str) == [(False, 'tracking')]
    for i in range(2, 50):
        hand.feed(i / 10.)
        assert hand.said(i / 10.) == []


@pytest.mark.parametrize('fault, positions, said', [
    (PalmState.LOST, hidden(0, 1, 2), 'the palm is lost'),
    (PalmState.COINCIDENT, np.vstack((RESTING[[0, 0, 0]], RESTING[3:])), 'coincide'),
    (PalmState.COLLINEAR, np.vstack(
        (RESTING[:2], [(RESTING[0] + RESTING[1]) / 2.], RESTING[3:])), 'one line'),
    (PalmState.TOO_FAR_APART, 1000. * RESTING[:8] / 30., 'unit_scale')])
def test_says_which_fault_the_palm_has_and_since_when(fault, positions, said):
    hand = Input()
    hand.feed(.1)
    hand.said(.1)
    hand.feed(1., positions)
    assert hand.watch._palm is fault
    hand.feed(1.4, positions)
    (warning, line), = hand.watch.report(1.5, str)
    assert warning and said in line and 'since 0.5 s' in line
    hand.feed(2.)
    assert hand.watch.report(2., str) == [(False, 'tracking again')]


def test_a_carried_palm_is_tracked():
    hand = Input()
    hand.feed(.1)
    hand.said(.1)
    hand.feed(.2, hidden(1))
    assert hand.said(.2) == []


def test_a_palm_that_is_lost_by_its_unit_says_so():
    hand = Input()
    hand.feed(0.)
    assert hand.said(0.) == ['tracking']
    hand.feed(.1, RESTING + np.array((0., 0., 2e3)))
    line, = hand.said(.1)
    assert 'the palm is lost: its markers are more than a kilometre away; check unit_scale' in line


def test_a_flickering_palm_is_said_a_bounded_number_of_times():
    hand = Input()
    lines = []
    for i in range(1000):
        hand.feed(i / 100., RESTING if i % 2 else hidden(0, 1, 2))
        lines += hand.said(i / 100.)
    assert len(lines) == LOG_LINES
    now = 10. + LOG_WINDOW
    hand.feed(now)
    lines += hand.said(now)
    assert lines[-1].startswith('tracking')


def test_says_once_when_the_markers_stay_off_the_hand_and_again_when_not():
    off = RESTING.copy()
    off[3:] *= 1.6  # farther than any finger reaches
    hand = Input()
    lines = []
    for i in range(200):
        hand.feed(i / 20., off)
        lines += [(i / 20., *line) for line in hand.watch.report(i / 20., str)]
    (_, *first), (then, *second) = lines
    assert first == [False, 'tracking']
    miss = 1e3 * np.mean(hand.tracker.update(off).residuals)
    assert second == [True, f'the markers are on average {miss:.0f} mm off the hand, '
                      'which is left out: wrong side, labels, layout or hand size (a hand file '
                      'says it: hand_file, hand:=)?']
    assert then == pytest.approx(OFF_HAND_AFTER)
    hand.feed(10.)
    assert hand.watch.report(10., str) == [(False, 'tracking again')]


# Off the hand by less than ends the tracking of one frame, and by more; on average by more.
NEAR, FAR = (state_of()._replace(residuals=np.full(8, miss)) for miss in (.010, .026))


def feed_by_turns(hand, start, seconds, *states):
    """Take frames of a moving hand at 20 Hz, with these states in turn; return what is said."""
    said = []
    for i in range(round(20. * seconds)):
        hand.watch.received(start + i / 20., frame())
        hand.watch.tracked(start + i / 20., states[i % len(states)])
        said += hand.said(start + i / 20.)
    return said


def test_markers_far_off_on_average_are_not_tracked_though_some_frames_fit():
    hand = Input()
    first, second = feed_by_turns(hand, 0., 1.1 * FIT_AFTER, NEAR, FAR)
    assert first == 'tracking' and 'on average 18 mm off the hand, which is left out' in second
    assert hand.watch.is_wrong
    assert feed_by_turns(hand, 20., 1.1 * FIT_AFTER, state_of()) == ['tracking again']
    assert not hand.watch.is_wrong


def test_a_hand_far_off_is_taken_back_once_it_fits_for_two_seconds_not_for_a_moment():
    hand = Input()
    feed_by_turns(hand, 0., 2. * FIT_AFTER, NEAR, FAR)
    feed_by_turns(hand, 2. * FIT_AFTER, .8 * REFIT_AFTER, NEAR)
    assert hand.watch.is_wrong
    now = 2. * FIT_AFTER + .8 * REFIT_AFTER
    # With the palm lost that is what is said.
    hand.fare(now, PalmState.LOST)
    assert hand.watch.situation(now) is PalmState.LOST and hand.watch.is_wrong
    feed_by_turns(hand, now, 2. * REFIT_AFTER, state_of())
    assert not hand.watch.is_wrong


# Nearer than counts as far off, farther than a hand that fits; and as in `feed_by_turns`.
DOUBTFUL = state_of()._replace(residuals=np.full(8, .014))


@pytest.mark.parametrize('turns, is_left_out', [
    ((FAR, FAR, DOUBTFUL), True), ((FAR, DOUBTFUL), False),
    ((*(FAR,) * 20, state_of()), False)])
def test_a_hand_far_off_in_most_frames_is_left_out_until_it_fits(turns, is_left_out):
    hand = Input()
    feed_by_turns(hand, 0., 4. * OFF_HAND_AFTER, *turns)
    for i, state in enumerate(turns):
        hand.watch.tracked(8. + i / 20., state)
        assert hand.watch.is_wrong == is_left_out
    hand.watch.tracked(9., state_of())
    assert not hand.watch.is_wrong


def test_frames_without_a_palm_say_nothing_of_a_hand_far_off():
    hand, lost = Input(), state_of(PalmState.LOST)
    feed_by_turns(hand, 0., 2.2 * OFF_HAND_AFTER, FAR, lost)
    assert hand.watch.is_wrong
    feed_by_turns(hand, 2.2 * OFF_HAND_AFTER, 2. * OFF_HAND_AFTER, lost)
    assert hand.watch.is_wrong and hand.watch.situation(5.) is PalmState.LOST
    hand.watch.tracked(10., state_of())
    assert not hand.watch.is_wrong


def test_a_hand_that_fits_is_not_left_out_for_another_of_before():
    hand = Input()
    feed_by_turns(hand, 0., .6 * FIT_AFTER, *(FAR,) * 30, state_of())
    said = feed_by_turns(hand, .6 * FIT_AFTER, .6 * FIT_AFTER, state_of())
    assert not hand.watch.is_wrong and not any('left out' in line for line in said)


def test_how_long_a_hand_was_far_off_does_not_count_for_the_next():
    hand = Input()
    feed_by_turns(hand, 0., .9 * OFF_HAND_AFTER, FAR)
    hand.watch.fit.forget()
    feed_by_turns(hand, .9 * OFF_HAND_AFTER, .9 * OFF_HAND_AFTER, FAR)
    assert not hand.watch.is_wrong


def test_a_recording_that_ends_far_off_says_so_and_not_that_it_was_left_out():
    hand = Input()
    feed_by_turns(hand, 0., .5 * FIT_AFTER, NEAR, FAR)
    hand.watch.ended()
    line, = hand.said(.5 * FIT_AFTER)
    assert '18 mm off the hand: wrong side' in line and 'left out' not in line


@pytest.mark.parametrize('miss, said', [
    (.026, '26 mm off the hand: wrong side'), (.3, '300 mm off the hand: wrong unit (unit_scale')])
def test_a_recording_that_is_off_in_every_frame_says_so_however_short_it_is(miss, said):
    off = state_of()._replace(residuals=np.full(8, miss))
    hand, other = Input(), Input()
    feed_by_turns(hand, 0., .1, off)
    hand.watch.tracked(.1, state_of(PalmState.LOST)._replace(residuals=np.full(8, np.nan)))
    feed_by_turns(other, 0., .1, NEAR, off)
    hand.watch.ended()
    other.watch.ended()
    line, = (line for line in hand.said(.1) if 'off the hand' in line)
    assert said in line and not other.said(.1)


def test_names_in_the_namespace_are_told_where_the_palm_is_waited_for():
    hand = Input()
    hand.watch.received(0., frame(hidden(1, 2), doubled=(0,)))
    hand.watch.tracked(0., state_of(PalmState.WAITING))
    assert "not seen yet '1' (index_mcp), '2' (little_mcp)" in hand.watch.why_never()
    assert "several markers of one message answer to the label '0'" in hand.watch.why_never()


def test_a_message_that_is_none_of_markers_is_named_while_no_other_comes():
    hand = Input()
    hand.watch.received_unreadable('malformed', 'left out: PoseArray of 20 poses')
    assert hand.said(1.) == ['left out: PoseArray of 20 poses']
    assert 'for 4 s: left out: PoseArray of 20 poses' in hand.watch.describe(4., 'silent', str)
    # They do arrive.
    assert hand.watch.describe(4., 'silent', lambda: f'/rig publishes them, but {SENDS_NOTHING}'
                               ).endswith('of 20 poses; /rig publishes them')
    hand.feed(5.)
    assert 'for 4 s: nobody is there' in hand.watch.describe(
        9., 'silent', lambda: 'nobody is there')


def test_a_frame_that_changes_between_messages_is_said_once():
    hand = Input()
    said = []
    for number, name in enumerate(('a', 'b', '', 'a', 'b')):
        hand.watch.received(float(number), frame()._replace(frame_id=name))
        said += hand.said(float(number))
    line, = (line for line in said if 'frame changes' in line)
    assert "from 'a' to 'b'" in line and 'mocap_frame' in line


def test_says_nothing_of_markers_that_are_off_for_a_moment_or_while_the_palm_is_lost():
    off = RESTING.copy()
    off[3:] *= 1.6
    hand = Input()
    hand.feed(0.)
    assert hand.said(0.) == ['tracking']
    for i in range(1, 200):
        hand.feed(i / 20., RESTING if i % 30 == 0 else off)
        assert hand.said(i / 20.) == []
    lost = off.copy()
    lost[:3] = np.nan
    for i in range(200, 300):
        hand.feed(i / 20., lost)
        assert not any('off the hand' in line for line in hand.said(i / 20.))


def test_tells_of_another_person_where_the_size_was_learned():
    off = RESTING.copy()
    off[3:] *= 1.6
    for learned, is_told in (('70 mm', True), ('', False)):
        hand = Input()
        hand.watch.learned_size = learned
        lines = []
        for i in range(100):
            hand.feed(i / 20., off)
            lines += hand.said(i / 20.)
        line = next(line for line in lines if 'off the hand' in line)
        assert ('size was learned (70 mm; ~/reset learns it anew)?' in line) is is_told


def test_says_that_a_right_hand_is_no_left_one():
    hand = Input()
    hand.tracker = HandTracker(Hand.scaled(side='left'))
    lines = []
    for i, positions in enumerate(demo_recording(rate=30.).markers):
        hand.feed(i / 30., positions)
        lines += hand.said(i / 30.)
    assert any('wrong side' in line for line in lines)


def said_of_the_demo(hand, layout, known_hand, known_layout, seconds=None):
    """Return what is said of the fit when the demo's hand is tracked as another."""
    rate = 60.
    entry = Input()
    entry.tracker = HandTracker(known_hand, known_layout)
    lines = []
    markers = demo_recording(hand, layout, rate).markers
    for i, positions in enumerate(markers[:None if seconds is None else round(rate * seconds)]):
        entry.feed(i / rate, positions)
        lines += entry.said(i / rate)
    entry.watch.ended()
    lines += entry.said(len(markers) / rate)
    return [line for line in lines if 'expected is a hand file' in line]


@pytest.mark.parametrize('seconds', [None, 9.])
def test_says_once_that_markers_on_the_skin_need_a_hand_file(seconds):
    hand = Hand.scaled()
    line, = said_of_the_demo(hand, skin_layout(hand), hand, MarkerLayout(), seconds)
    miss, = re.findall(r'on average ([\d.]+) mm', line)
    assert 5. < float(miss) < 8.


@pytest.mark.parametrize('seed', [1, 2])
def test_a_calibrated_hand_fits(seed):
    hand = Hand.scaled()
    layout = skin_layout(hand)
    assert not said_of_the_demo(hand, layout, *calibrated(hand, layout, seed))


@pytest.mark.parametrize('size, fits', [(.9, True), (.95, True), (1.05, True), (1.15, False)])
def test_a_hand_of_about_the_mean_size_fits(size, fits):
    hand = Hand.scaled(size * MEAN_LENGTH, size * MEAN_BREADTH)
    said = said_of_the_demo(hand, MarkerLayout(), Hand.scaled(), MarkerLayout())
    assert len(said) == (not fits)


def test_a_moment_is_too_short_to_judge_the_fit():
    hand = Hand.scaled()
    assert not said_of_the_demo(hand, skin_layout(hand), hand, MarkerLayout(), 1.5)


def test_names_the_never_seen_at_the_end_of_a_short_recording():
    hand = Input()
    hand.feed(.1, hidden(7), unknown=(('daumen', 0),))
    assert hand.said(.1) == ['tracking']
    hand.watch.ended()
    assert hand.said(.1) == ["never seen so far: '7' (thumb); there are 'daumen/0'"]


def test_says_what_the_palm_waits_for():
    hand = Input(LabelMap(['leds/0', *'1234567']))
    hand.feed(.1, hidden(0, 2), unknown=(('ids', 0),))
    line, = hand.said(.1)
    assert line.startswith('waiting for the palm')
    assert "'leds/0' (wrist), '2' (little_mcp)" in line
    assert "'ids/0'" in line and 'index_mcp)' not in line


def test_says_when_nothing_comes_and_when_it_comes_again():
    hand = Input()
    assert hand.said(SILENT_AFTER) == []
    line, = hand.said(SILENT_AFTER + .1)
    assert line == 'no markers on /markers for 3 s: nobody is there'
    assert hand.said(SILENT_AFTER + 60.) == []
    hand.feed(70.)
    assert hand.said(70.) == ['tracking']
    line, = hand.said(80.)
    assert 'for 10 s' in line
    hand.feed(81.)
    assert hand.said(81.) == ['tracking again']


def test_nothing_need_publish_while_a_source_may_still_start():
    hand = Input()
    assert hand.watch.report(START_UP - .1, lambda: None) == []
    (warning, line), = hand.watch.report(START_UP, lambda: None)
    assert warning and line == ('no markers on /markers for 20 s: nothing publishes them '
                                '(a remapping, ROS_DOMAIN_ID?)')
    # Nor need what publishes them send any yet; but it may not be of another kind.
    hand = Input()
    assert hand.watch.report(START_UP - .1, lambda: f'/replay, but {SENDS_NOTHING}') == []
    (warning, line), = hand.watch.report(SILENT_AFTER + .1, lambda: 'best effort, not reliable')
    assert warning and line.endswith('best effort, not reliable')
    # A publisher's node is named as soon as discovery knows it.
    hand = Input()
    unnamed = f'{UNDISCOVERED} publishes with best effort'
    assert hand.watch.report(SILENT_AFTER + .1, lambda: unnamed) == []
    (warning, line), = hand.watch.report(SILENT_AFTER + .2, lambda: '/driver publishes')
    assert warning and line.endswith('/driver publishes')
    hand = Input()
    (warning, line), = hand.watch.report(START_UP, lambda: unnamed)
    assert warning and line.endswith(unnamed)


def test_the_end_of_a_source_is_said_once_and_is_no_warning():
    hand = Input()
    hand.feed(.1)
    assert hand.said(.1) == ['tracking']
    assert hand.watch.report(SILENT_AFTER, lambda: None) == []
    assert hand.watch.report(SILENT_AFTER + .2, lambda: None) == [
        (False, 'no markers on /markers for 3 s: what published them has ended')]
    assert hand.watch.report(60., lambda: None) == []


def test_says_when_no_label_matches():
    hand = Input()
    for i in range(8):
        hand.feed(i / 2., stamp=False, unknown=(('leds', 11), ('leds', 12)))
    line, = hand.said(3.5)
    assert "'leds/11', 'leds/12'" in line
    assert "'0' (wrist)" in line and "'7' (thumb)" in line


def test_says_when_all_markers_are_in_another_frame():
    hand = Input()
    for i in range(8):
        hand.feed(i / 2., stamp=False, foreign=('base',))
    cause, line = hand.said(3.5)
    assert "frame 'base' are left out" in cause and 'mocap_frame' in cause
    assert "in frame 'base'" in line


def test_names_markers_that_were_never_seen_once():
    hand = Input(LabelMap([*'0123456', 'thumb/*']))
    lines = []
    for i in range(200):
        hand.feed(i / 10., hidden(7), unknown=(('daumen', 0),))
        lines += hand.said(i / 10.)
    assert lines[0] == 'tracking'
    assert lines[1:] == ["never seen so far: 'thumb/*' (thumb); there are 'daumen/0'"]


def test_does_not_miss_a_marker_that_is_not_worn():
    hand = Input(LabelMap([*'0123456', '']))
    lines = []
    for i in range(200):
        hand.feed(i / 10., hidden(7))
        lines += hand.said(i / 10.)
    assert lines == ['tracking']


def test_a_layout_most_of_whose_markers_never_come_is_doubted():
    for hidden_slots, is_doubted in ((range(3, 8), True), (range(5, 8), False)):
        hand = Input()
        for now in np.arange(0., NEVER_SEEN_AFTER + .2, .1):
            hand.feed(now, hidden(*hidden_slots))
        line, = (line for line in hand.said(now) if line.startswith('never seen so far'))
        assert line.endswith('; are the markers of another layout?') == is_doubted


def test_says_each_cause_once():
    hand = Input()
    lines = []
    for i in range(100):
        hand.feed(i / 100., doubled=(3,), foreign=('base',))
        lines += hand.said(i / 100.)
    assert len(lines) == 3
    assert sum("label '3' of index" in line for line in lines) == 1


def test_markers_of_the_other_hand_that_are_left_out_are_told_of_once():
    hand = Input(LabelMap(not_of='left'))
    others = tuple(('left', number) for number in range(8))
    for now in (0., .1):
        hand.feed(now, unknown=others)
    left_out, tracking = hand.said(.1)
    assert left_out.startswith("markers of namespace 'left' are left out, as the left hand's: "
                               'side:=left, side:=both, or ')
    assert tracking == 'tracking'
    alone = Input(LabelMap(not_of='left'))
    alone.watch.received(0., frame(np.full((8, 3), np.nan), stamp=None, unknown=others))
    alone.watch.tracked(0., state_of(PalmState.WAITING))
    assert "'left/7'; markers of namespace 'left' are left out" in alone.watch.why_never()


def test_says_in_a_line_that_markers_of_two_hands_have_each_label():
    hand = Input()
    for now in (0., .1):
        hand.feed(now, doubled=tuple(range(8)))
    line, _ = hand.said(.1)
    assert "the label '0' of wrist, and so it is with 7 more labels; the last one counts" in line
    hand.watch.bends_away_from = 'right'
    assert hand.watch.side_fault().endswith(
        'two are exchanged; markers of both hands are told apart with side:=both')
    hand.feed(.2)
    assert hand.watch.side_fault().endswith('two are exchanged')


def test_says_a_bounded_number_of_causes():
    hand = Input()
    for i in range(1000):
        hand.watch.warn_once(i, 'text')
    assert len(hand.said(1.)) == KEYS_LOGGED


@pytest.mark.parametrize('state, said', [
    (MarkerState.STALE, 'no longer seen'),
    (MarkerState.REJECTED, 'seen where it cannot be'),
    (MarkerState.SWAPPED, 'seen under the label of another')])
def test_says_once_what_became_of_markers_and_that_they_are_back(state, said):
    hand = Input(LabelMap(['0', '1', '2', 'leds/3', *'4567']))
    lines = []
    for i in range(1, 120):
        now = i / 10.
        trouble = 2. <= now < 7.
        hand.fare(now, **({'index': state, 'thumb': state} if trouble else {}))
        lines += [(now, *line) for line in hand.watch.report(now, str)]
    (_, *started), (first, is_warning, warning), (then, *back) = lines
    assert started == [False, 'tracking']
    assert (first, is_warning) == (2., True)
    assert said in warning and warning.endswith(": 'leds/3' (index), '7' (thumb)")
    assert then == pytest.approx(6.9 + RECOVERED_AFTER)
    assert back == [False, "seen again as expected: 'leds/3' (index), '7' (thumb)"]


def test_says_what_happened_to_a_marker_between_two_reports():
    hand = Input()
    hand.fare(.1)
    hand.said(.1)
    hand.fare(.2, ring=MarkerState.REJECTED)
    hand.fare(.21)
    line, = hand.said(.3)
    assert line == "seen where it cannot be, and not used: '5' (ring)"


def test_of_a_hand_of_the_other_side_its_side_alone_is_said():
    hand = Input()
    hand.fare(.1)
    assert hand.said(.1) == ['tracking']
    hand.watch.bends_away_from = 'left'
    hand.fare(.2, ring=MarkerState.SWAPPED)
    line, = hand.said(.2)
    assert line.startswith('the fingers bend away from the palm of a left hand')
    for i in range(3, 150):
        hand.fare(.1 * i, ring=MarkerState.REJECTED)
        assert hand.said(.1 * i) == []
    # It was of this side after all.
    hand.watch.bends_away_from = None
    hand.fare(15., ring=MarkerState.REJECTED)
    assert hand.said(15.) == ['tracking again',
                              "seen where it cannot be, and not used: '5' (ring)"]


def test_flickering_markers_are_said_a_bounded_number_of_times():
    rng = np.random.default_rng(5)
    hand = Input()
    lines = []
    for i in range(6000):
        states = dict(zip(MARKERS, rng.choice(list(MarkerState), len(MARKERS))))
        hand.fare(i / 100., **states)
        lines += hand.said(i / 100.)
    assert LOG_LINES < len(lines) <= 2 + LOG_LINES * 60. / LOG_WINDOW


def test_does_not_name_markers_while_the_palm_is_lost_or_nothing_comes():
    hand = Input()
    hand.fare(.1)
    hand.fare(.2, index=MarkerState.STALE)
    assert len(hand.said(.2)) == 2
    stale = dict.fromkeys(MARKERS, MarkerState.STALE)
    for i in range(3, 50):
        hand.fare(i / 10., PalmState.LOST, **stale)
        assert not any("'5'" in line for line in hand.said(i / 10.))
    hand.fare(5.)
    assert hand.said(5.) == ['tracking again']
    hand.said(7.)
    assert not any('as expected' in line for line in hand.said(8.))
    hand.fare(9.)
    assert "seen again as expected: '3' (index)" in hand.said(9.)


def test_says_once_that_the_stamps_stand():
    hand = Input()
    hand.feed(.1)
    hand.said(.1)
    for _ in range(2 * STANDING_STAMPS):
        hand.watch.received(.2, frame(stamp=Stamp(0, 0)))
    for i in range(2 * STANDING_STAMPS):
        hand.watch.received(.2, frame(stamp=Stamp(1, i)))
    assert hand.said(.2) == []
    for _ in range(3 * STANDING_STAMPS):
        hand.watch.received(.3, frame(stamp=Stamp(2, 3)))
    assert hand.said(.3) == ['the stamps stand still: frames are taken to come evenly']
    assert hand.said(.4) == []


def test_stamps_that_passed_in_between_do_not_stand():
    hand = Input()
    hand.feed(.1)
    hand.said(.1)
    for i in range(3 * STANDING_STAMPS):
        hand.watch.received(.2, frame(stamp=Stamp(2, 3)))
        hand.watch.received_alike(.2, Stamp(4, i))
    assert hand.said(.2) == []


def test_says_once_that_time_jumped_back():
    hand = Input()
    for _ in range(10):
        hand.watch.restarted()
    line, = hand.said(1.)
    assert 'jumped back' in line and 'use_sim_time' in line


def test_how_long_no_marker_was_of_the_hand_counts_from_the_first_message():
    hand = Input()
    for number in range(40):
        hand.feed(20. + .1 * number, hidden(*range(8)), stamp=False, unknown=(('leds', 40),))
        lines = hand.said(20. + .1 * number)
        assert any('held no marker' in line for line in lines) == (number == 31), number


def searched(hand, now, positions, points, **causes):
    """Take a message of points without labels."""
    found = frame(positions, **causes)._replace(searched=points)
    hand.watch.received(now, found)
    if causes.get('stamp', True):
        hand.watch.tracked(now, hand.tracker.update(positions))


def test_of_points_without_labels_no_label_is_expected():
    hand = Input()
    points = np.vstack((RESTING[:5], np.full((3, 3), np.nan)))
    searched(hand, .1, hidden(*range(8)), points)
    there = 'there are 5 points without labels'
    assert hand.said(.1) == [f'waiting for the palm: no hand is found yet; {there}']
    assert hand.watch.why_never() == f'waiting for the palm: no hand is found yet; {there}'
    # It is found, but for the wrist.
    searched(hand, .2, hidden(0), RESTING[1:])
    assert hand.watch.why_never() == (
        'waiting for the palm: not seen yet wrist; there are 7 points without labels')
    for number in range(40):
        searched(hand, 1. + .1 * number, hidden(*range(8)), points[5:], stamp=False)
    line, = (line for line in hand.said(5.) if 'held no marker' in line)
    assert line.endswith(' s: there are 0 points without labels')


def test_where_all_markers_are_of_another_frame_no_label_is_expected():
    hand = Input()
    for number in range(40):
        hand.feed(.1 * number, hidden(*range(8)), stamp=False, foreign=('world',))
    found = [line for line in hand.said(4.) if 'held no marker' in line]
    assert len(found) == 1 and 'labels' not in found[0]
    assert "there are markers in frame 'world'; expected is frame 'mocap' (mocap_frame" in found[0]
