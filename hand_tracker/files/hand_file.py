"""Read and write hand files: hand and marker layout in YAML, in millimetres and degrees.

`config/hand.yaml` shows every key. Each is optional, but one has to be there; the
defaults are those of the mean hand scaled to `length_mm` and `breadth_mm`.
"""

import math
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..core.model.hand import (
    ANGLE_RANGE,
    COUPLING_OFFSET_RANGE,
    COUPLING_PRESETS,
    COUPLING_SPREAD_RANGE,
    DIGITS,
    FINGERS,
    HAND_BREADTH_RANGE,
    HAND_LENGTH_RANGE,
    JOINTS,
    LENGTH_RANGE,
    LIMIT_PRESETS,
    NATURAL_OFFSET_RANGE,
    NATURAL_SLOPE_RANGE,
    NATURAL_SPREAD_RANGE,
    PALM_SYNERGY_RANGE,
    PHALANX_DEVIATION_RANGE,
    POSITION_RANGE,
    RADIUS_RANGE,
    SIDES,
    SLOPE_RANGE,
    SPLAY_RANGE,
    THUMB_AXIS_DISTANCE_RANGE,
    THUMB_MCP_ABDUCTION_RANGE,
    THUMB_ROLL_RANGE,
    USUAL_COUPLING_SPREAD,
    WEARER_LIMITS,
    Hand,
    average_natural_flexion,
    preset_coupling,
    preset_limits,
)
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..core.model.marker_rows import shows_arch
from ..output_files import write_whole_text
from .layout_file import choose_layout, layout_of_tree, tree_of_layout
from .plain_yaml import yaml_text
from .yaml_fields import InvalidHandFile, Quantity, choice, mapping, number, parse_yaml, read_yaml

__all__ = ['InvalidHandFile', 'choose_hand', 'file_notes', 'load_hand', 'save_hand',
           'unknown_range_note', 'worn_layout']


LENGTH = Quantity('mm', 0, *(1000. * v for v in HAND_LENGTH_RANGE))
BREADTH = Quantity('mm', 0, *(1000. * v for v in HAND_BREADTH_RANGE))
POINT = Quantity('mm', 3, -1000. * POSITION_RANGE, 1000. * POSITION_RANGE)
BONE_LENGTHS = Quantity('mm', 3, *(1000. * v for v in LENGTH_RANGE))
RADIUS = Quantity('mm', 0, *(1000. * v for v in RADIUS_RANGE))
DIGIT_RADII = RADIUS._replace(size=3)
SPLAY = Quantity('degrees', 0, -math.degrees(SPLAY_RANGE), math.degrees(SPLAY_RANGE))
PHALANX_DEVIATION = Quantity(
    'degrees', 0, *(math.degrees(v) for v in (-PHALANX_DEVIATION_RANGE, PHALANX_DEVIATION_RANGE)))
THUMB_MCP_ABDUCTION = Quantity(
    'degrees', 0, *(math.degrees(v) for v in THUMB_MCP_ABDUCTION_RANGE))
THUMB_ROLL = Quantity('degrees', 0, *(math.degrees(v) for v in THUMB_ROLL_RANGE))
THUMB_AXIS_DISTANCE = Quantity('mm', 0, *(1000. * v for v in THUMB_AXIS_DISTANCE_RANGE))
DIRECTION = Quantity('', 3, -1e6, 1e6)
SLOPE = Quantity('', 0, *SLOPE_RANGE)
COUPLING_OFFSET = Quantity('degrees', 0, *(math.degrees(v) for v in COUPLING_OFFSET_RANGE))
COUPLING_DEVIATION = Quantity('degrees', 0, *(math.degrees(v) for v in COUPLING_SPREAD_RANGE))
NATURAL_SLOPE = Quantity('', 0, *NATURAL_SLOPE_RANGE)
NATURAL_OFFSET = Quantity('degrees', 0, *(math.degrees(v) for v in NATURAL_OFFSET_RANGE))
NATURAL_SPREAD = Quantity('degrees', 0, *(math.degrees(v) for v in NATURAL_SPREAD_RANGE))
PALM_GAIN = Quantity('', 0, *PALM_SYNERGY_RANGE)
LIMIT = Quantity('degrees', 2, -math.degrees(ANGLE_RANGE), math.degrees(ANGLE_RANGE))

