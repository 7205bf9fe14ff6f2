"""Tracks: the filters of a group of markers, updated when seen and predicted when hidden.

Palm markers are tracked in the frame of the input, digit markers in the palm's frame: a hidden
digit so inherits the velocity and acceleration of the hand.

Seen markers are smoothed with low latency, by a Kalman filter with adaptive process noise. At
rest the filter expects little jerk, damps velocity and averages over a second. Two running means
of the innovations detect motion: a short one fast starts, a long one slow drift. Where either
exceeds its noise, the jerk that explains it is assumed to have begun shortly before and is
expected from then on, decaying. Ours; no source.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit
from ..numerics.vectors import Vector, store, vector
from .ukf import STATE_SIZE, add_jerk, correct, damp, initialise, predict

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

PACE_TIME = .02           # [s] time constant of the mean velocity; from captures
MISFIT_TIME = .1          # [s] time constant of the decay of a seen marker's misfit
PRIOR_MOTION = 1e-3       # [m²/s] of a digit's marker in the palm, beside what is learned
RESTART_HIDDEN_TIME = .1  # [s] hidden for longer, a marker seen again starts a new filter


class Tracks(NamedTuple):
    """Filters of n markers, one row each.

    Attributes
    ----------
    mean : ndarray, shape (n, 9)
        Position, velocity and acceleration [m, m/s, m/s²].
    covariance : ndarray, shape (n, 9, 9)
        Of these [products of m, m/s and m/s²].
    activity : ndarray, shape (n, 7)
        Of `update_filter`.
    pace : ndarray, shape (n, 3)
        Mean velocity over `PACE_TIME`, less noisy than the filter's: where a hidden marker's
        motion starts from [m/s].
    seen : ndarray of bool, shape (n,)
        Whether seen in the last frame.
    known : ndarray of bool, shape (n,)
        Whether seen since the start.
    hidden_for : ndarray, shape (n,)
        Time since last seen, or since the start [s].
    strayed : ndarray, shape (n, 3)
        Of a digit's marker measured while the palm is lost: its own motion since, by which it is
        off `mean` [m].
    own_motion : ndarray, shape (3 n, 3 n)
        Of the digits' markers: covariance of their motion in the palm, over time [m²/s].
    turning : ndarray, shape (1,)
        Of the palm's: variance of their turn about an axis, over time [rad²/s].
    line : ndarray, shape (2, 3)
        Of the palm's: ends of the line that further markers hold it by, equal ones for none [m].
    misfit : ndarray, shape (n,)
        Recent peak of the distance from the reported hand: decays while seen, kept while hidden
        [m].
    """

    mean: np.ndarray
    covariance: np.ndarray
    activity: np.ndarray
    pace: np.ndarray
    seen: np.ndarray
    known: np.ndarray
    hidden_for: np.ndarray
    strayed: np.ndarray
    own_motion: np.ndarray
    turning: np.ndarray
    line: np.ndarray
    misfit: np.ndarray


def initial_tracks(positions: np.ndarray) -> Tracks:
    """Return the `Tracks` of markers never seen, at assumed positions, shape (n, 3) [m]."""
    n = len(positions)
    mean = np.zeros((n, STATE_SIZE))
    mean[:, :3] = positions
    return Tracks(
        mean, np.zeros((n, STATE_SIZE, STATE_SIZE)), np.zeros((n, ACTIVITY_SIZE)),
        np.zeros((n, 3)), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), np.zeros(n),
        np.zeros((n, 3)), PRIOR_MOTION * np.eye(3 * n), np.zeros(1), np.zeros((2, 3)), np.zeros(n))


@jit
def position_deviation(covariance: np.ndarray) -> float:
    """Return a marker's standard deviation on an axis by its track's covariance (9, 9) [m]."""
    return math.sqrt((covariance[0, 0] + covariance[1, 1] + covariance[2, 2]) / 3.)


@jit
def update_filter(mean: np.ndarray, covariance: np.ndarray, activity: np.ndarray,
                  observed: np.ndarray | Vector, seen: bool, step: float, noise_sd: float,
                  fading: float) -> None:
    """Predict one marker's filter over a step and, if the marker is seen, correct it.

    Parameters
    ----------
    mean, covariance : ndarray, shape (9,) and (9, 9)
        State of the filter, replaced [m, m/s, m/s²].
    activity : ndarray, shape (ACTIVITY_SIZE,)
        Replaced. All zero before the first observation; zero it to start the filter anew.
    observed : ndarray or Vector, shape (3,)
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
                observed: np.ndarray | Vector, step: float, noise_sd: float) -> None:
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


