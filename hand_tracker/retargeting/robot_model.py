"""Kinematics of a robot as arrays: movable joints, independent variables, fixed frames.

Fixed joints are folded into the transforms of the movable ones; mimic joints share the variable of
the joint that they follow.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit
from .robot_urdf import InvalidRobot, UrdfJoint, UrdfShape, UrdfTree

STROKE_ANGLE = .5 * math.pi    # [rad] for which the stroke of a sliding joint counts; ours


class Joints(NamedTuple):
    """Movable joints, parents first.

    Attributes
    ----------
    parent : ndarray of int, shape (m,)
        Joint that moves the parent link; -1 for the base.
    rotation, translation : ndarray, shape (m, 3, 3) and (m, 3)
        Of the joint's frame at zero in its parent joint's moving frame [m].
    axis : ndarray, shape (m, 3)
        Unit vector in the joint's frame.
    is_prismatic : ndarray of uint8, shape (m,)
    variable : ndarray of int, shape (m,)
        Independent variable that moves the joint.
    multiplier, offset : ndarray, shape (m,)
        Position of the joint = multiplier * variable + offset.
    """

    parent: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    axis: np.ndarray
    is_prismatic: np.ndarray
    variable: np.ndarray
    multiplier: np.ndarray
    offset: np.ndarray


class LinkFrame(NamedTuple):
    """Place of a link: rigid on what a joint moves.

    Attributes
    ----------
    joint : int
        Index in `Joints`; -1 for the base.
    rotation, translation : ndarray, shape (3, 3) and (3,)
        Of the link's frame in the joint's moving frame [m].
    """

    joint: int
    rotation: np.ndarray
    translation: np.ndarray


class RobotModel(NamedTuple):
    """Kinematic model of a robot.

    Attributes
    ----------
    joints : Joints
    joint_names : tuple of str
        Of all movable joints, mimic joints too, in the order of `joints`.
    variables : tuple of str
        Names of the n independent joints, in the order of the URDF's document.
    lower, upper : ndarray, shape (n,)
        Limits of the variables within which mimic joints keep theirs [rad or m].
    velocity : ndarray, shape (n,)
        Limits of the URDF, also of mimic joints that are commanded [rad/s or m/s]; 0 where it has
        none.
    links : dict of str to LinkFrame
    shapes : tuple of UrdfShape
        To draw; none where the URDF has meshes alone.
    notes : tuple of str
        What a person should know: mimic joints that move against their own limits.
    """

    joints: Joints
    joint_names: tuple[str, ...]
    variables: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    links: dict[str, LinkFrame]
    shapes: tuple[UrdfShape, ...]
    notes: tuple[str, ...] = ()

    @property
    def per_radian(self) -> np.ndarray:
        """What counts as a radian of each variable, shape (n,): 1, or a length where it slides [m].

        So that one number limits turning and sliding joints; a whole stroke is `STROKE_ANGLE`.
        """
        found = np.ones(len(self.variables))
        for name, is_prismatic in zip(self.joint_names, self.joints.is_prismatic):
            if is_prismatic and name in self.variables:
                i = self.variables.index(name)
                stroke = self.upper[i] - self.lower[i]
                if 0. < stroke < math.inf:
                    found[i] = stroke / STROKE_ANGLE
        return found

    def open_position(self) -> np.ndarray:
        """Return the positions of the variables nearest zero within their limits, shape (n,)."""
        return np.clip(np.zeros(len(self.variables)), self.lower, self.upper)

    def frames(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (m, 3, 3) and origin (m, 3) of all joints' moving frames [m].

        Parameters
        ----------
        position : ndarray, shape (n,)
            Of the variables [rad or m].
        """
        count = len(self.joint_names)
        rotations, origins = np.empty((count, 3, 3)), np.empty((count, 3))
        place_joints(self.joints, count, np.ascontiguousarray(position, dtype=float), rotations,
                     origins)
        return rotations, origins

    def link_pose(self, link: str, frames: tuple[np.ndarray, np.ndarray]
                  ) -> tuple[np.ndarray, np.ndarray]:
        """Return rotation (3, 3) and position (3,) of a link's frame in the base [m].

        Parameters
        ----------
        link : str
        frames : tuple of ndarray
            From `frames`.
        """
        place = self.links[link]
        if place.joint < 0:
            return place.rotation, place.translation
        rotation, origin = frames[0][place.joint], frames[1][place.joint]
        return rotation @ place.rotation, origin + rotation @ place.translation

    def joint_positions(self, position: np.ndarray) -> np.ndarray:
        """Return the positions of all movable joints from those of the variables, shape (m,)."""
        return self.joints.multiplier * position[self.joints.variable] + self.joints.offset

    def variable_positions(self, joints: np.ndarray) -> np.ndarray:
        """Return the positions of the variables (n,) in those of all joints (m,)."""
        return joints[[self.joint_names.index(name) for name in self.variables]]


