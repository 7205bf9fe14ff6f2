"""Clock alignment: offset and drift between two recordings of a wrist, by its path.

The two paths are one but for a turn of the worlds, a unit, and how the systems differ.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import butter, find_peaks, sosfiltfilt
from scipy.spatial.transform import Rotation
from scipy.stats import theilslopes

from ..core.errors import HandTrackerError
from ..core.numerics.rigid_fit import nearest_rotation

GRID_RATE = 120.           # [Hz] at which velocities are correlated
CUTOFF = 6.                # [Hz] of the low-pass filter: faster than wrists turn is noise
FITTED_STEP = 5            # of the grid between samples that are fitted: 24 Hz keeps the cutoff
MIN_OVERLAP = 3.           # [s] that both recordings must show
PEAK_WIDTH = .5            # [s] around the best offset in which one peak is wide enough to lie
FITTED_PEAKS = 8           # peaks of the correlation that are fitted, one in each such width
NEAR_PEAKS = 4             # besides, in that of the largest one
SAME_OFFSET = .05          # [s] up to which fits have found the same one
REACH = .5                 # [s] by which a fit may move an offset
UNFITTED = .3              # [s] at the ends of what overlaps that is not fitted
JUDGED = 60.               # [s] by which candidates are judged: those with the most motion
MIN_SPREAD = .02           # least standard deviation of a wrist's speed, over its mean
FASTEST_WRIST = 1.5        # over the 95th percentile of its speeds: faster are jumps of trackers
MIN_CORRELATION = .5
MIN_CONFIDENCE = .1
SURE_CORRELATION = .9
SURE_CONFIDENCE = .5
SURE_DEVIATION = .004      # [s]
SYSTEM_DELAY = .0015       # [s] by which filters of the systems delay paths, which no motion shows
LEAST_REST = .01           # share of a motion's variance that always differs between systems
WHITENING = 4              # past samples by which a difference of the paths is predicted
WHITENING_ROUNDS = 3
OUTLYING = 3.              # times what 95 % of the differences are at most: counts no more
SCORE_REACH = 1.           # [s] over which what is left may still be correlated
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
        Of the two motions, but for what their own past predicts of the differences.
    confidence : float
        0 to 1: how much worse the next best offset fits, by standard deviations of what is left.
    gain : float
        Body's motion over the hand's, each in its own unit.
    next_best : float
        Offset of the next best fit, NaN where no other one overlaps [s].
    """

    offset: float
    drift: float = 0.
    deviation: float = 0.
    correlation: float = 1.
    confidence: float = 1.
    gain: float = float('nan')
    next_best: float = float('nan')

    @property
    def is_sure(self) -> bool:
        """Whether the motions are so alike that offset and gain are to be relied on."""
        return (self.is_one_peak and self.correlation > SURE_CORRELATION
                and self.deviation < SURE_DEVIATION)

    @property
    def is_one_peak(self) -> bool:
        """Whether no other offset fits nearly as well: else the deviation is not all."""
        return self.confidence > SURE_CONFIDENCE

    def hand_times(self, body_times: np.ndarray) -> np.ndarray:
        """Return times of the hand's recording by those of the body's [s]."""
        return (body_times - self.offset) / (1. + self.drift)


class _Motion(NamedTuple):
    """Path of a wrist, smoothed, on a regular grid of times."""

    start: float
    positions: np.ndarray

    @property
    def times(self) -> np.ndarray:
        return self.start + np.arange(len(self.positions)) / GRID_RATE

    @property
    def velocities(self) -> np.ndarray:
        """Shape (T, 3), shortened where a tracker jumps."""
        velocities = np.gradient(self.positions, 1. / GRID_RATE, axis=0)
        speed = np.linalg.norm(velocities, axis=1)
        limit = FASTEST_WRIST * np.percentile(speed, 95)
        return velocities * np.minimum(1., limit / np.maximum(speed, 1e-12 * limit))[:, None]


class _Fit(NamedTuple):
    """A fit of the hand's path to the body's.

    Attributes
    ----------
    alignment : ClockAlignment
        Without confidence.
    rest : float
        Share of the motion's variance that is left.
    turn : ndarray, shape (3, 3)
        From the hand's world to the body's; mirrored where one of them is left-handed.
    is_optimum : bool
        Whether the offset is one that the fit found within its reach.
    """

    alignment: ClockAlignment
    rest: float
    turn: np.ndarray
    is_optimum: bool


