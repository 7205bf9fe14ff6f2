"""Unscented Kalman filter (UKF) with the variable turn model (VTM), for one marker: inertia.

The state is position, velocity and acceleration (9) of a marker that turns at the rate
ω = |v×a| / |v|²: X. R. Li and V. P. Jilkov, "Survey of maneuvering target tracking. Part I",
IEEE Trans. Aerospace and Electronic Systems 39 (2003); sigma points after R. van der Merwe
(2004), α 1e-3, β 2, κ 0. All kernels update `mean`, shape (9,), and `covariance`, shape
(9, 9), in place [m, m/s, m/s²].
"""

import math
from functools import partial

import numpy as np

from ..numerics.cholesky import MIN_VARIANCE, factorise_covariance
from ..numerics.jit import indexed, jit
from ..numerics.vectors import Vector, add, clamp, cross, dot, scale, subtract

STATE_SIZE = 9
UKF_ALPHA = 1e-3
UKF_BETA = 2.
SIGMA_SPREAD = UKF_ALPHA * math.sqrt(STATE_SIZE)  # of the sigma points, in standard deviations
SIGMA_POINTS = 2 * STATE_SIZE  # and the centre
SIGMA_WEIGHT = .5 / (UKF_ALPHA * UKF_ALPHA * STATE_SIZE)  # of all sigma points but the centre
MEAN_SHARE = math.sqrt((UKF_BETA - UKF_ALPHA * UKF_ALPHA) / SIGMA_WEIGHT)

# Bounds of the turn, unsourced.
STILL_SPEED = .01                # [m/s] at and below it the turn rate falls to 0
MAX_TURN_RATE = 60.              # [rad/s] about ten turns a second
MAX_TURN_ANGLE = 1.              # [rad] in one step

INITIAL_SPEED_SD = 1.            # [m/s]
INITIAL_ACCELERATION_SD = 30.    # [m/s²]
# Bounds of means and standard deviations, far beyond any hand: products stay finite.
POSITION_LIMIT = 1e3             # [m]
SPEED_LIMIT = 1e2                # [m/s]
ACCELERATION_LIMIT = 1e4         # [m/s²]



@jit
def turn_motion(velocity: Vector, acceleration: Vector, step: float,
                uncertainty: float) -> tuple[Vector, Vector, Vector]:
    """Return the motion of a marker over a step by the variable turn model.

    The turn rate is bounded, or noise would spin a marker near rest: by the variance of the
    velocity, added to its square, so that only a velocity that exceeds its uncertainty turns;
    by `MAX_TURN_RATE`; and by `MAX_TURN_ANGLE` in one step.

    Parameters
    ----------
    velocity, acceleration : Vector
        [m/s, m/s²]
    step : float
        [s]
    uncertainty : float
        Variance of the velocity, summed over its coordinates [m²/s²].

    Returns
    -------
    shift, velocity, acceleration : Vector
        Displacement, and velocity and acceleration after the step [m, m/s, m/s²].
    """
    normal = cross(velocity, acceleration)
    speed = dot(velocity, velocity) + uncertainty + STILL_SPEED * STILL_SPEED
    rate = dot(normal, normal) / (speed * speed)
    rate = min(rate, MAX_TURN_RATE * MAX_TURN_RATE)
    if rate * step * step > MAX_TURN_ANGLE * MAX_TURN_ANGLE:
        rate = (MAX_TURN_ANGLE / step) ** 2
    # All functions of the angle are even: series in its square, exact to rounding up to 1 rad.
    square = rate * step * step
    ratio = 1. - square * (1. / 6. - square * (1. / 120. - square * (1. / 5040. - square * (
        1. / 362880. - square * (1. / 39916800. - square * (1. / 6227020800. - square * (
            1. / 1307674368000. - square / 355687428096000.)))))))
    versed = .5 - square * (1. / 24. - square * (1. / 720. - square * (1. / 40320. - square * (
        1. / 3628800. - square * (1. / 479001600. - square * (1. / 87178291200. - square * (
            1. / 20922789888000. - square / 6402373705728000.)))))))
    cosine = 1. - square * versed
    return (
        add(scale(velocity, ratio * step), scale(acceleration, versed * step * step)),
        add(scale(velocity, cosine), scale(acceleration, ratio * step)),
        subtract(scale(acceleration, cosine), scale(velocity, rate * ratio * step)),
    )


