"""Continuity: angles without jumps where the evidence about a digit changes.

When a marker vanishes, comes back or changes its label, the angles go on from where they were,
and the difference to the solution decays at a bounded rate; measured motion is neither delayed
nor smoothed. Predicted digits turn no faster than that rate: a predicted marker may leave the
digit's workspace, where the solution leaps.
"""

import numpy as np

from ..model.hand import DIGIT_OF_JOINT
from ..numerics.jit import jit
from ..numerics.vectors import clamp


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
