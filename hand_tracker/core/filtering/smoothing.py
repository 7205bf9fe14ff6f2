"""Temporal smoothing without latency: the marker's filter, with adaptive process noise.

At rest little jerk is expected, velocity fades, and the filter averages over a second. What
it then does not expect is noticed by two running means of the innovations: a short one for
what starts fast, a long one for what drifts. Where either leaves its noise, the jerk that
explains it is taken to have begun a little ago, and is expected from then on, ever less.
Palm markers are run in the world, those of digits in the palm's frame. Ours; no source.
"""

import math

import numpy as np

from ..numerics.jit import jit
from .ukf import add_jerk, correct, damp, initialise, predict

# A marker's row of activity: the expected jerk noise, then the two means of innovations [m].
ACTIVITY_SIZE = 7

# Spectral densities of jerk [m²/s⁵].
REST_JERK = 3e-6
HIDDEN_JERK = 10.            # a hidden marker may do anything usual
MAX_JERK = 1e7              # what takes more is no motion, but another place
JERK_DECAY_TIME = .025               # [s] in which the expected jerk noise falls to 1/e
REST_DECAY_TIME = .1                 # [s] in which velocity and acceleration fall to 1/e at rest
INNOVATION_WINDOWS = (.006, .08)        # [s] of the two means
ONSET_TIMES = (.015, .08)         # [s] ago that what they notice began
INNOVATION_GATES = (22., 20.)           # on a χ² of 3 degrees of freedom: false alarms once in minutes
PALM_ERROR_INFLATION = 3.              # variances of a smoothed palm, whose errors last


@jit
def update_filter(mean, covariance, activity, observed, seen, step, noise_sd, fading):
    """Move one marker on by a step and, when it is seen, correct it by what is observed.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        Of its filter, replaced [m, m/s, m/s²].
    activity : ndarray, shape (ACTIVITY,)
        Replaced; all zero before the first observation, and again to forget the marker.
    observed : ndarray, shape (3,)
        A position; not read when hidden [m].
    seen : bool
    step : float
        Since the last frame [s].
    noise_sd : float
        Standard deviation of each coordinate of `observed` [m].
    fading : float
        Time in which velocity and acceleration fall to 1/e when hidden [s].
    """
    if activity[0] == 0.:
        if seen:
            initialise(mean, covariance, observed, noise_sd)
            activity[0] = HIDDEN_JERK
        return
    activity[0] = max(REST_JERK if seen else HIDDEN_JERK,
                      activity[0] * math.exp(-step / JERK_DECAY_TIME))
    predict(mean, covariance, step, activity[0])
    # A marker at rest stays at rest: the velocity of noise is not carried on.
    rate = math.sqrt(REST_JERK / activity[0]) / REST_DECAY_TIME
    if not seen:
        rate += 1. / fading
    damp(mean, covariance, math.exp(-step * rate))
    if seen:
        _adapt_jerk(mean, covariance, activity, observed, step, noise_sd)
        correct(mean, covariance, observed, noise_sd)


@jit
def _adapt_jerk(mean, covariance, activity, observed, step, noise_sd):
    """Expect more jerk, now and for a while, where the means of innovations leave their noise."""
    if not step > 0.:
        # A frame that repeats the last time is no news of motion.
        return
    variance = noise_sd * noise_sd + (
        covariance[0, 0] + covariance[1, 1] + covariance[2, 2]) / 3.
    noticed = 0.
    since = 0.
    for i in range(2):
        share = 1. - math.exp(-step / INNOVATION_WINDOWS[i])
        square = 0.
        for k in range(3):
            at = 1 + 3 * i + k
            activity[at] += share * (observed[k] - mean[k] - activity[at])
            square += activity[at] * activity[at]
        # A running mean of white noise has share / (2 − share) of its variance.
        if square * (2. - share) > INNOVATION_GATES[i] * variance * share:
            # White jerk for a time t leaves a variance of jerk noise × t⁵ / 20.
            onset = max(ONSET_TIMES[i], step)
            jerk = 20. / 3. * square / onset ** 5
            if jerk > noticed:
                noticed = jerk
                since = onset
    if noticed == 0.:
        return
    for i in range(1, ACTIVITY_SIZE):
        activity[i] = 0.
    if noticed > MAX_JERK:
        initialise(mean, covariance, observed, noise_sd)
        activity[0] = HIDDEN_JERK
        return
    add_jerk(covariance, since, noticed)
    activity[0] = max(activity[0], noticed)


def noise_levers(template, places):
    """Return how much noise of the palm's markers reaches places in its frame.

    Parameters
    ----------
    template : ndarray, shape (3, 3)
        The palm's markers in its frame [m].
    places : ndarray, shape (n, 3)
        Of the digits' markers at rest [m].

    Returns
    -------
    ndarray, shape (n,)
        Variance of a coordinate there, over that of the palm's markers, in a rigid fit.
    """
    centre = template.mean(axis=0)
    arms = template - centre
    inertia = np.trace(arms.T @ arms) * np.eye(3) - arms.T @ arms
    turned = np.cross(np.eye(3), (places - centre)[:, None, :])
    return 1. / 3. + np.einsum('nij,ik,nkj->n', turned, np.linalg.inv(inertia), turned) / 3.


@jit
def noise_in_palm_frame(noise_sd, covariances, lever):
    """Return the noise of a digit's marker in the frame of the smoothed palm.

    Parameters
    ----------
    noise_sd : float
        Of the markers in the world, standard deviation of a coordinate [m].
    covariances : ndarray, shape (3, 9, 9)
        Of the palm's markers after this frame's correction.
    lever : float
        Of `noise_levers`.

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
    # What smoothing adds to a still palm is not white: its variance alone says too little.
    return math.sqrt(noise + lever * min(PALM_ERROR_INFLATION * variance, noise))
