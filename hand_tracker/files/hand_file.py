"""Read and write hand files: hand and marker layout in YAML, in millimetres and degrees.

`config/hand.yaml` shows every key. All keys are optional; the defaults are those of the mean hand
scaled to `length_mm` and `breadth_mm`.
"""

import difflib
import math
from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import ArrayLike

from ..core.errors import HandTrackerError
from ..core.model.hand import (
    ANGLE_RANGE,
    COUPLING_PRESETS,
    DIGITS,
    FINGERS,
    JOINTS,
    LENGTH_RANGE,
    LIMIT_PRESETS,
    NATURAL_OFFSET_RANGE,
    NATURAL_SLOPE_RANGE,
    NATURAL_SPREAD_RANGE,
    POSITION_RANGE,
    SIDES,
    SLOPE_RANGE,
    Hand,
    average_natural_flexion,
    preset_coupling,
    preset_limits,
)
from ..core.model.marker_layout import (
    DEVIATION_RANGE,
    MARKERS,
    OFFSET_RANGE,
    PAPER_PLACES,
    MarkerLayout,
)


class InvalidHandFile(HandTrackerError, ValueError):
    """A hand file is invalid; the message names file, field, value and what is allowed."""


class Quantity(NamedTuple):
    """Unit and bounds of a number, or of a list of numbers, in a hand file.

    Attributes
    ----------
    unit : {'mm', 'degrees', ''}
    size : int
        Length of the list; 0 for a single number.
    lower, upper : float
        Of each number, in the file's unit.
    """

    unit: str
    size: int
    lower: float
    upper: float

    def to_si(self, value: float) -> float:
        """Convert a number from the file's unit to metres or radians."""
        if self.unit == 'degrees':
            return np.radians(value)
        return value / 1000. if self.unit == 'mm' else float(value)

    def from_si(self, values: ArrayLike) -> float | list[float]:
        """Convert metres or radians to the file's unit, as plain numbers."""
        scale = {'mm': 1000., 'degrees': 180. / math.pi}.get(self.unit, 1.)
        numbers = [round(float(v) * scale, 12) + 0. for v in np.atleast_1d(values)]
        return numbers if self.size else numbers[0]


LENGTH = Quantity('mm', 0, 100., 260.)
BREADTH = Quantity('mm', 0, 40., 140.)
POINT = Quantity('mm', 3, -1000. * POSITION_RANGE, 1000. * POSITION_RANGE)
BONE_LENGTHS = Quantity('mm', 3, *(1000. * v for v in LENGTH_RANGE))
RADIUS = Quantity('mm', 0, 1., 50.)
DIGIT_RADII = Quantity('mm', 3, 1., 50.)
SPLAY = Quantity('degrees', 0, -45., 45.)
DIRECTION = Quantity('', 3, -1e6, 1e6)
SLOPE = Quantity('', 0, *SLOPE_RANGE)
COUPLING_OFFSET = Quantity('degrees', 0, -90., 90.)
NATURAL_SLOPE = Quantity('', 0, *NATURAL_SLOPE_RANGE)
NATURAL_OFFSET = Quantity('degrees', 0, *(math.degrees(v) for v in NATURAL_OFFSET_RANGE))
NATURAL_SPREAD = Quantity('degrees', 0, *(math.degrees(v) for v in NATURAL_SPREAD_RANGE))
MARKER_DEVIATION = Quantity('mm', 0, *(1000. * v for v in DEVIATION_RANGE))
MARKER_OFFSET = Quantity('mm', 3, -1000. * OFFSET_RANGE, 1000. * OFFSET_RANGE)
LIMIT = Quantity('degrees', 2, -math.degrees(ANGLE_RANGE), math.degrees(ANGLE_RANGE))

# Key of the file: field of Hand, names of its rows, quantity of each row.
ROW_FIELDS = {
    'finger_cmc_mm': ('finger_cmc', FINGERS, POINT),
    'finger_mcp_mm': ('finger_mcp', FINGERS, POINT),
    'finger_bones_mm': ('finger_bones', FINGERS, BONE_LENGTHS),
    'abduction_axes': ('finger_abduction_axes', FINGERS, DIRECTION),
    'splay_deg': ('splay', FINGERS, SPLAY),
    'radii_mm': ('radii', DIGITS, DIGIT_RADII),
}
THUMB_FIELDS = {
    'cmc_mm': ('thumb_cmc', POINT),
    'bones_mm': ('thumb_bones', BONE_LENGTHS),
    'abduction_axis': ('thumb_abduction_axis', DIRECTION),
    'rest_direction': ('thumb_rest_direction', DIRECTION),
}
COUPLING_FIELDS = {'slope': SLOPE, 'offset_deg': COUPLING_OFFSET}
NATURAL_FIELDS = {
    'slope': NATURAL_SLOPE, 'offset_deg': NATURAL_OFFSET, 'spread_deg': NATURAL_SPREAD}
