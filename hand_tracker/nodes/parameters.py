"""What a node says of one of its parameters. No ROS."""

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
    range: tuple = None
    choices: tuple = ()
    read_only: bool = False
    any_type: bool = False
