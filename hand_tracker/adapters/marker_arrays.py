"""Write frames of points as serialized MarkerArrays, the tracker's input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..messages.marker_ids import ANONYMOUS_NAMESPACE, MOST_MARKERS, HandIds, MarkerIds
from ..messages.stamps import Time
from ..messages.templates import Template, markers_template
from .packet_structure import PacketOrigin
from .point_frame import SourceFrame

POINTS_STEP = 8               # anonymous points by which a message grows


class MarkerArrayWriter:
    """Write frames of points as serialized MarkerArrays of one layout.

    A marker has the namespace and the id of `MarkerIds`. Names that were seen once
    stay in all later messages, as do places for as many anonymous points as there ever were, NaN
    where empty: the tracker's fast path takes messages of the same layout as the last.

    Parameters
    ----------
    warn_once : callable
        Logs a warning (key, text) once for each key.
    ids : callable, optional
        Of the hand's markers, see `MarkerIds`.

    Attributes
    ----------
    template : Template
        With the last message.
    """

    def __init__(self, warn_once: Callable[[str, str], None],
                 ids: HandIds | None = None) -> None:
        self._ids = MarkerIds(warn_once, ids)
        self._capacity = 0
        self._layout: tuple[str, tuple[str, ...]] | None = None

    def write(self, frame: SourceFrame, stamp: Time) -> bytes:
        """Return the message of a frame.

        Parameters
        ----------
        frame : SourceFrame
        stamp : Time
            Of the message.
        """
        count = len(frame.points)
        if count > MOST_MARKERS:
            self._ids.warn_of_points(count)
            count = MOST_MARKERS
        if (frame.frame_id, frame.names) != self._layout or count > self._capacity:
            self._prepare(frame, count)
        self._numbers.fill(np.nan)
        self._numbers[self._places] = frame.markers[self._taken]
        first = len(self._ids.rows)
        self._numbers[first:first + count] = frame.points[:count]
        return self.template.fill(stamp, self._numbers)

    def rows(self, origin: PacketOrigin) -> tuple[PacketOrigin, np.ndarray, np.ndarray]:
        """Return the origin of the markers that the last message has, and their rows in it.

        Parameters
        ----------
        origin : PacketOrigin
            Of its frame.

        Returns
        -------
        origin : PacketOrigin
            Of the markers that count.
        markers, points : ndarray of int
            The message's markers that these are, and its places for anonymous points.
        """
        return (origin.of_rows(self._taken.tolist()), self._places,
                np.arange(len(self._ids.rows), len(self.template.numbers) // 3))

    def _prepare(self, frame: SourceFrame, count: int) -> None:
        self._layout = frame.frame_id, frame.names
        self._capacity = max(self._capacity, -(-count // POINTS_STEP) * POINTS_STEP)
        taken, rows = self._ids.add(frame.names), self._ids.rows
        self._taken = np.array(taken, int)
        self._places = np.array([rows[frame.names[row]] for row in taken], int)
        markers = self._ids.labels()
        markers += [(ANONYMOUS_NAMESPACE, self._ids.anonymous_id(number))
                    for number in range(self._capacity)]
        self.template: Template = markers_template(frame.frame_id, markers)
        self._numbers = np.empty((len(markers), 3))