def align_clocks(body: Trajectory, hand: Trajectory) -> ClockAlignment:
    """Find the clock of one recording in another by the path of the wrist that both show.

    The correlation of the velocities, under the turn of the worlds at which it is largest, gives
    candidates of the offset to a step of the grid. At each of them least squares fit the paths;
    the best one counts. The correlation of windows gives the drift, and least squares on all of
    the overlap both of them, to fractions of a frame.

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
    body_motion, hand_motion = _motion(body, 'body'), _motion(hand, 'hand')
    lags, correlation = _correlations(body_motion.velocities, hand_motion.velocities)
    start = body_motion.start - hand_motion.start
    hand_path = CubicSpline(hand_motion.times, hand_motion.positions)
    fits = [_fitted(body_motion, hand_path, (start + lag / GRID_RATE, 0.))
            for lag in _peaks(lags, correlation)]
    fits.sort(key=lambda fit: fit.rest)
    best = fits[0]
    others = [fit for fit in fits if abs(fit.alignment.offset - best.alignment.offset)
              > (SAME_OFFSET if fit.is_optimum else PEAK_WIDTH)]
    rest = others[0].rest if others else 1.
    confidence = max(0., 1. - float(np.sqrt((best.rest + LEAST_REST) / (rest + LEAST_REST))))
    found = best.alignment.correlation
    if found < MIN_CORRELATION or confidence < MIN_CONFIDENCE:
        raise AlignmentError(
            f"the wrist's motions correlate by {found:.2f} at best, and by "
            f'{np.sqrt(max(0., 1. - rest)):.2f} at another offset; expected the same wrist in '
            'both, moved in some way that it does not repeat, or --offset SECONDS')
    line = _windowed_offset(body_motion, hand_motion, best)
    refined = _fitted(body_motion, hand_path, line, is_final=True)
    return refined.alignment._replace(
        confidence=confidence, next_best=others[0].alignment.offset if others else float('nan'))


def _motion(trajectory: Trajectory, whose: str) -> _Motion:
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
    return _Motion(float(grid[0]), smooth - smooth.mean(axis=0))


def _correlations(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lags of the second behind the first [steps], and the correlation at each.

    Of what overlaps at that lag, which is half of the shorter at least; of vectors, (T, 3), under
    the rotation at which it is largest.
    """
    size = next_fast_len(len(first) + len(second))

    def spectra(a: np.ndarray) -> np.ndarray:
        return rfft(a, size, axis=0)

    def sums(product: np.ndarray) -> np.ndarray:
        lagged = irfft(product, size, axis=0)
        return np.concatenate((lagged[-(len(second) - 1):], lagged[:len(first)])
                              if len(second) > 1 else (lagged[:len(first)],))

    # Less their means, so that small differences of large sums lose no digits.
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    one, other = spectra(first), np.conj(spectra(second))
    ones, others = spectra(np.ones(len(first))), np.conj(spectra(np.ones(len(second))))
    count = np.maximum(np.round(sums(ones * others)), 1.)
    mean_1 = sums(one * others[:, None]) / count[:, None]
    mean_2 = sums(ones[:, None] * other) / count[:, None]
    variance_1 = sums(spectra((first**2).sum(axis=1)) * others) / count - (mean_1**2).sum(axis=1)
    variance_2 = sums(ones * np.conj(spectra((second**2).sum(axis=1)))) / count - (
        mean_2**2).sum(axis=1)
    covariance = np.stack([sums(one[:, i] * other[:, j]) for i in range(3) for j in range(3)],
                          axis=1).reshape(-1, 3, 3) / count[:, None, None]
    covariance -= mean_1[:, :, None] * mean_2[:, None, :]
    scale = np.sqrt(np.maximum(variance_1, 0.) * np.maximum(variance_2, 0.))
    least = max(MIN_OVERLAP * GRID_RATE, .5 * min(len(first), len(second)))
    usable = (count >= least) & (scale > 1e-6 * np.sqrt((first**2).sum(axis=1).mean()
                                                        * (second**2).sum(axis=1).mean()))
    correlation = np.full(len(count), -1.)
    # The sum of the singular values; also that of the best mirrored turn.
    sizes = np.linalg.svd(covariance[usable], compute_uv=False)
    correlation[usable] = sizes.sum(axis=1) / scale[usable]
    return np.arange(1 - len(second), len(first)), correlation


