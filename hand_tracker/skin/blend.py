"""A mesh that follows bones: linear blend skinning."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..core.kinematics import Pose


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


def deform(skin, pose):
    """Return where the vertices of a skin are in a pose: linear blend skinning.

    Parameters
    ----------
    skin : Skin
    pose : Pose
        All 25 links, with or without a leading dimension n.

    Returns
    -------
    ndarray, shape (V, 3) or (n, V, 3)
        In the surroundings of the pose [m].
    """
    rows = list(skin.links)
    frames = np.concatenate((pose.rotation[..., rows, :, :].swapaxes(-1, -2),
                             pose.position[..., rows, None, :]), axis=-2)  # (..., B, 4, 3)
    return skin.blend @ frames.reshape(*frames.shape[:-3], -1, 3)
