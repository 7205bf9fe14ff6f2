"""The person's hand of a frame: landmarks of its angles, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..calibration.landmarks import LANDMARK_LINKS, LANDMARKS, TIP_ROWS
from ..core.model.hand import JOINTS, LINKS, Hand
from ..core.model.kinematics import JointTable, joint_table, place_links, tip_offsets
from ..core.numerics.jit import jit
from ..core.numerics.packs import Pack

JOINT_COUNT, POINT_COUNT, TIP_COUNT = len(JOINTS), len(LANDMARKS), len(TIP_ROWS)
MOST_ANGLE = 2. * np.pi  # [rad] beyond a full turn is no joint's: degrees, mostly


def are_joint_angles(angles: np.ndarray) -> bool:
    """Return whether angles are finite and within a full turn [rad]."""
    return bool((np.abs(angles) <= MOST_ANGLE).all())


class HumanHand(NamedTuple):
    """The person's hand in a frame.

    Attributes
    ----------
    table : JointTable
    links : ndarray of int, shape (20,)
        Link of each landmark after the wrist.
    tip_rows : ndarray of int, shape (5,)
        Landmarks that are tips, in the order of `tips`.
    tips : ndarray, shape (5, 3)
        Tips in the frames of their links [m].
    angles : ndarray, shape (1, 25)
        [rad]
    wrist_rotation, wrist_position : ndarray, shape (3, 3) and (3,)
        Identity and zero.
    rotations, positions : ndarray, shape (25, 3, 3) and (25, 3)
        Of the links.
    landmarks : ndarray, shape (21, 3)
        In the order of `LANDMARKS` [m].
    """

    table: JointTable
    links: np.ndarray
    tip_rows: np.ndarray
    tips: np.ndarray
    angles: np.ndarray
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    landmarks: np.ndarray


def new_human_hand(hand: Hand) -> HumanHand:
    """Return a person's hand of which no frame is known."""
    links = len(LINKS)
    return HumanHand(
        joint_table(hand), LANDMARK_LINKS.astype(np.int64), TIP_ROWS.astype(np.int64),
        tip_offsets(hand), np.zeros((1, JOINT_COUNT)), np.eye(3), np.zeros(3),
        np.zeros((links, 3, 3)), np.zeros((links, 3)), np.zeros((POINT_COUNT, 3)))


@jit
def place_landmarks(humans: Pack[HumanHand]) -> None:
    """Write the landmarks of the person's angles, in the wrist's frame."""
    human = humans[0]
    table, landmarks = human.table, human.landmarks
    place_links(JointTable(table.parent[:], table.rotation[:], table.translation[:], table.axis[:]),
                human.angles[0], human.wrist_rotation[:], human.wrist_position[:],
                human.rotations[:], human.positions[:])
    for row in range(1, POINT_COUNT):
        for k in range(3):
            landmarks[row, k] = human.positions[human.links[row - 1], k]
    for tip in range(TIP_COUNT):
        row = human.tip_rows[tip]
        turn = human.rotations[human.links[row - 1]]
        for k in range(3):
            landmarks[row, k] += (turn[k, 0] * human.tips[tip, 0] + turn[k, 1] * human.tips[tip, 1]
                                  + turn[k, 2] * human.tips[tip, 2])
