"""Events of single markers: each change once, flickering or not."""

import numpy as np
import pytest

from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.model.states import MarkerState
from hand_tracker.tracking.marker_events import (
    EVENTS,
    MANY_EXCHANGED,
    RECOVERED_AFTER,
    UNLABELLED_AFTER,
    MarkerEvents,
)
from hand_tracker.tracking.rate_limit import LOG_LINES, LOG_WINDOW

INDEX, RING = MARKERS.index('index'), MARKERS.index('ring')


def states(**changed):
    """Return states of markers, seen but for some."""
    found = np.full(len(MARKERS), int(MarkerState.SEEN))
    for marker, state in changed.items():
        found[MARKERS.index(marker)] = state
    return found


def reported(events, now):
    """Return what is reported, with the places of markers as a list."""
    return [(is_warning, text, slots.tolist()) for is_warning, text, slots in events.report(now)]


RECOVERED = False, 'seen again as expected', [INDEX]


@pytest.mark.parametrize('state', EVENTS)
def test_a_change_is_reported_once_and_so_is_its_end(state):
    events = MarkerEvents()
    events.update(0., states(), True)
    assert reported(events, 0.) == []
    for now in (1., 2., 3.):
        events.update(now, states(index=state), True)
        assert reported(events, now) == ([(True, EVENTS[state], [INDEX])] if now == 1. else [])
    # Seen again for long enough, once.
    events.update(3. + .9 * RECOVERED_AFTER, states(), True)
    assert reported(events, 4.) == []
    events.update(3. + RECOVERED_AFTER, states(), True)
    assert reported(events, 4.) == [RECOVERED]
    events.update(9., states(), True)
    assert reported(events, 9.) == []


def test_markers_of_one_event_share_a_line_and_another_event_has_its_own():
    events = MarkerEvents()
    events.update(1., states(index=MarkerState.STALE, ring=MarkerState.STALE,
                             thumb=MarkerState.SWAPPED), True)
    assert reported(events, 1.) == [
        (True, EVENTS[MarkerState.STALE], [INDEX, RING]),
        (True, EVENTS[MarkerState.SWAPPED], [MARKERS.index('thumb')])]
    # From one event to another, without being seen between.
    events.update(2., states(index=MarkerState.REJECTED, ring=MarkerState.STALE,
                             thumb=MarkerState.SWAPPED), True)
    assert reported(events, 2.) == [(True, EVENTS[MarkerState.REJECTED], [INDEX])]


def test_a_single_frame_between_two_reports_counts():
    events = MarkerEvents()
    events.update(1., states(index=MarkerState.REJECTED), True)
    events.update(1.01, states(), True)
    assert reported(events, 1.1) == [(True, EVENTS[MarkerState.REJECTED], [INDEX])]
    # While it flickers it is not seen again.
    for now in np.arange(1.1, 5., .5 * RECOVERED_AFTER):
        events.update(now, states(index=MarkerState.REJECTED), True)
        events.update(now + .01, states(), True)
        assert reported(events, now) == []


@pytest.mark.parametrize('state', [MarkerState.PREDICTED, MarkerState.ABSENT])
def test_a_marker_that_is_hidden_for_a_moment_is_no_event(state):
    events = MarkerEvents()
    events.update(1., states(index=state), True)
    assert reported(events, 1.) == []
    # But it is not seen again either.
    events.update(2., states(index=MarkerState.STALE), True)
    assert len(reported(events, 2.)) == 1
    for now in (3., 4., 5.):
        events.update(now, states(index=state), True)
        assert reported(events, now) == []


def test_without_the_palm_nothing_is_reported_and_nothing_seen_again():
    events = MarkerEvents()
    events.update(0., states(index=MarkerState.STALE), True)
    assert len(reported(events, 0.)) == 1
    for now in (1., 5.):
        events.update(now, states(ring=MarkerState.REJECTED), False)
        assert reported(events, now) == []
    events.update(5. + .9 * RECOVERED_AFTER, states(), True)
    assert reported(events, 6.) == []
    events.update(5. + RECOVERED_AFTER, states(), True)
    assert reported(events, 6.) == [RECOVERED]


def test_lines_are_bounded_and_what_was_held_back_is_reported_later():
    events = MarkerEvents()
    lines = 0
    kinds = list(EVENTS)
    for i in range(200):
        now = i * .9 * LOG_WINDOW / 200.
        events.update(now, states(index=kinds[i % len(kinds)]), True)
        lines += len(reported(events, now))
    assert lines == LOG_LINES
    now = 2. * LOG_WINDOW
    events.update(now, states(), True)
    assert reported(events, now) == [RECOVERED]


def exchanged(first, count=MANY_EXCHANGED):
    return states(**dict.fromkeys(MARKERS[first:first + count], MarkerState.SWAPPED))


def test_many_labels_are_exchanged_anew_until_the_same_have_been_for_long():
    events = MarkerEvents()
    for now, given, is_new in (
            (0., exchanged(0, MANY_EXCHANGED - 1), False), (1., exchanged(0), True),
            (1. + .9 * UNLABELLED_AFTER, exchanged(0), True),
            (1. + UNLABELLED_AFTER, exchanged(0), False), (4., states(), False),
            (5., exchanged(0), False), (6., exchanged(1), True)):
        events.update(now, given, True)
        assert events.exchanges_many == is_new, now