HAND_FILE_KEYS = ('side', 'length_mm', 'breadth_mm', *ROW_FIELDS, 'palm_radius_mm', 'thumb',
                  'coupling', 'natural_flexion', 'limits', 'markers')


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
    try:
        with open(path, encoding='utf-8') as file:
            tree = yaml.load(file, _UniqueKeyLoader)
        tree = _mapping('', tree, HAND_FILE_KEYS)
        return _hand(tree), _layout(_mapping('markers', tree.get('markers'), MARKERS))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        raise InvalidHandFile(
            f'{path}:{mark.line + 1}:{mark.column + 1}: {error.problem}') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InvalidHandFile(f'{path}: no YAML text: {error}') from None
    except OSError as error:
        raise InvalidHandFile(f'{path}: {error.strerror}') from None
    except HandTrackerError as error:
        raise InvalidHandFile(f'{path}: {error}') from None


def choose_hand(path: str | PathLike[str] | None = None, side: str | None = None,
                limits: str | None = None, coupling: str | None = None,
                **size: float) -> tuple[Hand, MarkerLayout]:
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
    hand, layout = load_hand(path) if path else (Hand.scaled(**size), MarkerLayout())
    overrides: dict[str, Any] = {}
    if side:
        overrides['side'] = side
    if limits:
        overrides['limits'] = preset_limits(limits)
    if coupling:
        overrides['coupling'] = preset_coupling(coupling)
    return hand.replace(**overrides), layout


def save_hand(path: str | PathLike[str], hand: Hand, layout: MarkerLayout) -> None:
    """Write a hand file; `load_hand` returns the same hand and layout.

    Parameters
    ----------
    path : str or path-like
    hand : Hand
    layout : MarkerLayout
    """
    tree: dict[str, Any] = {'side': hand.side}
    for key, (field, names, quantity) in ROW_FIELDS.items():
        tree[key] = {
            name: quantity.from_si(row) for name, row in zip(names, getattr(hand, field))}
    tree['palm_radius_mm'] = RADIUS.from_si(hand.palm_radius)
    tree['thumb'] = {
        key: quantity.from_si(getattr(hand, field))
        for key, (field, quantity) in THUMB_FIELDS.items()}
    for key, quantities, rows in (('coupling', COUPLING_FIELDS, hand.coupling),
                                  ('natural_flexion', NATURAL_FIELDS, hand.natural_flexion)):
        tree[key] = {
            digit: {name: quantity.from_si(value)
                    for (name, quantity), value in zip(quantities.items(), row)}
            for digit, row in zip(DIGITS, rows)}
    tree['limits'] = {
        f'{joint}_deg': LIMIT.from_si(row) for joint, row in zip(JOINTS, hand.limits)}
    tree['markers'] = {
        marker: {'place': place, 'offset_mm': MARKER_OFFSET.from_si(offset),
                 'deviation_mm': MARKER_DEVIATION.from_si(deviation)}
        for marker, place, offset, deviation in zip(
            MARKERS, layout.places, layout.offsets, layout.deviations)}
    text = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=99)
    Path(path).write_text(
        f'# A hand for hand_tracker, in millimetres and degrees.\n{text}', encoding='utf-8')


class _UniqueKeyLoader(yaml.SafeLoader):
    """YAML loader that refuses duplicate keys, instead of silently keeping the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        names = [key for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for i, key in enumerate(names):
            if key.value in [other.value for other in names[:i]]:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key '{key.value}' stands twice", key.start_mark)
        return super().construct_mapping(node, deep)


def _hand(tree: dict) -> Hand:
    """Return the Hand of a file's mapping."""
    size: dict[str, Any] = {name: _number(key, tree[key], quantity) for name, key, quantity in (
        ('length', 'length_mm', LENGTH), ('breadth', 'breadth_mm', BREADTH)) if key in tree}
    mean = Hand.scaled(**size)
    fields: dict[str, Any] = {'limits': _limits(tree.get('limits', 'paper')),
              'coupling': _coupling(tree.get('coupling', 'natural')),
              'natural_flexion': _of_digits('natural_flexion', _mapping(
                  'natural_flexion', tree.get('natural_flexion'), DIGITS),
                  average_natural_flexion(), NATURAL_FIELDS)}
    if 'side' in tree:
        fields['side'] = _choice('side', tree['side'], SIDES)
    for key, (field, names, quantity) in ROW_FIELDS.items():
        values = np.array(getattr(mean, field))
        for name, value in _mapping(key, tree.get(key), names).items():
            values[names.index(name)] = _number(f'{key}.{name}', value, quantity)
        fields[field] = values
    if 'palm_radius_mm' in tree:
        fields['palm_radius'] = _number('palm_radius_mm', tree['palm_radius_mm'], RADIUS)
    for key, value in _mapping('thumb', tree.get('thumb'), THUMB_FIELDS).items():
        field, quantity = THUMB_FIELDS[key]
        fields[field] = _number(f'thumb.{key}', value, quantity)
    return mean.replace(**fields)


