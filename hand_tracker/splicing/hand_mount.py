"""Hand mount: how a tracked hand sits on a body's wrist, and how their worlds are turned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.numerics.rigid_fit import nearest_rotation

MIN_MOTION = .02           # [m] rms that the wrist moves in two directions, to determine the world
MAX_MOUNT_SPREAD = np.radians(30.)
ROUNDS = 50


class HandMount(NamedTuple):
    """Constant rotations between a body's capture and a hand's.

    A rotation of the wrist in the hand's world is `world @ body's wrist @ wrist`.

    Attributes
    ----------
    wrist : ndarray, shape (3, 3)
        From the axes of the hand's wrist to those of the body's.
    world : ndarray, shape (3, 3)
        From the body's world to the hand's.
    spread : float
        Median angle by which a frame differs, NaN where nothing was fitted [rad].
    """

    wrist: np.ndarray
    world: np.ndarray
    spread: float = float('nan')

    @property
    def is_fitted(self) -> bool:
        """Whether the rotations are those of the recordings, not of the T-pose."""
        return bool(self.spread < MAX_MOUNT_SPREAD)


def rest_mount(side: str, bone: np.ndarray) -> HandMount:
    """Return the mount of a skeleton at rest: straight on with the forearm, the worlds equal.

    Parameters
    ----------
    side : {'right', 'left'}
    bone : ndarray, shape (3,)
        From the elbow to the wrist at rest, in the body's axes.

    Returns
    -------
    HandMount
    """
    along = np.array((1. if side == 'left' else -1., 0., 0.))
    direction = bone / max(float(np.linalg.norm(bone)), 1e-12)
    axis, cosine = np.cross(along, direction), float(along @ direction)
    angle = np.arctan2(np.linalg.norm(axis), cosine)
    if np.linalg.norm(axis) < 1e-9:
        # Straight or turned back: then about the upward axis.
        axis = np.array((0., 1., 0.))
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    return HandMount(turn, np.eye(3))


def fit_mount(body_places: np.ndarray, body_turns: np.ndarray, hand_places: np.ndarray,
              hand_turns: np.ndarray) -> HandMount | None:
    """Fit the mount to a wrist that both captures saw.

    The worlds are aligned by the wrist's path, then both rotations by turns to the wrist's.

    Parameters
    ----------
    body_places, hand_places : ndarray, shape (T, 3)
        Of the wrist at the same times [m].
    body_turns, hand_turns : ndarray, shape (T, 3, 3)

    Returns
    -------
    HandMount or None
        None where the wrist moves too little for a fit.
    """
    body, hand = (places - places.mean(axis=0) for places in (body_places, hand_places))
    left, sizes, right = np.linalg.svd(hand.T @ body / len(body))
    if not sizes[1] > MIN_MOTION**2:
        return None
    world = left @ np.diag((1., 1., np.linalg.det(left @ right))) @ right
    wrist = np.eye(3)
    for _ in range(ROUNDS):
        wrist = nearest_rotation(np.einsum('tji,tjk->ik', body_turns, world.T @ hand_turns))
        world = nearest_rotation(np.einsum('tij,tkj->ik', hand_turns, body_turns @ wrist))
    rest = (world @ body_turns @ wrist).swapaxes(1, 2) @ hand_turns
    spread = np.median(Rotation.from_matrix(rest).magnitude())
    return HandMount(wrist, world, float(spread))
