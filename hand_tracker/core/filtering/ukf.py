"""Inertia: an unscented Kalman filter with the variable turn model, for one marker.

The state is [position, velocity, acceleration] (9) of a marker that turns at the rate
ω = |v×a| / |v|²: X. R. Li and V. P. Jilkov, "Survey of maneuvering target tracking. Part I",
IEEE Trans. Aerospace and Electronic Systems 39 (2003); sigma points after R. van der Merwe
(2004), α 1e-3, β 2, κ 0. All kernels replace `mean`, shape (9,), and `covariance`, shape
(9, 9), in place [m, m/s, m/s²].
"""

import math

import numpy as np

from ..numerics.jit import indexed, jit
from ..numerics.vectors import add, clamp, cross, dot, scale, subtract

STATE_SIZE = 9
UKF_ALPHA = 1e-3
UKF_BETA = 2.
SIGMA_SPREAD = UKF_ALPHA * math.sqrt(STATE_SIZE)         # of the sigma points, in standard deviations
SIGMA_WEIGHT = .5 / (UKF_ALPHA * UKF_ALPHA * STATE_SIZE)     # of each but the central one

# Unsourced. At this speed and below, direction, and with it a turn, fade out [m/s].
STILL_SPEED = .01
MAX_TURN_RATE = 60.                       # [rad/s] about ten turns a second
MAX_TURN_ANGLE = 1.                         # [rad] in one step
SERIES_LIMIT = 1e-4                            # [rad²] below it three terms are exact

INITIAL_SPEED_SD = 1.                         # [m/s] standard deviation at the start
INITIAL_ACCELERATION_SD = 30.                 # [m/s²]
# Far beyond any hand: means and standard deviations stay within, and products finite.
POSITION_LIMIT, SPEED_LIMIT, ACCELERATION_LIMIT = 1e3, 1e2, 1e4  # [m, m/s, m/s²]

MIN_PIVOT = 1e-13                            # least share of a variance that is its own
LEAST_VARIANCE = 1e-30


@jit
def turn_motion(velocity, acceleration, step, uncertainty):
    """Return how a marker moves in a step: the variable turn model.

    The rate is bounded, or a marker near rest would spin as its noise has it: by the
    variance of the velocity, added to its square, so that only a velocity that stands out
    of its uncertainty turns; by the fastest turn of a hand; by the widest turn of one step.

    Parameters
    ----------
    velocity, acceleration : vector
        [m/s, m/s²]
    step : float
        [s]
    uncertainty : float
        Variance of the velocity, the sum over its coordinates [m²/s²].

    Returns
    -------
    shift, velocity, acceleration : vector
        Change of place, and both after the step [m, m/s, m/s²].
    """
    normal = cross(velocity, acceleration)
    speed = dot(velocity, velocity) + uncertainty + STILL_SPEED * STILL_SPEED
    rate = dot(normal, normal) / (speed * speed)
    rate = min(rate, MAX_TURN_RATE * MAX_TURN_RATE)
    if rate * step * step > MAX_TURN_ANGLE * MAX_TURN_ANGLE:
        rate = (MAX_TURN_ANGLE / step) ** 2
    # Only even functions of the angle are needed: smooth in its square.
    square = rate * step * step
    if square < SERIES_LIMIT:
        cosine = 1. - square * (.5 - square / 24.)
        ratio = 1. - square * (1. - square / 20.) / 6.
        versed = .5 - square * (1. - square / 30.) / 24.
    else:
        angle = math.sqrt(square)
        half = math.sin(.5 * angle) / angle
        cosine = math.cos(angle)
        ratio = math.sin(angle) / angle
        versed = 2. * half * half
    return (
        add(scale(velocity, ratio * step), scale(acceleration, versed * step * step)),
        add(scale(velocity, cosine), scale(acceleration, ratio * step)),
        subtract(scale(acceleration, cosine), scale(velocity, rate * ratio * step)),
    )


@jit
def initialise(mean, covariance, position, noise_sd):
    """Begin at a position, with motion unknown.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    position : ndarray, shape (3,)
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
def predict(mean, covariance, step, jerk_noise):
    """Move the state on by a step.

    With deviations d from the moved central point, the weighted sums of the unscented
    transform are mean = centre + m, m = Σ w d, and covariance = Σ w d dᵀ + (β − α²) m mᵀ:
    the central weight of −10⁶ drops out, and nothing negative is left.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    step : float
        Nothing changes when it is not above 0 [s].
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
    root = indexed(np.empty((STATE_SIZE, STATE_SIZE)))
    _cholesky(covariance, root)

    change = indexed(np.zeros(STATE_SIZE))
    deviation = indexed(np.empty(STATE_SIZE))
    for i in range(STATE_SIZE):
        for j in range(i + 1):
            covariance[i, j] = 0.
    for column in range(STATE_SIZE):
        for side in (-SIGMA_SPREAD, SIGMA_SPREAD):
            shift_there, moved_there, pulled_there = turn_motion(
                add(velocity, (side * root[3, column], side * root[4, column],
                               side * root[5, column])),
                add(acceleration, (side * root[6, column], side * root[7, column],
                                   side * root[8, column])), step, uncertainty)
            # Places enter by their differences alone: far from the origin nothing cancels.
            for k in range(3):
                deviation[k] = side * root[k, column] + (shift_there[k] - shift[k])
                deviation[3 + k] = moved_there[k] - moved[k]
                deviation[6 + k] = pulled_there[k] - pulled[k]
            for i in range(STATE_SIZE):
                weighted = SIGMA_WEIGHT * deviation[i]
                change[i] += weighted
                for j in range(i + 1):
                    covariance[i, j] += weighted * deviation[j]

    for i in range(STATE_SIZE):
        for j in range(i + 1):
            covariance[i, j] += (UKF_BETA - UKF_ALPHA * UKF_ALPHA) * change[i] * change[j]
            covariance[j, i] = covariance[i, j]
    for k in range(3):
        mean[k] += shift[k] + change[k]
        mean[3 + k] = moved[k] + change[3 + k]
        mean[6 + k] = pulled[k] + change[6 + k]
    add_jerk(covariance, step, jerk_noise)
    _limit_state(mean, covariance)


