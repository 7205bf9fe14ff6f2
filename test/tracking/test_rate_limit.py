"""Limits on how often something is done, under a clock that the test turns."""

import numpy as np
import pytest

from hand_tracker.tracking.rate_limit import (
    LOG_LINES,
    LOG_WINDOW,
    LogRateLimiter,
    RateLimiter,
    period_ns,
)


def due_times(limiter, times, rate):
    """Return those of the times at which it is due."""
    return np.array([now for now in times if limiter.due(now, rate)])


@pytest.mark.parametrize('frames, rate', [(120., 30.), (100., 60.), (960., 7.)])
def test_it_is_due_at_the_rate_whatever_the_rate_of_the_frames(frames, rate):
    times = 50. + np.arange(0., 20., 1. / frames)
    due = due_times(RateLimiter(), times, rate)
    assert len(due) == pytest.approx(20. * rate, abs=2)
    # Each is done with the first frame after it is due, so never a whole frame late.
    assert np.abs(np.diff(due)[1:] - 1. / rate).max() <= 1. / frames + 1e-9


def test_frames_that_are_slower_than_the_rate_are_all_due():
    times = 50. + np.arange(100) / 10.
    assert np.array_equal(due_times(RateLimiter(), times, 30.), times)


def test_a_pause_is_not_made_up_for():
    limiter = RateLimiter()
    due_times(limiter, np.arange(0., 1., .01), 10.)
    after = due_times(limiter, 100. + np.arange(0., 1., .001), 10.)
    assert after[0] == 100. and len(after) <= 1. * 10. + 2


def test_another_rate_counts_from_the_next_on():
    limiter = RateLimiter()
    due_times(limiter, np.arange(0., 1., .001), 100.)
    slower = due_times(limiter, np.arange(1., 11., .001), 2.)
    assert len(slower) == pytest.approx(20, abs=2)


def test_log_lines_are_allowed_again_one_by_one():
    limiter = LogRateLimiter()
    assert [limiter.allows(float(now)) for now in range(LOG_LINES)] == [True] * LOG_LINES
    assert not limiter.allows(LOG_WINDOW - .01)
    # The first is out of the window, the second is not.
    assert limiter.allows(LOG_WINDOW)
    assert not limiter.allows(LOG_WINDOW + .5)
    assert limiter.allows(LOG_WINDOW + 1.)


def test_no_window_has_more_log_lines_and_none_is_wasted():
    limiter = LogRateLimiter()
    times = np.cumsum(np.random.default_rng(3).exponential(.2, 5000))
    logged = np.array([now for now in times if limiter.allows(now)])
    # What is refused does not count.
    assert (logged[LOG_LINES:] - logged[:-LOG_LINES] >= LOG_WINDOW).all()
    assert len(logged) > .8 * LOG_LINES * times[-1] / LOG_WINDOW


def test_period_of_a_rate():
    assert [period_ns(rate) for rate in (30., 1., .1)] == [33_333_333, 10**9, 10**10]
