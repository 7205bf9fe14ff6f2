"""Third difference of a sequence: little of smooth motion, much of white noise."""

import numpy as np

from .jit import jit


@jit
def third_difference(past: np.ndarray, value: float) -> float:
    """Return the third difference at a value, which becomes the newest of the past.

    Parameters
    ----------
    past : ndarray, shape (3,)
        The last three values, newest first; updated.
    value : float

    Returns
    -------
    float
    """
    difference = value - 3. * past[0] + 3. * past[1] - past[2]
    past[2], past[1], past[0] = past[1], past[0], value
    return difference
