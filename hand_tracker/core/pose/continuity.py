"""Continuity: angles without jumps where the evidence about a digit changes.

When a marker vanishes, comes back or changes its label, the angles go on from where they were,
and the difference to the solution decays at a bounded rate; measured motion is neither delayed
nor smoothed. Predicted digits turn no faster than that rate: a predicted marker may leave the
digit's workspace, where the solution leaps. Both count from the motion so far, which a marker
that is missing for a frame or two does not end: what is late by it catches up.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import DIGIT_OF_JOINT
from ..numerics.jit import jit
from ..numerics.vectors import clamp

FASTEST_PACE = 15.      # [rad/s] of an angle that goes on; ours
CARRY_TIME = .05        # [s] time constant with which its velocity fades; ours
SMOOTHING_TIME = .006   # [s] time constant of that velocity while it is measured; ours
SHORT_GAP = 3.5         # frames between two whose difference is a velocity, at most; ours
CATCHING_UP = 1.5       # times its velocity, at which an angle may turn that is late; ours


class Pace(NamedTuple):
    """Velocity of the solved angles.

    Attributes
    ----------
    velocity : ndarray, shape (25,)
        Between the last two frames with a digit's principal marker and the palm; fades since
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
          upper: np.ndarray, pace: Pace | None = None,
          unmeasured: np.ndarray | None = None) -> None:
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
    pace : Pace, optional
        Velocity with which changed and predicted digits go on; updated.
    unmeasured : ndarray of bool, shape (5,), optional
        Digits that tell no velocity in this frame: the predicted ones, when left out, and those
        whose principal marker others place.
    """
    most = rate * step
    silent = predicted if unmeasured is None else unmeasured
    kept, taken = math.exp(-step / CARRY_TIME), 1. - math.exp(-step / SMOOTHING_TIME)
    hurry = 1. if pace is None else CATCHING_UP
    for joint in range(len(solved)):
        digit = DIGIT_OF_JOINT[joint]
        largest, carried = most, 0.
        if pace is not None:
            since = pace.measured_for[digit] + step
            # Without a gap before it, what has changed is other evidence than markers.
            is_other = changed[digit] and pace.measured_for[digit] == 0.
            if silent[digit] or is_other or not 0. < since <= min(SHORT_GAP * step, CARRY_TIME):
                pace.velocity[joint] *= kept
            else:
                velocity = clamp((solved[joint] - pace.measured[joint]) / since,
                                 -FASTEST_PACE, FASTEST_PACE)
                pace.velocity[joint] += taken * (velocity - pace.velocity[joint])
            if not silent[digit]:
                pace.measured[joint] = solved[joint]
            if changed[digit] or predicted[digit]:
                carried = step * pace.velocity[joint]
        start = blended[joint] + carried
        if changed[digit]:
            offset[joint] = start - solved[joint]
        elif not predicted[digit]:
            largest = max(most, hurry * abs(solved[joint] + offset[joint] - start))
        offset[joint] -= clamp(offset[joint], -most, most)
        move = solved[joint] + offset[joint] - start
        allowed = clamp(move, -largest, largest)
        if changed[digit] or predicted[digit]:
            fastest = max(most, hurry * abs(carried))
            allowed = clamp(allowed, -fastest - carried, fastest - carried)
        offset[joint] -= move - allowed
        blended[joint] = clamp(solved[joint] + offset[joint], lower[joint], upper[joint])
        offset[joint] = blended[joint] - solved[joint]
    if pace is not None:
        for digit in range(len(predicted)):
            pace.measured_for[digit] = pace.measured_for[digit] + step if silent[digit] else 0.
