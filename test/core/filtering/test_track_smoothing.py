"""Smoothing: quiet at rest, at once when a motion starts, and nothing flies away when hidden."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_tracker.core.filtering.tracks import ACTIVITY_SIZE, update_filter
from hand_tracker.core.numerics import jit

NOISE = 3e-4     # [m]
FADING = .07     # [s]
PLACE = np.array((.1, -.2, 1.3))


class Marker:
    """A marker and its filter."""

    def __init__(self):
        self.mean, self.covariance = np.zeros(9), np.zeros((9, 9))
        self.activity = np.zeros(ACTIVITY_SIZE)

    def advance(self, observed, step=1. / 120., seen=True, noise=NOISE):
        update_filter(self.mean, self.covariance, self.activity, np.asarray(observed, dtype=float),
                      seen, step, noise, FADING)
        return self.mean[:3].copy()

    def follow(self, places, rate, rng):
        """Return the smoothed places of a track with noise."""
        return np.array([self.advance(place + rng.normal(scale=NOISE, size=3), 1. / rate)
                         for place in places])


def sine(along, frequency, times):
    """Return gain and phase of a sine in a track [1, rad]."""
    phase = 2. * np.pi * frequency * times
    parts = np.stack((np.sin(phase), np.cos(phase), np.ones_like(phase)), axis=1)
    a, b, _ = np.linalg.lstsq(parts, along, rcond=None)[0]
    return np.hypot(a, b), np.arctan2(b, a)


@pytest.mark.parametrize('rate', [60, 120, 480])
def test_jitter_at_rest_falls_five_times(rate):
    rng = np.random.default_rng(rate)
    smoothed = Marker().follow(np.tile(PLACE, (8 * rate, 1)), rate, rng)[2 * rate:]
    assert (smoothed - PLACE).std() < NOISE / 5.


@pytest.mark.parametrize('rate', [120, 480])
@pytest.mark.parametrize('amplitude', [.005, .02])
@pytest.mark.parametrize('frequency', [1., 3., 10.])
def test_a_motion_keeps_its_size_and_its_time(frequency, amplitude, rate):
    rng = np.random.default_rng(rate)
    times = np.arange(4 * rate) / rate
    along = amplitude * np.sin(2. * np.pi * frequency * times)
    direction = np.array((.6, 0., .8))
    smoothed = Marker().follow(PLACE + np.outer(along, direction), rate, rng)
    gain, phase = sine((smoothed @ direction)[rate:], frequency, times[rate:])
    assert .95 < gain / amplitude < 1.05
    assert abs(phase) / (2. * np.pi * frequency) < .005


def test_a_start_from_rest_is_followed_within_frames():
    rng = np.random.default_rng(1)
    rate, rise = 120, .06
    share = np.clip((np.arange(4 * rate) / rate - 3.) / rise, 0., 1.)
    track = PLACE + np.outer(.02 * share ** 3 * (10. - 15. * share + 6. * share ** 2), (1, 0, 0))
    smoothed = Marker().follow(track, rate, rng)
    assert np.abs(smoothed - track)[3 * rate:].max() < 6. * NOISE


def test_quiet_returns_within_a_second_of_a_motion():
    rng = np.random.default_rng(2)
    rate = 120
    times = np.arange(6 * rate) / rate
    along = np.where(times < 3., .02 * np.sin(2. * np.pi * 3. * times), 0.)
    track = PLACE + np.outer(along, (1., 0., 0.))
    errors = Marker().follow(track, rate, rng) - track
    assert errors[4 * rate:].std() < NOISE / 4.


def test_a_teleport_is_taken_at_once():
    rng = np.random.default_rng(3)
    marker = Marker()
    marker.follow(np.tile(PLACE, (240, 1)), 120, rng)
    for _ in range(5):
        np.testing.assert_allclose(marker.advance(PLACE + 1e3), PLACE + 1e3, atol=3. * NOISE)


def test_a_hidden_marker_slows_down_and_grows_uncertain():
    rng = np.random.default_rng(4)
    marker, speed = Marker(), .5
    track = PLACE + np.outer(np.arange(120) * speed / 120., (1., 0., 0.))
    marker.follow(track, 120, rng)
    before, deviations = marker.mean[0], []
    for _ in range(120):
        place = marker.advance(np.full(3, np.nan), seen=False)
        deviations.append(np.sqrt(marker.covariance[0, 0]))
    assert .3 * speed * FADING < place[0] - before < 3. * speed * FADING
    assert (np.diff(deviations) > 0.).all()
    assert .002 < deviations[29] < deviations[-1] < .05
    # Seen again, it is where it is seen.
    place = marker.advance(PLACE)
    np.testing.assert_allclose(place, PLACE, atol=NOISE)


def test_nothing_is_known_before_the_first_observation():
    marker = Marker()
    marker.advance(np.full(3, np.nan), seen=False)
    assert not marker.mean.any() and not marker.activity.any()
    place = marker.advance(PLACE)
    np.testing.assert_array_equal(place, PLACE)


def test_a_repeated_frame_is_harmless():
    rng = np.random.default_rng(6)
    marker = Marker()
    marker.follow(np.tile(PLACE, (240, 1)), 120, rng)
    for _ in range(100):
        place = marker.advance(PLACE + NOISE, step=0.)
    np.testing.assert_allclose(place, PLACE + NOISE, atol=NOISE)


@given(st.integers(0, 2 ** 32 - 1))
@settings(max_examples=10, deadline=None)
def test_all_stays_finite_and_definite_whatever_comes(seed):
    rng = np.random.default_rng(seed)
    marker, place = Marker(), PLACE
    for _ in range(3000 if jit.COMPILED else 100):
        if rng.random() < .02:
            place = rng.uniform(-1e3, 1e3, 3)
        seen = rng.random() < .7
        observed = place + rng.normal(scale=NOISE, size=3)
        marker.advance(observed if seen else np.full(3, np.nan),
                       rng.choice((0., 1e-4, 1. / 120., 1.)), seen, 10. ** rng.uniform(-5, -2))
        assert np.isfinite(marker.mean).all() and np.isfinite(marker.activity).all()
        if marker.activity[0] > 0.:
            deviations = np.sqrt(np.diag(marker.covariance))
            correlations = marker.covariance / np.outer(deviations, deviations)
            assert (correlations == correlations.T).all()
            assert np.linalg.eigvalsh(correlations)[0] > 0.
