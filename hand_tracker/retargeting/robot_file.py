"""Robot files: which URDF, which links are tips, and how to retarget, in YAML.

The presets in `config/robots` are such files, all but `plain` without a URDF's path, which a
parameter gives. All keys are optional; what is not given is found by geometry. Tip links may hold
``{side}``, right or left, and ``{S}``, R or L; the URDF's path may hold ``{side}``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from ..core.model.hand import JOINTS, SIDES
from ..files.hand_file import HAND_FILE_KEYS
from ..files.plain_yaml import parse_plain_yaml, read_yaml_text, yaml_fault
from ..package_data import share_directory
from .dexretargeting_file import DEX_SECTION, find_urdf, translated
from .retarget_options import InvalidRetargetOption, RetargetOptions
from .robot_anatomy import ROLES, find_anatomy
from .robot_hand import Follow, RobotHand, guess_notes, tip_spheres
from .robot_model import RobotModel, robot_model
from .robot_paths import resolve_path
from .robot_urdf import InvalidRobot, UrdfTree, load_urdf_tree, read_urdf_tree

ROBOT_FILE_KEYS = ('name', 'urdf', 'side', 'digits', 'rest', 'follow', 'options', 'order')
DIGIT_KEYS = ('tip', 'tip_offset_mm', 'radius_mm')
LEAST_RADIUS_MM = .5     # of a tip: a smaller one is in metres
MOST_TIP_MM = 300.       # radius or offset of a tip
LONGEST_DIGIT = 1.       # [m] of a robot: a longer one is in millimetres
MOST_TURNS = 2.          # of a revolute joint in a digit: a wider limit is in degrees
REST_TOLERANCE = 1e-3    # [rad or m] beyond a limit that counts as at it
FOLLOW_KEYS = ('angle', 'scale', 'offset_deg')


class LoadedRobot(NamedTuple):
    """A robot hand with the settings of its file.

    Attributes
    ----------
    hand : RobotHand
    options : RetargetOptions
    order : tuple of str
        Names of the joints in the order of commands; where none is given, the independent ones as
        the URDF lists them.
    notes : tuple of str
        What a person should know: what the geometry left open, what of a file is not used.
    guesses : mapping of str to tuple of str
        Keys in `DIGIT_KEYS` whose values are guessed, by role.
    urdf : str
        Path of its URDF; empty where that was given as XML.
    """

    hand: RobotHand
    options: RetargetOptions
    order: tuple[str, ...]
    notes: tuple[str, ...]
    guesses: Mapping[str, tuple[str, ...]]
    urdf: str = ''


def preset_names() -> list[str]:
    """Return the names of the packaged robot files."""
    return sorted(path.stem for path in (share_directory() / 'config' / 'robots').glob('*.yaml'))


def load_robot(robot: str, urdf: str = '', side: str | None = None,
               preferred_side: str = SIDES[0], order: Sequence[str] = ()) -> LoadedRobot:
    """Return a robot of a preset, a robot file, a dex-retargeting file or a URDF.

    Parameters
    ----------
    robot : str
        Name of a preset, or path of a file.
    urdf : str
        Path, package:// path, or XML of the URDF; that of the file when empty.
    side : {'right', 'left'}, optional
        Of the robot; as in the file, or as the geometry says.
    preferred_side : {'right', 'left'}
        Of the URDF that is taken where a robot file has one for each side.
    order : sequence of str, optional
        Joints of a command, in place of the file's.

    Raises
    ------
    InvalidRobot
        Naming the file, the key, its value and what is expected.
    """
    if robot.lower().endswith(('.urdf', '.xml')):
        file = resolve_path(robot, Path())
        tree, place = load_urdf_tree(file), str(file.resolve())
        loaded = _assemble({}, tree, side, robot, order)
        return loaded._replace(notes=(*_own_preset(tree.name, place), *loaded.notes), urdf=place)
    path = share_directory() / 'config' / 'robots' / f'{robot}.yaml'
    if not path.is_file():
        path = resolve_path(robot, Path())
        if not path.is_file():
            raise InvalidRobot(f"robot: '{robot}' is no file and no preset; presets are "
                               f'{", ".join(preset_names())}')
    settings = _read_settings(path)
    if not set(settings) <= set(ROBOT_FILE_KEYS) and set(settings) <= set(HAND_FILE_KEYS):
        raise InvalidRobot(f"{path}: this is a person's hand file (--hand); expected a robot's "
                           f'URDF, or a robot file with keys as {", ".join(ROBOT_FILE_KEYS)}')
    notes: tuple[str, ...] = ()
    if DEX_SECTION in settings:
        settings, notes = translated(settings, str(path))
        if not urdf:
            settings['urdf'] = find_urdf(settings['urdf'], path)
    _require_keys('', settings, ROBOT_FILE_KEYS, str(path))
    given = urdf or str(settings.get('urdf', '')).replace('{side}', side or preferred_side)
    if not given:
        raise InvalidRobot(f"{path}: no urdf: give the path of the robot's URDF "
                           '(--robot-description of a command, robot_description of node and '
                           'launch)')
    if given.lstrip().startswith('<'):
        tree, place = read_urdf_tree(given, 'robot_description'), ''
    else:
        file = resolve_path(given, Path() if urdf else path.parent)
        tree, place = load_urdf_tree(file), str(file.resolve())
    loaded = _assemble(settings, tree, side, str(path), order)
    return loaded._replace(notes=(*notes, *_other_preset(robot, tree.name), *loaded.notes),
                           urdf=place)


def _other_preset(robot: str, named: str) -> tuple[str, ...]:
    """Return a note where a URDF names itself as the robot of another preset than the chosen."""
    alike = _presets_named(named)
    if robot not in preset_names() or robot in alike or not alike:
        return ()
    return (f"the URDF calls its robot '{named}': is the preset {' or '.join(alike)} meant in "
            f'place of {robot}?',)


def _own_preset(named: str, urdf: str) -> tuple[str, ...]:
    """Return a note where a URDF names itself as the robot of a preset, which takes it."""
    for preset in _presets_named(named):
        with suppress(InvalidRobot):
            load_robot(preset, urdf)
            return (f"the URDF calls its robot '{named}': the preset {preset} may know more of it, "
                    "as its tips or its driver's order; give that as the robot, and this URDF as "
                    'its robot_description',)
    return ()


def _presets_named(robot: str) -> list[str]:
    """Return the presets whose names a URDF's name of its robot has in it."""
    words = re.split(r'[\W_]+', robot.lower())
    return [preset for preset in preset_names()
            if any(word.startswith(part) for word in words for part in preset.split('_'))]


