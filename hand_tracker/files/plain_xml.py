"""XML without a document type: entities can expand without end, or read other files."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from ..core.errors import HandTrackerError

MAX_XML_DEPTH = 100        # of elements in elements


class NotPlainXml(HandTrackerError, ValueError):
    """A text is no XML, has a document type or entities, or is nested too deeply."""


def parse_plain_xml(text: str) -> Element:
    """Return the root element of a text.

    Raises
    ------
    NotPlainXml
        If it is no XML, has a document type or entities, or is nested too deeply.
    """
    depth = 0

    def refuse(*_: object) -> None:
        raise NotPlainXml('has a document type or entities; expected plain XML')

    def begin(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_XML_DEPTH:
            raise NotPlainXml(f'elements are nested more than {MAX_XML_DEPTH} deep')

    def end(*_: object) -> None:
        nonlocal depth
        depth -= 1

    checker = expat.ParserCreate()
    checker.StartDoctypeDeclHandler = refuse
    checker.EntityDeclHandler = refuse
    checker.StartElementHandler = begin
    checker.EndElementHandler = end
    try:
        checker.Parse(text, True)
        # Declarations of an encoding are refused in texts that are decoded already.
        return ElementTree.fromstring(text.encode('utf-8'))
    except (expat.ExpatError, ElementTree.ParseError, UnicodeEncodeError) as error:
        raise NotPlainXml(f'not XML: {error}') from None
