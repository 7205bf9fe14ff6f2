"""Parameter files of ROS 2 (YAML): the values that a node takes from one. No ROS."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from ..core.errors import HandTrackerError
from ..output_files import write_whole_text
from .plain_yaml import parse_plain_yaml, read_yaml_text, yaml_fault, yaml_text

SECTION = 'ros__parameters'


class InvalidParameterFile(HandTrackerError, ValueError):
    """A parameter file cannot be read, or holds nothing for the node."""


def node_parameters(path: str | Path, node: str) -> dict[str, Any]:
    """Return the parameters that a file sets for a node.

    Sections apply as in rclpy: in the order of the file, the last value of a parameter counts;
    in their names, `*` stands for one part and `**` for any number of parts.

    Parameters
    ----------
    path : path-like
    node : str
        Full name, as '/left/hand_tracker'.

    Returns
    -------
    dict of str to object
        Value of each parameter, by its dotted name.

    Raises
    ------
    InvalidParameterFile
        If no section is for the node, or one is for a node of its name in another namespace only.
    """
    try:
        tree = parse_plain_yaml(read_yaml_text(path))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InvalidParameterFile(yaml_fault(path, error)) from None
    sections = list(_sections(tree))
    applied = [_applies(name, node) for name, _ in sections]
    named = [name.rpartition('/')[2] == node.rpartition('/')[2] for name, _ in sections]
    expected = f"expected '/**' or '{node}', and '{SECTION}' below it"
    names = ', '.join(name or "''" for name, _ in sections)
    if not any(applied):
        raise InvalidParameterFile(f'{path}: for {names or "no node"}; {expected}')
    if any(named) and not any(map(min, applied, named)):
        raise InvalidParameterFile(
            f'{path}: for {names}, of which none names the node {node}; {expected}')
    values: dict[str, Any] = {}
    for applies, (_, parameters) in zip(applied, sections):
        if applies:
            values.update(_flat(parameters))
    return values


def save_parameters(path: Path, heading: str, values: dict[str, Any]) -> None:
    """Write a file with parameters for every node.

    Parameters
    ----------
    path : Path
        Replaced if it exists.
    heading : str
        Description of the parameters, in one line.
    values : dict of str to object

    Raises
    ------
    OutputError
        If it cannot be written; what was at its place is left as it was.
    """
    write_whole_text(path, yaml_text(heading, {'/**': {SECTION: values}}))


def _sections(tree: Any, name: str = '') -> Iterator[tuple[str, Any]]:
    """Yield name and parameters of each section of a parameter file."""
    if isinstance(tree, dict):
        if SECTION in tree:
            yield name, tree[SECTION]
        for key, branch in tree.items():
            if key != SECTION:
                yield from _sections(branch, f'{name}/{key}' if name else str(key))


def _applies(section: str, node: str) -> bool:
    """Return whether the name of a section stands for a node."""
    names = [name for name in node.split('/') if name]
    # Numbers of names that the parts so far can stand for.
    reached = {0}
    for part in filter(None, section.split('/')):
        if part == '**':
            reached = set(range(min(reached, default=len(names) + 1), len(names) + 1))
        else:
            reached = {n + 1 for n in reached if n < len(names) and part in ('*', names[n])}
    return len(names) in reached


def _flat(tree: Any, prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield dotted names and values of nested parameters."""
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
