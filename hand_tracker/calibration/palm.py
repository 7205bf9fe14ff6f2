"""The palm's frame, and what of palm and fingers shows in it."""

import numpy as np

from ..core.hand import FINGERS
from ..core.palm import rigid_palm
from ..core.plane import FIST_FAR
from ..core.vectors import vector
from .landmarks import FINGER_ROWS, INDEX_MCP, LITTLE_MCP, MIDDLE_MCP, WRIST
from .regularised import regularised_fit

STRONG_FLEXION = np.radians(60.)  # above it a finger's direction says little of its abduction
SEEN = (1., 99.)                  # [percentile] of the angles that count as the range of motion
LEAN_SPREAD = np.radians(5.)      # ours, unsourced, one standard deviation
LEAN_BOUND = 4.                   # [LEAN_SPREAD]


def palm_areas(joints):
    """Return the area of the triangle wrist, index MCP, little MCP, shape (T,) [m^2]."""
    wrist, index, little = (joints[:, row] for row in (WRIST, INDEX_MCP, LITTLE_MCP))
    return np.linalg.norm(np.cross(index - wrist, little - wrist), axis=1) / 2.


def palm_coordinates(joints):
    """Return joints of a right hand in the frame of its palm.

    The palm is that of the tracker: the rigid fit of wrist, index and little MCP to their
    medians. Their plane holds x, towards the middle MCP, and y.

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
            *(vector(frame[row]) for row in rows), *(vector(marker) for marker in template))
        local[t] = (frame - origin) @ np.array(fitted).T
    return local


def leaned(local, extension):
    """Return joints in the palm's frame turned about y so that the fingers flex about y.

    A finger's plane holds its MCP, its DIP and z: the PIP shows how far z leans from the
    normal of the palm. It leans no farther than the fingers' extension stays possible.

    Parameters
    ----------
    local : ndarray, shape (T, 21, 3)
        As from `palm_coordinates` [m].
    extension : ndarray, shape (4,)
        Lower limits of the flexion of the MCPs [rad].

    Returns
    -------
    ndarray, shape (T, 21, 3)
        [m]
    """
    mcp, pip, dip = (local[:, FINGER_ROWS[:, j]] for j in range(3))  # (T, 4, 3)

    bones = np.linalg.norm(pip - mcp, axis=2)
    reaches = np.linalg.norm(dip - mcp, axis=2)[:, :, None]

    def misses(x):
        z = np.array((np.sin(LEAN_SPREAD * x[0]), 0., np.cos(LEAN_SPREAD * x[0])))
        normal = np.cross(z, (dip - mcp) / reaches)
        size = np.linalg.norm(normal, axis=2)
        # A DIP straight above or below its MCP tells of no plane.
        aside = ((pip - mcp) * normal).sum(axis=2) / np.maximum(size, FIST_FAR)
        flexion = -np.arcsin(((pip - mcp) @ z / bones).clip(-1., 1.))
        return np.hypot(aside, bones * (extension - flexion).clip(0.))

    x, = regularised_fit(misses, [(0.,)], ((-LEAN_BOUND,), (LEAN_BOUND,)))
    c, s = np.cos(LEAN_SPREAD * x), np.sin(LEAN_SPREAD * x)
    return local @ np.array(((c, 0., s), (0., 1., 0.), (-s, 0., c)))


def median_lengths(chains):
    """Return the median distances between the joints of chains, shape (T, ..., joints, 3) [m]."""
    return np.median(np.linalg.norm(np.diff(chains, axis=-2), axis=-1), axis=0)


def splay(fingers):
    """Return the middle of the abduction seen, of fingers of shape (T, 4, 4, 3) [rad]."""
    proximal = fingers[:, :, 1] - fingers[:, :, 0]  # (T, 4, 3)
    abduction = np.arctan2(proximal[..., 1], proximal[..., 0])
    flexion = np.arctan2(-proximal[..., 2], np.hypot(proximal[..., 0], proximal[..., 1]))
    seen = (proximal[..., 0] > 0.) & (np.abs(flexion) < STRONG_FLEXION)
    return np.array([
        np.percentile(abduction[seen[:, f], f], SEEN).mean() if seen[:, f].any() else 0.
        for f in range(len(FINGERS))])
