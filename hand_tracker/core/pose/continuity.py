"""Continuity: angles without jumps where the evidence about a digit changes.

When a marker vanishes, comes back or changes its label, the angles go on from where they were,
and the difference to the solution decays at a bounded rate; measured motion is neither delayed
nor smoothed. Predicted digits turn no faster than that rate: a predicted marker may leave the
digit's workspace, where the solution leaps. Both count from the motion so far, which a marker
that is missing for a frame or two does not end.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import DIGIT_OF_JOINT
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import clamp

FASTEST_PACE = 15.  # [rad/s] of an angle that goes on; ours
PACE_TIME = .05     # [s] time constant with which its velocity fades; ours
SHORT_GAP = 3.5     # frames between two whose difference is a velocity, at most; ours
CATCHING_UP = 1.5   # times that velocity, at which an angle may turn; ours


class Pace(NamedTuple):
    """Velocity of the solved angles.

    Attributes
    ----------
    velocity : ndarray, shape (25,)
        Between the last two frames with all markers of a digit and of the palm; fades since
        [rad/s].
    measured : ndarray, shape (25,)
        Angles of the last such frame [rad].
    measured_for : ndarray, shape (5,)
        Time since then, for each digit [s].
    """

    velocity: np.ndarray
    measured: np.ndarray
    measured_for: np.ndarray


def no_pace() -> Pace:
    """Return the pace before the first frame."""
    return Pace(np.zeros(25), np.zeros(25), np.full(5, np.inf))


@jit
def blend(solved: np.ndarray, blended: np.ndarray, offset: np.ndarray, changed: np.ndarray,
          predicted: np.ndarray, step: float, rate: float, lower: np.ndarray,
          upper: np.ndarray) -> None:
    """Blend solved angles so that none jumps when a marker is lost or found.

    Parameters
    ----------
    solved : ndarray, shape (25,)
        Solution of this frame [rad].
    blended : ndarray, shape (25,)
        Of the last frame, replaced by this one's [rad].
    offset : ndarray, shape (25,)
        Difference of the blended to the solved angles, replaced [rad].
    changed : ndarray of bool, shape (5,)
        Digits whose evidence differs from the last frame's.
    predicted : ndarray of bool, shape (5,)
        Digits whose marker, or a marker of the palm, is hidden.
    step : float
        Since the last frame [s].
    rate : float
        Largest rate of the offset's decay and of a predicted angle [rad/s].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    """
    most = rate * step
    for joint in range(len(solved)):
        digit = DIGIT_OF_JOINT[joint]
        largest = most
        if changed[digit]:
            offset[joint] = blended[joint] - solved[joint]
        elif not predicted[digit]:
            largest = max(most, abs(solved[joint] + offset[joint] - blended[joint]))
        offset[joint] -= clamp(offset[joint], -most, most)
        move = solved[joint] + offset[joint] - blended[joint]
        offset[joint] -= move - clamp(move, -largest, largest)
        blended[joint] = clamp(solved[joint] + offset[joint], lower[joint], upper[joint])
        offset[joint] = blended[joint] - solved[joint]


@jit
def blend_on(solved: np.ndarray, blended: np.ndarray, offset: np.ndarray, pace: Pace,
             changed: np.ndarray, predicted: np.ndarray, step: float, rate: float,
             lower: np.ndarray, upper: np.ndarray) -> None:
    """Blend solved angles, from the motion so far where evidence changes or lacks.

    There they go on with the velocity that they had, and turn little faster, or at the rate.

    Parameters
    ----------
    solved, blended, offset, changed, predicted, step, rate, lower, upper
        As for `blend`.
    pace : Pace
        Updated.
    """
    former = local_floats(25)
    kept = math.exp(-step / PACE_TIME)
    for digit in range(len(predicted)):
        pace.measured_for[digit] += step
    for joint in range(len(solved)):
        digit = DIGIT_OF_JOINT[joint]
        former[joint] = blended[joint]
        since = pace.measured_for[digit]
        # Without a gap before it, what has changed is other evidence than markers.
        is_other = changed[digit] and since < 1.5 * step
        if not (predicted[digit] or is_other) and 0. < since <= min(SHORT_GAP * step, PACE_TIME):
            pace.velocity[joint] = clamp((solved[joint] - pace.measured[joint]) / since,
                                         -FASTEST_PACE, FASTEST_PACE)
        else:
            pace.velocity[joint] *= kept
        if not predicted[digit]:
            pace.measured[joint] = solved[joint]
        if changed[digit] or predicted[digit]:
            blended[joint] += step * pace.velocity[joint]
    for digit in range(len(predicted)):
        if not predicted[digit]:
            pace.measured_for[digit] = 0.
    blend(solved, blended, offset, changed, predicted, step, rate, lower, upper)
    for joint in range(len(solved)):
        digit = DIGIT_OF_JOINT[joint]
        if changed[digit] or predicted[digit]:
            most = step * max(rate, CATCHING_UP * abs(pace.velocity[joint]))
            blended[joint] = former[joint] + clamp(blended[joint] - former[joint], -most, most)
            offset[joint] = blended[joint] - solved[joint]
