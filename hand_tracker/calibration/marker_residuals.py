"""Residuals of a digit's fit: distances of markers, deviations from usual posture and shape.

All residuals are in standard deviations. A frame's angles appear in that frame's residuals only;
`ArrowSystem` keeps that structure.
"""

from typing import NamedTuple

import numpy as np

from .digit_chain import COUPLING_PART, Chain, place_markers, place_with_derivatives

# Distance of a marker at which its weight begins to fall [its standard deviation]; ours.
ROBUST_DISTANCE = 2.5
BEYOND_LIMIT_SPREAD = np.radians(2.)  # of angles beyond the limits of hands; ours


class PosturePrior(NamedTuple):
    """Prior of the usual posture of the digits.

    Attributes
    ----------
    mean, spread : ndarray, shape (4,) or (5,)
        Of the turn, of the first flexion, of the second beside `ratio` times the first, of the
        third beside its coupling to the second, and of the second joint's abduction [rad].
    ratio : float
        Second flexion over first [1].
    lower, upper : ndarray, shape (4,) or (5,)
        Usual limits of a joint [rad].
    """

    mean: np.ndarray
    spread: np.ndarray
    ratio: float
    lower: np.ndarray
    upper: np.ndarray


class ShapePrior(NamedTuple):
    """Usual shape of a digit: mean and standard deviation of the parameters of `Chain`, (p,)."""

    mean: np.ndarray
    spread: np.ndarray


class DigitProblem(NamedTuple):
    """A digit's markers and priors.

    Attributes
    ----------
    chain : Chain
    points : ndarray, shape (n, m, 3)
        Measured, in the palm's frame; NaN where missing [m].
    noise : ndarray, shape (m,)
        Standard deviation of each marker on an axis, skin included [m].
    posture : PosturePrior
    prior : ShapePrior
    meets : ndarray, shape (m,)
        Share of the noise to weigh a marker by: less for the tracker's own [1].
    weight : float
        Of a frame: independent frames for each one given [1].
    """

    chain: Chain
    points: np.ndarray
    noise: np.ndarray
    posture: PosturePrior
    prior: ShapePrior
    meets: np.ndarray
    weight: float


class ArrowSystem(NamedTuple):
    """Normal equations: blocks of the frames' angles, each linked to the shape alone.

    Attributes
    ----------
    angles : ndarray, shape (n, k, k)
        Of the k angles of a frame, 4 or 5.
    links : ndarray, shape (n, k, p)
    shape : ndarray, shape (p, p)
    angle_gradient : ndarray, shape (n, k)
    shape_gradient : ndarray, shape (p,)
    cost : ndarray, shape (n,)
        Of each frame.
    shape_cost : float
    """

    angles: np.ndarray
    links: np.ndarray
    shape: np.ndarray
    angle_gradient: np.ndarray
    shape_gradient: np.ndarray
    cost: np.ndarray
    shape_cost: float


