"""A pose that never jumps: what a change of knowledge would change at once fades in.

When a marker vanishes, comes back or changes its label, the angles go on from where they
were; what is off is taken away at a bounded rate on top of the true motion, which is so
neither delayed nor smoothed.
"""

from .digit import ABDUCTION, FLEXION
from .jit import jit
from .vectors import clamp


@jit
def ease(solved, eased, offset, changed, step, rate, lower, upper):
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
    step : float
        Since the last frame [s].
    rate : float
        At which an offset shrinks [rad/s].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    """
    for digit in range(5):
        if changed[digit]:
            offset[ABDUCTION[digit]] = eased[ABDUCTION[digit]] - solved[ABDUCTION[digit]]
            for joint in FLEXION[digit]:
                offset[joint] = eased[joint] - solved[joint]
    most = rate * step
    for joint in range(len(solved)):
        offset[joint] -= clamp(offset[joint], -most, most)
        eased[joint] = clamp(solved[joint] + offset[joint], lower[joint], upper[joint])
