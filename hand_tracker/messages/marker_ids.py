"""Ids of markers that a source knows by name, and of points without names.

They are what the tracker's parameters `labels.*` refer to: the namespace is the whole name, the id
that of the tracker's marker where the last part of the name says so. Of markers of both hands the
namespace is the side. No ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ..core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from .marker_array import ADD, DELETE, SPHERE, Head
from .point_cloud_parser import MOST_MARKERS

# Ids by which the tracker knows its markers, unless its parameters `labels.*` say otherwise: by
# the marker's name, or by that of the landmark it is at.
MARKER_IDS = {**{place: row for row, place in enumerate(PAPER_PLACES)},
              **{marker: row for row, marker in enumerate(MARKERS)}}
FIRST_FOREIGN_ID = 1000       # of markers that have none of these names, and of anonymous points
ANONYMOUS_NAMESPACE = 'unlabelled'
SOURCE_FRAME = 'mocap'        # of points whose source names no frame
# Returns the namespace, empty for the name itself, and the id of the hand's marker of a name; None
# for other names.
HandIds = Callable[[str], tuple[str, int] | None]


def ids_by_name(layout: MarkerLayout) -> Mapping[str, int]:
    """Return the ids of a layout's markers, as `MARKER_IDS`, by their names in small letters.

    Parameters
    ----------
    layout : MarkerLayout
        A marker goes also by the landmark that it alone is at.
    """
    if layout.names == MARKERS:
        return MARKER_IDS
    return {**{place: row for row, place in enumerate(layout.places)
               if layout.places.count(place) == 1},
            **{name.lower(): row for row, name in enumerate(layout.names)}}


def layout_ids(layout: MarkerLayout) -> HandIds:
    """Return the ids of the markers of one hand by the last part of their names.

    Parameters
    ----------
    layout : MarkerLayout
    """
    known = ids_by_name(layout)

    def find(name: str) -> tuple[str, int] | None:
        number = known.get(name.rpartition(':')[2].lower())
        return None if number is None else ('', number)

    return find


def no_warning(key: str, text: str) -> None:
    """Log nothing."""


class MarkerIds:
    """Ids of the named markers of one source; names that were seen once count in all later frames.

    Parameters
    ----------
    warn_once : callable
        Logs a warning (key, text) once for each key.
    find : callable, optional
        Finds the ids of the hand's markers, as `layout_ids`; of the paper's eight when left out.

    Attributes
    ----------
    rows : dict of str to int
        Place of each name, in the order in which they were first seen.
    """

    def __init__(self, warn_once: Callable[[str, str], None],
                 find: HandIds | None = None) -> None:
        self._warn_once, self._find = warn_once, find or layout_ids(MarkerLayout())
        self._found: list[tuple[str, int] | None] = []  # of each name
        self.rows: dict[str, int] = {}

    def add(self, names: Sequence[str]) -> list[int]:
        """Return which of a frame's names count: the first of each, of `MOST_MARKERS` in all."""
        taken, here = [], set()
        for place, name in enumerate(names):
            if name in here:
                self._warn_once('doubled', f"two markers of a frame are called '{name}'; "
                                           'the first is taken')
            elif name in self.rows or len(self.rows) < MOST_MARKERS:
                if name not in self.rows:
                    self.rows[name] = len(self.rows)
                    self._found.append(self._find(name))
                taken.append(place)
            here.add(name)
        return taken

    def labels(self) -> list[tuple[str, int]]:
        """Return namespace and id of each name; several that claim one of a hand do not get it."""
        labels = []
        for row, (name, label) in enumerate(zip(self.rows, self._found)):
            if label is not None and self._found.count(label) > 1:
                self._warn_once('subjects', f"'{name}' and others are called alike: none of them "
                                            'is taken for a marker of the hand; name one subject '
                                            '(subject) or set labels.*')
                label = None
            space, number = label or ('', FIRST_FOREIGN_ID + row)
            labels.append((space or name, number))
        return labels

    def anonymous_id(self, number: int) -> int:
        """Return the id of the anonymous point of a number."""
        return FIRST_FOREIGN_ID + len(self.rows) + number

    def heads(self, frame_id: str, names: Sequence[str | None]) -> list[Head]:
        """Return the heads of a frame's markers, of which those whose name is None are anonymous.

        Those that do not count, as those with an empty name, are deletions.
        """
        named = [place for place, name in enumerate(names) if name]
        kept = {named[k] for k in self.add([name for name in names if name])}
        labels = dict(zip(self.rows, self.labels()))
        heads: list[Head] = []
        anonymous = 0
        for place, name in enumerate(names):
            if name is None:
                label, counts = (ANONYMOUS_NAMESPACE, self.anonymous_id(anonymous)), (
                    anonymous < MOST_MARKERS)
                anonymous += 1
            else:
                label, counts = labels.get(name, (name, FIRST_FOREIGN_ID)), place in kept
            heads.append(Head(frame_id or SOURCE_FRAME, *label, SPHERE, ADD if counts else DELETE,
                              0))
        if anonymous >= MOST_MARKERS:
            self.warn_of_points(anonymous)
        return heads

    def warn_of_points(self, count: int) -> None:
        """Warn that a frame has too many anonymous points."""
        self._warn_once('points', f'{count} anonymous points in a frame; the first '
                                  f'{MOST_MARKERS} are taken')
