"""Least squares over a digit's shape and the angles of every frame, as in bundle adjustment.

Angles of different frames are coupled by the shape alone. Eliminating them frame by frame (Schur
complement) leaves a small system for the shape; its inverse is the covariance.
"""

from typing import NamedTuple

import numpy as np

from .marker_residuals import ArrowSystem, DigitProblem, frame_costs, linearised, shape_cost

FIRST_DAMPING = 1e-3
MAX_DAMPING = 1e8
MAX_ANGLE_STEP = .5      # [rad] of an iteration
SETTLED_DECREASE = 1e-6  # relative decrease of the cost that ends the iteration
SEARCH_ITERATIONS = 5    # of a frame's angles, from each start
ANGLE_ITERATIONS = 14    # then, from the best
LEAST_CURVATURE = 1e-9             # added to the angles' blocks, so that each can be inverted


class Solved(NamedTuple):
    """Result of a fit.

    Attributes
    ----------
    shape : ndarray, shape (p,)
    angles : ndarray, shape (n, k)
        [rad]
    cost : float
    """

    shape: np.ndarray
    angles: np.ndarray
    cost: float


def solve_shape(problem: DigitProblem, start: np.ndarray, angles: np.ndarray,
                iterations: int) -> Solved:
    """Fit shape and angles by Levenberg-Marquardt steps.

    Parameters
    ----------
    problem : DigitProblem
    start : ndarray, shape (p,)
    angles : ndarray, shape (n, k)
        [rad]
    iterations : int
        At most.

    Returns
    -------
    Solved
    """
    shape, damping = start, FIRST_DAMPING
    system = linearised(problem, shape, angles)
    cost = system.cost.sum() + system.shape_cost
    for _ in range(iterations):
        while damping < MAX_DAMPING:
            shape_step, angle_step = _step(system, damping)
            tried_shape, tried_angles = shape + shape_step, angles + angle_step
            tried = (frame_costs(problem, tried_shape, tried_angles).sum()
                     + shape_cost(problem.prior, tried_shape))
            if tried < cost:
                break
            damping *= 6.
        else:
            break
        decrease = cost - tried
        shape, angles, cost = tried_shape, tried_angles, tried
        damping = max(damping / 8., 1e-9)
        if decrease < SETTLED_DECREASE * cost:
            break
        system = linearised(problem, shape, angles)
    return Solved(shape, angles, float(cost))


def fit_angles(problem: DigitProblem, shape: np.ndarray, starts: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Find the angles of every frame for a given shape, from several starts.

    Parameters
    ----------
    problem : DigitProblem
    shape : ndarray, shape (p,)
    starts : ndarray, shape (s, k) or (s, n, k)
        Initial angles; the result of least cost is taken, frame by frame [rad].

    Returns
    -------
    angles : ndarray, shape (n, k)
        [rad]
    cost : ndarray, shape (n,)
    """
    frames = len(problem.points)
    best = np.zeros((frames, starts.shape[-1]))
    least = np.full(frames, np.inf)
    for start in starts:
        angles, cost = _descended(problem, shape, np.array(np.broadcast_to(start, best.shape)),
                                  SEARCH_ITERATIONS)
        nearer = cost < least
        best[nearer], least[nearer] = angles[nearer], cost[nearer]
    return _descended(problem, shape, best, ANGLE_ITERATIONS)


def _descended(problem: DigitProblem, shape: np.ndarray, angles: np.ndarray,
               iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """Return angles (n, k) after steps of each frame, and the frames' costs (n,)."""
    damping = np.full(len(angles), FIRST_DAMPING)
    cost = frame_costs(problem, shape, angles)
    for _ in range(iterations):
        system = linearised(problem, shape, angles, by_shape_too=False)
        damped = system.angles + damping[:, None, None] * _diagonals(system.angles)
        step = -np.linalg.solve(damped, system.angle_gradient[..., None])[..., 0]
        tried_angles = angles + np.clip(step, -MAX_ANGLE_STEP, MAX_ANGLE_STEP)
        tried = frame_costs(problem, shape, tried_angles)
        better = tried < cost
        decrease = (cost - tried)[better].sum()
        angles = np.where(better[:, None], tried_angles, angles)
        cost = np.where(better, tried, cost)
        damping = np.where(better, damping / 8., damping * 6.)
        if decrease < SETTLED_DECREASE * cost.sum():
            break
    return angles, cost


def covariance(problem: DigitProblem, shape: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the covariance of the shape with the angles free, shape (p, p)."""
    reduced, _ = _reduced(linearised(problem, shape, angles), 0.)
    return np.linalg.inv(reduced)


def _diagonals(blocks: np.ndarray) -> np.ndarray:
    """Return the diagonals of square blocks (..., k, k) as diagonal matrices, never zero."""
    diagonal = np.einsum('...ii->...i', blocks)
    return (diagonal + LEAST_CURVATURE)[..., None] * np.eye(blocks.shape[-1])


def _reduced(system: ArrowSystem, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the shape's system without the angles, and the damped blocks of the angles."""
    blocks = system.angles + damping * _diagonals(system.angles) + LEAST_CURVATURE * np.eye(
        system.angles.shape[-1])
    eliminated = np.linalg.solve(blocks, system.links)             # (n, k, p)
    size = system.shape.shape[0]
    reduced = system.shape - (
        system.links.reshape(-1, size).T @ eliminated.reshape(-1, size))
    return reduced, blocks


def _step(system: ArrowSystem, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the damped steps of shape (p,) and angles (n, k)."""
    reduced, blocks = _reduced(system, damping)
    reduced = reduced + damping * np.diag(np.diag(system.shape))
    alone = np.linalg.solve(blocks, system.angle_gradient[..., None])
    gradient = system.shape_gradient - np.einsum('nij,nik->j', system.links, alone)
    shape_step = -np.linalg.solve(reduced, gradient)
    angle_step = -np.linalg.solve(
        blocks, (system.angle_gradient + system.links @ shape_step)[..., None])[..., 0]
    return shape_step, np.clip(angle_step, -MAX_ANGLE_STEP, MAX_ANGLE_STEP)
