"""Classes of messages by their types, where their packages are installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ..adapters.point_frame import SourceUnavailable
from ..messages.message_definitions import KNOWN_FIELDS
from ..messages.message_kinds import MessageKind


def imported_message(package: str, name: str) -> Any:
    """Return a message class.

    Raises
    ------
    SourceUnavailable
        If its package is not installed.
    """
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except ImportError:
        raise SourceUnavailable(
            f'{package} is not installed: it has the messages {package}/{name} of this source. '
            'Build it in your workspace, or install its package for your ROS 2') from None


def class_of(kind: MessageKind) -> Any:
    """Return the class of a kind of messages.

    Raises
    ------
    SourceUnavailable
        If its package is not installed, or defines these messages otherwise than the parser knows.
    """
    package, _, name = kind.type.split('/')
    for part, fields in KNOWN_FIELDS.get(kind.type, {}).items():
        here = imported_message(package, part).get_fields_and_field_types()
        if list(here.items()) != list(fields.items()):
            raise SourceUnavailable(
                f'{package}/{part} has other fields here than the tracker knows: '
                f'{", ".join(map(" ".join, here.items()))}; start a source node, which takes them '
                'by name')
    return imported_message(package, name)
