"""Time between frames, whatever their stamps say."""

import numpy as np
import pytest
from hand_tracker.core.clock import BACKWARD, FARTHEST, LONGEST, SHORTEST, USUAL_STEP, Clock


def clock_at(*times):
    clock = Clock()
    for time in times:
        clock.step(time)
    return clock


@pytest.mark.parametrize('time', [None, np.nan, np.inf, -np.inf])
def test_a_frame_without_time_comes_one_usual_step_later(time):
    assert Clock().step(time) == (USUAL_STEP, False, False)
    clock = clock_at(*(np.arange(300) / 50.))
    assert clock.step(time) == (pytest.approx(.02), False, False)
    # It says nothing of when the next one comes.
    assert clock.step(300. / 50.) == (pytest.approx(.02), False, False)


@pytest.mark.parametrize('start', [0., -5., 1.7e9])
def test_steps_are_those_of_the_stamps(start):
    clock = Clock()
    assert clock.step(start) == (USUAL_STEP, False, False)
    for step in (.01, .002, .5, LONGEST - .01):
        start += step
        assert clock.step(start) == (pytest.approx(step, abs=1e-6), False, False)


@pytest.mark.parametrize('back', [0., SHORTEST / 2., .01, .49 * BACKWARD, .99 * BACKWARD])
def test_a_repeated_or_somewhat_older_stamp_takes_no_time(back):
    clock = clock_at(3.)
    assert clock.step(3. - back) == (0., False, False)
    assert clock.step(3.01) == (pytest.approx(.01), False, False)


def test_many_steps_that_are_too_short_add_up():
    clock = clock_at(0.)
    steps = [clock.step(i * SHORTEST / 8.)[0] for i in range(1, 65)]
    assert sum(steps) == pytest.approx(8. * SHORTEST, abs=SHORTEST)
    assert all(step == 0. or step >= SHORTEST for step in steps)


def test_smallest_numbers_take_no_time():
    assert clock_at(0.).step(5e-324) == (0., False, False)


def test_time_that_jumps_back_begins_anew():
    clock = clock_at(10., 10.01)
    step, paused, restarted = clock.step(10.01 - 1.01 * BACKWARD)
    assert 0. < step < .1 and not paused and restarted
    assert clock.step(10.02 - 1.01 * BACKWARD) == (pytest.approx(.01), False, False)


def test_a_long_gap_is_a_pause():
    clock = clock_at(0.)
    assert clock.step(1.01 * LONGEST) == (1.01 * LONGEST, True, False)
    assert clock.step(1e3) == (pytest.approx(1e3 - 1.01 * LONGEST), True, False)
    assert clock.step(1e300) == (FARTHEST, True, False)
    assert clock_at(-1e308).step(1e308) == (FARTHEST, True, False)


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
