"""Time between frames, whatever their stamps say."""

import numpy as np
import pytest

from hand_tracker.core.filtering.frame_clock import (
    DEFAULT_STEP,
    MAX_REPEATS,
    MAX_STEP,
    MIN_STEP,
    PAUSE_LIMIT,
    REORDER_LIMIT,
    advance_clock,
    initial_clock,
)
from hand_tracker.core.numerics.packs import packed


class Clock:
    """The kernel and what it keeps; None for a time that is not known."""

    def __init__(self):
        self._kept, _ = packed(initial_clock())

    def step(self, time):
        return advance_clock(self._kept[0], np.nan if time is None else float(time))


def clock_at(*times):
    clock = Clock()
    for time in times:
        clock.step(time)
    return clock


@pytest.mark.parametrize('time', [None, np.nan, np.inf, -np.inf])
def test_a_frame_without_time_comes_one_usual_step_later(time):
    assert Clock().step(time) == (DEFAULT_STEP, False, False)
    clock = clock_at(*(np.arange(300) / 50.))
    assert clock.step(time) == (pytest.approx(.02), False, False)
    # It says nothing of when the next one comes.
    assert clock.step(300. / 50.) == (pytest.approx(.02), False, False)


@pytest.mark.parametrize('start', [0., -5., 1.7e9])
def test_steps_are_those_of_the_stamps(start):
    clock = Clock()
    assert clock.step(start) == (DEFAULT_STEP, False, False)
    for step in (.01, .002, .5, PAUSE_LIMIT - .01):
        start += step
        assert clock.step(start) == (pytest.approx(step, abs=1e-6), False, False)


@pytest.mark.parametrize(
    'back', [0., MIN_STEP / 2., .01, .49 * REORDER_LIMIT, .99 * REORDER_LIMIT])
def test_a_repeated_or_somewhat_older_stamp_takes_no_time(back):
    clock = clock_at(3.)
    assert clock.step(3. - back) == (0., False, False)
    assert clock.step(3.01) == (pytest.approx(.01), False, False)


@pytest.mark.parametrize('progress', [0., MIN_STEP / 1000., -.001])
def test_frames_of_a_clock_that_stands_come_evenly(progress):
    clock = clock_at(*(np.arange(300) / 50.))
    last = 299. / 50.
    steps = [clock.step(last + i * progress) for i in range(1, 65)]
    assert steps[:MAX_REPEATS] == MAX_REPEATS * [(0., False, False)]
    assert steps[MAX_REPEATS:] == (64 - MAX_REPEATS) * [(pytest.approx(.02), False, False)]
    assert clock.step(last + .02) == (pytest.approx(.02), False, False), 'goes on'


def test_a_clock_set_back_takes_no_time_from_the_frames():
    clock = clock_at(*(np.arange(300) / 50.))
    steps = [clock.step(i / 50. - .3)[0] for i in range(300, 400)]
    assert steps[:MAX_REPEATS] == MAX_REPEATS * [0.]
    assert steps[MAX_REPEATS:] == pytest.approx([.02] * (100 - MAX_REPEATS))


def test_smallest_numbers_take_no_time():
    assert clock_at(0.).step(5e-324) == (0., False, False)


@pytest.mark.parametrize('back', [1.01 * REORDER_LIMIT, 3., 1e9])
@pytest.mark.parametrize('later', [0., .01, 2.])
def test_time_that_jumps_back_and_goes_on_there_begins_anew(back, later):
    clock = clock_at(10., 10.01)
    if later >= .5 * back:
        return
    step, paused, restarted = clock.step(10.01 - back)
    assert 0. < step < .1 and not paused and not restarted
    step, paused, restarted = clock.step(10.01 - back + later)
    assert 0. < step < .1 and not paused and restarted
    assert clock.step(10.02 - back + later) == (pytest.approx(.01, abs=1e-6), False, False)


def test_a_long_gap_is_a_pause_as_soon_as_time_goes_on_after_it():
    clock = clock_at(0.)
    assert clock.step(1.01 * PAUSE_LIMIT) == (DEFAULT_STEP, False, False)
    step, paused, restarted = clock.step(1.02 * PAUSE_LIMIT)
    assert step == pytest.approx(1.02 * PAUSE_LIMIT - DEFAULT_STEP) and paused and not restarted
    assert clock.step(1.03 * PAUSE_LIMIT) == (pytest.approx(.01), False, False)
    assert clock_at(0., 1e300).step(1e300) == (MAX_STEP, True, False)
    assert clock_at(-1e308, 1e308).step(1e308) == (MAX_STEP, True, False)


def test_frames_that_are_always_far_apart_take_their_time():
    clock = clock_at(0.)
    times = 2. * PAUSE_LIMIT * np.arange(1, 101)
    steps, paused, restarted = zip(*(clock.step(time) for time in times))
    assert sum(steps) == pytest.approx(times[-1]) and sum(paused) == 50 and not any(restarted)


@pytest.mark.parametrize('stray', [0., 9., 12., 1e9, 1e300, -1e300, None, np.nan])
def test_a_stray_stamp_takes_a_usual_step_and_is_forgotten(stray):
    times = 10. + np.arange(200) / 50.
    clock = clock_at(*times[:100])
    assert clock.step(stray) == (pytest.approx(.02, rel=1e-3), False, False)
    # The frames after it come as if it had had its own time.
    for time in times[101:]:
        assert clock.step(time) == (pytest.approx(.02, rel=1e-3), False, False)


def test_stray_stamps_all_over_take_usual_steps():
    rng = np.random.default_rng(1)
    clock, last, total = Clock(), None, 0.
    for frame in range(3000):
        stray = frame > 0 and last != 'stray' and rng.random() < .2
        last = 'stray' if stray else 'good'
        step, paused, restarted = clock.step(
            rng.uniform(-1e6, 1e6) if stray else 100. + frame / 120.)
        assert not paused and not restarted
        total += step
    assert total == pytest.approx(3000. / 120., rel=1e-3)


def test_frames_without_time_count_when_the_next_has_one():
    clock = clock_at(0., 1. / 120.)
    steps = [clock.step(None)[0] for _ in range(300)]
    step, paused, restarted = clock.step(302. / 120.)
    assert sum(steps) + step == pytest.approx(301. / 120.) and not paused and not restarted


def test_two_clocks_in_turns_are_neither_a_pause_nor_a_beginning():
    clock = clock_at(10., 500.)
    for frame in range(1, 200):
        for time in (10. + frame / 60., 500. + frame / 60.):
            step, paused, restarted = clock.step(time)
            assert 0. < step < .02 and not paused and not restarted


def test_the_usual_step_follows_the_rate_and_not_the_gaps():
    clock = clock_at(*(np.arange(100) / 120.))
    assert clock.step(None)[0] == pytest.approx(1. / 120.)
    time = 99. / 120.
    for _ in range(60):
        time += 1. / 30.
        clock.step(time)
    assert clock.step(None)[0] == pytest.approx(1. / 30., rel=.01)
    clock.step(time + 100.)
    clock.step(time + 100.)
    assert clock.step(None)[0] == pytest.approx(1. / 30., rel=.01)
