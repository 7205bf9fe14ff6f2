"""YAML of hand and layout files: reading with errors that name file, line and field."""

import difflib
import math
from collections.abc import Callable, Collection
from os import PathLike
from typing import Any, NamedTuple, TypeVar

import numpy as np
import yaml
from numpy.typing import ArrayLike

from ..core.errors import HandTrackerError
from .parameter_file import SECTION
from .plain_yaml import UniqueKeyLoader, parse_plain_yaml, read_yaml_text, yaml_fault

Parsed = TypeVar('Parsed')
HAND_EXAMPLE, LAYOUT_EXAMPLE = 'config/hand.yaml', 'docs/layouts.md'
VALUE_SHOWN = 60    # characters of a value in an error


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


def read_yaml(path: str | PathLike[str], parse: Callable[[Any], Parsed],
              like: str = HAND_EXAMPLE) -> Parsed:
    """Read and parse a YAML file; errors name the file.

    Parameters
    ----------
    path : str or path-like
    parse : callable
        Takes the file's tree; may raise `HandTrackerError`.
    like : str, optional
        File that is written as is expected, for errors.

    Raises
    ------
    InvalidHandFile
        If it cannot be read, is no YAML, or has a field that is refused.
    """
    try:
        text = read_yaml_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidHandFile(yaml_fault(path, error)) from None
    return parse_yaml(text, path, parse, like)


def parse_yaml(text: str, name: str | PathLike[str], parse: Callable[[Any], Parsed],
               like: str = HAND_EXAMPLE) -> Parsed:
    """Parse YAML text as `read_yaml` does; its `InvalidHandFile` has the name."""
    try:
        return parse(parse_plain_yaml(text, UniqueKeyLoader))
    except yaml.YAMLError as error:
        raise InvalidHandFile(yaml_fault(name, error, like)) from None
    except HandTrackerError as error:
        raise InvalidHandFile(f'{name}: {error}') from None


def mapping(where: str, value: Any, allowed: Collection[str]) -> dict:
    """Return a mapping, empty for None; raise `InvalidHandFile` for a key that is not allowed."""
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise InvalidHandFile(
            f'{where or "the file"}: {_shown(value)}; expected a mapping of {", ".join(allowed)}')
    for key in value:
        if key not in allowed:
            dotted = f'{where}.{key}' if where else f'{key}'
            if SECTION in str(value[key]):
                hint = 'the file is of ROS parameters, for --params-file or parameters:='
            elif near := difflib.get_close_matches(str(key), allowed, 1):
                hint = f"did you mean '{near[0]}'?"
            else:
                hint = f'allowed are {", ".join(allowed)}'
            raise InvalidHandFile(f'{dotted}: unknown key; {hint}')
    return value


def _shown(value: Any) -> str:
    """Return a value as an error shows it."""
    text = repr(value)
    return text if len(text) <= VALUE_SHOWN else f'{text[:VALUE_SHOWN]} ...'


def choice(where: str, value: Any, allowed: Collection[str]) -> str:
    """Return a value; raise `InvalidHandFile` unless it is one of those allowed."""
    if value not in tuple(allowed):
        raise InvalidHandFile(f'{where}: {_shown(value)}; allowed are {", ".join(allowed)}')
    return value


def number(where: str, value: Any, quantity: Quantity) -> float | list[float]:
    """Return a value of the file in metres, radians or no unit.

    Raises
    ------
    InvalidHandFile
        If it is no number, or no list of as many as asked for, or out of range.
    """
    if not quantity.size:
        values, places = [value], ['']
    elif isinstance(value, list) and len(value) == quantity.size:
        values, places = value, [f'[{i}]' for i in range(quantity.size)]
    else:
        raise InvalidHandFile(
            f'{where}: {_shown(value)}; expected a list of {quantity.size} numbers')
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