def _limits(value: str | dict) -> np.ndarray:
    """Return joint limits from a preset's name, or a mapping of single joints, (25, 2) [rad]."""
    if not isinstance(value, dict):
        return preset_limits(_choice('limits', value, LIMIT_PRESETS))
    keys = tuple(f'{joint}_deg' for joint in JOINTS)
    given = _mapping('limits', value, ('preset', *keys))
    limits = preset_limits(_choice('limits.preset', given.get('preset', 'paper'), LIMIT_PRESETS))
    for key in given:
        if key != 'preset':
            limits[keys.index(key)] = _number(f'limits.{key}', given[key], LIMIT)
    return limits


def _coupling(value: str | dict) -> np.ndarray:
    """Return the coupling from a preset's name, or a mapping of digits, (5, 2) [1, rad]."""
    if isinstance(value, str):
        return preset_coupling(_choice('coupling', value, COUPLING_PRESETS))
    given = _mapping('coupling', value, ('preset', *DIGITS))
    return _of_digits('coupling', given, preset_coupling(
        _choice('coupling.preset', given.get('preset', 'natural'), COUPLING_PRESETS)),
        COUPLING_FIELDS)


def _of_digits(where: str, given: dict, values: np.ndarray,
               quantities: dict[str, Quantity]) -> np.ndarray:
    """Return a row of quantities for each digit, (5, k): the given ones, else those of `values`."""
    for i, digit in enumerate(DIGITS):
        for key, number in _mapping(f'{where}.{digit}', given.get(digit), quantities).items():
            values[i, list(quantities).index(key)] = _number(
                f'{where}.{digit}.{key}', number, quantities[key])
    return values


def _layout(markers: dict) -> MarkerLayout:
    """Return the MarkerLayout of a file's mapping of markers."""
    places, offsets = list(PAPER_PLACES), np.zeros((len(MARKERS), 3))
    deviations = np.zeros(len(MARKERS))
    for marker, value in markers.items():
        given = _mapping(f'markers.{marker}', value, ('place', 'offset_mm', 'deviation_mm'))
        if 'place' in given:
            places[MARKERS.index(marker)] = given['place']
        if 'offset_mm' in given:
            offsets[MARKERS.index(marker)] = _number(
                f'markers.{marker}.offset_mm', given['offset_mm'], MARKER_OFFSET)
        if 'deviation_mm' in given:
            deviations[MARKERS.index(marker)] = _number(
                f'markers.{marker}.deviation_mm', given['deviation_mm'], MARKER_DEVIATION)
    return MarkerLayout(tuple(places), offsets, deviations)


def _mapping(where: str, value: Any, allowed: Collection[str]) -> dict:
    """Return a mapping after checking its keys; None becomes an empty one."""
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise InvalidHandFile(
            f'{where or "the file"}: {value!r}; expected a mapping of {", ".join(allowed)}')
    for key in value:
        if key not in allowed:
            dotted = f'{where}.{key}' if where else f'{key}'
            near = difflib.get_close_matches(str(key), allowed, 1)
            hint = f"did you mean '{near[0]}'?" if near else f'allowed are {", ".join(allowed)}'
            raise InvalidHandFile(f'{dotted}: unknown key; {hint}')
    return value


def _choice(where: str, value: Any, allowed: Collection[str]) -> str:
    if value not in tuple(allowed):
        raise InvalidHandFile(f'{where}: {value!r}; allowed are {", ".join(allowed)}')
    return value


def _number(where: str, value: Any, quantity: Quantity) -> float | list[float]:
    """Return a value of the file in metres, radians or no unit, after checking its range."""
    if not quantity.size:
        values, places = [value], ['']
    elif isinstance(value, list) and len(value) == quantity.size:
        values, places = value, [f'[{i}]' for i in range(quantity.size)]
    else:
        raise InvalidHandFile(
            f'{where}: {value!r}; expected a list of {quantity.size} numbers')
    for place, number in zip(places, values):
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise InvalidHandFile(f'{where}{place}: {number!r}; expected a number')
        # Also true for NaN.
        if not quantity.lower <= number <= quantity.upper:
            raise InvalidHandFile(
                f'{where}{place}: {number}; '
                f'allowed is {quantity.lower:g} to {quantity.upper:g} {quantity.unit}'.rstrip())
    numbers = [quantity.to_si(number) for number in values]
    return numbers if quantity.size else numbers[0]
