"""Find the hand's markers in a MarkerArray: one message is one frame.

Messages of rclpy and of rosbags serve alike, as they have the same fields. A marker that the
message does not hold was not seen. No ROS.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .labels import LabelMap
from .stamps import Time

MARKER_ARRAY = 'visualization_msgs/msg/MarkerArray'
# Constants of visualization_msgs/msg/Marker.
ADD, DELETE = 0, 2
CUBE, SPHERE, CYLINDER, CUBE_LIST, SPHERE_LIST, POINTS, TRIANGLE_LIST = 1, 2, 3, 6, 7, 8, 11

POINT_TYPES = frozenset((CUBE, SPHERE, CYLINDER))
LIST_TYPES = frozenset((CUBE_LIST, SPHERE_LIST, POINTS))
REPORTED = 8  # causes of each kind that a frame names, however hostile the message


class MarkerFrame(NamedTuple):
    """The hand's markers in a MarkerArray.

    Attributes
    ----------
    stamp : Time or None
        Of the first marker of the hand; None when the message has none of its markers.
    frame_id : str
        The markers' frame.
    positions : ndarray, shape (n, 3)
        In the order of the labels, NaN where not seen [m].
    unknown : tuple of (str, int)
        Some of the point-like markers, by namespace and id, that no label names.
    foreign : tuple of str
        Frames of markers that were left out because their frame is another.
    doubled : tuple of int
        Markers, by their place among the labels, to which several of the message answer.
    searched : ndarray, shape (n, 3), or None
        Points without labels among which the hand was searched, NaN where one is not seen [m];
        None where they have labels.
    """

    stamp: Time | None
    frame_id: str
    positions: np.ndarray
    unknown: tuple[tuple[str, int], ...]
    foreign: tuple[str, ...]
    doubled: tuple[int, ...]
    searched: np.ndarray | None = None

    @property
    def points_seen(self) -> int:
        """Number of points without labels that are there; 0 where points have labels."""
        return 0 if self.searched is None else int(np.isfinite(self.searched).all(axis=1).sum())


class Head(NamedTuple):
    """Fields of a message's marker that identify it, or its points, as markers of the hand."""

    frame_id: str
    ns: str
    id: int
    type: int
    action: int
    points: int


class Sources(NamedTuple):
    """Places of the hand's markers in a message.

    Attributes
    ----------
    first : int or None
        Place in the message of the first marker of the hand, which has the stamp.
    slots, markers, points : ndarray of int, shape (n,)
        Place among the labels, place of the marker in the message, and of the point in the
        marker's list, -1 for the marker itself.
    has_lists : bool
        Whether any of them is the point of a list.
    frame_id, unknown, foreign, doubled
        See `MarkerFrame`.
    """

    first: int | None
    slots: np.ndarray
    markers: np.ndarray
    points: np.ndarray
    has_lists: bool
    frame_id: str
    unknown: tuple[tuple[str, int], ...]
    foreign: tuple[str, ...]
    doubled: tuple[int, ...]


def markers_from_message(message: Any, labels: LabelMap, frame_id: str = '', scale: float = 1.0,
                         zero_is_missing: bool = True) -> MarkerFrame:
    """Return the frame of markers that a message holds.

    Only what the message adds counts, and of that only what is a point: spheres, cubes and
    cylinders by their id, and the points of their lists by their index. The last of several
    that answer to one label wins, as in RViz. A marker with no frame is in the frame asked for.

    Parameters
    ----------
    message : MarkerArray
    labels : LabelMap
    frame_id : str, optional
        Frame of the markers that count; that of the message's first marker of the hand
        when empty.
    scale : float, optional
        Of the message's unit [m].
    zero_is_missing : bool, optional
        Whether a marker at exactly (0, 0, 0) is one that the driver lost.

    Returns
    -------
    MarkerFrame
    """
    heads = [Head(marker.header.frame_id, marker.ns, marker.id, marker.type, marker.action,
                  len(marker.points) if marker.type in LIST_TYPES else 0)
             for marker in message.markers]
    sources = find_sources(heads, labels, frame_id)
    rows = np.full((len(labels.labels), 3), np.nan)
    lists = {}
    for slot, number, point in zip(sources.slots, sources.markers, sources.points):
        marker = message.markers[number]
        at = marker.pose.position
        if point < 0:
            rows[slot] = at.x, at.y, at.z
            continue
        if number not in lists:
            turn = marker.pose.orientation
            lists[number] = placed(
                np.array([(p.x, p.y, p.z) for p in marker.points]), (at.x, at.y, at.z),
                (turn.x, turn.y, turn.z, turn.w), zero_is_missing)
        rows[slot] = lists[number][point]
    stamp = None if sources.first is None else message.markers[sources.first].header.stamp
    return MarkerFrame(stamp, sources.frame_id, scaled(rows, scale, zero_is_missing),
                       sources.unknown, sources.foreign, sources.doubled)


