"""Cholesky's factorisation: normal equations of Gauss-Newton steps."""

import math

import numpy as np

from .jit import jit


@jit
def fix_unknown(matrix: np.ndarray, vector: np.ndarray, fixed: int, count: int) -> None:
    """Keep one unknown of the equations A x = b at 0, whatever the others become.

    Parameters
    ----------
    matrix : ndarray, shape (>= count, >= count)
        A, symmetric, changed.
    vector : ndarray, shape (>= count,)
        b, changed.
    fixed : int
        Number of the unknown.
    count : int
        Of all unknowns.
    """
    for k in range(count):
        matrix[fixed, k] = 0.
        matrix[k, fixed] = 0.
    matrix[fixed, fixed] = 1.
    vector[fixed] = 0.


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
        Share of the diagonal that is added to it [1].
    factor : ndarray, shape (>= count, >= count)
        Scratch memory, replaced.
    solution : ndarray, shape (>= count,)
        x, replaced.

    Returns
    -------
    bool
        Whether the matrix is positive definite; the solution is of no use if not.
    """
    if not factorise(matrix, count, damping, factor):
        return False
    solve_factorised(factor, vector, count, solution)
    return True


@jit
def factorise(matrix: np.ndarray, count: int, damping: float, factor: np.ndarray) -> bool:
    """Write Cholesky's factor of A + damping diag(A); parameters and return as `solve_damped`."""
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
    return True


@jit
def solve_factorised(factor: np.ndarray, vector: np.ndarray, count: int,
                     solution: np.ndarray) -> None:
    """Solve the equations of a factor by `factorise`; parameters are those of `solve_damped`."""
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
