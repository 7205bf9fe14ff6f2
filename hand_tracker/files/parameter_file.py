"""Parameter files of ROS 2 (YAML): the values that nodes take from one. No ROS."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from ..core.errors import HandTrackerError
from ..output_files import write_whole_text
from .plain_yaml import parse_plain_yaml, read_yaml_text, yaml_fault, yaml_text

SECTION = 'ros__parameters'


class InvalidParameterFile(HandTrackerError, ValueError):
    """A parameter file cannot be read, or holds nothing for the nodes."""


class ParameterFile:
    """A parameter file, of which each node takes what its sections set for it.

    Sections apply as in rclpy: in the order of the file, the last value of a parameter counts;
    in their names, `*` stands for one part and `**` for any number of parts.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    InvalidParameterFile
        If it cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = path
        try:
            tree = parse_plain_yaml(read_yaml_text(path))
        except (OSError, ValueError, yaml.YAMLError) as error:
            raise InvalidParameterFile(yaml_fault(path, error)) from None
        self._sections = list(_sections(tree))

    def parameters(self, node: str, unlike: str = '') -> dict[str, Any]:
        """Return the parameters that the file sets for a node.

        Parameters
        ----------
        node : str
            Full name, as '/left/hand_tracker'.
        unlike : str, optional
            Full name of another node: sections that stand for it too do not count.

        Returns
        -------
        dict of str to object
            Value of each parameter, by its dotted name.
        """
        values: dict[str, Any] = {}
        for name, parameters in self._sections:
            if _applies(name, node) and not (unlike and _applies(name, unlike)):
                values.update(_flat(parameters))
        return values

    def require(self, nodes: Sequence[str]) -> None:
        """Refuse a file that sets nothing for nodes that are started.

        Parameters
        ----------
        nodes : sequence of str
            Full names.

        Raises
        ------
        InvalidParameterFile
            If no section is for any of the nodes, or sections are for nodes of the name of some
            of them, but in other namespaces only.
        """
        sections = [name for name, _ in self._sections]
        names = ', '.join(name or "''" for name in sections) or 'no node'
        expected = ' or '.join(f"'{name}'" for name in ('/**', *nodes))
        expected = f"expected {expected}, and '{SECTION}' below it"
        if not _any_applies(sections, nodes):
            raise InvalidParameterFile(f'{self._path}: for {names}; {expected}')
        for kind in dict.fromkeys(map(_last_part, nodes)):
            named = [name for name in sections if _last_part(name) == kind]
            of_kind = [node for node in nodes if _last_part(node) == kind]
            if named and not _any_applies(named, of_kind):
                raise InvalidParameterFile(f'{self._path}: for {names}, of which none names the '
                                           f"node {' or '.join(of_kind)}; {expected}")


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


def _last_part(name: str) -> str:
    return name.rpartition('/')[2]


def _any_applies(sections: Sequence[str], nodes: Sequence[str]) -> bool:
    return any(_applies(section, node) for section in sections for node in nodes)


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