def robot_model(tree: UrdfTree, commanded: Collection[str] = ()) -> RobotModel:
    """Return the kinematic model of a URDF.

    Parameters
    ----------
    tree : UrdfTree
    commanded : collection of str, optional
        Mimic joints among these keep their limits and speeds, whatever is left to their variable.

    Raises
    ------
    InvalidRobot
        If the limits of a mimic joint that is commanded leave its variable nothing.
    """
    links = {tree.root: LinkFrame(-1, np.eye(3), np.zeros(3))}
    movable = [joint for joint in tree.joints if joint.is_movable]
    by_name = {joint.name: joint for joint in movable}
    # In the document's order, as drivers that take positions by index mostly have it.
    variables = tuple(name for name in tree.listed
                      if name in by_name and by_name[name].mimic is None)
    columns: list[tuple] = []
    for joint in tree.joints:
        base = links[joint.parent]
        rotation = base.rotation @ joint.rotation
        translation = base.translation + base.rotation @ joint.translation
        if not joint.is_movable:
            links[joint.child] = LinkFrame(base.joint, rotation, translation)
            continue
        links[joint.child] = LinkFrame(len(columns), np.eye(3), np.zeros(3))
        name, multiplier, offset = joint.name, 1., 0.
        while (mimic := by_name[name].mimic) is not None:
            name, offset = mimic.joint, offset + multiplier * mimic.offset
            multiplier *= mimic.multiplier
        columns.append((base.joint, rotation, translation, joint.axis, joint.kind == 'prismatic',
                        variables.index(name), multiplier, offset))
    kinds = (np.int64, float, float, float, np.uint8, np.int64, float, float)
    shapes = ((), (3, 3), (3,), (3,), (), (), (), ())
    joints = Joints(*(
        np.array([column[i] for column in columns], dtype=kind).reshape((len(columns), *shape))
        for i, (kind, shape) in enumerate(zip(kinds, shapes))))
    bounds = np.array([(by_name[name].lower, by_name[name].upper)
                       for name in variables]).reshape(-1, 2)
    velocity = np.array([by_name[name].velocity for name in variables])
    notes: list[str] = []
    for joint, variable, multiplier, offset in zip(
            movable, joints.variable, joints.multiplier, joints.offset):
        if joint.mimic is None:
            continue
        lower, upper = bounds[variable]
        if joint.name in commanded:
            bounds[variable] = _kept_by(joint, variables[variable], lower, upper, multiplier,
                                        offset)
            if joint.velocity and multiplier:
                most = joint.velocity / abs(multiplier)
                velocity[variable] = min(velocity[variable] or most, most)
        elif multiplier and joint.upper > joint.lower:
            narrowed = _narrowed(joint, lower, upper, multiplier, offset)
            # A mimic joint whose limits contradict its line, as with the sign of its multiplier
            # left out, does not forbid all movement.
            if narrowed[1] - narrowed[0] > .5 * (upper - lower):
                bounds[variable] = narrowed
            elif upper > lower:
                notes.append(_against_limits(joint, variables[variable], lower, upper, multiplier,
                                             offset) + ', which are not kept')
    return RobotModel(
        joints, tuple(joint.name for joint in movable), variables, bounds[:, 0].copy(),
        bounds[:, 1].copy(), velocity, links, tree.shapes, tuple(notes))