@jit
def add_jerk(covariance, step, jerk_noise):
    """Add what white jerk does in a step.

    Parameters
    ----------
    covariance : ndarray, shape (9, 9)
        Replaced.
    step : float
        [s]
    jerk_noise : float
        Spectral density [m²/s⁵].
    """
    for k in range(3):
        for i in range(3):
            for j in range(3):
                # ∫ of the responses t^(2−i) / (2−i)! and t^(2−j) / (2−j)! to a unit of jerk.
                power = 5 - i - j
                halves = (2. if i == 0 else 1.) * (2. if j == 0 else 1.)
                covariance[3 * i + k, 3 * j + k] += jerk_noise * step ** power / (power * halves)


@jit
def correct(mean, covariance, observed, noise_sd):
    """Correct the state by an observed position.

    The noise of the coordinates is independent: they are taken one after the other, which
    equals all at once and inverts no matrix.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    observed : ndarray, shape (3,)
        [m]
    noise_sd : float
        Standard deviation of each coordinate [m].

    Returns
    -------
    float
        The normalised innovation squared, of 3 degrees of freedom.
    """
    mean, covariance = indexed(mean), indexed(covariance)
    noise = max(float(noise_sd) ** 2, LEAST_VARIANCE)
    consistency = 0.
    cross_covariance = indexed(np.empty(STATE_SIZE))
    for k in range(3):
        innovation = float(observed[k]) - mean[k]
        total = covariance[k, k] + noise
        consistency += innovation * innovation / total
        for i in range(STATE_SIZE):
            cross_covariance[i] = covariance[i, k]
        for i in range(STATE_SIZE):
            gain = cross_covariance[i] / total
            mean[i] += gain * innovation
            for j in range(i + 1):
                covariance[i, j] -= gain * cross_covariance[j]
        # Where prediction tells nothing the difference would round to zero or below.
        for i in range(STATE_SIZE):
            rest = cross_covariance[i] * (noise / total)
            covariance[max(i, k), min(i, k)] = rest
        for i in range(STATE_SIZE):
            for j in range(i):
                covariance[j, i] = covariance[i, j]
    _limit_state(mean, covariance)
    return consistency


@jit
def damp(mean, covariance, share):
    """Keep a share of velocity and acceleration, with their uncertainty.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Replaced.
    share : float
        Above 0, to 1.
    """
    covariance = indexed(covariance)
    for i in range(3, STATE_SIZE):
        _scale_component(covariance, i, share)
        mean[i] *= share


@jit
def _scale_component(covariance, row, factor):
    """Multiply a component by `factor`, in its covariances."""
    for j in range(STATE_SIZE):
        covariance[row, j] *= factor
        covariance[j, row] = covariance[row, j]
    covariance[row, row] *= factor


@jit
def _limit_state(mean, covariance):
    """Keep velocity, acceleration and all standard deviations within those of this world."""
    for i in range(STATE_SIZE):
        bound = POSITION_LIMIT if i < 3 else SPEED_LIMIT if i < 6 else ACCELERATION_LIMIT
        if i >= 3:
            mean[i] = clamp(mean[i], -bound, bound)
        if covariance[i, i] > bound * bound:
            # So little is known that what it goes along with is no knowledge either.
            _scale_component(covariance, i, 0.)
            covariance[i, i] = bound * bound
        elif covariance[i, i] < LEAST_VARIANCE:
            covariance[i, i] = LEAST_VARIANCE


@jit
def _cholesky(covariance, root):
    """Put the lower Cholesky factor into `root`; pivots lost to rounding get a floor."""
    for j in range(STATE_SIZE):
        for i in range(j):
            root[i, j] = 0.
        pivot = covariance[j, j]
        for k in range(j):
            pivot -= root[j, k] * root[j, k]
        root[j, j] = math.sqrt(max(pivot, MIN_PIVOT * covariance[j, j], LEAST_VARIANCE))
        for i in range(j + 1, STATE_SIZE):
            part = covariance[i, j]
            for k in range(j):
                part -= root[i, k] * root[j, k]
            root[i, j] = part / root[j, j]
