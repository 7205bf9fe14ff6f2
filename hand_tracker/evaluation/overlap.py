"""How deep digits are in each other or in the palm."""

import numpy as np

from ..core.model.capsules import axis_of, capsules, close_pairs, nearest_points, place_capsules
from ..core.numerics.jit import indexed, jit, packed


def deepest_overlaps(hand, angles):
    """Return by how much the capsules of a hand overlap in each frame at most.

    Parameters
    ----------
    hand : Hand
    angles : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    ndarray, shape (n,)
        0 where nothing overlaps [m].
    """
    shapes = capsules(hand)
    found = np.zeros(len(angles))
    _overlaps(packed(shapes)[0][0], np.array(angles, dtype=float),
              np.empty((len(shapes.link), 2, 3)), found)
    return found


@jit
def _overlaps(capsules, angles, ends, found):
    for frame in range(found.size):
        place_capsules(capsules, angles[frame], ends)
        axes = indexed(ends)
        for pair in close_pairs(capsules, ends, 0.0):
            distance = nearest_points(
                axis_of(axes, capsules.first[pair]), axis_of(axes, capsules.second[pair]))[2]
            found[frame] = max(found[frame], capsules.apart[pair] - distance)
