"""Least squares that stay near what is usual as far as the recording does not say otherwise."""

import numpy as np
from scipy.optimize import least_squares

# Errors of a model last as long as a grasp does: a recording is worth this many frames.
WORTH_FRAMES = 20
FIRST_ERROR = .004  # [m] of the model, before a first fit shows it
LEAST_ERROR = .0002  # [m]
TRIES = 25          # iterations from each start; the best goes on to the end
REFITS = 4
STEP = 1e-4         # of finite differences


def regularised_fit(misses, starts, bounds):
    """Return the parameters that balance the misses of a model against their own size.

    The error that a first fit leaves says how far the recording is trusted in the next.

    Parameters
    ----------
    misses : callable
        From parameters, shape (p,), in units of what is usual, to distances, shape (n, k):
        of k points in n frames from where the model has them [m].
    starts : sequence of array_like, shape (p,)
    bounds : array_like, shape (2, p)
        Lower and upper.

    Returns
    -------
    ndarray, shape (p,)
    """
    def residuals(x, error):
        missed = misses(x) / error
        # Soft L1: squares that grow linearly beyond the error.
        robust = np.sqrt(2. * (np.sqrt(1. + missed ** 2) - 1.))
        return np.append(np.sqrt(WORTH_FRAMES / len(missed)) * robust.ravel(), x)

    tried = [least_squares(residuals, start, bounds=bounds, diff_step=STEP, max_nfev=TRIES,
                           args=(FIRST_ERROR,)) for start in starts]
    best = min(tried, key=lambda result: result.cost).x
    for _ in range(REFITS):
        error = max(np.sqrt(np.mean(misses(best) ** 2)), LEAST_ERROR)
        best = least_squares(residuals, best, bounds=bounds, diff_step=STEP, args=(error,)).x
    return best
