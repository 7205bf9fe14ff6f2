"""Unit quaternions of rotation matrices, and the transforms of the hand's links for TF."""

import math

import numpy as np
from numpy.typing import ArrayLike

from .jit import jit
from .vectors import Frame, Vector, components, frame, subtract, vector

Quaternion = tuple[float, float, float, float]  # x, y, z, w


def quaternion(rotation: ArrayLike) -> Quaternion:
    """Return the unit quaternion of a rotation matrix.

    Parameters
    ----------
    rotation : array_like, shape (3, 3)

    Returns
    -------
    tuple of float
        x, y, z, w of unit length, with w >= 0.
    """
    return quaternion_from_frame(frame(np.asarray(rotation, dtype=float)))


@jit
def quaternion_from_frame(axes: Frame) -> Quaternion:
    """Return the unit quaternion (x, y, z, w) of a frame, with w >= 0."""
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
def write_transforms(
        parent: np.ndarray, link_rotations: np.ndarray, link_positions: np.ndarray,
        rotation: np.ndarray, position: np.ndarray, transforms: np.ndarray) -> None:
    """Write the transforms of wrist and links for TF, each link in its parent link.

    Parameters
    ----------
    parent : ndarray of int, shape (25,)
        Parent link of each link, -1 for the wrist (`JointTable.parent`).
    link_rotations, link_positions : ndarray, shape (25, 3, 3) and (25, 3)
        Link frames in the markers' frame (`Pose`) [m].
    rotation, position : ndarray, shape (3, 3) and (3,)
        Wrist frame in the markers' frame [m].
    transforms : ndarray, shape (n, 7)
        Replaced: the wrist in the markers' frame, then the first n - 1 links in their
        parents, each as translation x, y, z [m] and quaternion x, y, z, w.
    """
    wrist, origin = frame(rotation), vector(position)
    _write_transform(wrist, origin, 0, transforms)
    for link in range(len(transforms) - 1):
        up = parent[link]
        axes, at = wrist, origin
        if up >= 0:
            axes, at = frame(link_rotations[up]), vector(link_positions[up])
        x, y, z = frame(link_rotations[link])
        _write_transform(
            (components(axes, x), components(axes, y), components(axes, z)),
            components(axes, subtract(vector(link_positions[link]), at)), link + 1, transforms)


@jit
def _write_transform(axes: Frame, position: Vector, row: int, transforms: np.ndarray) -> None:
    """Write a frame's position and quaternion into row `row` of `transforms`, shape (n, 7)."""
    rotation = quaternion_from_frame(axes)
    for i in range(3):
        transforms[row, i] = position[i]
    for i in range(4):
        transforms[row, 3 + i] = rotation[i]
