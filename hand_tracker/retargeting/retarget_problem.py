"""The retargeting problem of a robot and a person, as arrays for kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calibration.landmarks import LANDMARKS
from ..core.model.hand import DIGITS, FINGERS, LEFT_HAND_MIRROR, Hand
from .box_qp import new_box_qp
from .retarget_kernel import (
    LEAST_STEP_DAMPING,
    MAX_BONES,
    MAX_CHAIN,
    MAX_JOINTS,
    MAX_PAIRS,
    MAX_TIPS,
    MAX_VARIABLES,
    Problem,
    Solution,
)
from .retarget_options import RetargetOptions
from .robot_anatomy import gripper_positions
from .robot_hand import RobotHand
from .robot_model import Joints
from .robot_urdf import InvalidRobot


def digit_landmarks(role: str) -> np.ndarray:
    """Return the rows in `LANDMARKS` of a digit from its root to its tip, shape (4,)."""
    return np.array([row for row, name in enumerate(LANDMARKS) if name.startswith(role)])


def _used_joints(robot: RobotHand) -> list[int]:
    """Return the joints that move a digit against the palm, parents first."""
    return sorted({joint for digit in robot.anatomy.digits.values() for joint in digit.joints})


def make_problem(robot: RobotHand, hand: Hand, options: RetargetOptions) -> Problem:
    """Return the arrays of the kernel for a robot, a person and options.

    Parameters
    ----------
    robot : RobotHand
    hand : Hand
        Of the person; its lengths scale the targets, and never change from frame to frame.
    options : RetargetOptions

    Raises
    ------
    InvalidRobot
        If the robot's side is not the person's, or it has more joints than the kernel's arrays.
    """
    if hand.side != robot.side and not robot.anatomy.is_gripper:
        raise InvalidRobot(f"side: the robot's hand is a {robot.side} one, the person's a "
                           f"{hand.side} one; expected a {hand.side} robot, or the person's "
                           f'{robot.side} hand (--side {robot.side}, side:={robot.side})')
    joints, variables = _used_joints(robot), robot.digit_variables
    roles = list(robot.anatomy.digits)
    bones = [(role, bone, rows) for role in roles for bone, rows in _matched_bones(robot, role)]
    for name, count, most in (('joints', len(joints), MAX_JOINTS),
                              ('independent joints', len(variables), MAX_VARIABLES),
                              ('bones', len(bones), MAX_BONES)):
        if count > most:
            raise InvalidRobot(f'{count} {name} of digits; at most {most} are supported')
    for role, digit in robot.anatomy.digits.items():
        if len(digit.joints) >= MAX_CHAIN:
            raise InvalidRobot(f'{role}: {len(digit.joints)} movable joints; at most '
                               f'{MAX_CHAIN - 1} are supported')
    columns: dict[str, Any] = {}
    columns.update(_variable_columns(robot, variables, options))
    columns.update(_tip_columns(robot, hand, joints, options))
    columns.update(_bone_columns(robot, joints, roles, bones, options))
    pairs = [(j, i, 1) if roles[i] == 'thumb' else (i, j, int(roles[j] == 'thumb'))
             for i in range(len(roles)) for j in range(i)]
    opening = _gripper_opening(robot) if robot.anatomy.is_gripper else 0.
    return Problem(
        counts=np.array((len(joints), len(variables), len(roles), len(pairs), len(bones))),
        joints=_joints_in_palm(robot, joints, variables),
        pair=_padded(pairs, (MAX_PAIRS, 3), np.int64),
        touch=options.touch, escape=options.escape, touch_weight=options.touch_weight,
        free_weight=options.touch_weight if robot.anatomy.is_gripper else 0.,
        opening=opening, clearance=options.clearance,
        clearance_weight=options.clearance_weight, smoothness=options.smoothness,
        rest_weight=options.rest_weight, iterations=options.iterations,
        tolerance=options.tolerance, **columns)


def new_solution(position: np.ndarray) -> Solution:
    """Return the state of the solver at a position of the used variables [rad or m]."""
    row = (MAX_VARIABLES,)
    return Solution(
        _padded(position, row, float), np.zeros(row), np.zeros(row), np.zeros((MAX_TIPS, 3)),
        np.zeros((MAX_JOINTS, 3, 3)), np.zeros((MAX_JOINTS, 3)), np.zeros((MAX_JOINTS, 3)),
        np.zeros((MAX_TIPS, 3)), np.zeros((MAX_PAIRS, 2)), np.zeros((MAX_BONES, 3)),
        np.zeros((MAX_TIPS, 3, MAX_CHAIN)), np.zeros((MAX_VARIABLES, MAX_VARIABLES)),
        np.zeros(row), np.full(1, LEAST_STEP_DAMPING), new_box_qp(MAX_VARIABLES))


def _padded(rows: Any, shape: tuple[int, ...], kind: Any, fill: float = 0) -> np.ndarray:
    """Return rows in an array of a fixed shape."""
    array = np.full(shape, fill, dtype=kind)
    if len(rows):
        given = np.asarray(rows, dtype=kind)
        array[tuple(slice(size) for size in given.shape)] = given
    return array


def _joints_in_palm(robot: RobotHand, joints: list[int], variables: list[int]) -> Joints:
    """Return the digits' joints with those at the palm given in its frame."""
    model, axes = robot.model.joints, robot.anatomy.axes
    rotation, translation = model.rotation[joints].copy(), model.translation[joints].copy()
    parent = []
    for row, joint in enumerate(joints):
        up = int(model.parent[joint])
        parent.append(joints.index(up) if up in joints else -1)
        if parent[-1] < 0:
            rotation[row], translation[row] = axes.T @ rotation[row], axes.T @ translation[row]
    order = {variable: i for i, variable in enumerate(variables)}
    return Joints(
        _padded(parent, (MAX_JOINTS,), np.int64, -1),
        _padded(rotation, (MAX_JOINTS, 3, 3), float),
        _padded(translation, (MAX_JOINTS, 3), float),
        _padded(model.axis[joints], (MAX_JOINTS, 3), float),
        _padded(model.is_prismatic[joints], (MAX_JOINTS,), np.uint8),
        _padded([order[int(v)] for v in model.variable[joints]], (MAX_JOINTS,), np.int64),
        _padded(model.multiplier[joints], (MAX_JOINTS,), float),
        _padded(model.offset[joints], (MAX_JOINTS,), float))


