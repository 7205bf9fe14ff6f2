"""Skinning: deform a mesh with its links, by linear blend skinning or dual quaternions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.model.hand import DIGITS, LINKS
from ..core.model.kinematics import Pose


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh with skinning weights, bound to the links of a hand.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        At zero angles, in the wrist frame of the hand's side [m].
    faces : ndarray of int, shape (F, 3)
        Vertex indices of the triangles, anticlockwise seen from outside.
    weights : ndarray, shape (V, B)
        0 to 1; each row sums to 1.
    links : tuple of int, length B
        The links with a column of weights, as indices of `LINKS` and of a `Pose`.
    rest : Pose
        Frames of these links at zero angles, in the wrist frame, shape (B, ...).
    """

    vertices: np.ndarray
    faces: np.ndarray
    weights: np.ndarray
    links: tuple[int, ...]
    rest: Pose

    @cached_property
    def weighted_vertices(self) -> np.ndarray:
        """Homogeneous vertices in each link's frame, times their weights, shape (V, 4 B).

        Their product with the links' frames is the deformed mesh.
        """
        local = np.einsum('bji,vbj->vbi', self.rest.rotation,
                          self.vertices[:, None] - self.rest.position)
        homogeneous = np.concatenate((local, np.ones((*local.shape[:2], 1))), axis=2)
        return (self.weights[:, :, None] * homogeneous).reshape(len(local), -1)


def deform(skin: Skin, pose: Pose, dual_quaternions: bool = False) -> np.ndarray:
    """Return the vertices of a skin in a pose.

    Parameters
    ----------
    skin : Skin
    pose : Pose
        All 25 links, with or without a leading dimension n.
    dual_quaternions : bool
        Blend dual quaternions (Kavan et al., Geometric skinning with approximate dual
        quaternion blending, 2008) instead of matrices: bent joints keep their volume, at
        twenty times the cost.

    Returns
    -------
    ndarray, shape (V, 3) or (n, V, 3)
        In the frame of the pose [m].
    """
    blend = _dual_quaternions if dual_quaternions else _linear
    rows = list(skin.links)
    if pose.position.ndim == 2:
        return blend(skin, pose.rotation[rows], pose.position[rows])
    return np.stack([blend(skin, *frame) for frame in zip(
        pose.rotation[:, rows], pose.position[:, rows])])


def _linear(skin: Skin, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    frames = np.concatenate((rotation, position[:, :, None]), axis=2).swapaxes(0, 1)  # (3, B, 4)
    # einsum, as a matrix product would start all of BLAS's threads.
    return np.einsum('vk,ck->vc', skin.weighted_vertices, frames.reshape(3, -1))


def _dual_quaternions(skin: Skin, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    # Here, as the skin node does without, and scipy takes long to import.
    from scipy.spatial.transform import Rotation

    turned = rotation @ skin.rest.rotation.swapaxes(1, 2)
    moved = position - np.einsum('bij,bj->bi', turned, skin.rest.position)
    real = np.roll(Rotation.from_matrix(turned).as_quat(), 1, axis=1)  # w, x, y, z
    # Of q and -q take the one nearer to the previous link of the digit, or to the palm.
    for row in range(1, len(real)):
        before = row - 1 if _same_digit(*skin.links[row - 1:row + 1]) else 0
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


def _same_digit(first: int, second: int) -> bool:
    """Test whether two links, as indices of `LINKS`, belong to one digit."""
    links_per_digit = len(LINKS) // len(DIGITS)
    return first // links_per_digit == second // links_per_digit
