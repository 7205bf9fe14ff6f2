"""Cholesky's factorisation: of normal equations of Gauss-Newton steps, and of covariances."""

import math

import numpy as np

from .jit import jit

MIN_PIVOT = 1e-13    # of a covariance's factor, relative to the variance
MIN_VARIANCE = 1e-30


@jit
def solve_damped(matrix: np.ndarray, vector: np.ndarray, count: int, damping: float,
                 factor: np.ndarray, solution: np.ndarray) -> bool:
    """Solve (A + damping diag(A)) x = b by Cholesky's factorisation.

    Parameters
    ----------
    matrix : ndarray, shape (>= count, >= count)
        A, symmetric; its lower triangle is read.
    vector : ndarray, shape (>= count,)
        b
    count : int
        Number of unknowns.
    damping : float
    factor : ndarray, shape (>= count, >= count)
        Scratch memory, replaced.
    solution : ndarray, shape (>= count,)
        x, replaced.

    Returns
    -------
    bool
        Whether the matrix is positive definite; the solution is of no use if not.
    """
    for i in range(count):
        for j in range(i + 1):
            total = matrix[i, j]
            if i == j:
                total += damping * matrix[i, i]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i != j:
                factor[i, j] = total / factor[j, j]
            elif total > 0.:
                factor[i, i] = math.sqrt(total)
            else:
                return False
    for i in range(count):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * solution[k]
        solution[i] = total / factor[i, i]
    for i in range(count - 1, -1, -1):
        total = solution[i]
        for k in range(i + 1, count):
            total -= factor[k, i] * solution[k]
        solution[i] = total / factor[i, i]
    return True


@jit
def factorise_covariance(covariance: np.ndarray) -> None:
    """Replace a covariance, shape (n, n), by its lower Cholesky factor; pivots have a floor."""
    for j in range(len(covariance)):
        variance = covariance[j, j]
        pivot = variance
        for k in range(j):
            covariance[k, j] = 0.
            pivot -= covariance[j, k] * covariance[j, k]
        covariance[j, j] = math.sqrt(max(pivot, MIN_PIVOT * variance, MIN_VARIANCE))
        for i in range(j + 1, len(covariance)):
            part = covariance[i, j]
            for k in range(j):
                part -= covariance[i, k] * covariance[j, k]
            covariance[i, j] = part / covariance[j, j]
