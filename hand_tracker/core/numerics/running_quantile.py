"""Running quantile of positive values: an estimate, raised by each value above it, else lowered."""

import math

from .jit import jit
from .vectors import clamp


@jit
def quantile_steps(share: float, quantile: float) -> tuple[float, float]:
    """Return the factors of the estimate after a value above it, and after one below.

    Parameters
    ----------
    share : float
        Time since the last value over the time constant, from 0 to 1 [1].
    quantile : float
        Share of the values that are below it [1].

    Returns
    -------
    rise, fall : float
        [1]
    """
    share = clamp(share, 0., 1.)
    return math.exp(share * quantile), math.exp(share * (quantile - 1.))


@jit
def follow_quantile(estimate: float, value: float, steps: tuple[float, float]) -> float:
    """Return the estimate after a value, by `quantile_steps`."""
    return estimate * steps[0 if value > estimate else 1]
