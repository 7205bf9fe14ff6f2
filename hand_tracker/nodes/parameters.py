"""Declaration of one parameter of a node."""

from __future__ import annotations

from typing import NamedTuple


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
    """

    name: str
    default: object
    description: str
    range: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False
    any_type: bool = False