@jit
def initialise(mean: np.ndarray, covariance: np.ndarray, position: np.ndarray | Vector,
               noise_sd: float) -> None:
    """Initialise the state at a measured position, with unknown motion.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    position : ndarray or Vector, shape (3,)
        [m]
    noise_sd : float
        Standard deviation of each of its coordinates [m].
    """
    for i in range(STATE_SIZE):
        mean[i] = 0.
        for j in range(STATE_SIZE):
            covariance[i, j] = 0.
    for i in range(3):
        mean[i] = position[i]
        covariance[i, i] = noise_sd * noise_sd
        covariance[3 + i, 3 + i] = INITIAL_SPEED_SD * INITIAL_SPEED_SD
        covariance[6 + i, 6 + i] = INITIAL_ACCELERATION_SD * INITIAL_ACCELERATION_SD


@jit
def predict(mean: np.ndarray, covariance: np.ndarray, step: float, jerk_noise: float) -> None:
    """Predict the state over a step by the unscented transform.

    With deviations d from the propagated central point, the weighted sums of the unscented
    transform are mean = centre + m, m = Σ w d, and covariance = Σ w d dᵀ + (β − α²) m mᵀ:
    the central weight of −10⁶ cancels, and all terms are positive.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced; unchanged if `step` is not above 0.
    step : float
        [s]
    jerk_noise : float
        Spectral density of white jerk [m²/s⁵].
    """
    if not step > 0.:
        return
    mean, covariance = indexed(mean), indexed(covariance)
    velocity = (mean[3], mean[4], mean[5])
    acceleration = (mean[6], mean[7], mean[8])
    uncertainty = covariance[3, 3] + covariance[4, 4] + covariance[5, 5]
    shift, moved, pulled = turn_motion(velocity, acceleration, step, uncertainty)
    factorise_covariance(covariance)
    root = covariance
    deviations = indexed(np.empty((STATE_SIZE, SIGMA_POINTS + 1)))
    for point in range(SIGMA_POINTS):
        column = point // 2
        side = SIGMA_SPREAD if point % 2 else -SIGMA_SPREAD
        shift_there, moved_there, pulled_there = turn_motion(
            add(velocity, (side * root[3, column], side * root[4, column],
                           side * root[5, column])),
            add(acceleration, (side * root[6, column], side * root[7, column],
                               side * root[8, column])), step, uncertainty)
        # Positions enter by differences: no cancellation far from the origin.
        for k in range(3):
            deviations[k, point] = side * root[k, column] + (shift_there[k] - shift[k])
            deviations[3 + k, point] = moved_there[k] - moved[k]
            deviations[6 + k, point] = pulled_there[k] - pulled[k]
    _sum_deviations(deviations, shift + moved + pulled, mean, covariance)
    add_jerk(covariance, step, jerk_noise)
    _limit_state(mean, covariance)


@partial(jit, fastmath={'reassoc', 'contract'})  # sums by vectors; NaN stays NaN
def _sum_deviations(deviations: np.ndarray, centre: tuple[float, ...], mean: np.ndarray,
                    covariance: np.ndarray) -> None:
    """Write mean and covariance by the sigma points' deviations from the central point.

    Parameters
    ----------
    deviations : ndarray, shape (9, 19)
        Of the 18 points; the last column is replaced, by the mean's weighted share.
    centre : tuple of nine float
        Central point; its position is relative to that of `mean`.
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    """
    for i in range(STATE_SIZE):
        total = 0.
        for point in range(SIGMA_POINTS):
            total += deviations[i, point]
        change = SIGMA_WEIGHT * total
        deviations[i, SIGMA_POINTS] = MEAN_SHARE * change
        mean[i] = (mean[i] if i < 3 else 0.) + centre[i] + change
    for i in range(STATE_SIZE):
        for j in range(i + 1):
            total = 0.
            for column in range(SIGMA_POINTS + 1):
                total += deviations[i, column] * deviations[j, column]
            covariance[i, j] = covariance[j, i] = SIGMA_WEIGHT * total


