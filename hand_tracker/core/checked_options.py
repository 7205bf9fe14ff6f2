"""Fields of options with their range or choices, and the check of their values."""

from __future__ import annotations

from dataclasses import field, fields
from typing import Any


def number_option(default: float, lower: float, upper: float, unit: str, description: str) -> Any:
    """Return a field of a number from `lower` to `upper`: a whole one where its default is."""
    return field(default=default, metadata={
        'range': (lower, upper), 'unit': unit, 'description': description})


def switch(default: bool, description: str) -> Any:
    """Return a field that is true or false."""
    return field(default=default, metadata={'description': description})


def choice_option(default: str, choices: tuple[str, ...], description: str) -> Any:
    """Return a field of one of some words."""
    return field(default=default, metadata={'choices': choices, 'description': description})


def check(options: Any, error: type[Exception], prefix: str = '') -> None:
    """Raise an error that names the first field whose value is not allowed.

    Parameters
    ----------
    options : dataclass
        Of the fields above.
    error : type
        That is raised.
    prefix : str
        Before the names.
    """
    for option in fields(options):
        value, about = getattr(options, option.name), option.metadata
        if 'choices' in about:
            is_allowed = value in about['choices']
            expected = f" is not one of {', '.join(about['choices'])}"
        elif 'range' in about:
            lower, upper = about['range']
            is_whole = isinstance(option.default, int)
            is_allowed = (isinstance(value, int if is_whole else (int, float))
                          and not isinstance(value, bool) and lower <= value <= upper)
            whole = 'a whole number from ' if is_whole else ''
            expected = f"; allowed is {whole}{lower:g} to {upper:g} {about['unit']}".rstrip()
        else:
            is_allowed, expected = isinstance(value, bool), '; expected true or false'
        if not is_allowed:
            raise error(f'{prefix}{option.name}: {value!r}{expected}')
