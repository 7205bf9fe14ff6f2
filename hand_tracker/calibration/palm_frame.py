"""Coordinates in the palm frame, and median bone lengths."""

import numpy as np

from ..core.model.palm_triangle import rigid_palm
from ..core.numerics.vectors import vector
from .landmarks import INDEX_MCP, LITTLE_MCP, MIDDLE_MCP, WRIST


def palm_areas(joints: np.ndarray) -> np.ndarray:
    """Return the area of the triangle of wrist, index MCP and little MCP, shape (T,) [m²]."""
    wrist, index, little = (joints[:, row] for row in (WRIST, INDEX_MCP, LITTLE_MCP))
    return np.linalg.norm(np.cross(index - wrist, little - wrist), axis=1) / 2.


def palm_coordinates(joints: np.ndarray) -> np.ndarray:
    """Transform joints of a right hand into its palm frame.

    As in the tracker, the frame is the rigid fit of wrist, index and little MCP to their
    medians. x, towards the middle MCP, and y lie in their plane.

    Parameters
    ----------
    joints : ndarray, shape (T, 21, 3)
        [m]

    Returns
    -------
    ndarray, shape (T, 21, 3)
        [m]
    """
    wrist = joints[:, WRIST]
    z = np.cross(joints[:, LITTLE_MCP] - wrist, joints[:, INDEX_MCP] - wrist)
    y = np.cross(z, joints[:, MIDDLE_MCP] - wrist)
    axes = np.stack((np.cross(y, z), y, z), axis=1)
    axes /= np.linalg.norm(axes, axis=2)[:, :, None]
    rows = [WRIST, INDEX_MCP, LITTLE_MCP]
    template = np.median(
        np.einsum('tij,tkj->tki', axes, joints[:, rows] - wrist[:, None]), axis=0)
    local = np.empty_like(joints)
    for t, frame in enumerate(joints):
        fitted, origin = rigid_palm(
            (vector(frame[WRIST]), vector(frame[INDEX_MCP]), vector(frame[LITTLE_MCP])), template)
        local[t] = (frame - origin) @ np.array(fitted).T
    return local


def median_lengths(chains: np.ndarray) -> np.ndarray:
    """Return the median bone lengths of chains of joints, shape (T, ..., joints, 3) [m]."""
    return np.median(np.linalg.norm(np.diff(chains, axis=-2), axis=-1), axis=0)