# Key of the file: field of Hand, names of its rows, quantity of each row.
ROW_FIELDS = {
    'finger_cmc_mm': ('finger_cmc', FINGERS, POINT),
    'finger_mcp_mm': ('finger_mcp', FINGERS, POINT),
    'finger_bones_mm': ('finger_bones', FINGERS, BONE_LENGTHS),
    'abduction_axes': ('finger_abduction_axes', FINGERS, DIRECTION),
    'splay_deg': ('splay', FINGERS, SPLAY),
    'phalanx_deviation_deg': ('phalanx_deviation', FINGERS, PHALANX_DEVIATION),
    'palm_synergy': ('palm_synergy', FINGERS, PALM_GAIN),
    'radii_mm': ('radii', DIGITS, DIGIT_RADII),
}
THUMB_FIELDS = {
    'cmc_mm': ('thumb_cmc', POINT),
    'bones_mm': ('thumb_bones', BONE_LENGTHS),
    'abduction_axis': ('thumb_abduction_axis', DIRECTION),
    'rest_direction': ('thumb_rest_direction', DIRECTION),
    'mcp_abduction_deg': ('thumb_mcp_abduction', THUMB_MCP_ABDUCTION),
    'roll_deg': ('thumb_roll', THUMB_ROLL),
    'axis_distance_mm': ('thumb_axis_distance', THUMB_AXIS_DISTANCE),
}
COUPLING_FIELDS = {
    'slope': SLOPE, 'offset_deg': COUPLING_OFFSET, 'spread_deg': COUPLING_DEVIATION}
NATURAL_FIELDS = {
    'slope': NATURAL_SLOPE, 'offset_deg': NATURAL_OFFSET, 'spread_deg': NATURAL_SPREAD}
JOINT_KEYS = tuple(f'{joint}_deg' for joint in JOINTS)
HAND_FILE_KEYS = ('side', 'length_mm', 'breadth_mm', *ROW_FIELDS, 'palm_radius_mm', 'thumb',
                  'coupling', 'natural_flexion', 'limits', 'range_of_motion', 'markers')


def load_hand(path: str | PathLike[str]) -> tuple[Hand, MarkerLayout]:
    """Read a hand file.

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    InvalidHandFile
        Naming the file, the field by its dotted path, its value and what is allowed.
    """
    return read_yaml(path, _parse)


def parse_hand(text: str, name: str | PathLike[str]) -> tuple[Hand, MarkerLayout]:
    """Read the text of a hand file.

    Parameters
    ----------
    text : str
    name : str or path-like
        Of the file, for messages.

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    InvalidHandFile
        As `load_hand`.
    """
    return parse_yaml(text, name, _parse)


def _parse(tree: Any) -> tuple[Hand, MarkerLayout]:
    """Return the hand and the layout of a file's tree."""
    if not (tree := mapping('', tree, HAND_FILE_KEYS)):
        raise InvalidHandFile(f'it is empty; expected at least one of {", ".join(HAND_FILE_KEYS)}')
    return _hand(tree), layout_of_tree(tree.get('markers'))


def choose_hand(path: str | PathLike[str] | None = None, side: str | None = None,
                limits: str | None = None, coupling: str | None = None,
                layout: str | None = None, **size: float) -> tuple[Hand, MarkerLayout]:
    """Return the hand of a file, or the mean hand, with side and presets overridden.

    Parameters
    ----------
    path : path-like, optional
        Hand file; the mean hand with the paper's markers when left out.
    side : {'right', 'left'}, optional
    limits : str, optional
        One of `LIMIT_PRESETS`.
    coupling : str, optional
        One of `COUPLING_PRESETS`.
    layout : str, optional
        Name of a layout preset, or a layout file, in place of the hand file's markers; where these
        have the same names of their own, the hand file's places are kept, as calibrated.
    **size
        `length` and `breadth` of the mean hand [m].

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    InvalidHandFile
        As `load_hand`.
    """
    hand, markers = load_hand(path) if path else (Hand.scaled(**size), MarkerLayout())
    overrides: dict[str, Any] = {}
    if side:
        overrides['side'] = side
    if limits:
        overrides['limits'] = preset_limits(limits, hand.range_of_motion)
    if coupling:
        overrides['coupling'] = preset_coupling(coupling)
    markers = worn_layout(layout, markers) if layout else markers
    hand = hand.replace(**overrides)
    return hand.with_open_palm() if shows_arch(markers) else hand, markers


