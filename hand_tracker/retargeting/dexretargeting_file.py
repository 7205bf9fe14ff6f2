"""dex-retargeting's YAML files (`vector`, `position`, `dexpilot`), taken as robot files."""

from __future__ import annotations

import os.path
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from ..core.model.hand import FINGERS
from .robot_paths import resolve_path
from .robot_urdf import InvalidRobot

DEX_SECTION = 'retargeting'
# Keys that name the tips, by type.
TYPE_KEYS = {
    'vector': ('target_origin_link_names', 'target_task_link_names', 'target_link_human_indices'),
    'position': ('target_link_names', 'target_link_human_indices'),
    'dexpilot': ('finger_tip_link_names',),
}
# Why a key is not used.
UNUSED_KEYS = {
    'scaling_factor': "the scale comes from the lengths of the person's and the robot's digits",
    'low_pass_alpha': 'there is no filter, but limits of speed',
    'wrist_link_name': 'the palm is found by geometry',
    'target_joint_names': 'every independent joint that moves a digit is used',
    'add_dummy_free_joint': 'the palm is not moved in space; wrist.outputs moves an arm',
    'project_dist': 'tips pinch by the option touch of a robot file',
    'escape_dist': 'tips are free by the option escape of a robot file',
    'normal_delta': 'joints are kept still by the option smoothness of a robot file',
    'huber_delta': 'distances count by their squares',
    'has_joint_limits': "the URDF's limits always hold",
    'ignore_mimic_joint': 'joints that mimic others always do',
}
# Their row of a landmark: the wrist, then four of each digit, the thumb first.
DEX_TIP_ROWS = {4 * (i + 1): role for i, role in enumerate(('thumb', *FINGERS))}


def translated(file: Mapping[Any, Any], source: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the settings of a robot file for such a file.

    Parameters
    ----------
    file : mapping
        With the section `DEX_SECTION`.
    source : str
        Put before the message of an error.

    Returns
    -------
    settings : dict
    notes : tuple of str
        Parts of the file that are not used, and why.

    Raises
    ------
    InvalidRobot
        Naming the key and what is expected.
    """
    given = file[DEX_SECTION]
    if not isinstance(given, dict):
        raise InvalidRobot(f'{source}: retargeting: {given!r}; expected a mapping')
    kind = str(given.get('type', '')).lower()
    if kind not in TYPE_KEYS:
        raise InvalidRobot(f"{source}: retargeting.type: '{given.get('type')}'; expected one of "
                           f'{", ".join(TYPE_KEYS)}')
    if not given.get('urdf_path'):
        raise InvalidRobot(f'{source}: retargeting.urdf_path: missing')
    notes: list[str] = []
    if kind == 'dexpilot':
        links = _list(given, 'finger_tip_link_names', source)
        pairs = list(zip(DEX_TIP_ROWS, links))
    elif kind == 'position':
        pairs = list(zip(_list(given, 'target_link_human_indices', source),
                         _list(given, 'target_link_names', source)))
    else:
        rows = _list(given, 'target_link_human_indices', source)
        if len(rows) != 2:
            raise InvalidRobot(f'{source}: retargeting.target_link_human_indices: '
                               'expected rows of origins and of tasks')
        pairs = [*zip(rows[1], _list(given, 'target_task_link_names', source)),
                 *zip(rows[0], _list(given, 'target_origin_link_names', source))]
    digits: dict[str, dict[str, str]] = {}
    left_out = []
    for row, link in pairs:
        role = DEX_TIP_ROWS.get(row) if isinstance(row, int) else None
        if role:
            digits.setdefault(role, {'tip': str(link)})
        elif row != 0:
            left_out.append(str(link))
    if len(digits) < 2:
        raise InvalidRobot(f'{source}: retargeting: names {len(digits)} finger tips; expected at '
                           'least two')
    if left_out:
        notes.append(f'{", ".join(dict.fromkeys(left_out))}: vectors to links other than tips are '
                     'not used; directions of bones are')
    if wrists := dict.fromkeys(str(link) for row, link in pairs if row == 0):
        notes.append(f'{", ".join(wrists)}: not used as the wrist; '
                     f'{UNUSED_KEYS["wrist_link_name"]}')
    notes += _unused(file, kind)
    return {'urdf': str(given['urdf_path']), 'digits': digits}, tuple(notes)


def _unused(file: Mapping[Any, Any], kind: str) -> list[str]:
    """Return notes on the keys of a file that are not used."""
    other_types = f'type {kind} is read by {", ".join(TYPE_KEYS[kind])}'
    reasons = {**dict.fromkeys(chain(*TYPE_KEYS.values()), other_types), **UNUSED_KEYS}
    unused = {key: value for key, value in file[DEX_SECTION].items()
              if key not in ('type', 'urdf_path', *TYPE_KEYS[kind]) and value is not None}
    notes = []
    for key, value in unused.items():
        if key in reasons:
            shown = '' if isinstance(value, (list, dict)) else f' {value!r}'
            notes.append(f'{key}{shown}: not used; {reasons[key]}')
    unknown = [repr(key) for key in (*file, *unused) if key not in (DEX_SECTION, *reasons)]
    if unknown:
        notes.append(f'{", ".join(unknown)}: not used; files of dex-retargeting have no such key')
    return notes


def find_urdf(text: str, file: Path) -> str:
    """Return the path of the URDF that such a file names.

    dex-retargeting takes it relative to a folder that its program sets, and that nobody knows
    here: it is looked for beside the file and in the folders above it.

    Parameters
    ----------
    text : str
        Of its key `urdf_path`.
    file : Path

    Raises
    ------
    InvalidRobot
        If it is in none of them.
    """
    for folder in Path(os.path.abspath(file)).parents:
        place = resolve_path(text, folder)
        if os.path.isfile(place):  # unlike Path's, it takes whatever a file may hold
            return str(place)
    raise InvalidRobot(f"{file}: retargeting.urdf_path: there is no '{text}' beside this file or "
                       "in a folder above it; dex-retargeting's paths are relative to a URDF "
                       "directory of its own: give the URDF's path (--robot-description of a "
                       'command, robot_description of node and launch)')


def _list(given: dict[str, Any], key: str, source: str) -> list[Any]:
    value = given.get(key)
    if not isinstance(value, list) or not value:
        raise InvalidRobot(f'{source}: retargeting.{key}: {value!r}; expected a list')
    return value