@jit
def update_track(tracks: Tracks, row: int, observed: Vector, step: float, noise: float,
                 smooth: bool) -> None:
    """Update the track of a seen marker by its measured position.

    Parameters
    ----------
    tracks : Tracks
        Row `row` is updated.
    row : int
    observed : Vector
        Measured position [m].
    step : float
        Time since the last frame [s].
    noise : float
        Standard deviation of each coordinate [m].
    smooth : bool
        Whether the track takes the filtered position; else the measured one.
    """
    if tracks.hidden_for[row] > RESTART_HIDDEN_TIME or not tracks.known[row]:
        tracks.activity[row, :] = 0.
    before = vector(tracks.mean[row])
    update_filter(tracks.mean[row], tracks.covariance[row], tracks.activity[row], observed, True,
                  step, noise, 1.)
    if not smooth:
        store(tracks.mean, row, observed)
    if tracks.seen[row]:
        _update_pace(tracks, row, before, step)
    tracks.misfit[row] *= math.exp(-step / MISFIT_TIME)
    tracks.known[row] = True
    tracks.hidden_for[row] = 0.


@jit
def predict_track(tracks: Tracks, row: int, move: Vector, drift: Vector, step: float,
                  fading: float) -> None:
    """Predict the track of a hidden marker: the motion of its neighbours plus its own, fading.

    Parameters
    ----------
    tracks : Tracks
        Row `row` is updated.
    row : int
    move : Vector
        Displacement since the last frame by the neighbours' motion [m].
    drift : Vector
        Velocity by the neighbours' motion: in the first hidden frame the marker's own
        velocity is its pace, or the filter's, minus this [m/s].
    step : float
        Time since the last frame [s].
    fading : float
        Time constant of its own motion; 0 for none, infinity for all the motion of its filter,
        with acceleration and turn [s].
    """
    mean = tracks.mean[row]
    before = vector(mean)
    for k in range(3):
        if math.isinf(fading):
            if tracks.seen[row]:
                mean[3 + k] -= drift[k]
            continue
        if tracks.seen[row]:
            mean[3 + k] = tracks.pace[row, k] - drift[k]
        # Integrated twice, the noise of the acceleration would dominate.
        mean[6 + k] = 0.
        if fading <= 0.:
            mean[3 + k] = 0.
    update_filter(mean, tracks.covariance[row], tracks.activity[row], before, False, step, 0.,
                  max(fading, 1e-9))
    for k in range(3):
        mean[k] += move[k]
    _update_pace(tracks, row, before, step)
    tracks.hidden_for[row] += step


@jit
def _update_pace(tracks: Tracks, row: int, before: Vector, step: float) -> None:
    """Update the mean velocity of a marker that was at `before` [m] a step [s] ago."""
    if step <= 0.:
        return
    gain = 1. - math.exp(-step / PACE_TIME)
    for k in range(3):
        tracks.pace[row, k] += gain * (
            (tracks.mean[row, k] - before[k]) / step - tracks.pace[row, k])


@jit
def clear_motion(tracks: Tracks) -> None:
    """Keep all positions, but set velocities and accelerations to zero: after a pause."""
    tracks.mean[:, 3:] = 0.
    tracks.pace[:] = 0.
    tracks.activity[:] = 0.