def _variable_columns(robot: RobotHand, variables: list[int],
                      options: RetargetOptions) -> dict[str, np.ndarray]:
    row = (MAX_VARIABLES,)
    lower, upper = robot.model.lower[variables], robot.model.upper[variables]
    margin = np.minimum(options.limit_margin * robot.model.per_radian[variables],
                        .25 * (upper - lower))
    follow, maps = [-1] * len(variables), np.zeros((3, len(variables)))
    for one in robot.follow:
        i = variables.index(one.variable)
        follow[i], maps[:, i] = one.angle, (one.scale, one.offset, options.follow_weight)
    return {
        'lower': _padded(lower + margin, row, float), 'upper': _padded(upper - margin, row, float),
        'speed': np.full(row, options.max_speed),
        'rest': _padded(robot.rest[variables], row, float),
        'follow': _padded(follow, row, np.int64, -1), 'follow_scale': _padded(maps[0], row, float),
        'follow_offset': _padded(maps[1], row, float),
        'follow_weight': _padded(maps[2], row, float)}


def _tip_columns(robot: RobotHand, hand: Hand, joints: list[int],
                 options: RetargetOptions) -> dict[str, np.ndarray]:
    """Return the tips: a finger's from its own base, the thumb's from the first finger's.

    So a straight finger is straight, and thumb and first finger meet where the person's do.
    """
    mirror = LEFT_HAND_MIRROR if hand.side == 'left' else np.ones(3)
    digits = robot.anatomy.digits
    first = next(role for role in FINGERS if role in digits)
    chain, anchor, human, scales, weights = [], [], [], [], []
    for role, digit in digits.items():
        chain.append([joints.index(joint) for joint in reversed(digit.joints)])
        base = first if role == 'thumb' else role
        row = FINGERS.index(base)
        anchor.append(_base_in_palm(robot, base))
        human.append(hand.finger_mcp[row] * mirror)
        reach = digits[base].length - robot.spheres[base].radius
        scales.append(max(reach, 1e-3) / float(hand.finger_bones[row].sum()))
        weights.append(0. if robot.anatomy.is_gripper else
                       options.thumb_weight if role == 'thumb' else options.finger_weight)
    chains = np.full((MAX_TIPS, MAX_CHAIN), -1)
    for i, row_of in enumerate(chain):
        chains[i, :len(row_of)] = row_of
    vectors, row_shape = (MAX_TIPS, 3), (MAX_TIPS,)
    return {
        'chain': chains,
        'tip_offset': _padded([robot.spheres[role].centre for role in digits], vectors, float),
        'tip_anchor': _padded(anchor, vectors, float),
        'human_anchor': _padded(human, vectors, float),
        'tip_scale': _padded(scales, row_shape, float),
        'tip_radius': _padded([robot.spheres[role].radius for role in digits], row_shape, float),
        'tip_weight': _padded(weights, row_shape, float),
        'tip_landmark': _padded([digit_landmarks(role)[-1] for role in digits], row_shape,
                                np.int64),
        'human_radius': _padded([hand.radii[DIGITS.index(role), 2] for role in digits], row_shape,
                                float)}


