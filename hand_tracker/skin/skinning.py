"""A mesh that follows bones: linear blend skinning, or dual quaternions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.model.hand import DIGITS, LINKS
from ..core.model.kinematics import Pose


@dataclass(frozen=True, eq=False)
class Skin:
    """A closed mesh of the hand and how much each of its vertices follows each link.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        At zero angles, in the wrist's frame of the hand's own side [m].
    faces : ndarray of int, shape (F, 3)
        Vertices of the triangles, anticlockwise seen from outside.
    weights : ndarray, shape (V, B)
        0 to 1; each row sums to 1.
    links : tuple of int, length B
        The links that carry the skin, as indices of `LINKS` and of a `Pose`.
    rest : Pose
        Frames of these links at zero angles, in the wrist's frame, shape (B, ...).
    """

    vertices: np.ndarray
    faces: np.ndarray
    weights: np.ndarray
    links: tuple
    rest: Pose

    @cached_property
    def blend(self):
        """Weighted places of the vertices in the links' frames, shape (V, 4 B).

        Its product with the links' frames is the deformed mesh.
        """
        local = np.einsum('bji,vbj->vbi', self.rest.rotation,
                          self.vertices[:, None] - self.rest.position)
        homogeneous = np.concatenate((local, np.ones((*local.shape[:2], 1))), axis=2)
        return (self.weights[:, :, None] * homogeneous).reshape(len(local), -1)


def deform(skin, pose, dual_quaternions=False):
    """Return where the vertices of a skin are in a pose.

    Parameters
    ----------
    skin : Skin
    pose : Pose
        All 25 links, with or without a leading dimension n.
    dual_quaternions : bool
        Whether to blend dual quaternions (Kavan et al., Geometric skinning with approximate
        dual quaternion blending, 2008) in place of matrices: bent joints keep their volume,
        for twenty times the time.

    Returns
    -------
    ndarray, shape (V, 3) or (n, V, 3)
        In the surroundings of the pose [m].
    """
    blend = _dual_quaternions if dual_quaternions else _linear
    rows = list(skin.links)
    if pose.position.ndim == 2:
        return blend(skin, pose.rotation[rows], pose.position[rows])
    return np.stack([blend(skin, *frame) for frame in zip(
        pose.rotation[:, rows], pose.position[:, rows])])


def _linear(skin, rotation, position):
    frames = np.concatenate((rotation, position[:, :, None]), axis=2).swapaxes(0, 1)  # (3, B, 4)
    # Not a product of matrices: for that BLAS sets all its threads going.
    return np.einsum('vk,ck->vc', skin.blend, frames.reshape(3, -1))


def _dual_quaternions(skin, rotation, position):
    turned = rotation @ skin.rest.rotation.swapaxes(1, 2)
    moved = position - np.einsum('bij,bj->bi', turned, skin.rest.position)
    real = np.roll(Rotation.from_matrix(turned).as_quat(), 1, axis=1)  # w, x, y, z
    # Of q and -q the one nearer to the link before in the digit, or to the palm.
    for row in range(1, len(real)):
        before = row - 1 if same_digit(*skin.links[row - 1:row + 1]) else 0
        real[row] *= np.copysign(1., real[row] @ real[before])
    dual = .5 * np.column_stack((-np.einsum('bi,bi->b', moved, real[:, 1:]),
                                 real[:, :1] * moved + np.cross(moved, real[:, 1:])))
    real, dual = skin.weights @ real, skin.weights @ dual  # (V, 4)
    norm = np.linalg.norm(real, axis=1, keepdims=True)
    w, u = real[:, :1] / norm, real[:, 1:] / norm
    e, f = dual[:, :1] / norm, dual[:, 1:] / norm
    at = skin.vertices
    return (at + 2. * np.cross(u, np.cross(u, at) + w * at)
            + 2. * (w * f - e * u + np.cross(u, f)))


def same_digit(first, second):
    """Return whether two links, as indices of `LINKS`, are of one digit."""
    each = len(LINKS) // len(DIGITS)
    return first // each == second // each
