"""Poses of a person and of a robot hand that follows, as they are drawn side by side."""

from pathlib import Path

import numpy as np

from ..calibration.landmarks import landmark_positions
from ..core.model.hand import Hand, preset_limits
from ..core.model.kinematics import forward, joint_table
from ..drawing.robot_picture import RobotPose, save_robot_picture
from ..files.hand_file import choose_hand
from ..retargeting.retarget_problem import digit_landmarks
from ..retargeting.retargeter import Retargeter
from ..retargeting.robot_anatomy import ROLES
from ..retargeting.robot_file import LoadedRobot
from ..retargeting.robot_hand import RobotHand
from ..simulation.poses import pose_angles

INSPECTED_POSES = {
    'open': 'open', 'relaxed': 'relaxed', 'pinch': 'pinch', 'point': 'one', 'fist': 'fist'}
SETTLING_FRAMES = 60


def draw_robot(path: str | Path, loaded: LoadedRobot, hand_file: str | None) -> None:
    """Draw a robot beside a human hand in `INSPECTED_POSES`.

    Parameters
    ----------
    path : path-like
        PNG.
    loaded : LoadedRobot
    hand_file : str or None
        Of the person; the mean hand where there is none.
    """
    hand = (choose_hand(hand_file, loaded.hand.side)[0] if hand_file else
            Hand.scaled(side=loaded.hand.side, limits=preset_limits('wide')))
    table = joint_table(hand)
    poses = []
    for title, pose in INSPECTED_POSES.items():
        angles = pose_angles(pose, hand)
        landmarks = landmark_positions(hand, forward(table, angles))
        solver = Retargeter(loaded.hand, hand, loaded.options)
        for _ in range(SETTLING_FRAMES):
            position = solver.update(landmarks, np.inf, angles)
        poses.append(robot_pose(title, landmarks, loaded.hand, position))
    save_robot_picture(path, loaded.hand.name, poses)


def robot_pose(title: str, landmarks: np.ndarray, robot: RobotHand,
               position: np.ndarray) -> RobotPose:
    """Return both hands as they are drawn.

    Parameters
    ----------
    title : str
    landmarks : ndarray, shape (21, 3)
        Of the person, in the wrist's frame [m].
    robot : RobotHand
    position : ndarray, shape (n,)
        Of its variables [rad or m].
    """
    radii = [sphere.radius for sphere in robot.spheres.values()]
    return RobotPose(title, {role: landmarks[digit_landmarks(role)] for role in ROLES},
                     robot.chains(position), list(zip(robot.tip_positions(position), radii)))