def _base_in_palm(robot: RobotHand, role: str) -> np.ndarray:
    """Return the base of a digit, hand open, in the palm's frame, shape (3,) [m]."""
    rotations, origins = robot.model.frames(robot.model.open_position())
    palm = robot.anatomy.palm_joint
    at = origins[robot.anatomy.digits[role].base]
    if palm >= 0:
        at = rotations[palm].T @ (at - origins[palm])
    return robot.anatomy.axes.T @ at


def _matched_bones(robot: RobotHand, role: str) -> list[tuple[Any, tuple[int, int]]]:
    """Return a digit's bones with the person's landmarks that they point from and to."""
    if robot.anatomy.is_gripper:
        return []
    rows = digit_landmarks(role)
    bones = robot.anatomy.digits[role].bones[-3:]
    ends = {0: (), 1: ((0, 3),), 2: ((0, 1), (1, 3)), 3: ((0, 1), (1, 2), (2, 3))}[len(bones)]
    return [(bone, (int(rows[a]), int(rows[b]))) for bone, (a, b) in zip(bones, ends)]


def _bone_columns(robot: RobotHand, joints: list[int], roles: list[str], bones: list[Any],
                  options: RetargetOptions) -> dict[str, np.ndarray]:
    table, weights = [], []
    for role, bone, (start, end) in bones:
        table.append((joints.index(bone.joint), start, end, roles.index(role)))
        share = options.thumb_bone_weight if role == DIGITS[-1] else options.bone_weight
        weights.append(share * robot.anatomy.digits[role].length)
    return {'bone': _padded(table, (MAX_BONES, 4), np.int64),
            'bone_direction': _padded([bone.direction for _, bone, _ in bones], (MAX_BONES, 3),
                                      float),
            'bone_weight': _padded(weights, (MAX_BONES,), float)}


def _gripper_opening(robot: RobotHand) -> float:
    """Return the greatest distance of a gripper's tips [m]."""
    tips = [robot.tip_positions(position) for position in gripper_positions(robot.model)]
    return max(float(np.linalg.norm(first - second)) for first, second in tips)
