"""Low-latency smoothing of a marker: its Kalman filter with adaptive process noise.

At rest the filter expects little jerk, damps velocity and averages over a second. Two running
means of the innovations detect motion: a short one fast starts, a long one slow drift. Where
either exceeds its noise, the jerk that explains it is assumed to have begun shortly before and
is expected from then on, decaying. Palm markers are filtered in the world frame, digit markers
in the palm's frame. Ours; no source.
"""

import math

import numpy as np

from ..numerics.jit import jit
from .ukf import add_jerk, correct, damp, initialise, predict

# A marker's activity row: expected jerk noise [m²/s⁵], then the two mean innovations [m].
ACTIVITY_SIZE = 7

# Spectral densities of jerk [m²/s⁵].
REST_JERK = 3e-6              # of a seen marker at rest
HIDDEN_JERK = 10.             # of a hidden marker: any usual motion
MAX_JERK = 1e7                # more is a jump to another place: the filter starts anew

JERK_DECAY_TIME = .025             # [s] time constant of the expected jerk noise
REST_DECAY_TIME = .1               # [s] time constant of velocity and acceleration at rest
INNOVATION_WINDOWS = (.006, .08)   # [s] time constants of the two mean innovations
ONSET_TIMES = (.015, .08)          # [s] ago that a motion detected by each of them began
INNOVATION_GATES = (22., 20.)      # of χ² (3 degrees of freedom): a false alarm in minutes
PALM_ERROR_INFLATION = 3.          # of the smoothed palm's variance: its errors are correlated


@jit
def update_filter(mean: np.ndarray, covariance: np.ndarray, activity: np.ndarray,
                  observed: np.ndarray, seen: bool, step: float, noise_sd: float,
                  fading: float) -> None:
    """Predict one marker's filter over a step and, if the marker is seen, correct it.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        State of the filter, replaced [m, m/s, m/s²].
    activity : ndarray, shape (ACTIVITY_SIZE,)
        Replaced. All zero before the first observation; zero it to start the filter anew.
    observed : ndarray, shape (3,)
        Measured position; not read when hidden [m].
    seen : bool
    step : float
        Time since the last frame [s].
    noise_sd : float
        Standard deviation of each coordinate of `observed` [m].
    fading : float
        Time constant of velocity and acceleration when hidden [s].
    """
    if activity[0] == 0.:
        if seen:
            initialise(mean, covariance, observed, noise_sd)
            activity[0] = HIDDEN_JERK
        return
    activity[0] = max(REST_JERK if seen else HIDDEN_JERK,
                      activity[0] * math.exp(-step / JERK_DECAY_TIME))
    predict(mean, covariance, step, activity[0])
    # At rest velocity is damped, else the filter would follow that of the noise.
    rate = math.sqrt(REST_JERK / activity[0]) / REST_DECAY_TIME
    if not seen:
        rate += 1. / fading
    damp(mean, covariance, math.exp(-step * rate))
    if seen:
        _adapt_jerk(mean, covariance, activity, observed, step, noise_sd)
        correct(mean, covariance, observed, noise_sd)


@jit
def _adapt_jerk(mean: np.ndarray, covariance: np.ndarray, activity: np.ndarray,
                observed: np.ndarray, step: float, noise_sd: float) -> None:
    """Raise the expected jerk where a mean innovation exceeds its noise: motion has begun."""
    if not step > 0.:
        # A repeated timestamp carries no information on motion.
        return
    variance = noise_sd * noise_sd + (
        covariance[0, 0] + covariance[1, 1] + covariance[2, 2]) / 3.
    highest = 0.
    since = 0.
    for i in range(2):
        gain = 1. - math.exp(-step / INNOVATION_WINDOWS[i])
        square = 0.
        for k in range(3):
            at = 1 + 3 * i + k
            activity[at] += gain * (observed[k] - mean[k] - activity[at])
            square += activity[at] * activity[at]
        # A running mean of white noise has gain / (2 − gain) of its variance.
        if square * (2. - gain) > INNOVATION_GATES[i] * variance * gain:
            # White jerk over a time t causes a position variance of jerk noise × t⁵ / 20.
            onset = max(ONSET_TIMES[i], step)
            jerk = 20. / 3. * square / onset ** 5
            if jerk > highest:
                highest = jerk
                since = onset
    if highest == 0.:
        return
    for i in range(1, ACTIVITY_SIZE):
        activity[i] = 0.
    if highest > MAX_JERK:
        initialise(mean, covariance, observed, noise_sd)
        activity[0] = HIDDEN_JERK
        return
    add_jerk(covariance, since, highest)
    activity[0] = max(activity[0], highest)


def noise_levers(template: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the gain of the palm markers' variance at places in the palm's frame.
    Parameters
    ----------
    template : ndarray, shape (3, 3)
        Palm markers in the palm's frame [m].
    places : ndarray, shape (n, 3)
        Digit markers at rest in the palm's frame [m].

    Returns
    -------
    ndarray, shape (n,)
        Variance of a coordinate there, due to a rigid fit, over that of the palm's markers.
    """
    centre = template.mean(axis=0)
    arms = template - centre
    inertia = np.trace(arms.T @ arms) * np.eye(3) - arms.T @ arms
    turned = np.cross(np.eye(3), (places - centre)[:, None, :])
    return 1. / 3. + np.einsum('nij,ik,nkj->n', turned, np.linalg.inv(inertia), turned) / 3.


@jit
def noise_in_palm_frame(noise_sd: float, covariances: np.ndarray, lever: float) -> float:
    """Return the noise of a digit's marker in the frame of the smoothed palm.

    Parameters
    ----------
    noise_sd : float
        Standard deviation of a coordinate of the markers in the world frame [m].
    covariances : ndarray, shape (3, 9, 9)
        Of the palm's markers, after this frame's correction.
    lever : float
        From `noise_levers` [1].

    Returns
    -------
    float
        Standard deviation of a coordinate [m].
    """
    variance = 0.
    for i in range(3):
        for k in range(3):
            variance += covariances[i, k, k] / 9.
    noise = noise_sd * noise_sd
    # Errors of a smoothed palm at rest are correlated in time: the variance is inflated.
    return math.sqrt(noise + lever * min(PALM_ERROR_INFLATION * variance, noise))
