"""The verdict of `benchmarks.soak`: each bound is exceeded by something."""

from types import SimpleNamespace

import pytest

from benchmarks.soak import JUDGED_FROM, MOST_FILES, MOST_LINES, MOST_P99, MOST_SLOPE, total

NEEDS = 'psutil',


def watched(slope=0., more_files=0, has_crashed=False):
    files = [10] * 2000 + [10 + more_files] * 10
    return {'tracker': SimpleNamespace(
        slope=lambda first: slope, files=files, has_crashed=has_crashed)}


def verdict(minutes=2 * JUDGED_FROM, last=1., lines=0, lost=0, **more):
    """Return the faults of a run whose last minutes are `last` times as slow as the first."""
    rows = [{'p99_us': 500. * (last if minute >= minutes // 2 else 1.), 'late': 0,
             'log_lines': {'tracker': lines}} for minute in range(minutes)]
    driver = SimpleNamespace(sent=1000, lost=lost, parameters_set=3, parameters_refused=1,
                             diagnostics={})
    return total(driver, watched(**more), rows, 480., minutes)[1]


def test_a_run_within_the_bounds_passes():
    assert verdict() == []


@pytest.mark.parametrize(('run', 'text'), [
    ({'lost': 1}, '1 of 1000 frames lost'),
    ({'last': 1.01 * MOST_P99}, 'p99 went from 500 to'),
    ({'slope': 1.01 * MOST_SLOPE}, 'memory grows by'),
    ({'slope': float('nan')}, 'memory grows by'),
    ({'more_files': MOST_FILES + 1}, 'more files open'),
    ({'has_crashed': True}, 'ended or failed: tracker'),
    ({'lines': MOST_LINES + 1}, 'lines logged in a minute'),
    ({'minutes': 0}, 'nothing was measured')])
def test_each_bound_is_judged(run, text):
    faults = verdict(**run)
    assert any(text in fault for fault in faults), faults


def test_growth_and_latency_of_minutes_are_not_judged():
    assert verdict(minutes=JUDGED_FROM - 1, last=2., slope=100.) == []
