"""A quantile of a sequence, followed by small steps: up where a value is above it, else down."""

import math

from .jit import jit


@jit
def quantile_steps(share: float, quantile: float) -> tuple[float, float]:
    """Return the factors of a positive estimate for a value above it, and for one below.

    Parameters
    ----------
    share : float
        Time since the last value over the time constant; at most 1 counts [1].
    quantile : float
        That is followed [1].

    Returns
    -------
    rise, fall : float
        [1]
    """
    share = min(max(share, 0.), 1.)
    return math.exp(share * quantile), math.exp(share * (quantile - 1.))
