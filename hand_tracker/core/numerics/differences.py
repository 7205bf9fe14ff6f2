"""Differences of a sequence: little of smooth motion, much of white noise."""

import numpy as np

from .jit import jit

# Factors of the values before the newest one.
THIRD, FIFTH = (-3., 3., -1.), (-5., 10., -10., 5., -1.)
# Variance of a difference over that of white noise.
THIRD_GAIN, FIFTH_GAIN = 20., 252.


@jit
def latest_difference(past: np.ndarray, value: float, factors: tuple[float, ...]) -> float:
    """Return the difference of order n at a value, which becomes the newest of the past.

    Parameters
    ----------
    past : ndarray, shape (n,)
        The last n values, newest first; updated.
    value : float
    factors : tuple of float, length n
        `THIRD` or `FIFTH`.

    Returns
    -------
    float
        NaN where one of the values is.
    """
    difference = value
    for k in range(len(factors)):
        difference += factors[k] * past[k]
    for k in range(len(factors) - 1, 0, -1):
        past[k] = past[k - 1]
    past[0] = value
    return difference
