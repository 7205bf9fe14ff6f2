"""Differences of a sequence: little of smooth motion, much of white noise."""

import numpy as np

from .jit import jit


@jit
def latest_difference(past: np.ndarray, value: float) -> float:
    """Return the difference of order n at a value, which becomes the newest of the past.

    Parameters
    ----------
    past : ndarray, shape (n,)
        The last n values, newest first; updated.
    value : float

    Returns
    -------
    float
    """
    difference, binomial = value, 1.
    for k in range(len(past)):
        binomial *= (k - len(past)) / (k + 1)
        difference += binomial * past[k]
    for k in range(len(past) - 1, 0, -1):
        past[k] = past[k - 1]
    past[0] = value
    return difference