def _read_settings(path: Path) -> dict[str, Any]:
    """Return the mapping of a YAML file.

    Raises
    ------
    InvalidRobot
        If there is none.
    """
    try:
        tree = parse_plain_yaml(read_yaml_text(path))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InvalidRobot(yaml_fault(path, error)) from None
    if not isinstance(tree, dict):
        raise InvalidRobot(f'{path}: expected a mapping with keys as {", ".join(ROBOT_FILE_KEYS)}')
    return tree


def _assemble(settings: Mapping[str, Any], tree: UrdfTree, side: str | None,
              source: str, order: Sequence[str] = ()) -> LoadedRobot:
    """Return a robot from its settings and its URDF."""
    side = side or settings.get('side')
    if side not in (None, *SIDES):
        raise InvalidRobot(f"{source}: side: '{side}'; expected {' or '.join(SIDES)}")
    digits = _mapping(settings, 'digits', source)
    _require_keys('digits', digits, ROLES, source)
    for role, digit in digits.items():
        if not isinstance(digit, dict):
            raise InvalidRobot(f'{source}: digits.{role}: expected keys as '
                               f'{", ".join(DIGIT_KEYS)}')
        _require_keys(f'digits.{role}', digit, DIGIT_KEYS, source)
    order = order or settings.get('order') or ()
    if not isinstance(order, (list, tuple)):
        raise InvalidRobot(f'{source}: order: {order!r}; expected a list')
    try:
        model = robot_model(tree, order)
        anatomy = find_anatomy(model, _tips(digits, model, side), side)
    except InvalidRobot as error:
        raise InvalidRobot(f'{source}: {error}') from None
    radii, centres = {}, {}
    for role in anatomy.digits:
        given = digits.get(role, {})
        if given.get('radius_mm') is not None:
            radius_mm = _number(given['radius_mm'], f'{source}: digits.{role}.radius_mm')
            if radius_mm != 0. and radius_mm < LEAST_RADIUS_MM:
                raise InvalidRobot(f'{source}: digits.{role}.radius_mm: {radius_mm:g}; expected '
                                   f'none below {LEAST_RADIUS_MM:g} mm, but 0 for a point')
            if radius_mm > MOST_TIP_MM:
                raise InvalidRobot(f'{source}: digits.{role}.radius_mm: {radius_mm:g}; expected '
                                   f'{MOST_TIP_MM:g} mm at most')
            radii[role] = radius_mm / 1e3
        if 'tip_offset_mm' in given:
            centre = _offset(given['tip_offset_mm'], f'{source}: digits.{role}.tip_offset_mm')
            place = model.links[anatomy.digits[role].tip_link]
            centres[role] = place.translation + place.rotation @ centre
    spheres, guessed = tip_spheres(model, anatomy, tree.spheres, radii, centres)
    hand = RobotHand(str(settings.get('name') or tree.name), model, anatomy, spheres,
                     _rest(settings, model, tree, source), _follow(settings, model, source))
    _refuse_units(hand, tree, source)
    for one in hand.follow:
        if one.variable not in hand.digit_variables:
            able = ', '.join(model.variables[i] for i in hand.digit_variables)
            raise InvalidRobot(f"{source}: follow: joint '{model.variables[one.variable]}' moves "
                               f'no digit; expected one of {able}')
    order = order or model.variables
    unknown = [name for name in order if name not in model.joint_names]
    if unknown or len(set(order)) != len(order):
        what = f"there is no movable joint '{unknown[0]}'" if unknown else 'a joint comes twice'
        raise InvalidRobot(f'{source}: order: {what}; there are {", ".join(model.joint_names)}')
    # A centre that is not given goes with the radius.
    guesses = {role: ('radius_mm',) if role in centres else ('tip_offset_mm', 'radius_mm')
               for role in guessed}
    return LoadedRobot(hand, _options(settings, source), tuple(order),
                       (*anatomy.unsure, *model.notes, *_speed_notes(hand),
                        *guess_notes(hand, guessed)), guesses)


