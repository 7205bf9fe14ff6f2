"""The tracked hand as OpenXR has it: 26 poses, or the 25 of WebXR, or 21 landmarks.

A pose's place is the joint at which its bone begins, or the tip; its axes are OpenXR's: -z along
the bone, y out of its back. The metacarpal bones of the fingers have the wrist's axes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import DIGITS, LINKS, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.numerics.quaternion import quaternion
from ..messages.landmark_kinds import OPENXR
from .hand_landmarks import landmark_order

# Columns: the axes of OpenXR along those of a link, x along the bone and z out of its back.
OPENXR_AXES = np.array(((0., 0., -1.), (-1., 0., 0.), (0., 1., 0.)))
FINGER_LINK_OF = {'cmc': 'metacarpal', 'mcp': 'proximal', 'pip': 'middle', 'dip': 'distal',
                  'tip': 'distal'}
THUMB_LINK_OF = {'cmc': 'metacarpal', 'mcp': 'proximal', 'ip': 'distal', 'tip': 'distal'}
NAME_OF_LANDMARK = {landmark: name for name, landmark in OPENXR.items()}


class LandmarkPoses(NamedTuple):
    """Poses of n landmarks.

    Attributes
    ----------
    names : tuple of str
        As OpenXR's, with the side before them: 'left_INDEX_TIP'.
    positions : ndarray, shape (n, 3)
        [m]
    orientations : ndarray, shape (n, 4)
        Quaternions x, y, z, w.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    orientations: np.ndarray


class OpenXrHand:
    """Poses of a hand's landmarks.

    Parameters
    ----------
    hand : Hand
    count : int
        Of the landmarks: 21, 25 or 26.

    Raises
    ------
    SourceUnavailable
        If it is another.
    """

    def __init__(self, hand: Hand, count: int) -> None:
        landmarks = landmark_order(count)
        self.names = tuple(f'{hand.side}_{NAME_OF_LANDMARK[name]}' for name in landmarks)
        self._table, self._tips = joint_table(hand), tip_offsets(hand)
        self._landmarks = landmarks
        # Half of the middle metacarpal, in the wrist's frame.
        flat = forward(self._table, np.zeros(len(LINKS))).position
        self._palm = .5 * (flat[LINKS.index('middle_metacarpal')]
                           + flat[LINKS.index('middle_proximal')])

    def poses(self, angles: ArrayLike, orientation: ArrayLike,
              position: np.ndarray) -> LandmarkPoses:
        """Return the landmarks' poses.

        Parameters
        ----------
        angles : array_like, shape (25,)
            Of the joints [rad].
        orientation : array_like, shape (4,)
            Quaternion x, y, z, w of the wrist in the frame of the poses.
        position : ndarray, shape (3,)
            Of the wrist there [m].
        """
        # Here, as nodes that never get that far import this module too, and scipy takes long.
        from scipy.spatial.transform import Rotation

        rotation = Rotation.from_quat(orientation).as_matrix()
        pose = forward(self._table, angles, rotation, position)
        positions, orientations = [], []
        for name in self._landmarks:
            at, turn = position, rotation
            if name == 'palm':
                at = position + rotation @ self._palm
            elif name != 'wrist':
                digit, _, joint = name.partition('_')
                links = THUMB_LINK_OF if digit == 'thumb' else FINGER_LINK_OF
                row = LINKS.index(f'{digit}_{links[joint]}')
                at, turn = pose.position[row], pose.rotation[row]
                if joint == 'tip':
                    at = at + turn @ self._tips[DIGITS.index(digit)]
            positions.append(at)
            orientations.append(quaternion(turn @ OPENXR_AXES))
        return LandmarkPoses(self.names, np.array(positions), np.array(orientations))