def _narrowed(joint: UrdfJoint, lower: float, upper: float, multiplier: float,
              offset: float) -> tuple[float, float]:
    """Return a variable's limits, narrowed so that a mimic joint of it stays within its own."""
    ends = sorted((limit - offset) / multiplier for limit in (joint.lower, joint.upper))
    return max(lower, ends[0]), min(upper, ends[1])


def _kept_by(joint: UrdfJoint, variable: str, lower: float, upper: float, multiplier: float,
             offset: float) -> tuple[float, float]:
    """Return a variable's limits narrowed by a commanded mimic joint; raise if none are left.

    A joint that is continuous or without limits does not narrow them.
    """
    if joint.kind == 'continuous' or not joint.upper > joint.lower:
        return lower, upper
    kept = lower, upper
    if multiplier:
        kept = _narrowed(joint, lower, upper, multiplier, offset)
    elif not joint.lower <= offset <= joint.upper:
        kept = upper, lower
    if kept[0] > kept[1] or kept[0] == kept[1] and lower < upper:
        against = _against_limits(joint, variable, lower, upper, multiplier, offset)
        raise InvalidRobot(f'order: {against}: leave it out, or correct the URDF')
    return kept


def _against_limits(joint: UrdfJoint, variable: str, lower: float, upper: float,
                    multiplier: float, offset: float) -> str:
    """Return in words from where to where a mimic joint follows, and its own limits."""
    ends = sorted((multiplier * lower + offset, multiplier * upper + offset))
    return (f"'{joint.name}' follows '{variable}' from {ends[0]:g} to {ends[1]:g}, against its "
            f'limits {joint.lower:g} to {joint.upper:g}')


@jit
def place_joints(joints: Joints, count: int, position: np.ndarray, rotations: np.ndarray,
                 origins: np.ndarray) -> None:
    """Write the moving frames of all joints: forward kinematics of the tree.

    Parameters
    ----------
    joints : Joints
    count : int
        How many of them to place.
    position : ndarray, shape (n,)
        Of the variables [rad or m].
    rotations, origins : ndarray, shape (m, 3, 3) and (m, 3)
        In the base's frame, replaced [m].
    """
    for joint in range(count):
        up = joints.parent[joint]
        value = joints.multiplier[joint] * position[joints.variable[joint]] + joints.offset[joint]
        x, y, z = joints.axis[joint, 0], joints.axis[joint, 1], joints.axis[joint, 2]
        s, c, slide = 0., 1., value
        if joints.is_prismatic[joint] == 0:
            s, c, slide = math.sin(value), math.cos(value), 0.
        v = 1. - c
        t0 = (c + v * x * x, v * x * y - s * z, v * x * z + s * y)
        t1 = (v * x * y + s * z, c + v * y * y, v * y * z - s * x)
        t2 = (v * x * z - s * y, v * y * z + s * x, c + v * z * z)
        # Origin of the joint in its parent's frame, moved along the axis if prismatic.
        r = joints.rotation[joint]
        at0 = joints.translation[joint, 0] + slide * (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z)
        at1 = joints.translation[joint, 1] + slide * (r[1, 0] * x + r[1, 1] * y + r[1, 2] * z)
        at2 = joints.translation[joint, 2] + slide * (r[2, 0] * x + r[2, 1] * y + r[2, 2] * z)
        for i in range(3):
            a, b, d, base = 0., 0., 0., 0.
            if up < 0:
                a = 1. if i == 0 else 0.
                b = 1. if i == 1 else 0.
                d = 1. if i == 2 else 0.
            else:
                a, b, d = rotations[up, i, 0], rotations[up, i, 1], rotations[up, i, 2]
                base = origins[up, i]
            origins[joint, i] = base + a * at0 + b * at1 + d * at2
            e = a * r[0, 0] + b * r[1, 0] + d * r[2, 0]
            f = a * r[0, 1] + b * r[1, 1] + d * r[2, 1]
            g = a * r[0, 2] + b * r[1, 2] + d * r[2, 2]
            rotations[joint, i, 0] = e * t0[0] + f * t1[0] + g * t2[0]
            rotations[joint, i, 1] = e * t0[1] + f * t1[1] + g * t2[1]
            rotations[joint, i, 2] = e * t0[2] + f * t1[2] + g * t2[2]
