"""A pose that never jumps: what a change of knowledge would change at once fades in.

When a marker vanishes, comes back or changes its label, the angles go on from where they
were; what is off is taken away at a bounded rate, while the true motion is neither delayed nor
smoothed. A predicted digit turns no faster than that: its marker may leave what the digit can
reach, where the solution leaps.
"""

from ..model.hand import DIGIT_OF_JOINT
from ..numerics.jit import jit
from ..numerics.vectors import clamp


@jit
def ease(solved, eased, offset, changed, predicted, step, rate, lower, upper):
    """Bring the eased angles to this frame.

    Parameters
    ----------
    solved : ndarray, shape (25,)
        Of this frame [rad].
    eased : ndarray, shape (25,)
        Of the last frame, replaced [rad].
    offset : ndarray, shape (25,)
        What is still to be taken away, replaced [rad].
    changed : ndarray of bool, shape (5,)
        Digits of which something else is known than in the last frame.
    predicted : ndarray of bool, shape (5,)
        Digits of which the marker, or one of the palm's, is hidden.
    step : float
        Since the last frame [s].
    rate : float
        At which an angle turns at most, unless it is solved from what is seen and turns
        faster [rad/s].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    """
    most = rate * step
    for joint in range(len(solved)):
        digit = DIGIT_OF_JOINT[joint]
        farthest = most
        if changed[digit]:
            offset[joint] = eased[joint] - solved[joint]
        elif not predicted[digit]:
            farthest = max(most, abs(solved[joint] + offset[joint] - eased[joint]))
        offset[joint] -= clamp(offset[joint], -most, most)
        move = solved[joint] + offset[joint] - eased[joint]
        offset[joint] -= move - clamp(move, -farthest, farthest)
        eased[joint] = clamp(solved[joint] + offset[joint], lower[joint], upper[joint])
        offset[joint] = eased[joint] - solved[joint]
