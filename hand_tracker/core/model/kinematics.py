"""Forward kinematics: frames of the hand's 25 links from its joint angles and wrist pose.

The published pose is always the forward kinematics of the published angles.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..numerics.jit import jit
from ..numerics.packs import indexed
from .hand import (
    DIGITS,
    FINGER_JOINTS,
    FINGERS,
    JOINTS,
    LEFT_HAND_MIRROR,
    LINKS,
    THUMB_JOINTS,
    Hand,
)

X_AXIS, Y_AXIS, Z_AXIS = np.eye(3)
# Sign of a rotation about z that abducts: away from the middle finger (its own: to the thumb).
ABDUCTION_SIGN = (1., 1., -1., -1., 1.)


class JointTable(NamedTuple):
    """Kinematic tree: fixed transform and axis of each of the 25 revolute joints.

    Attributes
    ----------
    parent : ndarray of int, shape (25,)
        Parent link of each joint; -1 is the wrist.
    rotation : ndarray, shape (25, 3, 3)
        From the joint's frame at zero angle to the parent link's frame.
    translation : ndarray, shape (25, 3)
        Joint in the parent link's frame [m].
    axis : ndarray, shape (25, 3)
        Unit axis of rotation in the joint's frame, right-handed.
    """

    parent: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    axis: np.ndarray


class Pose(NamedTuple):
    """Frames of the 25 links.

    Attributes
    ----------
    rotation : ndarray, shape (..., 25, 3, 3)
        From each link's frame to the reference frame; x along the bone, z dorsal.
    position : ndarray, shape (..., 25, 3)
        Origin of each link's frame, its joint, in the reference frame [m].
    """

    rotation: np.ndarray
    position: np.ndarray


def direction_in_base(turn: float, flexion: float) -> np.ndarray:
    """Return the direction of a digit's first bone in the frame of `digit_base`, shape (3,).

    Parameters
    ----------
    turn : float
        About z, from x towards y [rad].
    flexion : float
        Of the turned bone, from the plane of x and y [rad].
    """
    return np.array((np.cos(flexion) * np.cos(turn), np.cos(flexion) * np.sin(turn),
                     -np.sin(flexion)))


def base_rotation(axis: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the rotation of a digit's base frame, in which its abduction and flexion are solved.

    z is the axis of abduction, x the projection of the digit's direction at zero angles onto
    the plane normal to z, and `tilt` the flexion from x to that direction.

    Parameters
    ----------
    axis, rest : ndarray, shape (3,)
        Axis of abduction and direction at zero angles, in the right hand's wrist frame.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
        From the base frame to the right hand's wrist frame.
    tilt : float
        [rad]
    """
    x = rest - (rest @ axis) * axis
    x = x / np.linalg.norm(x)
    return np.column_stack((x, np.cross(axis, x), axis)), float(np.arctan2(-rest @ axis, rest @ x))


