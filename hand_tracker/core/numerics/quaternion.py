"""Rotations as quaternions, and frames as transforms, for messages and tables."""

import math

import numpy as np

from .jit import jit
from .vectors import components, frame, subtract, vector


def quaternion(rotation):
    """Return a rotation matrix as a quaternion.

    Parameters
    ----------
    rotation : array_like, shape (3, 3)

    Returns
    -------
    tuple of float
        x, y, z, w of unit length, w not negative.
    """
    return quaternion_from_frame(frame(np.asarray(rotation, dtype=float)))


@jit
def quaternion_from_frame(axes):
    """Return the quaternion of a frame; see `quaternion`."""
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = axes
    # Rows of 4 q qᵀ: that of the greatest diagonal is q times a number far from zero.
    rows = ((1. + xx - yy - zz, xy + yx, xz + zx, zy - yz),
            (xy + yx, 1. - xx + yy - zz, yz + zy, xz - zx),
            (xz + zx, yz + zy, 1. - xx - yy + zz, yx - xy),
            (zy - yz, xz - zx, yx - xy, 1. + xx + yy + zz))
    greatest = 0
    for i in range(1, 4):
        if rows[i][i] > rows[greatest][greatest]:
            greatest = i
    x, y, z, w = rows[greatest]
    norm = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    return x / norm, y / norm, z / norm, w / norm


@jit
def write_transforms(parent, link_rotations, link_positions, rotation, position, numbers):
    """Write the wrist in its surroundings, and links in their parents, as TF has them.

    Parameters
    ----------
    parent : ndarray of int, shape (25,)
        Of `JointTable`.
    link_rotations, link_positions : ndarray, shape (25, 3, 3) and (25, 3)
        Of `Pose` [m].
    rotation, position : ndarray, shape (3, 3) and (3,)
        The wrist [m].
    numbers : ndarray, shape (n, 7)
        Of the wrist and the first n - 1 links, replaced: x, y, z of the translation and
        x, y, z, w of the rotation.
    """
    wrist, origin = frame(rotation), vector(position)
    _write_transform(wrist, origin, 0, numbers)
    for link in range(len(numbers) - 1):
        up = parent[link]
        axes, at = wrist, origin
        if up >= 0:
            axes, at = frame(link_rotations[up]), vector(link_positions[up])
        x, y, z = frame(link_rotations[link])
        _write_transform(
            (components(axes, x), components(axes, y), components(axes, z)),
            components(axes, subtract(vector(link_positions[link]), at)), link + 1, numbers)


@jit
def _write_transform(axes, position, row, numbers):
    turn = quaternion_from_frame(axes)
    for i in range(3):
        numbers[row, i] = position[i]
    for i in range(4):
        numbers[row, 3 + i] = turn[i]
