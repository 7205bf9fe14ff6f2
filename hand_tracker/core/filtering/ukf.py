"""Unscented Kalman filter (UKF) with the variable turn model (VTM), for one marker: inertia.

The state x is position, velocity and acceleration (9) of a marker that turns at the rate
ω = |v×a| / |v|², bounded by `squared_turn_rate`: X. R. Li and V. P. Jilkov, "Survey of maneuvering
target tracking. Part I", IEEE Trans. Aerospace and Electronic Systems 39 (2003).

Predictions are the scaled unscented transform (S. Julier 2002, R. van der Merwe 2004; β 2) in the
limit α → 0, where sums over sigma points become derivatives of the motion f, to second order:
mean f + m and covariance J P Jᵀ + β m mᵀ, m = ½ tr(H P), with J, H first and second derivatives.
Here f = L(ρ) x, ρ = |v×a|² / (|v|² + c)² with the constant c of the bound: with ρ's gradient g and
Hessian R, both zero at its limits, and L', L'' derivatives by ρ, J = L + u gᵀ, u = L' x, and
m = ½ (u tr(R P) + L'' x gᵀP g) + L' P g. No P is factorised.

All kernels update `mean`, shape (9,), and `covariance`, shape (9, 9), in place: three coordinates
each of position, velocity and acceleration [m, m/s, m/s²], and products of these.
"""

from functools import partial

import numpy as np

from ..numerics.jit import jit
from ..numerics.packs import indexed
from ..numerics.variable_turn import AxisState, Turn, turn_matrices, turned
from ..numerics.vectors import Vector, add, clamp, cross, dot, scale

STATE_SIZE = 9
UKF_BETA = 2.
MIN_VARIANCE = 1e-30

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

AxisTerms = tuple[AxisState, AxisState, AxisState]


@jit
def squared_turn_rate(velocity: Vector, acceleration: Vector, step: float,
                      uncertainty: float) -> tuple[float, float, bool]:
    """Return the squared turn rate of the variable turn model.

    It is bounded, or noise would spin a marker near rest: by the variance of the velocity, added
    to its square, so that only a velocity that exceeds its uncertainty turns; by
    `MAX_TURN_RATE`; and by `MAX_TURN_ANGLE` in one step.

    Parameters
    ----------
    velocity, acceleration : Vector
        [m/s, m/s²]
    step : float
        Above 0 [s].
    uncertainty : float
        Variance of the velocity, summed over its coordinates [m²/s²].

    Returns
    -------
    rate : float
        Squared [rad²/s²].
    speed2 : float
        Squared speed, with its uncertainty [m²/s²].
    is_free : bool
        Whether the rate is below both limits.
    """
    normal = cross(velocity, acceleration)
    speed2 = dot(velocity, velocity) + uncertainty + STILL_SPEED * STILL_SPEED
    rate = dot(normal, normal) / (speed2 * speed2)
    limit = min(MAX_TURN_RATE, MAX_TURN_ANGLE / step) ** 2
    return min(rate, limit), speed2, rate < limit


