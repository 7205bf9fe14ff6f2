"""Report on a robot's geometry, as text and as a commented robot file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict

from ..core.model.hand import JOINTS
from .hand_frame import DEX_AXES, MOST_TURNED_DEG, axes_in_words, turn_deg
from .retarget_options import RetargetOptions
from .robot_file import LoadedRobot
from .robot_hand import RobotHand

DECIMALS_MM = 2


def findings(loaded: LoadedRobot) -> list[str]:
    """Return the findings on a robot's geometry, a line each.

    Parameters
    ----------
    loaded : LoadedRobot
    """
    robot = loaded.hand
    model, anatomy = robot.model, robot.anatomy
    kind = 'gripper' if anatomy.is_gripper else f'{anatomy.side} hand'
    lines = [f'{robot.name}: {kind} of {len(anatomy.digits)} digits, '
             f'{len(model.variables)} independent of {len(model.joint_names)} movable joints',
             f"palm: '{anatomy.palm_link}', {_palm_frame(robot)}"]
    for role, digit in anatomy.digits.items():
        names = ', '.join(model.joint_names[joint] for joint in digit.joints)
        lines.append(f"{role}: tip '{digit.tip_link}', {1e3 * digit.length:.0f} mm from its base, "
                     f'sphere of {1e3 * robot.spheres[role].radius:.1f} mm; joints {names}')
    arm = robot.arm_joints
    if arm:
        lines.append(f'joints that move the palm, and are not commanded: {", ".join(arm)}')
    idle = [name for i, name in enumerate(model.variables)
            if i not in robot.digit_variables and name not in arm]
    if idle:
        lines.append(f'joints that move no digit, and stay: {", ".join(idle)}')
    return lines


def _palm_frame(robot: RobotHand) -> str:
    """Return the turn of the palm's frame, in words, and whether dex-retargeting would go wrong."""
    axes = robot.anatomy.axes
    words = f'its axes are {axes_in_words(axes, robot.side)}'
    away = turn_deg(axes @ DEX_AXES)
    if robot.anatomy.is_gripper or away <= MOST_TURNED_DEG:
        return words
    return (f'{words}: turned by {away:.0f} degrees against the frame that dex-retargeting '
            'expects (x palmar, z distal); here that is accounted for')


def robot_file_text(loaded: LoadedRobot, urdf: str) -> str:
    """Return a robot file with comments; `load_robot` returns the same robot from it.

    Parameters
    ----------
    loaded : LoadedRobot
    urdf : str
        Path of its URDF.
    """
    robot = loaded.hand
    lines = ['# Robot hand for retargeting, made by hand_tracker robot inspect.']
    lines += [f'# {line}' for line in findings(loaded)]
    lines += [f'# UNSURE: {line}' for line in loaded.notes]
    lines += [f'name: {_text(robot.name)}', f'urdf: {_text(urdf)}',
              f'side: {robot.side}', '',
              '# Link at the tip of each digit; centre [mm, in the frame of that link] and radius',
              "# [mm] of the sphere with which it touches: measure your robot's. Another radius",
              '# moves the centre, too: by as much, along the digit.']
    if loaded.guesses:
        lines += ['# What is behind the braces is guessed anew as this file is loaded, and told as',
                  '# unsure. A measured radius_mm within them ends that; the centre goes with it.']
    lines.append('digits:')
    frames = robot.model.frames(robot.model.open_position())
    for role, digit in robot.anatomy.digits.items():
        centre, radius = robot.spheres[role]
        last = digit.joints[-1]
        rotation, place = robot.model.link_pose(digit.tip_link, frames)
        world = frames[1][last] + frames[0][last] @ centre
        offset = [round(1e3 * float(v), DECIMALS_MM) + 0. for v in rotation.T @ (world - place)]
        values = {'tip': _text(digit.tip_link), 'tip_offset_mm': offset,
                  'radius_mm': round(1e3 * radius, DECIMALS_MM)}
        guessed = loaded.guesses.get(role, ())
        given, behind = (', '.join(f'{key}: {value}' for key, value in values.items()
                                   if (key in guessed) == is_guess) for is_guess in (False, True))
        lines.append(f'  {role}: {{{given}}}' + (f'  # guessed: {behind}' if behind else ''))
    lines += ['', '# Positions at rest [rad or m].', 'rest:']
    lines += [f'  {_text(name)}: {round(float(value), 6) + 0.}'
              for name, value in zip(robot.model.variables, robot.rest)]
    order = [name for name in loaded.order if name not in robot.arm_joints]
    lines += ['', '# Joints that are commanded, in the order of commands without names.',
              '# Those of an arm are left to its controller.',
              f'order: [{", ".join(map(_text, order))}]', '',
              '# Joints may follow human joints one to one, in place of the tips:',
              '# follow: {JOINT: {angle: index_mcp_flexion, scale: 1, offset_deg: 0}}',
              *_section('follow', {robot.model.variables[one.variable]: (
                  f'{{angle: {JOINTS[one.angle]}, scale: {one.scale}, '
                  f'offset_deg: {round(math.degrees(one.offset), 6)}}}') for one in robot.follow}),
              '# Weights and distances: hand_tracker/retargeting/retarget_options.py.',
              '# options: {touch: 0.005, escape: 0.03}',
              *_section('options', {name: str(value) for name, value in asdict(
                  loaded.options).items() if value != getattr(RetargetOptions(), name)})]
    return '\n'.join(lines) + '\n'


def _section(key: str, values: Mapping[str, str]) -> list[str]:
    """Return the lines of a mapping of YAML, none for none."""
    if not values:
        return []
    return [f'{key}:', *(f'  {_text(name)}: {value}' for name, value in values.items())]


def _text(value: str) -> str:
    """Return a text quoted for YAML."""
    return "'" + value.replace("'", "''") + "'"
