"""Average of the angles of digits with several markers, and of the palm's arch, within the noise.

Each frame's markers tell these angles anew, noise and all. Alone an angle is often known ten times
worse than what several do together, which a finger that moves shows at once. So components are
averaged that are independent of each other, by Cholesky's factor of the normal equations: the
first is what the markers move by as the first joint turns, the next what the second adds to it.
Each has a Kalman filter of one state, a random walk whose process noise follows the innovation
beyond the noise. That is learned from third differences, as the noise of markers. Ours; no source.
"""

import math
from typing import NamedTuple

import numpy as np

from ..filtering.noise_estimate import NOISE_TIME, THIRD_DIFFERENCE_GAIN, TRACKED_QUANTILE
from ..numerics.jit import jit
from ..numerics.running_quantile import quantile_steps
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import clamp
from .angle_filter import INNOVATION_TIME, LONGEST_STEP

CHAIN_JOINTS = 5              # of a digit
SLOWER_NOISE_VARIANCE = 2.    # over that of the noise: there is slower noise, by the palm's pose
LONGEST_AVERAGE = .2          # [s] of a component that moves within the noise
SINGLE_CHI_SQUARE = .1015     # tracked quantile of a χ² of 1 degree of freedom
UNKNOWN_NOISE = .3            # [1] of a component before any is learned
NOISE_RANGE = 1e-3, 1.        # [1] of a component


class AngleAverage(NamedTuple):
    """Averaged angles, and the filters of their components.

    Attributes
    ----------
    angles : ndarray, shape (25,)
        [rad]
    variance, noise_variance : ndarray, shape (25,)
        Of each joint's component, and of its noise, over that of the fit [1].
    past : ndarray, shape (25, 3)
        Last three solved angles, newest first [rad].
    consecutive : ndarray of int, shape (25,)
        How many of them, at most 3, are of consecutive frames.
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
                        np.zeros((count, 3)), np.zeros(count, dtype=np.int64))


@jit
def average_angles(state: AngleAverage, digit: int, joints: tuple[int, int], solved: np.ndarray,
                   factor: np.ndarray, step: float) -> None:
    """Average angles along a digit's chain.

    Parameters
    ----------
    state : AngleAverage
        Updated.
    digit : int
    joints : tuple of int
        The first of its chain, and the one behind the last.
    solved : ndarray, shape (5,)
        This frame's angles along the chain [rad].
    factor : ndarray, shape (5, 5)
        Cholesky's, of the normal equations, in its lower triangle [1/rad].
    step : float
        Since the last frame [s].
    """
    first, end = joints
    start = 5 * digit
    off, third = local_floats(CHAIN_JOINTS), local_floats(CHAIN_JOINTS)
    known = state.consecutive[start + first]
    for j in range(first, end):
        past = state.past[start + j]
        third[j] = solved[j] - 3. * past[0] + 3. * past[1] - past[2]
        past[2], past[1], past[0] = past[1], past[0], solved[j]
        state.consecutive[start + j] = min(known + 1, 3) if step > 0. else 0
        if known == 0:
            state.angles[start + j], state.variance[start + j] = solved[j], 0.
        off[j] = solved[j] - state.angles[start + j]
    shown = 1. - math.exp(-min(step, LONGEST_STEP) / INNOVATION_TIME)
    rise, fall = quantile_steps(step / NOISE_TIME, TRACKED_QUANTILE)
    forgotten = (step / LONGEST_AVERAGE) ** 2
    for j in range(first, end):
        innovation, difference = 0., 0.
        for k in range(j, end):
            innovation += factor[k, j] * off[k]
            difference += factor[k, j] * third[k]
        noise = state.noise_variance[start + j]
        if known == 3 and step > 0.:
            above = difference * difference > SINGLE_CHI_SQUARE * THIRD_DIFFERENCE_GAIN * noise
            noise = clamp(noise * (rise if above else fall), NOISE_RANGE[0] ** 2,
                          NOISE_RANGE[1] ** 2)
            state.noise_variance[start + j] = noise
        moved = shown * max(abs(innovation) - math.sqrt(noise), 0.)
        noise *= SLOWER_NOISE_VARIANCE
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
