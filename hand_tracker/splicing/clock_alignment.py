"""Clock alignment: offset and drift between two recordings of a wrist, by its speed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt
from scipy.stats import theilslopes

from ..core.errors import HandTrackerError

GRID_RATE = 120.           # [Hz] at which speeds are compared
CUTOFF = 6.                # [Hz] of the low-pass filter: faster than wrists turn is noise
MIN_OVERLAP = 3.           # [s] that both recordings must show
PEAK_WIDTH = .5            # [s] around the best offset that counts as the same peak
MIN_SPREAD = .02           # least standard deviation of a wrist's speed, over its mean
MIN_CORRELATION = .5
MIN_CONFIDENCE = .1
SURE_CORRELATION = .9
SURE_DEVIATION = .004      # [s]
LEAST_REST = .01           # share of a speed's variance that always differs between systems
WINDOW = 20.               # [s] in which the drift is taken for constant
DRIFT_REACH = .5           # [s] search range of a window's offset about the coarse one
DRIFT_OVERLAP = 60.        # [s] least duration to distinguish drift from noise


class AlignmentError(HandTrackerError):
    """Clocks that cannot be aligned: the message says why, and what to give instead."""


class Trajectory(NamedTuple):
    """Places of a point over time.

    Attributes
    ----------
    times : ndarray, shape (T,)
        Increasing [s].
    positions : ndarray, shape (T, 3)
        In any unit.
    """

    times: np.ndarray
    positions: np.ndarray


class ClockAlignment(NamedTuple):
    """Time of one recording in that of another.

    Attributes
    ----------
    offset : float
        Time in the body's recording at the time 0 of the hand's [s].
    drift : float
        Seconds that the body's clock gains in one second of the hand's.
    deviation : float
        Standard deviation of the offset in the middle of what both show [s].
    correlation : float
        Of the two speeds.
    confidence : float
        0 to 1: how much worse the next best offset fits, by standard deviations of what is left.
    gain : float
        Body's speed over the hand's, each in its own unit.
    """

    offset: float
    drift: float = 0.
    deviation: float = 0.
    correlation: float = 1.
    confidence: float = 1.
    gain: float = float('nan')

    @property
    def is_sure(self) -> bool:
        """Whether the speeds are so alike that offset and gain are to be relied on."""
        return self.correlation > SURE_CORRELATION and self.deviation < SURE_DEVIATION

    def hand_times(self, body_times: np.ndarray) -> np.ndarray:
        """Return times of the hand's recording by those of the body's [s]."""
        return (body_times - self.offset) / (1. + self.drift)


class _Speed(NamedTuple):
    """Speed of a wrist on a regular grid of times."""

    start: float
    values: np.ndarray

    @property
    def times(self) -> np.ndarray:
        return self.start + np.arange(len(self.values)) / GRID_RATE


def align_clocks(body: Trajectory, hand: Trajectory) -> ClockAlignment:
    """Find the clock of one recording in another by the speed of the wrist that both show.

    The correlation of the speeds gives the offset to a step of the grid, that of windows the
    drift, and least squares on all of the overlap both of them, to fractions of a frame.

    Parameters
    ----------
    body, hand : Trajectory
        Of the same wrist.

    Returns
    -------
    ClockAlignment

    Raises
    ------
    AlignmentError
        If the wrist hardly moves, or moves in the same way again and again.
    """
    body_speed, hand_speed = _speed(body, 'body'), _speed(hand, 'hand')
    lags, correlation = _correlations(body_speed.values, hand_speed.values)
    best = int(np.argmax(correlation))
    found = float(correlation[best])
    other = np.abs(lags - lags[best]) > PEAK_WIDTH * GRID_RATE
    next_best = float(np.max(correlation[other], initial=0.))
    confidence = max(0., 1. - np.sqrt(
        (1. - found**2 + LEAST_REST) / (1. - next_best**2 + LEAST_REST)))
    if found < MIN_CORRELATION or confidence < MIN_CONFIDENCE:
        raise AlignmentError(
            f"the wrist's speeds correlate by {found:.2f} at best, and by {next_best:.2f} at "
            'another offset; expected the same wrist in both, moved in some way that it does not '
            'repeat, or --offset SECONDS')
    coarse = body_speed.start - hand_speed.start + lags[best] / GRID_RATE
    line = _windowed_offset(body_speed, hand_speed, coarse)
    refined = _refined(body_speed, hand_speed, line)
    return refined._replace(confidence=confidence)


def _speed(trajectory: Trajectory, whose: str) -> _Speed:
    times, positions = trajectory
    seen = np.isfinite(positions).all(axis=1)
    times, first = np.unique(times[seen], return_index=True)
    positions = positions[seen][first]
    if len(times) < 4 or times[-1] - times[0] < MIN_OVERLAP:
        raise AlignmentError(f"{MIN_OVERLAP:g} s of the {whose}'s wrist are needed to align "
                             'clocks; expected a longer recording, or --offset SECONDS')
    grid = np.arange(times[0], times[-1], 1. / GRID_RATE)
    low_pass = butter(2, CUTOFF, fs=GRID_RATE, output='sos')
    smooth = sosfiltfilt(low_pass, CubicSpline(times, positions)(grid), axis=0)
    speed = np.linalg.norm(np.gradient(smooth, 1. / GRID_RATE, axis=0), axis=1)
    if not speed.std() > MIN_SPREAD * speed.mean():
        raise AlignmentError(f"the {whose}'s wrist moves at one speed; expected a motion that "
                             'tells the time, or --offset SECONDS')
    return _Speed(float(grid[0]), speed)


def _correlations(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lags of the second behind the first [steps], and Pearson's correlation at each.

    Of what overlaps at that lag, which is half of the shorter at least.
    """
    size = next_fast_len(len(first) + len(second))

    def sums(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        product = irfft(rfft(a, size) * np.conj(rfft(b, size)), size)
        return np.concatenate((product[-(len(second) - 1):], product[:len(first)])
                              if len(second) > 1 else (product[:len(first)],))

    ones = np.ones_like(first), np.ones_like(second)
    # Less their means, so that small differences of large sums lose no digits.
    first, second = first - first.mean(), second - second.mean()
    count = np.round(sums(*ones))
    mean_1, mean_2 = sums(first, ones[1]) / np.maximum(count, 1.), \
        sums(ones[0], second) / np.maximum(count, 1.)
    variance_1 = sums(first**2, ones[1]) / np.maximum(count, 1.) - mean_1**2
    variance_2 = sums(ones[0], second**2) / np.maximum(count, 1.) - mean_2**2
    covariance = sums(first, second) / np.maximum(count, 1.) - mean_1 * mean_2
    scale = np.sqrt(np.maximum(variance_1, 0.) * np.maximum(variance_2, 0.))
    least = max(MIN_OVERLAP * GRID_RATE, .5 * min(len(first), len(second)))
    usable = (count >= least) & (scale > 1e-6 * first.std() * second.std())
    correlation = np.where(usable, covariance / np.where(usable, scale, 1.), -1.)
    return np.arange(1 - len(second), len(first)), correlation


def _windowed_offset(body: _Speed, hand: _Speed, coarse: float) -> tuple[float, float]:
    """Return offset and drift by the offsets of windows, the drift 0 in short recordings."""
    spline = CubicSpline(body.times, body.values)
    size, reach = int(WINDOW * GRID_RATE), int(DRIFT_REACH * GRID_RATE)
    middles, offsets = [], []
    for first in range(0, len(hand.values) - size, size // 2):
        times = hand.times[first:first + size]
        shifted = coarse + times[0] + np.arange(-reach, size + reach) / GRID_RATE
        if shifted[0] < body.times[0] or shifted[-1] > body.times[-1]:
            continue
        window = hand.values[first:first + size]
        views = np.lib.stride_tricks.sliding_window_view(spline(shifted), size)
        centred = views - views.mean(axis=1, keepdims=True)
        here = window - window.mean()
        scale = np.linalg.norm(centred, axis=1) * np.linalg.norm(here)
        correlation = centred @ here / np.maximum(scale, 1e-12)
        best = int(np.argmax(correlation))
        if correlation[best] > MIN_CORRELATION and 0 < best < 2 * reach:
            middles.append(times[size // 2])
            offsets.append(coarse + (best - reach) / GRID_RATE)
    if len(middles) < 4 or middles[-1] - middles[0] < DRIFT_OVERLAP:
        return coarse, 0.
    drift, offset, _, _ = theilslopes(offsets, middles)
    return float(offset), float(drift)


def _refined(body: _Speed, hand: _Speed, line: tuple[float, float]) -> ClockAlignment:
    """Return offset and drift by least squares on the speeds of the overlap."""
    spline = CubicSpline(hand.times, hand.values)
    start = ClockAlignment(*line)
    times = start.hand_times(body.times)
    inside = (times > hand.times[0] + .1) & (times < hand.times[-1] - .1)
    body_times, speed = body.times[inside], body.values[inside]
    # About the middle of the overlap, where offset and drift are independent.
    middle = float(np.mean(times[inside]))
    at_middle = line[0] + (1. + line[1]) * middle
    duration = max(float(np.ptp(body_times)), MIN_OVERLAP)
    deviation_of_speed = float(speed.std())
    fits_drift = duration > DRIFT_OVERLAP

    def model(solved: np.ndarray) -> np.ndarray:
        at, stretch, gain, rest = solved
        return gain * spline(middle + (body_times - at_middle - at)
                             / (1. + line[1] + stretch / duration)) + rest

    def residuals(variables: np.ndarray) -> np.ndarray:
        solved = variables if fits_drift else np.insert(variables, 1, 0.)
        return (model(solved) - speed) / deviation_of_speed

    slope, rest = np.polyfit(spline(times[inside]), speed, 1)
    initial = np.array((0., 0., slope, rest))
    if not fits_drift:
        initial = np.delete(initial, 1)
    result = least_squares(residuals, initial, loss='soft_l1', f_scale=.3, x_scale='jac')
    solved = result.x if fits_drift else np.insert(result.x, 1, 0.)
    left = model(solved) - speed
    # Samples of a filtered speed are not independent.
    independent = max(len(speed) * 2. * CUTOFF / GRID_RATE, len(result.x) + 1.)
    covariance = np.linalg.pinv(result.jac.T @ result.jac) * (
        np.mean(left**2) / deviation_of_speed**2 * len(speed) / independent)
    drift = line[1] + solved[1] / duration
    return ClockAlignment(
        float(at_middle + solved[0] - (1. + drift) * middle), float(drift),
        float(np.sqrt(covariance[0, 0])), float(np.corrcoef(model(solved), speed)[0, 1]),
        gain=float(solved[2]))
