"""Regularised robust least squares, for parameters with usual values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:  # scipy is imported at the first fit
    from scipy.optimize import OptimizeResult

# Frames that a recording counts for, however long: within a grasp model errors are alike.
INDEPENDENT_FRAMES = 20
INITIAL_MODEL_ERROR = .004  # [m] standard deviation in the first fit
MIN_MODEL_ERROR = .0002     # [m]
EVALUATIONS_PER_START = 25  # of each start; the best one is refined
REFITS = 4                  # each with the model error of the last fit
EVALUATIONS_PER_REFIT = 100 # at most: slow fits, of motions without noise, gain little by more
DIFFERENCE_STEP = 1e-4      # relative, of finite differences


def least_squares(residuals: Callable[..., np.ndarray], start: ArrayLike,
                  **options: Any) -> OptimizeResult:
    """Return the result of `scipy.optimize.least_squares`, imported at the first call.

    Every node imports this module, and scipy's optimisation takes half as long as all else.
    """
    from scipy import optimize

    return optimize.least_squares(residuals, start, **options)


def regularised_fit(residuals: Callable[[np.ndarray], np.ndarray], starts: Sequence[ArrayLike],
                    bounds: ArrayLike) -> np.ndarray:
    """Minimise robust residuals plus the squared parameters.

    The residuals are weighted by their standard deviation, re-estimated from each fit.

    Parameters
    ----------
    residuals : callable
        From parameters, shape (p,), in standard deviations from their usual values, to errors of
        k points in n frames, shape (n, k) [m].
    starts : sequence of array_like, shape (p,)
        The one with the lowest cost after a few iterations is refined.
    bounds : array_like, shape (2, p)
        Lower and upper.

    Returns
    -------
    ndarray, shape (p,)
    """
    def weighted(x: np.ndarray, error: float) -> np.ndarray:
        scaled = residuals(x) / error
        # Soft L1 loss: quadratic within the error, linear beyond.
        robust = np.sqrt(2. * (np.sqrt(1. + scaled ** 2) - 1.))
        return np.append(np.sqrt(INDEPENDENT_FRAMES / len(scaled)) * robust.ravel(), x)

    tried = [least_squares(weighted, start, bounds=bounds, diff_step=DIFFERENCE_STEP,
                           max_nfev=EVALUATIONS_PER_START, args=(INITIAL_MODEL_ERROR,))
             for start in starts]
    best = min(tried, key=lambda result: result.cost).x
    for _ in range(REFITS):
        error = max(np.sqrt(np.mean(residuals(best) ** 2)), MIN_MODEL_ERROR)
        best = least_squares(
            weighted, best, bounds=bounds, diff_step=DIFFERENCE_STEP,
            max_nfev=EVALUATIONS_PER_REFIT, args=(error,)).x
    return best
