"""The 21 hand landmarks, in the order of public data sets, and their forward kinematics."""

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import FINGERS, LINKS, Hand
from ..core.model.kinematics import Pose, tip_offsets

# The wrist, then each digit from root to tip, the thumb first.
LANDMARKS = ('wrist', 'thumb_cmc', 'thumb_mcp', 'thumb_ip', 'thumb_tip') + tuple(
    f'{finger}_{joint}' for finger in FINGERS for joint in ('mcp', 'pip', 'dip', 'tip'))
# The link of each landmark after the wrist, which is the root.
LANDMARK_LINKS = np.array([LINKS.index(link) for link in (
    'thumb_metacarpal', 'thumb_proximal', 'thumb_distal', 'thumb_distal') + tuple(
        f'{finger}_{link}' for finger in FINGERS
        for link in ('proximal', 'middle', 'distal', 'distal'))])
TIP_ROWS = np.array([LANDMARKS.index(f'{digit}_tip') for digit in FINGERS + ('thumb',)])

FINGER_ROWS = np.array([[LANDMARKS.index(f'{finger}_{joint}') for joint in (
    'mcp', 'pip', 'dip', 'tip')] for finger in FINGERS])
THUMB_ROWS = np.array([LANDMARKS.index(f'thumb_{joint}') for joint in ('cmc', 'mcp', 'ip', 'tip')])
WRIST, INDEX_MCP, MIDDLE_MCP, LITTLE_MCP = (LANDMARKS.index(name) for name in (
    'wrist', 'index_mcp', 'middle_mcp', 'little_mcp'))


def landmark_positions(hand: Hand, pose: Pose,
                       wrist_position: ArrayLike = (0., 0., 0.)) -> np.ndarray:
    """Return the positions of the 21 landmarks in a pose.

    Parameters
    ----------
    hand : Hand
    pose : Pose
        With or without a leading dimension n.
    wrist_position : array_like, shape (..., 3), optional
        As given to `forward` [m].

    Returns
    -------
    ndarray, shape (..., 21, 3)
        In the order of `LANDMARKS` [m].
    """
    points = pose.position[..., LANDMARK_LINKS, :]
    distal = pose.rotation[..., LANDMARK_LINKS[TIP_ROWS - 1], :, :]
    points[..., TIP_ROWS - 1, :] += np.einsum('...ij,...j->...i', distal, tip_offsets(hand))
    wrist = np.broadcast_to(wrist_position, points.shape[:-2] + (3,))
    return np.concatenate((wrist[..., None, :], points), axis=-2)
