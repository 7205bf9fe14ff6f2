"""Kinds of messages of points that the tracker takes as they are, and how their points are named.

No ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..core.errors import HandTrackerError
from .marker_array import ADD, MARKER_ARRAY, Head
from .marker_ids import MarkerIds
from .mocap4r2_parser import AS_BEFORE

# Numbers of the parsers.
(PARSE_MARKER_ARRAY, PARSE_MARKERS, PARSE_RIGID_BODIES, PARSE_POSE_ARRAY, PARSE_CLOUD,
 PARSE_NAMED_POSES, PARSE_LANDMARK_MARKERS) = range(7)

HeadRows = Sequence[Sequence[int]]
PointNames = list[str | None]


class MalformedMessage(HandTrackerError, ValueError):
    """Bytes that are no message of the expected type."""


class MessageKind(NamedTuple):
    """Kind of messages of points.

    Attributes
    ----------
    type : str
        Of the messages, such as 'geometry_msgs/msg/PoseArray'.
    parser : int
        Number of its parser, see `parse_points`.
    names : callable or None
        Returns the frame, and the name of each point, None of one without and '' of one that does
        not count, for the heads and strings that the parser has found; None where heads have
        namespaces and ids.
    note : str
        What else is expected of such a message, for errors.
    """

    type: str
    parser: int
    names: Callable[[HeadRows, bytes], tuple[str, PointNames]] | None = None
    note: str = ''

    @property
    def title(self) -> str:
        """The type without its package, and what is taken of it."""
        return self.type.rpartition('/')[2] + self.note

    def heads(self, rows: HeadRows, strings: bytes, ids: MarkerIds) -> list[Head]:
        """Return the heads of a message's points.

        Parameters
        ----------
        rows : sequence of sequence of int
            Heads as the parser has found them.
        strings : bytes
        ids : MarkerIds
            Of the source; names that are new are added.

        Raises
        ------
        MalformedMessage
            If there are others in number than expected.
        """
        if self.names is None:
            return _labelled_heads(rows, strings)
        return ids.heads(*self.names(rows, strings)) if rows else []


def texts_of(strings: bytes, lengths: Sequence[int]) -> list[str]:
    """Return strings of CDR, one after the other, as rclpy does: each up to its first NUL."""
    texts, at = [], 0
    for length in lengths:
        texts.append(strings[at:at + length].partition(b'\0')[0].decode(errors='replace'))
        at += length
    return texts


def _labelled_heads(rows: HeadRows, strings: bytes) -> list[Head]:
    texts = iter(texts_of(strings, [length for row in rows for length in row[:2]]))
    return [Head(next(texts), next(texts), number, kind, ADD, points)
            for _, _, number, kind, points in rows]


def _marker_names(rows: HeadRows, strings: bytes) -> tuple[str, PointNames]:
    """Return the frame and the names of a Markers message's markers.

    One with an index alone has none: drivers number the markers of each frame anew.
    """
    frame_id, *names = texts_of(strings, [rows[0][0], *(row[4] for row in rows)])
    return frame_id, [name if row[4] else None for name, row in zip(names, rows)]


def _body_names(rows: HeadRows, strings: bytes) -> tuple[str, PointNames]:
    """Return the frame and the names, 'body:marker', of a RigidBodies message's markers.

    Within a body an index, too, is the same marker in each frame: 'body:3'.
    """
    lengths = [length for row in rows for length in (row[1], row[4]) if length != AS_BEFORE]
    texts = iter(texts_of(strings, [rows[0][0], *lengths]))
    frame_id, body = next(texts), ''
    names: PointNames = []
    for _, body_length, index, _, length in rows:
        body = body if body_length == AS_BEFORE else next(texts)
        name = next(texts)
        names.append(f'{body}:{name if length else index}')
    return frame_id, names


def _no_names(rows: HeadRows, strings: bytes) -> tuple[str, PointNames]:
    """Return the frame of points without names."""
    return texts_of(strings, [rows[0][0]])[0], [None] * len(rows)


MARKER_ARRAY_KIND = MessageKind(MARKER_ARRAY, PARSE_MARKER_ARRAY)
MOCAP4R2_MARKERS = MessageKind('mocap4r2_msgs/msg/Markers', PARSE_MARKERS, _marker_names)
RIGID_BODIES = MessageKind('mocap4r2_msgs/msg/RigidBodies', PARSE_RIGID_BODIES, _body_names)
POINT_CLOUD = MessageKind('sensor_msgs/msg/PointCloud2', PARSE_CLOUD, _no_names,
                          ' with x, y and z in range of its sizes')
