"""The status of a source tells whether frames come, and what is wrong with them."""

from hand_tracker.tracking.diagnostics import Level
from hand_tracker.tracking.source_status import MOST_WARNINGS, WARNED_TIME, SourceStatus


def test_frames_are_counted_by_the_second():
    status = SourceStatus(100.)
    status.add(100.1, 8, 3)
    status.add_alike(100.9, 119)
    found = status.status(101.)
    assert (found.level, found.text) == (Level.OK, 'frames come')
    assert found.values == {'frames': '120', 'rate [Hz]': '120.0', 'names of markers': '8',
                            'anonymous points': '3'}
    status.add(101.1, 7, 0)
    # Asked twice within a moment it keeps its rate.
    assert status.status(101.2).values == {
        'frames': '121', 'rate [Hz]': '120.0', 'names of markers': '7', 'anonymous points': '0'}
    assert status.status(103.).values['rate [Hz]'] == '0.5'


def test_silence_is_told_with_its_reason():
    status = SourceStatus(0.)
    assert status.status(1.)[:2] == (Level.WARN, 'no frame yet')
    assert status.status(2., 'nobody publishes')[:2] == (
        Level.WARN, 'no frame yet; nobody publishes')
    status.add(3., 1, 0)
    assert status.status(3.5, 'nobody publishes')[:2] == (Level.OK, 'frames come')
    status.warn(5., 'left out')
    assert status.status(5.5, 'nobody publishes')[:2] == (
        Level.WARN, 'no frame for 2.5 s; nobody publishes; left out')


def test_a_warning_that_is_said_once_lasts_for_a_while():
    status = SourceStatus(0.)
    for text in ('first', 'second', 'first'):
        status.warn(0., text)
    for now in (.5, WARNED_TIME - .5):
        status.add(now, 8, 0)
        assert status.status(now)[:2] == (Level.WARN, 'frames come; second; first')
    status.add(WARNED_TIME, 8, 0)
    assert status.status(WARNED_TIME)[:2] == (Level.OK, 'frames come')


def test_the_last_warnings_are_kept():
    status = SourceStatus(0.)
    for number in range(1000):
        status.warn(0., str(number))
    assert status.status(0.).text.count(';') == MOST_WARNINGS
    assert status.status(0.).text.endswith('; 998; 999')
