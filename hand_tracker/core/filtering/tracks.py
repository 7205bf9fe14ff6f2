"""What the filters know of the eight markers, one row each.

Palm markers are followed in the frame of the markers, those of digits in the palm's: a
hidden digit so inherits the velocity and acceleration of the hand.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit
from ..numerics.vectors import store, vector
from .smoothing import ACTIVITY_SIZE, update_filter
from .ukf import STATE_SIZE

PACE_TIME = .02   # [s] over which the pace is taken; from captures
MAX_HIDDEN_TIME = .1   # [s] hidden, after which a marker's old motion says nothing of its new one


class Tracks(NamedTuple):
    """The filters of n markers.

    Attributes
    ----------
    mean : ndarray, shape (n, 9)
        Position, velocity and acceleration [m, m/s, m/s²].
    covariance : ndarray, shape (n, 9, 9)
    activity : ndarray, shape (n, 7)
        Of the smoothing.
    pace : ndarray, shape (n, 3)
        Mean velocity of the last hundredths of a second: what a hidden marker goes on
        with, and less noisy than the filter's own [m/s].
    seen : ndarray of bool, shape (n,)
        In the last frame.
    known : ndarray of bool, shape (n,)
        Seen since the start.
    hidden_for : ndarray, shape (n,)
        Time since it was seen, or since the start [s].
    """

    mean: np.ndarray
    covariance: np.ndarray
    activity: np.ndarray
    pace: np.ndarray
    seen: np.ndarray
    known: np.ndarray
    hidden_for: np.ndarray


def initial_tracks(positions):
    """Return `Tracks` of markers that were never seen, shape (n, 3) [m]."""
    n = len(positions)
    mean = np.zeros((n, STATE_SIZE))
    mean[:, :3] = positions
    return Tracks(mean, np.zeros((n, STATE_SIZE, STATE_SIZE)), np.zeros((n, ACTIVITY_SIZE)),
                  np.zeros((n, 3)), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), np.zeros(n))


@jit
def update_track(tracks, row, observed, step, noise, smooth):
    """Take a seen marker's position into its track.

    Parameters
    ----------
    tracks : Tracks
        Its row is changed.
    row : int
    observed : vector
        [m]
    step : float
        Since the last frame [s].
    noise : float
        Standard deviation of each coordinate [m].
    smooth : bool
        Whether the filter's position is taken, else the observed one.
    """
    if tracks.hidden_for[row] > MAX_HIDDEN_TIME or not tracks.known[row]:
        tracks.activity[row, :] = 0.
    place = np.empty(3)
    before = vector(tracks.mean[row])
    for k in range(3):
        place[k] = observed[k]
    update_filter(tracks.mean[row], tracks.covariance[row], tracks.activity[row], place, True,
                  step, noise, 1.)
    if not smooth:
        store(tracks.mean, row, observed)
    if tracks.seen[row]:
        _update_pace(tracks, row, before, step)
    tracks.known[row] = True
    tracks.hidden_for[row] = 0.


@jit
def predict_track(tracks, row, move, drift, step, fading):
    """Move a hidden marker on.

    Parameters
    ----------
    tracks : Tracks
        Its row is changed.
    row : int
    move, drift : vector
        What others say of its move since the last frame and, in the first frame without
        it, of its velocity: what goes beyond is its own, and fades [m], [m/s].
    step : float
        Since the last frame [s].
    fading : float
        Time in which its own motion falls to a third; 0 leaves it none [s].
    """
    mean = tracks.mean[row]
    before = vector(mean)
    for k in range(3):
        if tracks.seen[row]:
            mean[3 + k] = tracks.pace[row, k] - drift[k]
        # Twice integrated, its noise would lead far astray.
        mean[6 + k] = 0.
        if fading <= 0.:
            mean[3 + k] = 0.
    update_filter(mean, tracks.covariance[row], tracks.activity[row], mean[:3], False, step, 0.,
                  max(fading, 1e-9))
    for k in range(3):
        mean[k] += move[k]
    _update_pace(tracks, row, before, step)
    tracks.hidden_for[row] += step


@jit
def _update_pace(tracks, row, before, step):
    if step <= 0.:
        return
    share = 1. - math.exp(-step / PACE_TIME)
    for k in range(3):
        tracks.pace[row, k] += share * (
            (tracks.mean[row, k] - before[k]) / step - tracks.pace[row, k])


@jit
def clear_motion(tracks):
    """Keep places, but not how they moved: after a pause.

    Parameters
    ----------
    tracks : Tracks
        Changed.
    """
    tracks.mean[:, 3:] = 0.
    tracks.pace[:] = 0.
    tracks.activity[:] = 0.