def worn_layout(layout: str, own: MarkerLayout) -> MarkerLayout:
    """Return the markers of a layout, with the places that a hand file knows of them.

    Parameters
    ----------
    layout : str
        As of `choose_hand`.
    own : MarkerLayout
        Of the hand file.
    """
    asked = choose_layout(layout)
    return own.in_order(asked.names) if _has_markers_of(own, asked) else asked


def _has_markers_of(own: MarkerLayout, asked: MarkerLayout) -> bool:
    """Return whether a hand file knows the places of the markers of a layout.

    By their names, each on the same digit or on the palm: calibration may move them along it. The
    paper's eight have the same names everywhere: of them it does where they are off the joints.
    """
    def digits(layout: MarkerLayout) -> dict[str, str]:
        return dict(zip(layout.names, layout.digits))

    return digits(own) == digits(asked) and (asked.names != MARKERS or bool(own.offsets.any()))


def file_notes(path: str | PathLike[str], side: str | None = None,
               layout: str | None = None) -> list[str]:
    """Return notes on how a tracked hand differs from that of its file.

    Parameters
    ----------
    path : path-like
        Hand file.
    side : {'right', 'left'}, optional
        Of the hand that it stands for; the file's own when left out.
    layout : str, optional
        As of `choose_hand`.
    """
    hand, own = load_hand(path)
    usual, notes = MarkerLayout(), []
    if side and hand.side != side:
        notes.append(f'the hand file {path} is of a {hand.side} hand: its mirror image is taken '
                     f'for the {side} one')
    is_usual = (own.names, own.places) == (usual.names, usual.places) and not own.offsets.any()
    if layout and not is_usual and not _has_markers_of(own, choose_layout(layout)):
        notes.append(f'the markers of the layout {layout} take the place of those of the hand '
                     f'file {path}, which it was fitted with')
    return notes


def unknown_range_note(limits: str | None, hand: Hand) -> str | None:
    """Return a note where a wearer's limits are asked for, but a hand has none, else None.

    Parameters
    ----------
    limits : str or None
        Preset that is asked for.
    hand : Hand
    """
    return None if limits != WEARER_LIMITS or hand.range_of_motion.any() else (
        f"limits '{WEARER_LIMITS}' are Table 1 of the paper ('paper') here: the wearer's range of "
        'motion is not known; expected a hand file of hand_tracker calibrate')


def save_hand(path: str | PathLike[str], hand: Hand, layout: MarkerLayout) -> None:
    """Write a hand file; `load_hand` returns the same hand and layout.

    Parameters
    ----------
    path : str or path-like
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    OutputError
        If it cannot be written; what was at its place is left as it was.
    """
    write_whole_text(Path(path), hand_text(hand, layout))


def hand_text(hand: Hand, layout: MarkerLayout) -> str:
    """Return the text of a hand file, which `parse_hand` reads.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout

    Returns
    -------
    str
    """
    tree: dict[str, Any] = {'side': hand.side}
    for key, (field, names, quantity) in ROW_FIELDS.items():
        tree[key] = {
            name: quantity.from_si(row) for name, row in zip(names, getattr(hand, field))}
    tree['palm_radius_mm'] = RADIUS.from_si(hand.palm_radius)
    tree['thumb'] = {
        key: quantity.from_si(getattr(hand, field))
        for key, (field, quantity) in THUMB_FIELDS.items()}
    for key, quantities, rows in (
            ('coupling', COUPLING_FIELDS,
             np.column_stack((hand.coupling, hand.coupling_spread))),
                                  ('natural_flexion', NATURAL_FIELDS, hand.natural_flexion)):
        tree[key] = {
            digit: {name: quantity.from_si(value)
                    for (name, quantity), value in zip(quantities.items(), row)}
            for digit, row in zip(DIGITS, rows)}
    tree['limits'] = _preset_of_limits(hand) or _joint_ranges(hand.limits)
    if hand.range_of_motion.any():
        tree['range_of_motion'] = _joint_ranges(hand.range_of_motion)
    tree['markers'] = tree_of_layout(layout)
    return yaml_text('A hand for hand_tracker, in millimetres and degrees.', tree)


