"""The clock of another machine, over a network that delays each message differently."""

import numpy as np
import pytest

from hand_tracker.adapters.clock_estimate import ClockEstimate

JITTER = .005        # [s]
ACCURACY = 2e-4      # [s]
SETTLED_AFTER = 5.   # [s]
RATE = 120.          # [Hz]
PROCESSING = .004    # [s] from exposure to sending


def simulated(seconds, drift=0., wander=0., has_echoes=True, base=3e-4, start=1e5, seed=1):
    """Return the clock and, of each frame, its time, and the error of its stamp [s].

    Delays are `base` and up to `JITTER`, either way; the remote clock is fast by `drift` and by a
    temperature that changes it by `wander` to and fro within ten minutes.
    """
    rng, clock = np.random.default_rng(seed), ClockEstimate()
    times = np.arange(0., seconds, 1. / RATE)
    pulse = 2. * np.pi / 600.

    def remote(local):
        return start + local * (1. + drift) + wander / pulse * (1. - np.cos(pulse * local))

    delays = base + JITTER * rng.random((len(times), 3))
    errors = []
    for number, (local, (out, back, way)) in enumerate(zip(times, delays)):
        if has_echoes and number % 12 == 0:
            clock.echoed(local, remote(local + out), local + out + back)
        sent = local + PROCESSING
        clock.received(remote(sent), sent + way)
        errors.append(clock.local(remote(local)) - local)
    return clock, times, np.array(errors)


@pytest.mark.parametrize('drift, wander', [(0., 0.), (8e-5, 0.), (-2e-4, 0.), (5e-5, 3e-6)])
def test_stamps_are_within_a_fifth_of_a_millisecond(drift, wander):
    _, times, errors = simulated(40., drift, wander)
    assert np.abs(errors[times > SETTLED_AFTER]).max() < ACCURACY


def test_nothing_accumulates():
    _, times, errors = simulated(600., 1e-4, 3e-6, seed=2)
    early = (times > SETTLED_AFTER) & (times < 60.)
    assert np.abs(errors[times > SETTLED_AFTER]).max() < ACCURACY
    # The last minutes are as good as the first.
    assert np.abs(errors[times > 540.]).mean() < 2. * np.abs(errors[early]).mean()


def test_without_echoes_the_least_delay_remains():
    _, times, errors = simulated(40., 5e-5, has_echoes=False, base=0.)
    assert np.abs(errors[times > SETTLED_AFTER]).max() < ACCURACY
    _, times, errors = simulated(40., 5e-5, has_echoes=False, base=.002)
    assert np.abs(errors[times > SETTLED_AFTER] - .002).max() < ACCURACY


def test_a_clock_that_was_set_is_followed():
    clock, times, _ = simulated(10.)
    last = times[-1]
    for local in last + np.arange(1, 200) / RATE:
        clock.echoed(local, 7. + local, local + 2e-4)
    assert abs(clock.local(7. + local) - local) < ACCURACY
    for later in local + np.arange(1, 200) / RATE:
        clock.received(7e6 + later, later + 1e-4)
    assert abs(clock.local(7e6 + later) - later) < ACCURACY


@pytest.mark.parametrize('has_echoes', [True, False])
@pytest.mark.parametrize('seed', range(5))
def test_times_never_step_back_as_bounds_tighten(has_echoes, seed):
    _, times, errors = simulated(40., 1e-4, has_echoes=has_echoes, seed=seed)
    assert np.diff(times + errors).min() > .8 / RATE


def test_a_clock_that_was_set_back_is_followed_at_once_though_nothing_was_echoed():
    clock = ClockEstimate()
    for local in np.arange(0., 10., 1. / RATE):
        clock.received(local, local + .001)
    for local in np.arange(10., 10.5, 1. / RATE):
        clock.received(local + 7., local + .001)
    assert abs(clock.local(local + 7.) - local) < .002


def test_nothing_is_known_before_the_first_message():
    clock = ClockEstimate()
    assert not clock.is_known and np.isnan(clock.local(1.))
    clock.received(5., 7.)
    assert clock.is_known and clock.local(6.) == 8.
