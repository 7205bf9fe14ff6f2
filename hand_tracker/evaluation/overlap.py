"""Depth of overlaps between the capsules of a hand."""

import numpy as np

from ..core.model.capsules import (
    Capsules,
    axis_of,
    close_pairs,
    hand_capsules,
    nearest_points,
    place_capsules,
)
from ..core.model.hand import Hand
from ..core.numerics.jit import indexed, jit, packed


def deepest_overlaps(hand: Hand, angles: np.ndarray) -> np.ndarray:
    """Return the depth of the deepest overlap of digits or palm in each frame.

    Parameters
    ----------
    hand : Hand
    angles : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    ndarray, shape (n,)
        0 without an overlap [m].
    """
    shapes = hand_capsules(hand)
    found = np.zeros(len(angles))
    _overlaps(packed(shapes)[0][0], np.array(angles, dtype=float),
              np.empty((len(shapes.link), 2, 3)), found)
    return found


@jit
def _overlaps(capsules: Capsules, angles: np.ndarray, ends: np.ndarray, found: np.ndarray) -> None:
    for frame in range(found.size):
        place_capsules(capsules, angles[frame], ends)
        axes = indexed(ends)
        for pair in close_pairs(capsules, ends, 0.0):
            distance = nearest_points(
                axis_of(axes, capsules.first[pair]), axis_of(axes, capsules.second[pair]))[2]
            found[frame] = max(found[frame], capsules.apart[pair] - distance)
