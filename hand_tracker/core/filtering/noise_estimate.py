"""The noise of each marker, learned from the moments in which it is still.

Third differences of its places hold little motion but twenty times the variance of white
noise; of their squares a low quantile is followed, which moments of motion do not reach. Ours.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit
from ..numerics.vectors import clamp

VARIANCE_QUANTILE = .25
CHI_SQUARE_QUANTILE = 1.213   # that quantile of a χ² of 3 degrees of freedom
THIRD_DIFFERENCE_GAIN = 20.              # variance of a third difference over that of the noise: 1 + 9 + 9 + 1
VARIANCE_TIME = .3             # [s]
MIN_NOISE = 1e-5            # [m]


class NoiseEstimate(NamedTuple):
    """What is known of the noise of n markers.

    Attributes
    ----------
    deviation : ndarray, shape (n,)
        Standard deviation on an axis [m].
    past : ndarray, shape (n, 3, 3)
        The last three places, the newest first [m].
    count : ndarray of int, shape (n,)
        How many of them follow on each other.
    """

    deviation: np.ndarray
    past: np.ndarray
    count: np.ndarray


def initial_noise(count, most):
    """Return `NoiseEstimate` of markers of which the worst is assumed: `most` [m]."""
    return NoiseEstimate(np.full(count, most), np.zeros((count, 3, 3)), np.zeros(count, dtype=np.int64))


@jit
def update_noise(noise, markers, seen, step, most):
    """Learn from a frame.

    Parameters
    ----------
    noise : Noise
        Changed.
    markers : ndarray, shape (n, 3)
        [m]
    seen : ndarray of bool, shape (n,)
    step : float
        Since the last frame [s].
    most : float
        Standard deviation that is not exceeded, however restless a marker is [m].
    """
    for i in range(len(seen)):
        if not seen[i] or step <= 0.:
            noise.count[i] = 0
            continue
        past = noise.past[i]
        if noise.count[i] == 3:
            square = 0.
            for k in range(3):
                third = markers[i, k] - 3. * past[0, k] + 3. * past[1, k] - past[2, k]
                square += third * third
            variance = noise.deviation[i] ** 2
            above = square > CHI_SQUARE_QUANTILE * THIRD_DIFFERENCE_GAIN * variance
            variance *= math.exp(min(step / VARIANCE_TIME, 1.) * (VARIANCE_QUANTILE if above else VARIANCE_QUANTILE - 1.))
            noise.deviation[i] = clamp(math.sqrt(variance), MIN_NOISE, most)
        noise.count[i] = min(noise.count[i] + 1, 3)
        for k in range(3):
            past[2, k] = past[1, k]
            past[1, k] = past[0, k]
            past[0, k] = markers[i, k]
