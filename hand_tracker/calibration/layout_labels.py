"""Match the labels of a recording to the markers of a layout."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import SIDES
from ..core.model.marker_layout import MarkerLayout
from .hand_axes import labelled_hands
from .hand_labels import literal_spellings, spellings
from .layout_names import NEAR_LANDMARK

NOT_THERE = -1


class PointNames(NamedTuple):
    """Columns of points by the names that their labels have without a side.

    Attributes
    ----------
    own, landmarks : mapping of str to mapping of str to int
        By side, empty for labels that say none: names as of `spellings`, and landmarks as of
        `labelled_hands`.
    literal : mapping of str to mapping of str to int
        By the side in front, set off by a separator: the rest of the label in small letters; by an
        empty side: the whole.
    """

    own: Mapping[str, Mapping[str, int]]
    landmarks: Mapping[str, Mapping[str, int]]
    literal: Mapping[str, Mapping[str, int]]


class LabelledLayout(NamedTuple):
    """Markers of a layout among the points of a recording.

    Attributes
    ----------
    columns : tuple of int
        Of the points, in the order of the layout; -1 where none is the marker.
    side : str
        Of the hand, as the labels say; empty where they do not.
    """

    columns: tuple[int, ...]
    side: str

    @property
    def found(self) -> set[int]:
        """Columns of the markers that are there."""
        return {column for column in self.columns if column != NOT_THERE}


def point_names(labels: Sequence[str], is_landmarks: bool = False) -> PointNames:
    """Return the names of points by their labels.

    Parameters
    ----------
    labels : sequence of str
        Empty for points without one.
    is_landmarks : bool, optional
        See `labelled_hands`.

    Returns
    -------
    PointNames
    """
    own: dict[str, dict[str, int]] = {side: {} for side in ('', *SIDES)}
    literal: dict[str, dict[str, int]] = {side: {} for side in ('', *SIDES)}
    for column, label in enumerate(labels):
        for names, readings in ((own, spellings), (literal, literal_spellings)):
            for side, name in readings(label) if label else ():
                names[side].setdefault(name, column)
    return PointNames(
        own, {hand.side: hand.columns for hand in labelled_hands(labels, is_landmarks)}, literal)


def labelled_layout(names: PointNames, layout: MarkerLayout,
                    side: str | None = None) -> LabelledLayout:
    """Find the markers of a layout by the names of points.

    Parameters
    ----------
    names : PointNames
    layout : MarkerLayout
    side : {'right', 'left'}, optional
        Of the hand; the one with more of the markers when left out.

    Returns
    -------
    LabelledLayout
        A marker is found by its own name, in any spelling and with a side in front, but word for
        word where only some names begin with the letter of a side; else, if it is
        the one at a landmark, by that landmark's; else several at a landmark by its numbered
        names, as wrist_1 and wrist_2.
    """
    found = []
    # 'RNG6', say, may also be read as a right hand's 'NG6'.
    without_side = _columns(layout, *(of.get('', {}) for of in names))
    for one in (side,) if side else SIDES:
        columns = _columns(layout, *({**of.get('', {}), **of.get(one, {})} for of in names))
        found.append(LabelledLayout(columns, '' if columns == without_side else one))
    return max(found, key=lambda match: len(match.found))


def _columns(layout: MarkerLayout, own: Mapping[str, int], landmarks: Mapping[str, int],
             literal: Mapping[str, int]) -> tuple[int, ...]:
    """Return the column of each marker by the names of a hand's points, -1 for none."""
    readings = [spellings(name)[0] for name in layout.names]
    # A letter in front of some names only, as r1 and l1 beside i1, is no side.
    letters_are_no_side = len({side for side, _ in readings}) > 1
    columns = [literal.get(name.lower(), NOT_THERE) if side and letters_are_no_side
               else own.get(rest, NOT_THERE)
               for name, (side, rest) in zip(layout.names, readings)]
    for place in dict.fromkeys(layout.places):
        rows = [row for row, other in enumerate(layout.places) if other == place]
        numbered = [landmarks.get(f'{place}_{number}', NOT_THERE)
                    for number in range(1, len(rows) + 1)]
        if (len(rows) > 1 and NOT_THERE not in numbered
                and all(columns[row] == NOT_THERE for row in rows)):
            for row, column in zip(rows, numbered):
                columns[row] = column
            continue
        nearest = min(rows, key=lambda row: float(np.linalg.norm(layout.offsets[row])))
        column = landmarks.get(place, NOT_THERE)
        if (columns[nearest] == NOT_THERE and column not in columns
                and np.linalg.norm(layout.offsets[nearest]) < NEAR_LANDMARK):
            columns[nearest] = column
    return tuple(columns)
