"""A robot hand ready for retargeting: model, anatomy, and a sphere at each tip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .robot_anatomy import RobotAnatomy, find_anatomy, gripper_positions, joints_before
from .robot_model import RobotModel, robot_model
from .robot_urdf import UrdfTree

TIP_RADIUS_SHARE = .09             # [1] of a digit's length, where no radius is known
TIP_RADIUS_RANGE = (.001, .05)     # [m]
NOTED_PAD_RADIUS = 1e-4            # [m] of a gripper's pads, from which its guess is noted


class TipSphere(NamedTuple):
    """Sphere at the tip of a digit, with which it touches others.

    Attributes
    ----------
    centre : ndarray, shape (3,)
        In the last joint's frame [m].
    radius : float
        [m]
    """

    centre: np.ndarray
    radius: float


class Follow(NamedTuple):
    """Joint-to-joint map: variable = scale * angle + offset.

    Attributes
    ----------
    variable, angle : int
        Index in `RobotModel.variables` and in `JOINTS`.
    scale, offset : float
        [1] and [rad]
    """

    variable: int
    angle: int
    scale: float
    offset: float


class RobotHand(NamedTuple):
    """A robot hand.

    Attributes
    ----------
    name : str
    model : RobotModel
    anatomy : RobotAnatomy
    spheres : dict of str to TipSphere
        By role.
    rest : ndarray, shape (n,)
        Position of the variables at rest [rad or m].
    follow : tuple of Follow
    """

    name: str
    model: RobotModel
    anatomy: RobotAnatomy
    spheres: dict[str, TipSphere]
    rest: np.ndarray
    follow: tuple[Follow, ...] = ()

    @property
    def side(self) -> str:
        """'right' or 'left'."""
        return self.anatomy.side

    @property
    def arm_joints(self) -> list[str]:
        """Variables that move the palm: of an arm or a wrist."""
        before = joints_before(self.model, self.anatomy.palm_joint)
        return [self.model.variables[i] for i in sorted(
            {int(self.model.joints.variable[joint]) for joint in before})]

    @property
    def digit_variables(self) -> list[int]:
        """Variables of the joints that move digits against the palm."""
        return sorted({int(self.model.joints.variable[joint])
                       for digit in self.anatomy.digits.values() for joint in digit.joints})

    def tip_positions(self, position: np.ndarray) -> np.ndarray:
        """Return the centres of the tip spheres in the palm's frame, shape (digits, 3) [m].

        Parameters
        ----------
        position : ndarray, shape (n,)
            Of the variables [rad or m].
        """
        frames = self.model.frames(position)
        points = [frames[1][digit.joints[-1]] + frames[0][digit.joints[-1]]
                  @ self.spheres[role].centre for role, digit in self.anatomy.digits.items()]
        return self._in_palm(np.array(points), frames)

    def chains(self, position: np.ndarray) -> dict[str, np.ndarray]:
        """Return joints and tip of each digit in the palm's frame, by role, shape (k, 3) [m].

        Parameters
        ----------
        position : ndarray, shape (n,)
            Of the variables [rad or m].
        """
        frames = self.model.frames(position)
        rotations, origins = frames
        return {role: self._in_palm(np.array(
            [*(origins[joint] for joint in digit.joints),
             origins[digit.joints[-1]] + rotations[digit.joints[-1]] @ digit.tip]), frames)
            for role, digit in self.anatomy.digits.items()}

    def base_pose(self, frames: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (3, 3) and position (3,) of the base in the palm's frame [m].

        Parameters
        ----------
        frames : tuple of ndarray
            As from `RobotModel.frames`.
        """
        rotations, origins = frames
        turned, at = self.anatomy.axes.T, np.zeros(3)
        if (palm := self.anatomy.palm_joint) >= 0:
            turned = turned @ rotations[palm].T
            at = -turned @ origins[palm]
        return turned, at

    def _in_palm(self, points: np.ndarray, frames: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return points of the base in the palm's frame, shape (n, 3) [m]."""
        palm = self.anatomy.palm_joint
        if palm >= 0:
            points = (points - frames[1][palm]) @ frames[0][palm]
        return points @ self.anatomy.axes


def robot_hand(tree: UrdfTree, tips: dict[str, str] | None = None,
               side: str | None = None) -> RobotHand:
    """Return a robot hand of which everything is found by geometry.

    Parameters
    ----------
    tree : UrdfTree
    tips, side : optional
        As for `find_anatomy`.

    Raises
    ------
    InvalidRobot
        If there is no hand to be found.
    """
    model = robot_model(tree)
    anatomy = find_anatomy(model, tips, side)
    spheres, _ = tip_spheres(model, anatomy, tree.spheres, {}, {})
    return RobotHand(tree.name, model, anatomy, spheres, model.open_position())


def tip_spheres(model: RobotModel, anatomy: RobotAnatomy, known: dict[str, float],
                radii: dict[str, float], centres: dict[str, np.ndarray]
                ) -> tuple[dict[str, TipSphere], tuple[str, ...]]:
    """Return the spheres at the tips, by role, and the roles whose radius is guessed.

    A sphere ends at its digit's tip. Those of a gripper touch where it is closed.

    Parameters
    ----------
    model : RobotModel
    anatomy : RobotAnatomy
    known : dict of str to float
        Radius of spheres among the shapes of links [m].
    radii : dict of str to float
        That are given, by role; else that of the tip link's shape, else guessed [m].
    centres : dict of str to ndarray
        That are given, by role, in the frame of the last joint [m].
    """
    digits = anatomy.digits
    guessed = [role for role, digit in digits.items()
               if role not in radii and (anatomy.is_gripper or digit.tip_link not in known)]
    if anatomy.is_gripper:
        at = {role: centres.get(role, digit.tip) for role, digit in digits.items()}
        guess = min(.5 * _least_gap(model, anatomy, at), TIP_RADIUS_RANGE[1])
    else:
        lengths = [digit.length for digit in digits.values()]
        guess = float(np.clip(TIP_RADIUS_SHARE * np.median(lengths), *TIP_RADIUS_RANGE))
    spheres = {}
    for role, digit in digits.items():
        radius = radii.get(role, guess)
        if role not in radii and role not in guessed:
            radius = float(np.clip(known[digit.tip_link], *TIP_RADIUS_RANGE))
        centre = centres.get(role, digit.tip)
        if role not in centres and not anatomy.is_gripper and digit.bones and (
                digit.bones[-1].joint == digit.joints[-1]):
            centre = digit.tip - radius * digit.bones[-1].direction
        spheres[role] = TipSphere(centre, radius)
    return spheres, tuple(guessed)


def guess_notes(robot: RobotHand, guessed: tuple[str, ...]) -> tuple[str, ...]:
    """Return what a person should know of guessed radii.

    Parameters
    ----------
    robot : RobotHand
    guessed : tuple of str
        Roles, as from `tip_spheres`.
    """
    if not guessed:
        return ()
    radius, is_gripper = robot.spheres[guessed[0]].radius, robot.anatomy.is_gripper
    if is_gripper and radius < NOTED_PAD_RADIUS:
        return ()
    how = ('half of what is between the two where the gripper is closed' if is_gripper else
           f'guessed, {100. * TIP_RADIUS_SHARE:.0f} % of a digit: measure it, set radius_mm')
    return (f'radius at the tip of {", ".join(guessed)}: {1e3 * radius:.1f} mm, {how}',)


def _least_gap(model: RobotModel, anatomy: RobotAnatomy,
               centres: dict[str, np.ndarray]) -> float:
    """Return the least distance of a gripper's two tips over its range [m]."""
    gaps = []
    for position in gripper_positions(model):
        rotations, origins = model.frames(position)
        first, second = (origins[digit.joints[-1]] + rotations[digit.joints[-1]] @ centres[role]
                         for role, digit in anatomy.digits.items())
        gaps.append(float(np.linalg.norm(first - second)))
    return min(gaps)
