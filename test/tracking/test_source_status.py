"""The status of a source tells whether frames come, and what is wrong with them."""

import pytest

from hand_tracker.tracking import source_status
from hand_tracker.tracking.diagnostics import Level


@pytest.fixture
def clock(monkeypatch):
    """Return a clock of one number, which the status reads."""
    now = [100.]
    monkeypatch.setattr(source_status.time, 'monotonic', lambda: now[0])
    return now


def test_frames_are_counted_by_the_second(clock):
    status = source_status.SourceStatus()
    status.add(8, 3)
    status.add_alike(119)
    clock[0] += 1.
    found = status.status()
    assert (found.level, found.text) == (Level.OK, 'frames come')
    assert found.values == {'frames': '120', 'frames per second': '120.0', 'named markers': '8',
                            'anonymous points': '3'}
    status.add(7, 0)
    clock[0] += .5
    found = status.status()
    assert found.values == {'frames': '121', 'frames per second': '2.0', 'named markers': '7',
                            'anonymous points': '0'}


def test_silence_is_told_with_its_reason(clock):
    status = source_status.SourceStatus()
    assert status.status()[:2] == (Level.WARN, 'no frame yet')
    status.warn('nobody answers')
    assert status.status()[:2] == (Level.WARN, 'no frame yet; nobody answers')
    status.add(1, 0)
    clock[0] += 2.5
    status.warn('left out')
    assert status.status()[:2] == (Level.WARN, 'no frame for 2.5 s; left out')


def test_a_warning_lasts_as_long_as_frames_have_it(clock):
    status = source_status.SourceStatus()
    for _ in range(2):
        status.warn('no such subject')
        status.add(0, 0)
        assert status.status()[:2] == (Level.WARN, 'frames come; no such subject')
    status.add_alike(1)
    assert status.status().level == Level.WARN
    status.add(8, 0)
    assert status.status()[:2] == (Level.OK, 'frames come')
