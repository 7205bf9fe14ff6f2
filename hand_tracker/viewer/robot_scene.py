"""A robot hand in the scene of the viewer, which follows the hand that is shown."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from ..core.model.hand import Hand
from ..core.model.kinematics import Pose
from ..core.tracker import HandState
from ..retargeting.retargeter import Retargeter
from ..retargeting.robot_file import LoadedRobot
from ..retargeting.robot_hand import RobotHand
from ..retargeting.robot_urdf import DEFAULT_SHAPE_RGB, rotation_from_rpy
from .scene import Extent, wxyz

if TYPE_CHECKING:
    from viser import SceneApi

EXTENT_MARGIN = .02         # [m] around what is framed
BONE_SHARE = .5             # [1] of the tip's radius, of the bones of a robot without shapes
LEAST_DRAWN_RADIUS = .004   # [m] of a tip
Z_TO_X = rotation_from_rpy(np.array((0., .5 * np.pi, 0.)))


class RobotScene:
    """One robot hand in the scene; nothing is sent to a robot.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Of its node, such as '/robot'.
    loaded : LoadedRobot
    hand : Hand
        The person's.

    Raises
    ------
    InvalidRobot
        If robot and person do not fit.
    """

    def __init__(self, scene: SceneApi, name: str, loaded: LoadedRobot, hand: Hand) -> None:
        self._retargeter = Retargeter(loaded.hand, hand, loaded.options)
        self._robot = loaded.hand
        self._then: float | None = None
        self._node = scene.add_frame(name, show_axes=False)
        self._base = scene.add_frame(f'{name}/base', show_axes=False)
        self._frames = [scene.add_frame(f'{name}/base/{i}', show_axes=False)
                        for i in range(len(loaded.hand.model.joint_names))]
        add_shapes(scene, f'{name}/base', loaded.hand)
        scene.add_label(f'{name}/caption', loaded.hand.name, position=(-.03, 0., 0.),
                        anchor='top-center', font_screen_scale=1.3)

    def remove(self) -> None:
        """Remove the robot from the scene."""
        self._node.remove()

    def draw(self, state: HandState, anchor: Pose, offset: float) -> None:
        """Draw the robot as it follows a frame of the hand.

        Parameters
        ----------
        state : HandState
        anchor : Pose
            Origin of the scene, in the frame of the state.
        offset : float
            Shift to the left [m].
        """
        now = time.monotonic()
        step = np.inf if self._then is None else now - self._then
        self._then = now
        position = self._retargeter.update_angles(state.angles, step)
        rotations, origins = self._robot.model.frames(position)
        self._node.wxyz = wxyz(anchor.rotation.T @ state.wrist_rotation)
        self._node.position = (0., offset, 0.)
        turned, at = self._robot.base_pose((rotations, origins))
        self._base.wxyz, self._base.position = wxyz(turned), at
        for frame, rotation, origin in zip(self._frames, rotations, origins):
            frame.wxyz, frame.position = wxyz(rotation), origin


def robot_extent(robot: RobotHand) -> Extent:
    """Return the space of a robot with its digits stretched, from its palm's origin.

    Parameters
    ----------
    robot : RobotHand
    """
    rotations, origins = robot.model.frames(robot.model.open_position())
    turned, at = robot.base_pose((rotations, origins))
    digits = robot.anatomy.digits.values()
    ends = [origins[digit.joints[-1]] + rotations[digit.joints[-1]] @ digit.tip
            for digit in digits]
    moved = [origins[joint] for digit in digits for joint in digit.joints]
    points = np.array([*moved, *ends]) @ turned.T + at
    return Extent(points[:, 0].min() - EXTENT_MARGIN, points[:, 0].max() + EXTENT_MARGIN,
                  np.abs(points[:, 1]).max() + EXTENT_MARGIN)


def add_shapes(scene: SceneApi, name: str, robot: RobotHand) -> None:
    """Add a robot's shapes to the frames of its joints; bones where its URDF has none but meshes.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
        Of the base's node; its children are those of the joints, by number.
    robot : RobotHand
    """
    shaped = set()
    for i, shape in enumerate(robot.model.shapes):
        place = robot.model.links[shape.link]
        if shape.kind != 'sphere':
            shaped.add(place.joint)
        node = f'{name}/{place.joint}' if place.joint >= 0 else name
        _add_shape(scene, f'{node}/shape{i}', shape.kind, shape.size, shape.colour,
                   place.rotation @ shape.rotation,
                   place.translation + place.rotation @ shape.translation)
    frames = robot.model.frames(robot.model.open_position())
    for role, digit in robot.anatomy.digits.items():
        tip_radius = max(robot.spheres[role].radius, LEAST_DRAWN_RADIUS)
        radius = BONE_SHARE * tip_radius
        for joint, following in zip(digit.joints, (*digit.joints[1:], None)):
            end = digit.tip if following is None else (
                frames[1][following] - frames[1][joint]) @ frames[0][joint]
            length = float(np.linalg.norm(end))
            if joint in shaped or length < radius:
                continue
            x, y, z = end / length
            turn = rotation_from_rpy(np.array((0., -np.arcsin(z), np.arctan2(y, x))))
            _add_shape(scene, f'{name}/{joint}/{role}', 'cylinder', (radius, length),
                       DEFAULT_SHAPE_RGB, turn @ Z_TO_X, .5 * end)
        if digit.joints[-1] not in shaped:
            _add_shape(scene, f'{name}/{digit.joints[-1]}/{role}_tip', 'sphere',
                       (tip_radius,), DEFAULT_SHAPE_RGB, np.eye(3),
                       robot.spheres[role].centre)


def _add_shape(scene: SceneApi, name: str, kind: str, size: tuple[float, ...],
               colour: tuple[float, ...], rotation: np.ndarray, at: np.ndarray) -> None:
    """Add a primitive shape of a URDF at a place in its parent's frame."""
    more = {'color': tuple(round(255. * share) for share in colour), 'wxyz': wxyz(rotation),
            'position': tuple(at)}
    if kind == 'box':
        scene.add_box(name, dimensions=size, **more)
    elif kind == 'sphere':
        scene.add_icosphere(name, radius=size[0], **more)
    else:
        scene.add_cylinder(name, radius=size[0], height=size[1], **more)
