"""All points of a message, whatever their labels: a cloud of points. No ROS."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from .cdr import MarkerReader, PointMarker
from .labels import LabelMap
from .marker_array import ADD, LIST_TYPES, POINT_TYPES, placed, scaled
from .message_kinds import MARKER_ARRAY_KIND, MessageKind
from .stamps import Time

LABELS_KEPT = 4096  # namespaces and ids that are distinguished at most


class PointFrame(NamedTuple):
    """Points of a message.

    Attributes
    ----------
    stamp : Time or None
        Of the first point; None where the message has none.
    frame_id : str
        Their frame.
    points : ndarray, shape (n, 3)
        Those of other frames left out [m].
    ids : ndarray of int, shape (n,)
        A number for each namespace, id and place in a list.
    foreign : tuple of str
        Frames of points that were left out.
    """

    stamp: Time | None
    frame_id: str
    points: np.ndarray
    ids: np.ndarray
    foreign: tuple[str, ...]


class PointReader:
    """Read the points of messages of one kind, of bytes, or of MarkerArrays as objects.

    Parameters
    ----------
    frame_id, scale, zero_is_missing
        See `markers_from_message`.
    kind : MessageKind, optional
        MarkerArrays when left out.
    """

    def __init__(self, frame_id: str = '', scale: float = 1., zero_is_missing: bool = True,
                 kind: MessageKind = MARKER_ARRAY_KIND) -> None:
        self._frame_id, self._scale, self._zero_is_missing = frame_id, scale, zero_is_missing
        self._numbers: dict[tuple[str, int, int], int] = {}
        self._bytes = MarkerReader(LabelMap(), kind=kind)

    def read(self, message: Any) -> PointFrame:
        """Return the points of a message.

        Parameters
        ----------
        message : bytes or MarkerArray

        Returns
        -------
        PointFrame

        Raises
        ------
        MalformedMessage
            If the bytes are no such message.
        """
        frame_id, stamp = self._frame_id, None
        points: list[np.ndarray] = [np.empty((0, 3))]
        ids: list[int] = []
        foreign = set()
        for one in self._bytes.points(message) if isinstance(message, bytes) else of_object(
                message):
            frame_id = frame_id or one.frame_id
            if one.frame_id and one.frame_id != frame_id:
                foreign.add(one.frame_id)
                continue
            stamp = one.stamp if stamp is None else stamp
            here = one.position[None] if one.points is None else placed(
                one.points, one.position, one.orientation, self._zero_is_missing)
            points.append(scaled(here, self._scale, self._zero_is_missing))
            if len(self._numbers) + len(here) > LABELS_KEPT:
                self._numbers.clear()
            ids += [self._numbers.setdefault((one.ns, one.id, k), len(self._numbers))
                    for k in range(len(here))]
        return PointFrame(stamp, frame_id, np.concatenate(points), np.array(ids, dtype=int),
                          tuple(sorted(foreign)))


def of_object(message: Any) -> Iterator[PointMarker]:
    """Yield the point-like markers that a message object adds."""
    for marker in message.markers:
        if marker.action != ADD or marker.type not in POINT_TYPES | LIST_TYPES:
            continue
        at, turn = marker.pose.position, marker.pose.orientation
        listed = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)
        yield PointMarker(
            marker.header.stamp, marker.header.frame_id, marker.ns, marker.id,
            np.array((at.x, at.y, at.z)), np.array((turn.x, turn.y, turn.z, turn.w)),
            listed if marker.type in LIST_TYPES else None)
