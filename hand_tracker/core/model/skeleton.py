"""Skeleton of the hand: named points and the bones between them, for drawing and capsules."""

import numpy as np

from .hand import DIGITS, FINGERS, LINKS, ROOT, Hand
from .kinematics import Pose

DIGIT_TIPS = tuple(f'{digit}_tip' for digit in DIGITS)
SKELETON_POINTS = LINKS + (ROOT,) + DIGIT_TIPS


def _point_rows(*names: str) -> tuple[int, ...]:
    """Return the rows of named points in `SKELETON_POINTS`."""
    return tuple(SKELETON_POINTS.index(name) for name in names)


# Points of each digit from its first joint to its tip, and bones as pairs of points.
DIGIT_CHAINS = tuple(
    _point_rows(*(f'{finger}_{link}' for link in ('metacarpal', 'proximal', 'middle', 'distal')),
                f'{finger}_tip') for finger in FINGERS) + (
    _point_rows('thumb_metacarpal', 'thumb_proximal', 'thumb_distal', 'thumb_tip'),)
# The palm: from the wrist to every CMC, and across the knuckles.
PALM_BONES = tuple((SKELETON_POINTS.index(ROOT), chain[0]) for chain in DIGIT_CHAINS) + tuple(
    (a[1], b[1]) for a, b in zip(DIGIT_CHAINS[:3], DIGIT_CHAINS[1:4]))
SKELETON_BONES = PALM_BONES + tuple(
    bone for chain in DIGIT_CHAINS for bone in zip(chain, chain[1:]))


def bone_radii(hand: Hand) -> np.ndarray:
    """Return the radius of the capsule around each of `SKELETON_BONES`.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    ndarray, shape (len(SKELETON_BONES),)
        [m]
    """
    palm = len(PALM_BONES) * [hand.palm_radius]
    fingers = [radius for digit in range(4) for radius in (hand.palm_radius, *hand.radii[digit])]
    return np.array(palm + fingers + list(hand.radii[4]))


def skeleton_points(tips: np.ndarray, pose: Pose, wrist_position: np.ndarray) -> np.ndarray:
    """Return the positions of `SKELETON_POINTS` in a pose.

    Parameters
    ----------
    tips : ndarray, shape (5, 3)
        From `tip_offsets` [m].
    pose : Pose
        With or without a leading dimension n.
    wrist_position : ndarray, shape (..., 3)
        [m]

    Returns
    -------
    ndarray, shape (..., 31, 3)
        [m]
    """
    distal = [LINKS.index(f'{digit}_distal') for digit in DIGITS]
    ends = pose.position[..., distal, :] + np.einsum(
        '...nij,nj->...ni', pose.rotation[..., distal, :, :], tips)
    return np.concatenate((pose.position, np.asarray(wrist_position)[..., None, :], ends), axis=-2)
