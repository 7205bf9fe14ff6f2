"""How long frames take in the node, which never came, and what is throttled."""

import numpy as np
import pytest

from hand_tracker.tracking.diagnostics import FRAMES_KEPT, LatencyStatistics
from hand_tracker.tracking.rate_limit import RateLimiter

STEP = 1. / 128.  # [s], exact in binary


def test_times_of_each_summary():
    latency = LatencyStatistics()
    for i in range(100):
        latency.add(1e-3 * i, None)
    timing = latency.summary()
    assert (timing.p50, timing.longest) == (pytest.approx(.0495), pytest.approx(.099))
    assert timing.p50 < timing.p99 < timing.longest
    latency.add(.5, None)
    assert latency.summary()[:3] == (.5, .5, .5)
    assert np.isnan(latency.summary()[:3]).all()
    assert (timing.late, timing.dropped) == (0, 0)


def test_frames_that_stamps_tell_are_missing():
    latency = LatencyStatistics()
    for i in range(1, 1001):
        if i % 100 and i not in (250, 251, 252):
            latency.add(1e-4, i * STEP)
        if not i % 333:
            latency.summary()
    # The last one, 1000, is missing, but nothing came after it.
    assert latency.summary().dropped == 9 + 3


def test_an_outage_between_even_stamps_is_counted_however_long():
    latency = LatencyStatistics()
    for i in range(100):
        if not 30 <= i < 95:
            latency.add(1e-4, i * STEP)
    assert latency.summary().dropped == 65


@pytest.mark.filterwarnings('error')
def test_a_frame_after_a_pause_alone_is_no_loss():
    latency = LatencyStatistics()
    for stamp in (1., 3.):
        latency.add(1e-4, stamp)
    assert latency.summary().dropped == 0


@pytest.mark.parametrize('stamps', [
    [.083 * (i // 10) + 5e-4 * (i % 10) for i in range(600)],
    np.cumsum(np.random.default_rng(1).exponential(1. / 120., 600)),
    np.arange(600) / 120. + np.random.default_rng(1).uniform(0., 1. / 120., 600)],
    ids=['bursts', 'by chance', 'late by up to a period'])
def test_stamps_of_no_even_rate_tell_nothing_of_lost_frames(stamps):
    latency = LatencyStatistics()
    for number, stamp in enumerate(stamps):
        latency.add(1e-4, stamp)
        if not number % 120:
            latency.summary()
    assert latency.summary().dropped == 0


def test_a_pause_repeated_stamps_and_a_jump_back_are_no_loss():
    latency = LatencyStatistics()
    for stamp in (1., 1. + STEP, 1. + 2. * STEP, 1. + 2. * STEP, 30., 30. + STEP, 5., 5. + STEP):
        latency.add(1e-4, stamp)
    assert latency.summary().dropped == 0


def test_frames_of_which_nothing_is_known_any_more_are_no_loss():
    latency = LatencyStatistics()
    for stamp in (1., 1. + STEP, 1. + 2. * STEP, np.nan, 1. + 50. * STEP, 1. + 51. * STEP):
        latency.add(1e-4, stamp)
    assert latency.summary().dropped == 0


def test_frames_that_take_longer_than_the_time_between_two_are_late():
    latency = LatencyStatistics()
    for i in range(100):
        latency.add(1.5 * STEP if i in (10, 20, 30) else .5 * STEP, i * STEP)
    assert latency.summary().late == 3
    assert latency.summary().late == 3


def test_what_is_kept_is_bounded():
    latency = LatencyStatistics()
    for i in range(2 * FRAMES_KEPT):
        latency.add(1e-4, i * STEP)
    assert len(latency._latencies) == len(latency._times) == FRAMES_KEPT


@pytest.mark.parametrize('rate, limit, expected', [
    (120., 60., 60.), (100., 60., 60.), (960., 60., 60.), (30., 60., 30.), (120., 1., 1.)])
def test_a_throttle_gives_its_rate_or_that_of_the_frames(rate, limit, expected):
    throttle = RateLimiter()
    rng = np.random.default_rng(1)
    times = 1000. + np.arange(0., 20., 1. / rate)
    times += rng.uniform(0., .2 / rate, times.size)
    given = sum(throttle.due(now, limit) for now in times)
    assert given == pytest.approx(20. * expected, rel=.03, abs=1.)


def test_a_throttle_saves_nothing_up():
    throttle = RateLimiter()
    assert throttle.due(100., 10.)
    assert sum(throttle.due(200. + 1e-4 * i, 10.) for i in range(100)) <= 2


def test_frames_that_came_and_were_left_out_are_not_dropped():
    latency = LatencyStatistics()
    for i in range(1, 101):
        if i not in (50, 51, 70, 71, 72):
            latency.add(1e-4, i * STEP)
    latency.left_out(3)
    assert latency.summary().dropped == 2
    for i in (103, 104, 105, 106):
        latency.add(1e-4, i * STEP)
    assert latency.summary().dropped == 4
