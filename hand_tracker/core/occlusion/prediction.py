"""Inputs that the palm's and the digits' prediction share."""

from typing import NamedTuple

import numpy as np


class Observation(NamedTuple):
    """One frame of n markers as measured.

    Attributes
    ----------
    positions : ndarray, shape (n, 3)
        Not read where a marker is hidden [m].
    seen : ndarray of bool, shape (n,)
    noise : ndarray, shape (n,)
        Standard deviation of each marker on an axis [m].
    """

    positions: np.ndarray
    seen: np.ndarray
    noise: np.ndarray


class PredictionOptions(NamedTuple):
    """Options of filtering and prediction, out of `TrackerOptions`.

    Attributes
    ----------
    smoothing : bool
        Whether a seen marker's position is the filtered one.
    inertia : float
        Time constant in which a hidden marker's own motion fades; 0 switches it off, infinity
        is the paper's VTM-UKF, which does not fade [s].
    palm_from_fingers : bool
        Whether the fingers' markers correct hidden palm markers.
    transdigital_memory : float
        Time constant of the digits' motion statistics; 0 switches them off [s].
    max_prediction_time : float
        Time for which a prediction holds [s].
    relax_time : float
        Time constant in which a stale digit relaxes; 0 holds it [s].
    """

    smoothing: bool
    inertia: float
    palm_from_fingers: bool
    transdigital_memory: float
    max_prediction_time: float
    relax_time: float
