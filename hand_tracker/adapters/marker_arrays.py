"""Write frames of points as serialized MarkerArrays, the tracker's input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.model.marker_layout import MARKERS, PAPER_PLACES
from ..messages.stamps import Time
from ..messages.templates import Template, markers_template
from .point_frame import PointFrame

# Ids by which the tracker knows its markers, unless its parameters `labels.*` say otherwise: by
# the marker's name, or by that of the landmark it is at.
MARKER_IDS = {**{place: row for row, place in enumerate(PAPER_PLACES)},
              **{marker: row for row, marker in enumerate(MARKERS)}}
FIRST_FOREIGN_ID = 1000       # of markers that have none of these names, and of anonymous points
ANONYMOUS_NAMESPACE = 'unlabelled'
POINTS_STEP = 8               # anonymous points by which a message grows
MOST_MARKERS = 1000           # of a message


class MarkerArrayWriter:
    """Write frames of points as serialized MarkerArrays of one layout.

    A marker has its whole name as namespace; its id is that of `MARKER_IDS` where the last part of
    its name is there. Names that were seen once stay in all later messages, as do places for as
    many anonymous points as there ever were, NaN where empty: the tracker's fast path takes
    messages of the same layout as the last.

    Parameters
    ----------
    warn_once : callable
        Logs a warning (key, text) once for each key.
    """

    def __init__(self, warn_once: Callable[[str, str], None]) -> None:
        self._warn_once = warn_once
        self._rows: dict[str, int] = {}
        self._capacity = 0
        self._layout: tuple[str, tuple[str, ...]] | None = None

    def write(self, frame: PointFrame, stamp: Time) -> bytes:
        """Return the message of a frame.

        Parameters
        ----------
        frame : PointFrame
        stamp : Time
            Of the message.
        """
        count = len(frame.points)
        if count > MOST_MARKERS:
            self._warn_once('points', f'{count} anonymous points in a frame; the first '
                                      f'{MOST_MARKERS} are taken')
            count = MOST_MARKERS
        if (frame.frame_id, frame.names) != self._layout or count > self._capacity:
            self._prepare(frame, count)
        self._numbers.fill(np.nan)
        self._numbers[self._places] = frame.markers[self._taken]
        first = len(self._rows)
        self._numbers[first:first + count] = frame.points[:count]
        return self._template.fill(stamp, self._numbers)

    def _prepare(self, frame: PointFrame, count: int) -> None:
        self._layout = frame.frame_id, frame.names
        self._capacity = max(self._capacity, -(-count // POINTS_STEP) * POINTS_STEP)
        taken = []
        for row, name in enumerate(frame.names):
            if name in frame.names[:row]:
                self._warn_once('doubled', f"two markers of a frame are called '{name}'; "
                                           'the first is taken')
            elif name in self._rows or len(self._rows) < MOST_MARKERS:
                self._rows.setdefault(name, len(self._rows))
                taken.append(row)
        self._taken = np.array(taken, int)
        self._places = np.array([self._rows[frame.names[row]] for row in taken], int)
        markers = [(name, number) for name, number in zip(self._rows, self._ids())]
        markers += [(ANONYMOUS_NAMESPACE, FIRST_FOREIGN_ID + len(self._rows) + number)
                    for number in range(self._capacity)]
        self._template: Template = markers_template(frame.frame_id, markers)
        self._numbers = np.empty((len(markers), 3))

    def _ids(self) -> list[int]:
        """Return the id of each marker; a hand's own go to no marker where several claim one."""
        own = [MARKER_IDS.get(name.rpartition(':')[2].lower()) for name in self._rows]
        ids = []
        for row, (name, number) in enumerate(zip(self._rows, own)):
            if number is not None and own.count(number) > 1:
                self._warn_once('subjects', f"'{name}' and others are called alike: none of them "
                                            'is taken for a marker of the hand; name one subject '
                                            '(subject) or set labels.*')
                number = None
            ids.append(FIRST_FOREIGN_ID + row if number is None else number)
        return ids
