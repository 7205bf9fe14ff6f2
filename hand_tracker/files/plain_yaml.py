"""YAML of plain trees, by the safe loader: aliases, deep nesting and huge integers are refused."""

from __future__ import annotations

from os import PathLike
from typing import Any

import yaml

MAX_YAML_CHARACTERS = 2**20
MAX_YAML_DEPTH = 50        # of lists and mappings in each other


def yaml_text(heading: str, tree: Any) -> str:
    """Return a file's text: a comment, then a tree in its order, its innermost rows in one line.

    Parameters
    ----------
    heading : str
        One line.
    tree : object

    Returns
    -------
    str
    """
    text = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=99)
    return f'# {heading}\n{text}'


class PlainLoader(yaml.SafeLoader):
    """YAML loader of plain trees.

    Aliases, by which a short text can be a tree without end, are refused as ROS 2 does in its
    parameter files; so are deep trees and integers beyond 64 bits.
    """

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            raise yaml.composer.ComposerError(
                None, None, f"alias '*{event.anchor}', which is not read", event.start_mark)
        if self._depth == MAX_YAML_DEPTH:
            raise yaml.composer.ComposerError(
                None, None, f'nested more than {MAX_YAML_DEPTH} deep', event.start_mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        number = super().construct_yaml_int(node)
        if not -2**63 <= number < 2**64:
            raise yaml.constructor.ConstructorError(
                None, None, 'an integer of more than 64 bits', node.start_mark)
        return number


PlainLoader.add_constructor('tag:yaml.org,2002:int', PlainLoader.construct_yaml_int)


class UniqueKeyLoader(PlainLoader):
    """YAML loader that also refuses duplicate keys, instead of silently keeping the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        names: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in names:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key '{key.value}' stands twice", key.start_mark)
            names.add(key.value)
        return super().construct_mapping(node, deep)


def read_yaml_text(path: str | PathLike[str]) -> str:
    """Return the text of a file, no more than `parse_plain_yaml` takes and refuses.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is no text in UTF-8.
    """
    with open(path, encoding='utf-8') as file:
        return file.read(MAX_YAML_CHARACTERS + 1)


def parse_plain_yaml(text: str, loader: type[PlainLoader] = PlainLoader) -> Any:
    """Return the tree of a text.

    Raises
    ------
    yaml.YAMLError
    """
    if len(text) > MAX_YAML_CHARACTERS:
        raise yaml.YAMLError(f'more than {MAX_YAML_CHARACTERS} characters')
    try:
        return yaml.load(text, loader)
    except yaml.YAMLError:
        raise
    # Dates, escapes and tags that are none raise whatever Python's own types do.
    except Exception as error:
        raise yaml.YAMLError(str(error)) from None


# What the parser was at: what is wrong from where that began, in words of a file.
BROKEN_FROM_START = {
    'while scanning a simple key': "a key without ':' and a value",
    'while scanning a quoted scalar': 'a text in quotes that is not closed',
    'while parsing a flow node': 'a list in [ ] or a mapping in { } that is not closed',
    'while parsing a flow sequence': 'a list in [ ] that is not closed, or lacks a comma',
    'while parsing a flow mapping': 'a mapping in { } that is not closed, or lacks a comma',
}
INDENTED_OTHERWISE = ('while parsing a block mapping', 'while parsing a block collection')


def yaml_fault(name: str | PathLike[str], error: Exception, like: str = '') -> str:
    """Return in one line why a file cannot be read: file, line, and what is expected there.

    Parameters
    ----------
    name : str or path-like
        Of the file.
    error : OSError, ValueError or yaml.YAMLError
        Of `read_yaml_text` or `parse_plain_yaml`.
    like : str, optional
        File that is written as is expected.

    Returns
    -------
    str
    """
    if isinstance(error, OSError):
        return f'{name}: {error.strerror or error}'
    if isinstance(error, UnicodeDecodeError):
        byte = error.object[error.start]
        return f'{name}: no YAML text: byte {byte:#x}; expected text in UTF-8'
    if isinstance(error, yaml.reader.ReaderError):
        return f'{name}: no YAML text: character {error.character:#x}; expected text in UTF-8'
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
        return f'{name}: no YAML text: {" ".join(str(error).split())}'
    mark, context, problem = error.problem_mark, error.context or '', error.problem or ''
    if not isinstance(error, (yaml.scanner.ScannerError, yaml.parser.ParserError)):
        wrong = ('a tag, which is not read' if 'tag' in problem.split() else
                 'a list or a mapping as a key' if 'unhashable' in problem else problem)
        return f'{name}:{mark.line + 1}:{mark.column + 1}: {wrong}'
    is_cut = mark.buffer is not None and not mark.buffer[mark.pointer:].strip('\0 \n')
    wrong, expected = 'no YAML', f'YAML, as in {like}' if like else 'YAML'
    if context in BROKEN_FROM_START:
        wrong, mark = BROKEN_FROM_START[context], error.context_mark or mark
    elif context in INDENTED_OTHERWISE:
        wrong = 'another indentation than that of the lines before'
    elif problem.startswith('mapping values'):
        wrong = "a second ':' in an entry, or a line that is indented too far"
    elif repr('\t') in problem:
        wrong, expected = 'a tab', 'spaces'
    cut = ' (the file ends there, perhaps cut off)' if is_cut else ''
    return f'{name}:{mark.line + 1}:{mark.column + 1}: {wrong}{cut}; expected {expected}'
