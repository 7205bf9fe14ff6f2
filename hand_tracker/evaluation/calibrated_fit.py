"""The simulated hand as a calibration finds it, and its true angles about the joints found."""

from functools import cache

import numpy as np

from ..calibration.landmarks import landmark_angles
from ..calibration.marker_fit import MarkerFit, fit_markers
from ..calibration.palm_template import rigid_poses
from ..core.model.hand import Hand
from ..simulation.skin_take import EVERY_JOINT, skin_mount, skin_take
from .simulated import Trial

TAKE_MOTION, TAKE_SECONDS = 'range_of_motion', 27.  # as a live calibration asks for it


@cache
def calibrated_fit(seed: int) -> MarkerFit:
    """Return the mean hand as it is fitted to a take of markers at all its joints.

    Parameters
    ----------
    seed : int
        Of motion and noise.

    Returns
    -------
    MarkerFit
    """
    take, _ = skin_take(Hand.scaled(), EVERY_JOINT, (TAKE_MOTION,), TAKE_SECONDS, seed=seed)
    return fit_markers([take])


def true_angles(one: Trial, fit: MarkerFit) -> np.ndarray:
    """Return the true angles of a trial about the axes and from the zeros of the fitted hand.

    Its palm lies in the true one as their markers do; splay and the thumb's rest direction are the
    middle of its own take, so that the simulated hand's angles are not its.

    Parameters
    ----------
    one : Trial
    fit : MarkerFit
        To a take of the same hand.

    Returns
    -------
    ndarray, shape (n, 25)
        NaN of an abduction that a strongly bent finger does not show [rad].
    """
    true = np.array([skin_mount(one.hand, name).offset for name in fit.palm.names])
    rotation, position = rigid_poses(fit.palm.template[None], true)
    local = (one.joints - one.position[:, None]) @ one.rotation
    return landmark_angles(fit.hand, local @ rotation[0].T + position[0])
