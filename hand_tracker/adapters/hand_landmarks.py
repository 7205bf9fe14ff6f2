"""Landmarks of a hand, as cameras and headsets estimate them, as named points, and their checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import FINGERS
from ..messages.cdr import PointMarker
from ..messages.landmark_kinds import (
    LANDMARK_ORDERS,
    OTHER_COUNT,
    OTHER_COUNTS,
    sided_landmark,
)
from ..messages.landmark_parsers import BESIDE_ORIGIN
from .point_frame import MalformedFrame, SourceFrame, SourceUnavailable, point_frame

PALM_LENGTHS = .04, .16  # [m] from wrist to middle MCP, of any hand
CURLED = .15             # of the palm's length, by which finger tips are in front of it [1]
SIDE_FRAMES = 30         # that agree on a side before it is logged


def landmark_order(count: int) -> tuple[str, ...]:
    """Return the names of as many landmarks, in their order.

    Raises
    ------
    SourceUnavailable
        If no hand has as many.
    """
    if count not in LANDMARK_ORDERS:
        raise SourceUnavailable(f'landmarks: {count}; expected one of '
                                f'{", ".join(map(str, LANDMARK_ORDERS))}')
    return LANDMARK_ORDERS[count]


def named_landmarks(message: Any, side: str) -> SourceFrame:
    """Return the landmarks of one hand of a NamedPoseArray.

    Parameters
    ----------
    message : teleop_ros2_interfaces/NamedPoseArray
    side : {'right', 'left'}

    Returns
    -------
    SourceFrame
        NaN where `is_valid` is false, or several are at exactly (0, 0, 0).

    Raises
    ------
    MalformedFrame
        If names, poses and validity are not equally many, or none is of this side.
    """
    counts = len(message.name), len(message.pose), len(message.is_valid)
    if len(set(counts)) > 1:
        raise MalformedFrame(OTHER_COUNTS.format(*counts))
    points = {row: _position(pose) if is_valid else (np.nan,) * 3 for row, (pose, is_valid)
              in enumerate(zip(message.pose, message.is_valid))
              if message.name[row].lower().startswith(f'{side}_')}
    names = [sided_landmark(message.name[row])[1] for row in points]
    if not any(names):
        raise MalformedFrame(f"NamedPoseArray: no name like '{side}_INDEX_TIP' among "
                             f"{', '.join(message.name[:3]) or 'none'}, ...")
    places = mark_missing(list(points.values()))
    taken = [row for row, name in enumerate(names) if name]
    return point_frame(message.header.stamp, message.header.frame_id,
                       [names[row] for row in taken], places[taken])


def landmarks_of_poses(message: Any) -> SourceFrame:
    """Return the landmarks of a PoseArray, by their number.

    Parameters
    ----------
    message : geometry_msgs/PoseArray
        Of 21, 25 or 26 poses.

    Returns
    -------
    SourceFrame
        NaN where a pose has no finite place, or several are at exactly (0, 0, 0).

    Raises
    ------
    MalformedFrame
        If there are others in number.
    """
    names = LANDMARK_ORDERS.get(len(message.poses))
    if names is None:
        raise MalformedFrame(OTHER_COUNT.format(len(message.poses)))
    points = mark_missing([_position(pose) for pose in message.poses])
    return point_frame(message.header.stamp, message.header.frame_id, names, points)


def landmarks_of_markers(message: Any, count: int) -> SourceFrame:
    """Return the landmarks of a MarkerArray: a marker's id is the landmark's number.

    Parameters
    ----------
    message : visualization_msgs/MarkerArray
    count : int
        Of the landmarks, a key of `LANDMARK_ORDERS`: those not seen may be absent.

    Returns
    -------
    SourceFrame
        NaN where a landmark is absent, or several are at exactly (0, 0, 0).

    Raises
    ------
    MalformedFrame
        If no marker has the id of a landmark.
    """
    names = LANDMARK_ORDERS[count]
    points, header = np.full((count, 3), np.nan), None
    for marker in message.markers:
        if marker.action == marker.ADD and 0 <= marker.id < count and marker.type in (
                marker.SPHERE, marker.CUBE, marker.CYLINDER):
            points[marker.id] = _position(marker.pose)
            header = header or marker.header
    if header is None:
        raise MalformedFrame(f'MarkerArray of {len(message.markers)} markers; expected spheres '
                             f'with the ids 0 to {count - 1} of landmarks')
    return point_frame(header.stamp, header.frame_id, names, mark_missing(points))


def _position(pose: Any) -> tuple[float, float, float]:
    return pose.position.x, pose.position.y, pose.position.z


def mark_missing(points: ArrayLike) -> np.ndarray:
    """Return points with NaN in place of several at exactly (0, 0, 0); a single one is kept.

    A single one is the origin of its source. It is moved by a nanometre, as markers at exactly
    zero count as lost.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Of one hand.
    """
    found = np.array(points, float)
    # Not `any`, which warns of signalling NaN.
    at_origin = (found == 0.).all(axis=1)
    found[at_origin] = np.nan if at_origin.sum() > 1 else (BESIDE_ORIGIN, 0., 0.)
    return found


def named_points(points: Iterable[PointMarker]) -> SourceFrame:
    """Return the points of a message in a frame, by the names that are their namespaces."""
    found = list(points)
    return point_frame(found[0].stamp if found else None, found[0].frame_id if found else '',
                       [one.ns for one in found], [one.position for one in found])


class LandmarkChecks:
    """Warn of landmarks of the other hand, and of landmarks in another unit than metres.

    Parameters
    ----------
    side : {'right', 'left'}
        Side that is tracked.
    warn_once : callable
        Logs a warning (key, text) once for each key.
    """

    def __init__(self, side: str, warn_once: Callable[[str, str], None]) -> None:
        self._side, self._warn_once = side, warn_once
        self._votes = 0

    def check(self, frame: SourceFrame) -> None:
        """Take a frame into account."""
        points = dict(zip(frame.names, frame.markers))
        length = palm_length(points)
        if not PALM_LENGTHS[0] <= length <= PALM_LENGTHS[1]:  # False of NaN
            if np.isfinite(length):
                self._warn_once(
                    'length', f'from wrist to middle MCP the landmarks measure {length:.3g}; '
                    f'expected {PALM_LENGTHS[0]:g} to {PALM_LENGTHS[1]:g} m (of MediaPipe: its '
                    'world landmarks, not those in the image)')
            return
        side = side_of_landmarks(points)
        if side is None:
            return
        self._votes = max(-SIDE_FRAMES, min(
            SIDE_FRAMES, self._votes + (1 if side == self._side else -1)))
        if self._votes == -SIDE_FRAMES:
            self._warn_once('side', f'these landmarks bend as a {side} hand does, but side is '
                                    f'{self._side}: another hand, or a mirrored image')


def palm_length(points: dict[str, np.ndarray]) -> float:
    """Return the distance from wrist to middle MCP; NaN where not seen."""
    nowhere = np.full(3, np.nan)
    return float(np.linalg.norm(points.get('middle_mcp', nowhere) - points.get('wrist', nowhere)))


def side_of_landmarks(points: dict[str, np.ndarray]) -> str | None:
    """Return the side of a hand by the way its fingers bend.

    Parameters
    ----------
    points : dict of str to ndarray
        By the names of landmarks.

    Returns
    -------
    {'right', 'left'} or None
        None where they are too straight to tell, or the palm is not seen.
    """
    if not {'wrist', 'index_mcp', 'little_mcp'} <= points.keys():
        return None
    wrist = points['wrist']
    # Points out of the palm of a right hand, and out of the back of a left one.
    normal = np.cross(points['index_mcp'] - wrist, points['little_mcp'] - wrist)
    tips = [points[f'{finger}_tip'] - points[f'{finger}_mcp'] for finger in FINGERS
            if f'{finger}_tip' in points and f'{finger}_mcp' in points]
    heights = np.array(tips).reshape(-1, 3) @ normal
    heights = heights[np.isfinite(heights)]
    scale = np.linalg.norm(normal) * palm_length(points)
    if not len(heights) or not abs(heights.mean()) > CURLED * scale:
        return None
    return 'right' if heights.mean() > 0. else 'left'
