"""Depth of overlaps between the capsules of a hand."""

import numpy as np

from ..core.model.capsules import (
    Capsules,
    Placement,
    axis_of,
    blank_placement,
    hand_capsules,
    may_touch,
    nearest_points,
    place_capsules,
)
from ..core.model.hand import Hand
from ..core.numerics.jit import jit
from ..core.numerics.packs import indexed, packed


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
    _overlaps(packed(shapes)[0][0], np.array(angles, dtype=float), blank_placement(), found)
    return found


@jit
def _overlaps(capsules: Capsules, angles: np.ndarray, placement: Placement,
              found: np.ndarray) -> None:
    for frame in range(found.size):
        place_capsules(capsules, angles[frame], placement)
        axes = indexed(placement.ends)
        for pair in range(len(capsules.first)):
            if not may_touch(capsules, axes, pair, 0.0):
                continue
            distance = nearest_points(
                axis_of(axes, capsules.first[pair]), axis_of(axes, capsules.second[pair]))[2]
            found[frame] = max(found[frame], capsules.apart[pair] - distance)
