"""Quadratic programme within a box: ½ xᵀHx + gᵀx, lower <= x <= upper, by an active set.

Variables that a bound holds are fixed; the others take a Newton step by a Cholesky factor, cut
short at the first bound that it meets, which then holds its variable. Nocedal & Wright, Numerical
Optimization, section 16.5, for bounds alone.
"""

import math
from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit

PIVOT_FLOOR = 1e-6      # [1] of a diagonal; a variable with a smaller pivot stays
LEAST_PIVOT = 1e-16     # in any case
RELEASED_FROM = 1e-12   # gradient into the box from which a variable leaves its bound


class BoxQp(NamedTuple):
    """A problem with n <= size variables, its solution, and workspace.

    Attributes
    ----------
    hessian, factor : ndarray, shape (size, size)
        `hessian` is symmetric, and ought to be positive definite: where it is not, the solution is
        feasible but not optimal. `factor` is workspace.
    gradient, lower, upper, solution : ndarray, shape (size,)
        `solution` is the start, and is replaced. It must lie within the bounds.
    slope, free, held : ndarray, shape (size,), float, int64 and int64
        Workspace.
    """

    hessian: np.ndarray
    factor: np.ndarray
    gradient: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    solution: np.ndarray
    slope: np.ndarray
    free: np.ndarray
    held: np.ndarray


def new_box_qp(size: int) -> BoxQp:
    """Return a problem of zeros with space for `size` variables."""
    return BoxQp(
        hessian=np.zeros((size, size)), factor=np.zeros((size, size)), gradient=np.zeros(size),
        lower=np.zeros(size), upper=np.zeros(size), solution=np.zeros(size),
        slope=np.zeros(size), free=np.zeros(size, dtype=np.int64),
        held=np.zeros(size, dtype=np.int64))


@jit
def solve_box_qp(n: int, qp: BoxQp) -> int:
    """Replace the solution by that of the first n variables; return the number of steps.

    Parameters
    ----------
    n : int
    qp : BoxQp
    """
    x, slope, free, held = qp.solution, qp.slope, qp.free, qp.held
    _set_slope(n, qp)
    for i in range(n):
        held[i] = int(x[i] <= qp.lower[i] and slope[i] >= 0.
                      or x[i] >= qp.upper[i] and slope[i] <= 0.)
    for step in range(4 * n + 4):
        count = 0
        for i in range(n):
            if held[i] == 0:
                free[count] = i
                count += 1
        _factorise(count, qp.hessian, qp.factor, free)
        _substitute(count, qp.factor, free, slope)
        # The step, -slope, is cut at the first bound it meets, which then holds its variable.
        share, blocking = 1., -1
        for k in range(count):
            i = free[k]
            slack = x[i] - qp.lower[i] if slope[i] > 0. else qp.upper[i] - x[i]
            if abs(slope[i]) * share > slack:
                share, blocking = slack / abs(slope[i]), i
        for k in range(count):
            i = free[k]
            x[i] = min(max(x[i] - share * slope[i], qp.lower[i]), qp.upper[i])
        if blocking >= 0:
            x[blocking] = qp.lower[blocking] if slope[blocking] > 0. else qp.upper[blocking]
            held[blocking] = 1
            _set_slope(n, qp)
            continue
        # Optimal unless a held variable wants to leave its bound.
        _set_slope(n, qp)
        worst, leaving = RELEASED_FROM, -1
        for i in range(n):
            if held[i] == 1 and qp.upper[i] > qp.lower[i]:
                inward = -slope[i] if x[i] <= qp.lower[i] else slope[i]
                if inward > worst:
                    worst, leaving = inward, i
        if leaving < 0:
            return step + 1
        held[leaving] = 0
    return 4 * n + 4


@jit
def _set_slope(n: int, qp: BoxQp) -> None:
    """Write the gradient at the solution, Hx + g."""
    for i in range(n):
        total = qp.gradient[i]
        for j in range(n):
            total += qp.hessian[i, j] * qp.solution[j]
        qp.slope[i] = total


@jit
def _factorise(count: int, hessian: np.ndarray, factor: np.ndarray, free: np.ndarray) -> None:
    """Write the Cholesky factor L of the free rows and columns; its diagonal is inverted."""
    for i in range(count):
        for j in range(i + 1):
            total = hessian[free[i], free[j]]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                floor = max(PIVOT_FLOOR * hessian[free[i], free[i]], LEAST_PIVOT)
                # Where the Hessian is not convex, a variable stays rather than runs away.
                factor[i, i] = 1. / math.sqrt(total) if total > floor else 0.
            else:
                factor[i, j] = total * factor[j, j]


@jit
def _substitute(count: int, factor: np.ndarray, free: np.ndarray, slope: np.ndarray) -> None:
    """Replace the free entries of `slope` by the solution of L Lᵀ d = slope."""
    for i in range(count):
        total = slope[free[i]]
        for k in range(i):
            total -= factor[i, k] * slope[free[k]]
        slope[free[i]] = total * factor[i, i]
    for i in range(count - 1, -1, -1):
        total = slope[free[i]]
        for k in range(i + 1, count):
            total -= factor[k, i] * slope[free[k]]
        slope[free[i]] = total * factor[i, i]