def _speed_notes(hand: RobotHand) -> tuple[str, ...]:
    """Return which joints of the digits the URDF gives no speed, in words, if there are any."""
    names = [hand.model.variables[i] for i in hand.digit_variables if not hand.model.velocity[i]]
    return (f"no limit of speed in the URDF: {', '.join(names)}; retarget moves them at "
            'up to safety.max_speed',) if names else ()


def _tips(digits: Mapping[str, Any], model: RobotModel, side: str | None) -> dict[str, str] | None:
    """Return the tip links that are given, with the side that the URDF has."""
    patterns = {role: str(digit['tip']) for role, digit in digits.items() if 'tip' in digit}
    if not patterns:
        return None
    for one in (side,) if side else SIDES:
        tips = {role: pattern.replace('{side}', one).replace('{S}', one[0].upper())
                for role, pattern in patterns.items()}
        if all(link in model.links for link in tips.values()):
            break
    for link in tips.values():
        if len(same := [role for role in tips if tips[role] == link]) > 1:
            raise InvalidRobot(f"digits: {' and '.join(same)} have the tip '{link}'; expected "
                               'another for each')
    return tips


def _refuse_units(hand: RobotHand, tree: UrdfTree, source: str) -> None:
    """Refuse a URDF whose digits are in millimetres, or turn by degrees."""
    for role, digit in hand.anatomy.digits.items():
        if digit.length > LONGEST_DIGIT:
            raise InvalidRobot(f"{source}: {role}: {digit.length:.3g} m long, to its tip "
                               f"'{digit.tip_link}'; expected a URDF in metres, not millimetres")
    in_digits = {hand.model.variables[i] for i in hand.digit_variables}
    for joint in tree.joints:
        if joint.name in in_digits and joint.kind == 'revolute' and (
                max(-joint.lower, joint.upper) > MOST_TURNS * 2. * np.pi):
            raise InvalidRobot(f"{source}: joint '{joint.name}': limits {joint.lower:g} to "
                               f'{joint.upper:g}; expected radians, not degrees')