def _peaks(lags: np.ndarray, correlation: np.ndarray) -> list[int]:
    """Return the lags of the largest correlations, the largest first [steps]."""
    left, found = correlation.copy(), []
    for _ in range(FITTED_PEAKS):
        best = int(np.argmax(left))
        if left[best] <= -1.:
            break
        found.append(best)
        left[np.abs(lags - lags[best]) <= PEAK_WIDTH * GRID_RATE] = -1.
    if not found:
        raise AlignmentError(f'{MIN_OVERLAP:g} s that both show are needed to align clocks; '
                             'expected a wrist that moves in both, or --offset SECONDS')
    local, _ = find_peaks(correlation)
    away = np.abs(lags[local] - lags[found[0]])
    near = local[(away > 0) & (away <= PEAK_WIDTH * GRID_RATE)]
    near = near[np.argsort(-correlation[near])][:NEAR_PEAKS]
    return lags[[*found, *near]].tolist()


def _windowed_offset(body: _Motion, hand: _Motion, coarse: _Fit) -> tuple[float, float]:
    """Return offset and drift by the offsets of windows, the drift 0 in short recordings."""
    offset = coarse.alignment.offset
    spline = CubicSpline(body.times, body.velocities)
    velocities = hand.velocities @ coarse.turn.T
    size, reach = int(WINDOW * GRID_RATE), int(DRIFT_REACH * GRID_RATE)
    middles, offsets = [], []
    for first in range(0, len(velocities) - size, size // 2):
        times = hand.times[first:first + size]
        shifted = offset + times[0] + np.arange(-reach, size + reach) / GRID_RATE
        if shifted[0] < body.times[0] or shifted[-1] > body.times[-1]:
            continue
        window = velocities[first:first + size]
        views = np.lib.stride_tricks.sliding_window_view(spline(shifted), size, axis=0)
        centred = views - views.mean(axis=2, keepdims=True)     # (lags, 3, size)
        here = (window - window.mean(axis=0)).T
        scale = np.linalg.norm(centred, axis=(1, 2)) * np.linalg.norm(here)
        correlation = np.einsum('lis,is->l', centred, here) / np.maximum(scale, 1e-12)
        best = int(np.argmax(correlation))
        if correlation[best] > MIN_CORRELATION and 0 < best < 2 * reach:
            middles.append(times[size // 2])
            offsets.append(offset + (best - reach) / GRID_RATE)
    if len(middles) < 4 or middles[-1] - middles[0] < DRIFT_OVERLAP:
        return offset, 0.
    drift, offset, _, _ = theilslopes(offsets, middles)
    return float(offset), float(drift)


def _fitted(body: _Motion, hand: CubicSpline, line: tuple[float, float],
            is_final: bool = False) -> _Fit:
    """Return offset and drift by least squares on the paths of the overlap, or on some of it.

    All of it is fitted if `is_final`, and then the drift of a long one, too. The paths differ by
    noise, which changes from sample to sample, and by a slow drift of a system's world; so that
    each counts for as much as it tells, what the past predicts of the difference is taken off both.
    """
    every, ends = body.times, hand.x[[0, -1]]
    times = ClockAlignment(*line).hand_times(every)
    inside = np.flatnonzero((times > ends[0] + UNFITTED) & (times < ends[1] - UNFITTED)
                            & (every > every[0] + UNFITTED)
                            & (every < every[-1] - UNFITTED))[::FITTED_STEP]
    duration = max(float(np.ptp(every[inside])), MIN_OVERLAP)
    fits_drift = is_final and duration > DRIFT_OVERLAP
    if not is_final:
        inside = _most_moving(inside, body.positions)
    body_times, path = every[inside], body.positions[inside]
    # About the middle of the overlap, where offset and drift are independent.
    middle = float(np.mean(times[inside]))
    at_middle = line[0] + (1. + line[1]) * middle
    filtering = np.ones(1)

    def whitened(samples: np.ndarray) -> np.ndarray:
        last = len(filtering) - 1
        changes = np.zeros((len(samples) - last, samples.shape[1]))
        for k, share in enumerate(filtering):
            changes += share * samples[last - k:len(samples) - k]
        return changes - changes.mean(axis=0)

    @lru_cache(maxsize=2)  # of the derivatives most are by the turn and the gain
    def hand_path(at: float, stretch: float) -> np.ndarray:
        return hand(np.clip(middle + (body_times - at_middle - at)
                            / (1. + line[1] + stretch / duration), *ends))

    own, other = whitened(path), whitened(hand_path(0., 0.))
    mirror = -1. if np.linalg.det(own.T @ other) < 0. else 1.

    def model(variables: np.ndarray) -> np.ndarray:
        at, *turn, gain = variables[:5]
        stretch = variables[5] if fits_drift else 0.
        return hand_path(at, stretch) @ (
            mirror * gain * Rotation.from_rotvec(turn).as_matrix().T)

    def differences(variables: np.ndarray, own: np.ndarray, level: float) -> np.ndarray:
        return ((whitened(model(variables)) - own) / level).ravel()

    turn = nearest_rotation(mirror * own.T @ other)
    gain = mirror * float((own * (other @ turn.T)).sum() / max(float((other**2).sum()), 1e-30))
    variables = np.array((0., *Rotation.from_matrix(turn).as_rotvec(), gain,
                          *([0.] if fits_drift else [])))
    bounds = np.full(len(variables), np.inf)
    bounds[0] = REACH
    for _ in range(WHITENING_ROUNDS):
        own = whitened(path)
        level = _usual_most(own - whitened(model(variables)))
        result = least_squares(differences, variables, args=(own, level), loss='soft_l1',
                               x_scale='jac', bounds=(-bounds, bounds))
        variables = result.x
        filtering = _whitening(path - model(variables))
    left = level * result.fun.reshape(-1, 3)
    most = OUTLYING * _usual_most(left)
    rest = float(np.minimum((left**2).sum(axis=1), most**2).mean() / (own**2).sum(axis=1).mean())
    drift = line[1] + (variables[5] / duration if fits_drift else 0.)
    return _Fit(ClockAlignment(
        float(at_middle + variables[0] - (1. + drift) * middle), float(drift),
        _deviation(result), float(np.sqrt(max(0., 1. - rest))), gain=float(variables[4])),
        rest, mirror * Rotation.from_rotvec(variables[1:4]).as_matrix(),
        abs(variables[0]) < REACH - SAME_OFFSET)


def _most_moving(samples: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return those samples of a path, one after another for `JUDGED`, that move most."""
    length = round(JUDGED * GRID_RATE / FITTED_STEP)
    if len(samples) <= length:
        return samples
    way = np.cumsum((np.diff(positions[samples], axis=0)**2).sum(axis=1))
    first = int(np.argmax(way[length - 1:] - np.append(0., way[:-length])))
    return samples[first:first + length]


def _usual_most(vectors: np.ndarray) -> float:
    """Return the length that all vectors but a few have at most."""
    return max(float(np.percentile(np.linalg.norm(vectors, axis=1), 95)), 1e-12)


def _whitening(left: np.ndarray) -> np.ndarray:
    """Return the filter that takes off differences, (T, 3), what their own past predicts."""
    left = left - left.mean(axis=0)
    length = np.linalg.norm(left, axis=1, keepdims=True)
    left = left * np.minimum(1., OUTLYING * _usual_most(left) / np.maximum(length, 1e-12))
    past = np.stack([left[WHITENING - k:len(left) - k].ravel() for k in range(1, WHITENING + 1)],
                    axis=1)
    return np.concatenate(((1.,), -np.linalg.lstsq(past, left[WHITENING:].ravel(), rcond=None)[0]))


def _deviation(result: OptimizeResult) -> float:
    """Return the standard deviation of the first variable of a fit of vectors.

    By the scores of samples, as what is left may still be correlated over `SCORE_REACH`.
    """
    # Of the derivatives that least_squares has scaled for its loss.
    weights = (1. + result.fun**2) ** .25
    scores = result.jac * (result.fun * weights)[:, None]
    scores = scores.reshape(-1, 3, len(result.x)).sum(axis=1)
    inverse = np.linalg.pinv(result.jac.T @ result.jac)
    each = scores @ inverse[0]
    variance = float(each @ each)
    reach = round(SCORE_REACH * GRID_RATE / FITTED_STEP)
    together = variance + 2. * sum((1. - lag / (reach + 1.)) * float(each[lag:] @ each[:-lag])
                                   for lag in range(1, min(reach, len(each) - 1) + 1))
    return float(np.sqrt(max(variance, together) + SYSTEM_DELAY**2))