def digit_base(hand: Hand, digit: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the base frame of a digit, see `base_rotation`: rotation, position and tilt.

    Parameters
    ----------
    hand : Hand
    digit : int
        0 to 4, index finger to thumb.

    Returns
    -------
    rotation : ndarray, shape (3, 3)
    position : ndarray, shape (3,)
        The MCP joint of a finger; of the thumb a point on the CMC's axis of abduction [m].
    tilt : float
        [rad]
    """
    if digit < len(FINGERS):
        root, axis = hand.finger_mcp[digit], hand.finger_abduction_axes[digit]
        rest = np.array((np.cos(hand.splay[digit]), np.sin(hand.splay[digit]), 0.))
    else:
        root, axis, rest = hand.thumb_cmc, hand.thumb_abduction_axis, hand.thumb_rest_direction
    rotation, tilt = base_rotation(axis, rest)
    return rotation, root, tilt


def joint_table(hand: Hand) -> JointTable:
    """Return the kinematic tree of a hand, of its own side.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    JointTable
        The source of the URDF and of `forward`.
    """
    parent: list[int] = []
    rotation: list[np.ndarray] = []
    translation: list[np.ndarray] = []
    axis: list[np.ndarray] = []
    ends = hand.bone_ends()
    for digit, name in enumerate(DIGITS):
        base, root, tilt = digit_base(hand, digit)
        c, s = np.cos(tilt), np.sin(tilt)
        tilted = np.array(((c, 0., s), (0., 1., 0.), (-s, 0., c)))
        if name == 'thumb':
            joints = THUMB_JOINTS
            cp, sp = np.cos(hand.thumb_roll), np.sin(hand.thumb_roll)
            rolled = np.array(((1., 0., 0.), (0., cp, -sp), (0., sp, cp)))
            rotations = (base, tilted, rolled, np.eye(3), np.eye(3))
            translations = (root, hand.thumb_axis_distance * X_AXIS, ends[digit, 0], 0. * X_AXIS,
                            ends[digit, 1])
        else:
            joints = FINGER_JOINTS
            cmc = hand.finger_cmc[digit]
            rotations = (np.eye(3), base, tilted, np.eye(3), np.eye(3))
            translations = (cmc, root - cmc, 0. * X_AXIS, ends[digit, 0], ends[digit, 1])
        parent += [-1] + [5 * digit + j for j in range(4)]
        rotation += rotations
        translation += translations
        axis += [Y_AXIS if 'flexion' in joint else ABDUCTION_SIGN[digit] * Z_AXIS
                 for joint in joints]
    table = JointTable(*(np.array(column) for column in (parent, rotation, translation, axis)))
    if hand.side == 'right':
        return table
    # The mirror y -> -y turns a rotation about v into one about -(mirrored v).
    return table._replace(
        rotation=LEFT_HAND_MIRROR[:, None] * table.rotation * LEFT_HAND_MIRROR,
        translation=table.translation * LEFT_HAND_MIRROR, axis=-table.axis * LEFT_HAND_MIRROR)


def tip_offsets(hand: Hand) -> np.ndarray:
    """Return the tips of the five digits in the frames of their distal links.

    Returns
    -------
    ndarray, shape (5, 3)
        [m]
    """
    return hand.bone_ends()[:, 2]


@jit
def place_digit_links(
        table: JointTable, digit: int, angles: np.ndarray, wrist_rotation: np.ndarray,
        wrist_position: np.ndarray, rotations: np.ndarray, positions: np.ndarray) -> None:
    """Write the frames of a digit's five links in a pose.

    Parameters are those of `place_links`: `angles`, shape (25,) [rad], the wrist's pose, shapes
    (3, 3) and (3,) [m], and the links' frames, shapes (25, 3, 3) and (25, 3) [m], of which the
    digit's are replaced.
    """
    parent, rotation, translation, axis = (
        indexed(table.parent), indexed(table.rotation), indexed(table.translation),
        indexed(table.axis))
    angles, rotations, positions = indexed(angles), indexed(rotations), indexed(positions)
    wrist_rotation, wrist_position = indexed(wrist_rotation), indexed(wrist_position)
    for joint in range(5 * digit, 5 * digit + 5):
        x, y, z = axis[joint, 0], axis[joint, 1], axis[joint, 2]
        s = math.sin(angles[joint])
        c = math.cos(angles[joint])
        v = 1. - c
        turn = (
            (c + v * x * x, v * x * y - s * z, v * x * z + s * y),
            (v * x * y + s * z, c + v * y * y, v * y * z - s * x),
            (v * x * z - s * y, v * y * z + s * x, c + v * z * z))
        up = parent[joint]
        for i in range(3):
            if up < 0:
                a = wrist_rotation[i, 0]
                b = wrist_rotation[i, 1]
                d = wrist_rotation[i, 2]
                at = wrist_position[i]
            else:
                a = rotations[up, i, 0]
                b = rotations[up, i, 1]
                d = rotations[up, i, 2]
                at = positions[up, i]
            positions[joint, i] = (
                at + a * translation[joint, 0] + b * translation[joint, 1]
                + d * translation[joint, 2])
            e = (a * rotation[joint, 0, 0] + b * rotation[joint, 1, 0]
                 + d * rotation[joint, 2, 0])
            f = (a * rotation[joint, 0, 1] + b * rotation[joint, 1, 1]
                 + d * rotation[joint, 2, 1])
            g = (a * rotation[joint, 0, 2] + b * rotation[joint, 1, 2]
                 + d * rotation[joint, 2, 2])
            for k in range(3):
                rotations[joint, i, k] = e * turn[0][k] + f * turn[1][k] + g * turn[2][k]


@jit
def place_links(table: JointTable, angles: np.ndarray, wrist_rotation: np.ndarray,
                wrist_position: np.ndarray, rotations: np.ndarray, positions: np.ndarray) -> None:
    """Write the frames of all links in a pose.

    Parameters
    ----------
    table : JointTable
    angles : ndarray, shape (25,)
        [rad]
    wrist_rotation, wrist_position : ndarray, shape (3, 3) and (3,)
        Wrist in the reference frame [m].
    rotations, positions : ndarray, shape (25, 3, 3) and (25, 3)
        Links in the reference frame, replaced [m].
    """
    for digit in range(5):
        place_digit_links(
            table, digit, angles, wrist_rotation, wrist_position, rotations, positions)


@jit
def _place_poses(table: JointTable, angles: np.ndarray, wrist_rotation: np.ndarray,
                 wrist_position: np.ndarray, rotations: np.ndarray, positions: np.ndarray) -> None:
    """Write the frames of all links in n poses, the first dimension of all but the table."""
    for n in range(len(angles)):
        place_links(table, angles[n], wrist_rotation[n], wrist_position[n], rotations[n],
                    positions[n])


def forward(table: JointTable, angles: ArrayLike, wrist_rotation: ArrayLike | None = None,
            wrist_position: ArrayLike | None = None) -> Pose:
    """Return the frames of all links for given joint angles.

    Parameters
    ----------
    table : JointTable
        Of a hand, from `joint_table`.
    angles : array_like, shape (25,) or (n, 25)
        In the order of `JOINTS` [rad].
    wrist_rotation : array_like, shape (3, 3) or (n, 3, 3), optional
        From the wrist's frame to the reference frame; identity by default.
    wrist_position : array_like, shape (3,) or (n, 3), optional
        Wrist in the reference frame; zero by default [m].

    Returns
    -------
    Pose
        With the leading dimension of `angles`.

    Raises
    ------
    ValueError
        If the shape of `angles` is another.
    """
    angles = np.asarray(angles, dtype=float)
    batch = np.atleast_2d(angles)
    n = len(batch)
    if batch.shape[1:] != (len(JOINTS),):
        raise ValueError(f'angles: shape {angles.shape}; expected (25,) or (n, 25)')
    turned = np.eye(3) if wrist_rotation is None else np.asarray(wrist_rotation, dtype=float)
    moved = np.zeros(3) if wrist_position is None else np.asarray(wrist_position, dtype=float)
    rotations = np.empty((n, len(LINKS), 3, 3))
    positions = np.empty((n, len(LINKS), 3))
    # Copies: numba would compile once more for the read-only view of a single frame.
    _place_poses(table, batch, np.array(np.broadcast_to(turned, (n, 3, 3)), order='C'),
                 np.array(np.broadcast_to(moved, (n, 3)), order='C'), rotations, positions)
    if angles.ndim == 1:
        return Pose(rotations[0], positions[0])
    return Pose(rotations, positions)
