"""Declaration of the parameters of a node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple, TypeVar

Options = TypeVar('Options')


class Parameter(NamedTuple):
    """One parameter of a node.

    Attributes
    ----------
    name : str
    default : object
        Gives the type.
    description : str
        With the unit in brackets.
    range : tuple, optional
        Lowest and highest value, for an int or a float.
    choices : tuple of str, optional
    read_only : bool
        Whether it is read only once, when the node starts.
    any_type : bool
        Whether a value may have another type than the default.
    short_name : str
        By which it may be given at the start, too.
    """

    name: str
    default: object
    description: str
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False
    any_type: bool = False
    short_name: str = ''


def option_parameters(kind: type, scope: str = '') -> tuple[Parameter, ...]:
    """Return the parameters of the fields of options.

    Parameters
    ----------
    kind : type
        A dataclass with the fields of `core.checked_options`.
    scope : str
        Before their names.
    """
    rows = []
    for option in fields(kind):
        about = option.metadata
        unit = f" [{about['unit']}]" if about.get('unit') else ''
        rows.append(Parameter(scope + option.name, option.default, about['description'] + unit,
                              about.get('range'), about.get('choices', ())))
    return tuple(rows)


def options_of(kind: type[Options], values: Mapping[str, Any], scope: str = '') -> Options:
    """Return options by the values of their `option_parameters`."""
    return kind(**{option.name: values[scope + option.name]
                   for option in fields(kind)})     # type: ignore[arg-type]
