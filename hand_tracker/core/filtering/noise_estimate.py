"""Measurement noise of each marker by third differences, and its propagation to the palm's frame.

Third differences contain little motion but 20 times the variance of white noise. A low
quantile of their squares is tracked, so that short motions do not raise it. Ours; no source.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.differences import THIRD, THIRD_GAIN, latest_difference
from ..numerics.jit import jit
from ..numerics.running_quantile import follow_quantile, quantile_steps
from ..numerics.vectors import clamp

TRACKED_QUANTILE = .25        # of the squared third differences
CHI_SQUARE_QUANTILE = 1.213   # that quantile of a χ² of 3 degrees of freedom
NOISE_TIME = .3               # [s] time constant of the estimate
MIN_NOISE = 1e-5              # [m] lower limit of the estimate
PALM_ERROR_INFLATION = 3.     # of the smoothed palm's variance: its errors are correlated


class NoiseEstimate(NamedTuple):
    """Noise estimates of n markers.

    Attributes
    ----------
    deviation : ndarray, shape (n,)
        Standard deviation of each coordinate [m].
    past : ndarray, shape (n, 3, 3)
        Last three positions, newest first [m].
    consecutive : ndarray of int, shape (n,)
        How many of them, at most 3, are of consecutive frames.
    """

    deviation: np.ndarray
    past: np.ndarray
    consecutive: np.ndarray


def initial_noise(count: int, highest: float) -> NoiseEstimate:
    """Return the estimate before the first frame: `highest` [m] for each of `count` markers."""
    return NoiseEstimate(
        np.full(count, highest), np.zeros((count, 3, 3)), np.zeros(count, dtype=np.int64))


@jit
def update_noise(noise: NoiseEstimate, markers: np.ndarray, seen: np.ndarray, step: float,
                 highest: float) -> None:
    """Update the noise estimates by a frame.

    Parameters
    ----------
    noise : NoiseEstimate
        Updated.
    markers : ndarray, shape (n, 3)
        Measured positions [m].
    seen : ndarray of bool, shape (n,)
    step : float
        Time since the last frame [s].
    highest : float
        Upper limit of the standard deviation [m].
    """
    steps = quantile_steps(step / NOISE_TIME, TRACKED_QUANTILE)
    for i in range(len(seen)):
        if not seen[i] or step <= 0.:
            noise.consecutive[i] = 0
            continue
        square = 0.
        for k in range(3):
            square += latest_difference(noise.past[i, :, k], markers[i, k], THIRD) ** 2
        if noise.consecutive[i] == 3:
            variance = follow_quantile(
                noise.deviation[i] ** 2, square / (CHI_SQUARE_QUANTILE * THIRD_GAIN),
                steps)
            noise.deviation[i] = clamp(math.sqrt(variance), MIN_NOISE, highest)
        noise.consecutive[i] = min(noise.consecutive[i] + 1, 3)


def noise_levers(template: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the gain of the palm markers' variance at places in the palm's frame.

    Parameters
    ----------
    template : ndarray, shape (3, 3)
        Palm markers in the palm's frame [m].
    places : ndarray, shape (n, 3)
        Digit markers at rest in the palm's frame [m].

    Returns
    -------
    ndarray, shape (n,)
        Variance of a coordinate there, due to a rigid fit, over that of the palm's markers.
    """
    centre = template.mean(axis=0)
    arms = template - centre
    inertia = np.trace(arms.T @ arms) * np.eye(3) - arms.T @ arms
    turned = np.cross(np.eye(3), (places - centre)[:, None, :])
    return 1. / 3. + np.einsum('nij,ik,nkj->n', turned, np.linalg.inv(inertia), turned) / 3.


@jit
def noise_in_palm_frame(noise_sd: float, covariances: np.ndarray, lever: float) -> float:
    """Return the noise of a digit's marker in the frame of the smoothed palm.

    Parameters
    ----------
    noise_sd : float
        Standard deviation of a coordinate of the markers in the world frame [m].
    covariances : ndarray, shape (3, 9, 9)
        Of the palm's markers, after this frame's correction [products of m, m/s and m/s²].
    lever : float
        From `noise_levers` [1].

    Returns
    -------
    float
        Standard deviation of a coordinate [m].
    """
    variance = 0.
    for i in range(3):
        for k in range(3):
            variance += covariances[i, k, k] / 9.
    noise = noise_sd * noise_sd
    # Errors of a smoothed palm at rest are correlated in time: the variance is inflated.
    return math.sqrt(noise + lever * min(PALM_ERROR_INFLATION * variance, noise))