def _rest(settings: Mapping[str, Any], model: RobotModel, tree: UrdfTree,
          source: str) -> np.ndarray:
    rest = model.open_position()
    limits = {joint.name: (joint.lower, joint.upper) for joint in tree.joints}
    for name, given in _mapping(settings, 'rest', source).items():
        row = _variable(name, model, f'{source}: rest')
        value = _number(given, f'{source}: rest.{name}')
        lower, upper = limits[name]
        if not lower - REST_TOLERANCE <= value <= upper + REST_TOLERANCE:
            raise InvalidRobot(f'{source}: rest.{name}: {value:g}; expected {lower:.4g} to '
                               f'{upper:.4g}, its limits [rad or m]')
        rest[row] = value
    # A joint that follows one may leave it less than its own limits.
    return np.clip(rest, model.lower, model.upper)


def _follow(settings: Mapping[str, Any], model: RobotModel, source: str) -> tuple[Follow, ...]:
    found = []
    for name, given in _mapping(settings, 'follow', source).items():
        place = f'{source}: follow.{name}'
        given = given if isinstance(given, dict) else {'angle': given}
        _require_keys(f'follow.{name}', given, FOLLOW_KEYS, source)
        if given.get('angle') not in JOINTS:
            raise InvalidRobot(f"{place}: angle: '{given.get('angle')}'; expected one of "
                               f'{", ".join(JOINTS)}')
        found.append(Follow(
            _variable(name, model, f'{source}: follow'), JOINTS.index(given['angle']),
            _number(given.get('scale', 1.), f'{place}: scale'),
            float(np.radians(_number(given.get('offset_deg', 0.), f'{place}: offset_deg')))))
    return tuple(found)


def _options(settings: Mapping[str, Any], source: str) -> RetargetOptions:
    given = _mapping(settings, 'options', source)
    _require_keys('options', given, tuple(option.name for option in fields(RetargetOptions)),
                  source)
    try:
        return RetargetOptions(**given)
    except InvalidRetargetOption as error:
        raise InvalidRetargetOption(f'{source}: options: {error}') from None


def _variable(name: str, model: RobotModel, place: str) -> int:
    if name not in model.variables:
        raise InvalidRobot(f"{place}: there is no independent joint '{name}'; there are "
                           f'{", ".join(model.variables)}')
    return model.variables.index(name)


def _mapping(settings: Mapping[str, Any], key: str, source: str) -> dict[str, Any]:
    value = settings.get(key) or {}
    if not isinstance(value, dict):
        raise InvalidRobot(f'{source}: {key}: {value!r}; expected a mapping')
    return value


def _require_keys(place: str, given: Mapping[str, Any], known: tuple[str, ...],
                  source: str) -> None:
    for key in given:
        if key not in known:
            raise InvalidRobot(f"{source}: {place + ': ' if place else ''}there is no key '{key}'; "
                               f'expected are {", ".join(known)}')


def _number(value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
        raise InvalidRobot(f'{place}: {value!r}; expected a number')
    return float(value)


def _offset(value: Any, place: str) -> np.ndarray:
    if not isinstance(value, list) or len(value) != 3:
        raise InvalidRobot(f'{place}: {value!r}; expected three numbers')
    offset_mm = np.array([_number(number, place) for number in value])
    if np.linalg.norm(offset_mm) > MOST_TIP_MM:
        raise InvalidRobot(f'{place}: {value!r}; expected {MOST_TIP_MM:g} mm at most')
    return offset_mm / 1e3
