"""dex-retargeting's YAML files (`vector`, `position`, `dexpilot`), taken as robot files."""

from __future__ import annotations

from typing import Any

from ..core.model.hand import FINGERS
from .robot_urdf import InvalidRobot

DEX_TYPES = ('vector', 'position', 'dexpilot')
# Their row of a landmark: the wrist, then four of each digit, the thumb first.
DEX_TIP_ROWS = {4 * (i + 1): role for i, role in enumerate(('thumb', *FINGERS))}


def translated(given: Any, source: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the settings of a robot file for the section `retargeting` of such a file.

    Parameters
    ----------
    given : object
        The section.
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
    if not isinstance(given, dict):
        raise InvalidRobot(f'{source}: retargeting: {given!r}; expected a mapping')
    kind = str(given.get('type', '')).lower()
    if kind not in DEX_TYPES:
        raise InvalidRobot(f"{source}: retargeting.type: '{given.get('type')}'; expected one of "
                           f'{", ".join(DEX_TYPES)}')
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
        notes.append(f'{", ".join(left_out)}: vectors to links other than tips are not used; '
                     'directions of bones are')
    if 'scaling_factor' in given:
        notes.append(f"scaling_factor {given['scaling_factor']}: not used; the scale comes from "
                     "the lengths of the person's and the robot's digits")
    if 'low_pass_alpha' in given:
        notes.append(f"low_pass_alpha {given['low_pass_alpha']}: not used; there is no filter, "
                     'but limits of speed')
    return {'urdf': str(given['urdf_path']), 'digits': digits}, tuple(notes)


def _list(given: dict[str, Any], key: str, source: str) -> list[Any]:
    value = given.get(key)
    if not isinstance(value, list) or not value:
        raise InvalidRobot(f'{source}: retargeting.{key}: {value!r}; expected a list')
    return value
