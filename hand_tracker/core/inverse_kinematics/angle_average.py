"""Averages of the angles of digits with several markers, and of the palm's arch.

Each frame's markers tell these angles anew, with their noise. An angle alone may be known ten times
worse than what several do together; but a finger that moves shows at once in what they do together.
So independent components are averaged, by Cholesky's factor of the normal equations: the first is
all that moves the markers as the first joint does, the next what the second joint adds across
that, and so on. Each has a Kalman filter of one state, a random walk whose process noise follows
the innovation beyond the noise. The noise is learned as that of markers, but from fifth
differences: of a tapping finger third ones, at 30 to 60 frames a second, are mostly motion. Ours;
no source.
"""

import math
from typing import NamedTuple

import numpy as np

from ..filtering.noise_estimate import NOISE_TIME, TRACKED_QUANTILE
from ..numerics.differences import FIFTH, FIFTH_GAIN, latest_difference
from ..numerics.jit import jit
from ..numerics.running_quantile import follow_quantile, quantile_steps
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import clamp
from .angle_filter import INNOVATION_TIME
from .digit import CHAIN_JOINTS

# Variance of a component's noise over the learned one [1]: differences miss slow noise, such as
# that of the palm's pose.
SLOWER_NOISE_VARIANCE = 2.
AVERAGING_TIME = .2           # [s] of a component that moves within the noise, at most
SINGLE_CHI_SQUARE = .1015     # tracked quantile of a χ² of 1 degree of freedom
UNKNOWN_NOISE = .3            # [1] of a component before any is learned
NOISE_RANGE = 1e-3, 1.        # [1] of a component


class AngleAverage(NamedTuple):
    """Averaged angles, and the filters of their components.

    A joint 0 of a finger is the palm's arch, by itself; the joints after it are the digit's.

    Attributes
    ----------
    angles : ndarray, shape (25,)
        [rad]
    variance, noise_variance : ndarray, shape (25,)
        Of each joint's component and of its noise, that of the fit being 1 [1].
    past : ndarray, shape (25, 5)
        Last five fitted angles, newest first; NaN before the consecutive ones [rad].
    consecutive : ndarray of int, shape (25,)
        Consecutive frames, at most 3; 0 begins an average anew, 1 its past alone. Of a chain,
        its first joint's counts.
    """

    angles: np.ndarray
    variance: np.ndarray
    noise_variance: np.ndarray
    past: np.ndarray
    consecutive: np.ndarray


def initial_average(angles: np.ndarray) -> AngleAverage:
    """Return the `AngleAverage` before the first frame, at angles of shape (25,) [rad]."""
    count = len(angles)
    return AngleAverage(angles.copy(), np.zeros(count), np.full(count, UNKNOWN_NOISE ** 2),
                        np.full((count, len(FIFTH)), np.nan), np.zeros(count, dtype=np.int64))


@jit
def average_angles(state: AngleAverage, digit: int, joints: tuple[int, int], solved: np.ndarray,
                   factor: np.ndarray, step: float) -> None:
    """Average fitted angles along a digit's chain, or one of the arch.

    Parameters
    ----------
    state : AngleAverage
        Updated.
    digit : int
        Or the finger of the arch's angle.
    joints : tuple of int
        The first of its chain, and the one behind the last.
    solved : ndarray, shape (5,)
        This frame's angles along the chain [rad].
    factor : ndarray, shape (5, 5)
        Cholesky's, of the normal equations, in its lower triangle [1/rad].
    step : float
        Since the last frame; a frame of the same time moves the average, but tells no noise [s].
    """
    first, end = joints
    start = 5 * digit
    off, latest = local_floats(CHAIN_JOINTS), local_floats(CHAIN_JOINTS)
    known = state.consecutive[start + first]
    for j in range(first, end):
        if known == 0:
            state.angles[start + j] = solved[j]
        off[j] = solved[j] - state.angles[start + j]
        if known == 0 or step > 0.:
            latest[j] = latest_difference(state.past[start + j], solved[j], FIFTH)
            if known < 2:
                state.past[start + j, 1:] = math.nan
            state.consecutive[start + j] = min(known + 1, 3)
    shown = 1. - math.exp(-step / INNOVATION_TIME) if step > 0. else 1.
    steps = quantile_steps(step / NOISE_TIME, TRACKED_QUANTILE)
    forgotten = (step / AVERAGING_TIME) ** 2
    for j in range(first, end):
        innovation, difference = 0., 0.
        for k in range(j, end):
            innovation += factor[k, j] * off[k]
            difference += factor[k, j] * latest[k]
        noise = state.noise_variance[start + j]
        if known == 3 and not math.isnan(difference):
            noise = clamp(
                follow_quantile(noise, difference * difference
                                / (SINGLE_CHI_SQUARE * FIFTH_GAIN), steps),
                NOISE_RANGE[0] ** 2, NOISE_RANGE[1] ** 2)
            state.noise_variance[start + j] = noise
        moved = shown * max(abs(innovation) - math.sqrt(noise), 0.)
        noise *= SLOWER_NOISE_VARIANCE
        if known == 0:
            state.variance[start + j] = noise
            continue
        variance = state.variance[start + j] + moved * moved + forgotten * noise
        gain = variance / (variance + noise)
        state.variance[start + j] = variance * (1. - gain)
        off[j] = gain * innovation
    # From components back to angles, the last joint's first.
    for j in range(end - 1, first - 1, -1):
        for k in range(j + 1, end):
            off[j] -= factor[k, j] * off[k]
        off[j] /= factor[j, j]
        state.angles[start + j] += off[j]