def _preset_of_limits(hand: Hand) -> str | None:
    """Return the preset equal to a hand's limits, the wearer's first; None for other limits."""
    presets = LIMIT_PRESETS[::-1] if hand.range_of_motion.any() else LIMIT_PRESETS
    return next((preset for preset in presets if np.array_equal(
        hand.limits, preset_limits(preset, hand.range_of_motion))), None)


def _joint_ranges(ranges: np.ndarray) -> dict[str, Any]:
    """Return a range of each joint, (25, 2) [rad], as a file's mapping."""
    return {key: LIMIT.from_si(row) for key, row in zip(JOINT_KEYS, ranges)}


def _hand(tree: dict) -> Hand:
    """Return the Hand of a file's mapping."""
    size: dict[str, Any] = {name: number(key, tree[key], quantity) for name, key, quantity in (
        ('length', 'length_mm', LENGTH), ('breadth', 'breadth_mm', BREADTH)) if key in tree}
    mean = Hand.scaled(**size)
    shown = _ranges('range_of_motion', mapping('range_of_motion', tree.get('range_of_motion'),
                                                JOINT_KEYS), np.zeros((len(JOINTS), 2)))
    fields: dict[str, Any] = {'limits': _limits(tree.get('limits', 'paper'), shown),
              'range_of_motion': shown,
              **dict(zip(('coupling', 'coupling_spread'),
                         _coupling(tree.get('coupling', 'natural')))),
              'natural_flexion': _of_digits('natural_flexion', mapping(
                  'natural_flexion', tree.get('natural_flexion'), DIGITS),
                  average_natural_flexion(), NATURAL_FIELDS)}
    if 'side' in tree:
        fields['side'] = choice('side', tree['side'], SIDES)
    for key, (field, names, quantity) in ROW_FIELDS.items():
        values = np.array(getattr(mean, field))
        for name, value in mapping(key, tree.get(key), names).items():
            values[names.index(name)] = number(f'{key}.{name}', value, quantity)
        fields[field] = values
    if 'palm_radius_mm' in tree:
        fields['palm_radius'] = number('palm_radius_mm', tree['palm_radius_mm'], RADIUS)
    for key, value in mapping('thumb', tree.get('thumb'), THUMB_FIELDS).items():
        field, quantity = THUMB_FIELDS[key]
        fields[field] = number(f'thumb.{key}', value, quantity)
    return mean.replace(**fields)


def _limits(value: str | dict, shown: np.ndarray) -> np.ndarray:
    """Return joint limits from a preset's name, or a mapping of single joints, (25, 2) [rad]."""
    if not isinstance(value, dict):
        return preset_limits(choice('limits', value, LIMIT_PRESETS), shown)
    given = mapping('limits', value, ('preset', *JOINT_KEYS))
    preset = choice('limits.preset', given.pop('preset', 'paper'), LIMIT_PRESETS)
    return _ranges('limits', given, preset_limits(preset, shown))


def _ranges(where: str, given: dict, values: np.ndarray) -> np.ndarray:
    """Return a range of each joint, (25, 2): the given ones, else those of `values` [rad]."""
    for key, value in given.items():
        values[JOINT_KEYS.index(key)] = number(f'{where}.{key}', value, LIMIT)
    return values


def _coupling(value: str | dict) -> tuple[np.ndarray, np.ndarray]:
    """Return coupling and spread of a preset, or of a mapping of digits, (5, 2), (5,) [1, rad]."""
    usual = np.full((len(DIGITS), 1), np.radians(USUAL_COUPLING_SPREAD))
    if isinstance(value, str):
        return preset_coupling(choice('coupling', value, COUPLING_PRESETS)), usual[:, 0]
    given = mapping('coupling', value, ('preset', *DIGITS))
    rows = _of_digits('coupling', given, np.hstack((preset_coupling(
        choice('coupling.preset', given.get('preset', 'natural'), COUPLING_PRESETS)), usual)),
        COUPLING_FIELDS)
    return rows[:, :2], rows[:, 2]


def _of_digits(where: str, given: dict, values: np.ndarray,
               quantities: dict[str, Quantity]) -> np.ndarray:
    """Return a row of quantities for each digit, (5, k): the given ones, else those of `values`."""
    for i, digit in enumerate(DIGITS):
        for key, value in mapping(f'{where}.{digit}', given.get(digit), quantities).items():
            values[i, list(quantities).index(key)] = number(
                f'{where}.{digit}.{key}', value, quantities[key])
    return values