def frame_costs(problem: DigitProblem, shape: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the cost of each frame, shape (n,)."""
    scaled = (place_markers(problem.chain, shape, angles) - problem.points) / problem.noise[:, None]
    postures, _, _ = _posture_residuals(problem.posture, shape, angles)
    return problem.weight * (_robust_cost(scaled).sum(axis=1) + (postures ** 2).sum(axis=1))


def shape_cost(prior: ShapePrior, shape: np.ndarray) -> float:
    """Return the cost of a shape's deviation from the usual one."""
    return float((((shape - prior.mean) / prior.spread) ** 2).sum())


def linearised(problem: DigitProblem, shape: np.ndarray, angles: np.ndarray,
               by_shape_too: bool = True) -> ArrowSystem:
    """Return the normal equations at a shape and the frames' angles.

    Parameters
    ----------
    problem : DigitProblem
    shape : ndarray, shape (p,)
    angles : ndarray, shape (n, k)
        [rad]
    by_shape_too : bool, optional
        Without it the blocks of the shape are empty.

    Returns
    -------
    ArrowSystem
    """
    placed = place_with_derivatives(problem.chain, shape, angles, by_shape_too)
    sigma = problem.noise[:, None]
    scaled = (placed.points - problem.points) / sigma
    cost = _robust_cost(scaled).sum(axis=1)
    # Square root of the weight that makes least squares of the robust loss; 0 where missing.
    root = np.sqrt(_robust_weight(scaled))[..., None]              # (n, m, 1)
    frames = len(angles)
    residuals = (root * np.nan_to_num(scaled)).reshape(frames, -1)
    by_angle = (root[..., None] * placed.by_angle / sigma[..., None]).reshape(
        frames, -1, angles.shape[1])
    postures, posture_by_angle, posture_by_coupling = _posture_residuals(
        problem.posture, shape, angles)
    cost = problem.weight * (cost + (postures ** 2).sum(axis=1))
    residuals = np.concatenate((residuals, postures), axis=1)
    by_angle = np.concatenate((by_angle, posture_by_angle), axis=1)
    weighted = problem.weight * np.swapaxes(by_angle, 1, 2)
    blocks = weighted @ by_angle
    gradient = (weighted @ residuals[..., None])[..., 0]
    if not by_shape_too:
        return ArrowSystem(blocks, np.zeros((*angles.shape, 0)), np.zeros((0, 0)), gradient,
                           np.zeros(0), cost, shape_cost(problem.prior, shape))

    by_shape = (root[..., None] * placed.by_shape / sigma[..., None]).reshape(
        frames, -1, len(shape))
    padded = np.zeros((frames, postures.shape[1], len(shape)))
    padded[..., COUPLING_PART] = posture_by_coupling
    by_shape = np.concatenate((by_shape, padded), axis=1)
    flat = by_shape.reshape(-1, len(shape))
    deviation = (shape - problem.prior.mean) / problem.prior.spread ** 2
    return ArrowSystem(
        blocks, weighted @ by_shape,
        problem.weight * flat.T @ flat + np.diag(problem.prior.spread ** -2.),
        gradient, problem.weight * flat.T @ residuals.ravel() + deviation,
        cost, shape_cost(problem.prior, shape))


def _robust_cost(scaled: np.ndarray) -> np.ndarray:
    """Return the pseudo-Huber loss of residuals (..., 3), 0 where missing, shape (...)."""
    square = np.nan_to_num((scaled ** 2).sum(axis=-1)) / ROBUST_DISTANCE ** 2
    return 2. * ROBUST_DISTANCE ** 2 * (np.sqrt(1. + square) - 1.)


def _robust_weight(scaled: np.ndarray) -> np.ndarray:
    """Return the weight of each marker in least squares, 0 where missing, shape (...)."""
    square = (scaled ** 2).sum(axis=-1) / ROBUST_DISTANCE ** 2
    return np.nan_to_num(1. / np.sqrt(1. + square))


def _posture_residuals(posture: PosturePrior, shape: np.ndarray, angles: np.ndarray
                       ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return residuals (n, 2 k) of postures (n, k), by angle (n, 2 k, k), coupling (n, 2 k, 2)."""
    frames, count = angles.shape
    slope, offset = shape[COUPLING_PART]
    usual = np.tile(posture.mean, (frames, 1))
    usual[:, 2] += posture.ratio * angles[:, 1]
    usual[:, 3] += slope * angles[:, 2] + offset
    beyond = np.minimum(angles - posture.lower, 0.) + np.maximum(angles - posture.upper, 0.)
    residuals = np.concatenate(
        ((angles - usual) / posture.spread, beyond / BEYOND_LIMIT_SPREAD), axis=1)
    by_angle = np.zeros((frames, 2 * count, count))
    by_angle[:, range(count), range(count)] = 1. / posture.spread
    by_angle[:, 2, 1] = -posture.ratio / posture.spread[2]
    by_angle[:, 3, 2] = -slope / posture.spread[3]
    by_angle[:, range(count, 2 * count), range(count)] = (
        (beyond != 0.) / BEYOND_LIMIT_SPREAD)
    by_coupling = np.zeros((frames, 2 * count, 2))
    by_coupling[:, 3, 0] = -angles[:, 2] / posture.spread[3]
    by_coupling[:, 3, 1] = -1. / posture.spread[3]
    return residuals, by_angle, by_coupling
