"""Marker names: landmark and link of each marker."""

import re
from typing import NamedTuple

from ..core.model.hand import DIGITS
from ..core.model.marker_layout import LANDMARKS_OF_DIGIT, MARKERS, PAPER_PLACES

ON_PALM = -1
SYNONYMS = {'pinky': 'little', 'pinkie': 'little', 'small': 'little', 'fore': 'index',
            'knuckle': 'mcp', 'end': 'tip', 'carpus': 'wrist'}
LABEL_SIDES = {'right': 'right', 'left': 'left', 'r': 'right', 'l': 'left'}
WORD_GAP = r'(?<=[a-z])(?=[A-Z0-9])'    # between words without a separator


class NamedMarker(NamedTuple):
    """A marker of a take.

    Attributes
    ----------
    name : str
        As 'index_pip'; of markers at no landmark as in the file.
    digit : int
        0 to 4, index finger to thumb; -1 on the palm.
    link : int
        0 to 2 behind the digit's root; -1 is the palm.
    """

    name: str
    digit: int
    link: int


class UsualPlace(NamedTuple):
    """Offset of a palm marker that is at no landmark.

    Attributes
    ----------
    landmark : str
    offset : tuple of three float
        From it, in the wrist's frame of a right hand [m].
    """

    landmark: str
    offset: tuple[float, float, float]


def usual_words(text: str, gap: str = WORD_GAP) -> list[str]:
    """Return the usual words of a label; `gap` matches where one begins without a separator."""
    spaced = re.sub(gap, '_', text.strip()).lower()
    return [SYNONYMS.get(word, word) for word in re.split(r'[\W_]+', spaced) if word]


def canonical_name(text: str) -> str:
    """Return a marker's name in words with underscores: 'ThumbCMC' becomes 'thumb_cmc'."""
    found = usual_words(text)
    if len(found) > 1:
        # A side says nothing of the place: 'right_index_tip', 'R_Index_Tip'.
        found = [word for i, word in enumerate(found) if i or word not in LABEL_SIDES]
    name = '_'.join(found)
    return PAPER_PLACES[MARKERS.index(name)] if name in MARKERS else name


def identify(names: tuple[str, ...]) -> list[NamedMarker | None]:
    """Return the meaning of each name, None for other markers.

    Parameters
    ----------
    names : tuple of str
        In any usual spelling.

    Returns
    -------
    list of NamedMarker or None
    """
    return [_identified(canonical_name(name)) for name in names]


def riding(marker: NamedMarker) -> NamedMarker:
    """Return a knuckle that moves in the palm as a marker of its digit's first bone."""
    digit, _, landmark = marker.name.partition('_')
    if digit in DIGITS and landmark in ('mcp', 'cmc'):
        return NamedMarker(marker.name, DIGITS.index(digit), 0)
    return marker


def is_knuckle(marker: NamedMarker) -> bool:
    """Return whether a marker on a digit is near the root of its first bone."""
    digit, _, landmark = marker.name.partition('_')
    return marker.link == 0 and landmark == ('cmc' if digit == 'thumb' else 'mcp')


def _identified(name: str) -> NamedMarker | None:
    digit, _, landmark = name.partition('_')
    if digit in DIGITS:
        row = DIGITS.index(digit)
        # Each at the end of the next link behind the digit's root.
        if name in LANDMARKS_OF_DIGIT[digit]:
            return NamedMarker(name, row, LANDMARKS_OF_DIGIT[digit].index(name))
        # A thumb's CMC lies in the palm; so do the knuckles.
        return NamedMarker(name, -1, ON_PALM) if landmark in ('mcp', 'cmc') else None
    if 'wrist' in name or re.match('(back|dorsum|palm|hand|metacarp)', name):
        return NamedMarker(name, -1, ON_PALM)
    return None
