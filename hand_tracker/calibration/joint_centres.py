"""Detect takes of joint centres (solved skeletons), as opposed to markers on the skin."""

import numpy as np

from ..core.model.hand import FINGERS
from .landmarks import LANDMARKS
from .takes import Gathered

CENTRE_CHANGE = .0015  # [m] of the distance of neighbouring joints, 5th to 95th percentile
# [m] the same of fingertip and knuckle: a finger that does not bend shows nothing.
BENT_CHANGE = .02


def are_joint_centres(gathered: Gathered, are_declared: bool) -> bool:
    """Return whether all 21 landmarks are there, and are joints or keep their neighbours' distance.

    Markers on the back of a finger move apart by millimetres as it bends.

    Parameters
    ----------
    gathered : Gathered
    are_declared : bool
        Whether the files say that these are joints: those that a camera estimates keep no distance.

    Returns
    -------
    bool
    """
    if not set(LANDMARKS) <= set(gathered.names):
        return False
    if are_declared:
        return True

    def change(first: str, second: str) -> float:
        distances = np.linalg.norm(gathered.points[:, gathered.names.index(first)]
                                   - gathered.points[:, gathered.names.index(second)], axis=1)
        low, high = np.nanpercentile(distances, (5., 95.))
        return float(high - low)

    bending = [finger for finger in FINGERS
               if change(f'{finger}_mcp', f'{finger}_tip') > BENT_CHANGE]
    return bool(bending) and all(
        change(f'{finger}_{first}', f'{finger}_{second}') < CENTRE_CHANGE
        for finger in bending for first, second in (('mcp', 'pip'), ('pip', 'dip')))


def landmark_frames(gathered: Gathered) -> np.ndarray:
    """Return the landmarks of a right hand, shape (T, 21, 3), in the order of `LANDMARKS` [m]."""
    return gathered.points[:, [gathered.names.index(name) for name in LANDMARKS]]
