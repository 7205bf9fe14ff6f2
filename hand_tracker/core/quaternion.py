"""Rotations as quaternions, for messages and tables."""

import math


def quaternion(rotation):
    """Return a rotation matrix as a quaternion.

    Parameters
    ----------
    rotation : sequence of sequence of float, shape (3, 3)

    Returns
    -------
    tuple of float
        x, y, z, w of unit length, w not negative.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    # Rows of 4 q qᵀ: that of the greatest diagonal is q times a number far from zero.
    diagonal = (1. + xx - yy - zz, 1. - xx + yy - zz, 1. - xx - yy + zz, 1. + xx + yy + zz)
    greatest = diagonal.index(max(diagonal))
    x, y, z, w = (
        (diagonal[0], xy + yx, xz + zx, zy - yz), (xy + yx, diagonal[1], yz + zy, xz - zx),
        (xz + zx, yz + zy, diagonal[2], yx - xy), (zy - yz, xz - zx, yx - xy, diagonal[3]),
    )[greatest]
    norm = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    return x / norm, y / norm, z / norm, w / norm