@jit
def initialise(mean: np.ndarray, covariance: np.ndarray, position: np.ndarray | Vector,
               noise_sd: float) -> None:
    """Initialise the state at a measured position, with unknown motion.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced [m, m/s, m/s², and products of these].
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

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced; unchanged if `step` is not above 0 [m, m/s, m/s², and products of these].
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
    rate, speed2, is_free = squared_turn_rate(velocity, acceleration, step, uncertainty)
    with_rate, variance, trace = (
        ((0., 0., 0.), (0., 0., 0.), (0., 0., 0.)), 0., 0.)
    if is_free:
        with_rate, variance, trace = _rate_moments(
            covariance, velocity, acceleration, rate, speed2, uncertainty)
    turns = turn_matrices(rate, step)
    x = _turn_mean(mean, 0, turns, with_rate[0], variance, trace)
    y = _turn_mean(mean, 1, turns, with_rate[1], variance, trace)
    z = _turn_mean(mean, 2, turns, with_rate[2], variance, trace)
    _turn_covariance(covariance, 0, 0, turns[0], x, x)
    _turn_covariance(covariance, 1, 1, turns[0], y, y)
    _turn_covariance(covariance, 2, 2, turns[0], z, z)
    _turn_covariance(covariance, 1, 0, turns[0], y, x)
    _turn_covariance(covariance, 2, 0, turns[0], z, x)
    _turn_covariance(covariance, 2, 1, turns[0], z, y)
    add_jerk(covariance, step, jerk_noise)
    _limit_state(mean, covariance)


# Inlined, as tuples are passed through memory.
@partial(jit, forceinline=True)
def _rate_moments(covariance: np.ndarray, velocity: Vector, acceleration: Vector, rate: float,
                  speed2: float, uncertainty: float) -> tuple[AxisTerms, float, float]:
    """Return moments of the squared turn rate ρ = N / speed2², N = |v|²|a|² − (v·a)², not bounded.

    `rate` and `speed2` are those of `squared_turn_rate`.

    Returns
    -------
    with_rate : tuple of AxisState
        P g: covariance of the state with the rate, by axis.
    variance : float
        gᵀP g [rad⁴/s⁴]
    trace : float
        tr(R P) [rad²/s²]
    """
    along, share = dot(velocity, acceleration), 2. / (speed2 * speed2)
    by_velocity = add(scale(velocity, share * dot(acceleration, acceleration) - 4. * rate / speed2),
                      scale(acceleration, -share * along))
    by_acceleration = add(scale(acceleration, share * dot(velocity, velocity)),
                          scale(velocity, -share * along))
    of_position = _product(covariance, 0, by_velocity, by_acceleration)
    of_velocity = _product(covariance, 3, by_velocity, by_acceleration)
    of_acceleration = _product(covariance, 6, by_velocity, by_acceleration)
    # tr(R P) by the product rule, sorted by blocks of P
    common = covariance[3, 6] + covariance[4, 7] + covariance[5, 8]
    trace = share * (
        (dot(acceleration, acceleration) - 2. * rate * speed2) * uncertainty
        + dot(velocity, velocity) * (covariance[6, 6] + covariance[7, 7] + covariance[8, 8])
        - 2. * along * common
        + 4. * dot(velocity, _product(covariance, 3, scale(velocity, -rate), acceleration))
        - dot(acceleration, _product(covariance, 3, acceleration, scale(velocity, 2.)))
        - dot(velocity, _product(covariance, 6, (0., 0., 0.), velocity))
        - 4. * speed2 * dot(velocity, of_velocity))
    return (
        ((of_position[0], of_velocity[0], of_acceleration[0]),
         (of_position[1], of_velocity[1], of_acceleration[1]),
         (of_position[2], of_velocity[2], of_acceleration[2])),
        dot(by_velocity, of_velocity) + dot(by_acceleration, of_acceleration), trace)


@partial(jit, forceinline=True)
def _product(covariance: np.ndarray, row: int, velocity: Vector, acceleration: Vector) -> Vector:
    """Return three rows of the covariance times a velocity and an acceleration."""
    x, y, z = 0., 0., 0.
    for k in range(3):
        v, a = velocity[k], acceleration[k]
        x += covariance[row, 3 + k] * v + covariance[row, 6 + k] * a
        y += covariance[row + 1, 3 + k] * v + covariance[row + 1, 6 + k] * a
        z += covariance[row + 2, 3 + k] * v + covariance[row + 2, 6 + k] * a
    return x, y, z


@partial(jit, forceinline=True)
def _turn_mean(mean: np.ndarray, k: int, turns: tuple[Turn, Turn, Turn], with_rate: AxisState,
               variance: float, trace: float) -> AxisTerms:
    """Replace the mean on an axis; return u, w and m on it, by which the covariance changes.

    With w = L P g + u gᵀP g / 2, J P Jᵀ = L P Lᵀ + u wᵀ + w uᵀ.
    """
    turn, slope, bend = turns
    axis = (mean[k], mean[3 + k], mean[6 + k])
    u = turned(slope, axis)
    w = add(turned(turn, with_rate), scale(u, .5 * variance))
    m = add(turned(slope, with_rate),
            scale(add(scale(u, trace), scale(turned(bend, axis), variance)), .5))
    mean[k], mean[3 + k], mean[6 + k] = add(turned(turn, axis), m)
    return u, w, m


@partial(jit, forceinline=True)
def _turn_covariance(covariance: np.ndarray, k: int, other: int, turn: Turn, terms: AxisTerms,
                     other_terms: AxisTerms) -> None:
    """Replace the covariance of the states on two axes: J P Jᵀ + β m mᵀ."""
    u, w, m = terms
    other_u, other_w, other_m = other_terms
    by_position = turned(turn, (
        covariance[k, other], covariance[3 + k, other], covariance[6 + k, other]))
    by_velocity = turned(turn, (
        covariance[k, 3 + other], covariance[3 + k, 3 + other], covariance[6 + k, 3 + other]))
    by_acceleration = turned(turn, (
        covariance[k, 6 + other], covariance[3 + k, 6 + other], covariance[6 + k, 6 + other]))
    for i in range(3):
        row = turned(turn, (by_position[i], by_velocity[i], by_acceleration[i]))
        for j in range(3):
            total = row[j] + u[i] * other_w[j] + w[i] * other_u[j] + UKF_BETA * m[i] * other_m[j]
            covariance[3 * i + k, 3 * j + other] = covariance[3 * j + other, 3 * i + k] = total


@jit
def add_jerk(covariance: np.ndarray, step: float, jerk_noise: float) -> None:
    """Add the process noise of white jerk over a step to the covariance.

    Parameters
    ----------
    covariance : ndarray, shape (9, 9)
        Replaced [products of m, m/s and m/s²].
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
        Replaced [m, m/s, m/s², and products of these].
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
        Replaced [m, m/s, m/s², and products of these].
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