def find_sources(heads: Iterable[Head], labels: LabelMap, frame_id: str) -> Sources:
    """Find the hand's markers in a message.

    Parameters
    ----------
    heads : iterable of Head
    labels, frame_id
        See `markers_from_message`.

    Returns
    -------
    Sources
    """
    first: int | None = None
    found: dict[int, tuple[int, int]] = {}
    unknown: set[tuple[str, int]] = set()
    of_other: set[tuple[str, int]] = set()  # of all such markers the first
    foreign: set[str] = set()
    doubled: set[int] = set()
    for place, (own, ns, number, kind, action, count) in enumerate(heads):
        if action != ADD:
            continue
        if kind in POINT_TYPES:
            points: Iterable[tuple[int, int]] = ((number, -1),)
        elif kind in LIST_TYPES:
            points = zip(range(count), range(count))
        else:
            continue
        for number, point in points:
            slot = labels.slot(ns, number)
            if slot is None:
                if ns and ns == labels.not_of:
                    of_other = of_other or {(ns, number)}
                elif len(unknown) < REPORTED and not labels.is_of_other_hand(ns, number):
                    unknown.add((ns, number))
                continue
            frame_id = frame_id or own
            if own and own != frame_id:
                if len(foreign) < REPORTED:
                    foreign.add(own)
                continue
            if first is None:
                first = place
            if slot in found:
                doubled.add(slot)
            found[slot] = place, point
    places = np.array([(slot, *where) for slot, where in found.items()], int).reshape(-1, 3)
    # Contiguous: kernels are compiled for that.
    slots, markers, in_list = np.ascontiguousarray(places.T)
    return Sources(first, slots, markers, in_list, bool((in_list >= 0).any()), frame_id,
                   tuple(sorted(unknown | of_other)), tuple(sorted(foreign)),
                   tuple(sorted(doubled)))


def placed(points: np.ndarray, position: ArrayLike, orientation: ArrayLike,
           zero_is_missing: bool) -> np.ndarray:
    """Return the points of a list marker in its header's frame.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    position : sequence of float, shape (3,)
        Of the marker.
    orientation : sequence of float, shape (4,)
        Of the marker: x, y, z, w of any length.
    zero_is_missing : bool

    Returns
    -------
    ndarray, shape (n, 3)
        NaN where a point is missing.
    """
    if zero_is_missing:
        points = _zeros_as_nan(points)
    turn = np.asarray(orientation, dtype=float)
    # RViz takes a quaternion of zeros for no rotation.
    if 0. < (greatest := np.abs(turn).max()) < np.inf:
        turn = turn / greatest  # of any length: its square may be no float
        w, v = turn[3], turn[:3]
        cross = np.cross(v, points)
        points = points + 2. / (w * w + v @ v) * (w * cross + np.cross(v, cross))
    return points + np.asarray(position)


def scaled(positions: np.ndarray, scale: float, zero_is_missing: bool) -> np.ndarray:
    """Return the positions of markers in metres, NaN for those that are missing.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
    scale, zero_is_missing
        See `markers_from_message`.

    Returns
    -------
    ndarray, shape (n, 3)
        [m]
    """
    if zero_is_missing:
        positions = _zeros_as_nan(positions)
    return positions * scale


def _zeros_as_nan(points: np.ndarray) -> np.ndarray:
    """Return points (n, 3) with NaN for those at exactly (0, 0, 0)."""
    return np.where((points == 0.).all(axis=1, keepdims=True), np.nan, points)