@jit
def add_jerk(covariance: np.ndarray, step: float, jerk_noise: float) -> None:
    """Add the process noise of white jerk over a step to the covariance.

    Parameters
    ----------
    covariance : ndarray, shape (9, 9)
        Replaced.
    step : float
        [s]
    jerk_noise : float
        Spectral density [m²/s⁵].
    """
    for i in range(3):
        for j in range(3):
            # ∫ of the responses t^(2−i) / (2−i)! and t^(2−j) / (2−j)! to unit jerk.
            power = 5 - i - j
            halves = (2. if i == 0 else 1.) * (2. if j == 0 else 1.)
            variance = jerk_noise * step ** power / (power * halves)
            for k in range(3):
                covariance[3 * i + k, 3 * j + k] += variance


@jit
def correct(mean: np.ndarray, covariance: np.ndarray, observed: np.ndarray | Vector,
            noise_sd: float) -> float:
    """Correct the state by a measured position; return the normalised innovation squared.

    The coordinates' noise is independent, so they are processed one after the other: equal to
    the joint correction, without inverting a matrix.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    observed : ndarray or Vector, shape (3,)
        [m]
    noise_sd : float
        Standard deviation of each coordinate [m].

    Returns
    -------
    float
        Normalised innovation squared (NIS), of 3 degrees of freedom.
    """
    mean, covariance = indexed(mean), indexed(covariance)
    noise = max(float(noise_sd) ** 2, MIN_VARIANCE)
    consistency = 0.
    for k in range(3):
        innovation = float(observed[k]) - mean[k]
        total = covariance[k, k] + noise
        consistency += innovation * innovation / total
        for i in range(STATE_SIZE):
            gain = covariance[i, k] / total
            mean[i] += gain * innovation
            for j in range(i + 1):
                if i != k and j != k:
                    covariance[i, j] -= gain * covariance[j, k]
                    covariance[j, i] = covariance[i, j]
        # With an uninformative prediction the difference would round to zero or below.
        for i in range(STATE_SIZE):
            covariance[i, k] *= noise / total
            covariance[k, i] = covariance[i, k]
    _limit_state(mean, covariance)
    return consistency


@jit
def damp(mean: np.ndarray, covariance: np.ndarray, factor: float) -> None:
    """Multiply velocity and acceleration, and their standard deviations, by a factor.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    factor : float
        Above 0, at most 1 [1].
    """
    covariance = indexed(covariance)
    for i in range(3, STATE_SIZE):
        _scale_component(covariance, i, factor)
        mean[i] *= factor


@jit
def _scale_component(covariance: np.ndarray, row: int, factor: float) -> None:
    """Multiply one state component by a factor, in the covariance."""
    for j in range(STATE_SIZE):
        covariance[row, j] *= factor
        covariance[j, row] = covariance[row, j]
    covariance[row, row] *= factor


@jit
def _limit_state(mean: np.ndarray, covariance: np.ndarray) -> None:
    """Clamp velocity, acceleration and all standard deviations to their limits."""
    for i in range(STATE_SIZE):
        bound = POSITION_LIMIT if i < 3 else SPEED_LIMIT if i < 6 else ACCELERATION_LIMIT
        if i >= 3:
            mean[i] = clamp(mean[i], -bound, bound)
        if covariance[i, i] > bound * bound:
            # Variance at its bound: drop the cross-covariances.
            _scale_component(covariance, i, 0.)
            covariance[i, i] = bound * bound
        elif covariance[i, i] < MIN_VARIANCE:
            covariance[i, i] = MIN_VARIANCE
