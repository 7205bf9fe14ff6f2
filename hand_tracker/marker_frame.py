"""A message of markers to arrays, without ROS.

Messages of rclpy and of rosbags serve alike: they have the same fields. A message is one
frame: what it does not hold was not seen.
"""

from typing import NamedTuple

import numpy as np

from .core.layout import MARKERS

# Constants of visualization_msgs/msg/Marker.
ADD = 0
CUBE, SPHERE, CYLINDER, CUBE_LIST, SPHERE_LIST, POINTS = 1, 2, 3, 6, 7, 8

POINT_TYPES = frozenset((CUBE, SPHERE, CYLINDER))
LIST_TYPES = frozenset((CUBE_LIST, SPHERE_LIST, POINTS))
MISSING = (np.nan,) * 3
REPORTED = 8  # causes of each kind that a frame names, however hostile the message


class MarkerFrame(NamedTuple):
    """What a MarkerArray says of the hand.

    Attributes
    ----------
    stamp : Time or None
        Of the first marker of the hand; None when the message has none of its markers.
    frame_id : str
        The markers' frame.
    positions : ndarray, shape (8, 3)
        In the order of `MARKERS`, NaN where not seen [m].
    unknown : tuple of (str, int)
        Some of the point-like markers, by namespace and id, that no label names.
    foreign : tuple of str
        Frames of markers that were left out because their frame is another.
    doubled : tuple of int
        Markers, by their place in `MARKERS`, to which several of the message answer.
    """

    stamp: object
    frame_id: str
    positions: np.ndarray
    unknown: tuple
    foreign: tuple
    doubled: tuple


def markers_from_message(message, labels, frame_id='', scale=1., zero_is_missing=True):
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
        Metres per unit of the message.
    zero_is_missing : bool, optional
        Whether a marker at exactly (0, 0, 0) is one that the driver lost.

    Returns
    -------
    MarkerFrame
    """
    rows = [MISSING] * len(MARKERS)
    stamp, found, unknown, foreign, doubled = None, set(), set(), set(), set()
    for marker in message.markers:
        if marker.action != ADD:
            continue
        if marker.type in POINT_TYPES:
            at = marker.pose.position
            points = ((marker.id, (at.x, at.y, at.z)),)
        elif marker.type in LIST_TYPES:
            points = enumerate(_list_points(marker, zero_is_missing))
        else:
            continue
        for number, point in points:
            slot = labels.slot(marker.ns, number)
            if slot is None:
                if len(unknown) < REPORTED:
                    unknown.add((marker.ns, number))
                continue
            own = marker.header.frame_id
            frame_id = frame_id or own
            if own and own != frame_id:
                if len(foreign) < REPORTED:
                    foreign.add(own)
                continue
            if stamp is None:
                stamp = marker.header.stamp
            if slot in found:
                doubled.add(slot)
            found.add(slot)
            rows[slot] = MISSING if zero_is_missing and not any(point) else point
    return MarkerFrame(stamp, frame_id, np.array(rows) * scale, tuple(sorted(unknown)),
                       tuple(sorted(foreign)), tuple(sorted(doubled)))


def seconds(stamp):
    """Return a stamp as one number, None for the zero of a driver or clock that has no time.

    Parameters
    ----------
    stamp : Time

    Returns
    -------
    float or None
        [s]
    """
    return stamp.sec + 1e-9 * stamp.nanosec or None


def _list_points(marker, zero_is_missing):
    """Return the points of a list marker in its header's frame."""
    points = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)
    if zero_is_missing:
        points[~points.any(axis=1)] = np.nan
    at, turn = marker.pose.position, marker.pose.orientation
    w, v = turn.w, np.array((turn.x, turn.y, turn.z))
    norm = w * w + v @ v
    # RViz takes a quaternion of zeros for no rotation.
    if norm > 0.:
        cross = np.cross(v, points)
        points = points + 2. / norm * (w * cross + np.cross(v, cross))
    return [tuple(point) for point in (points + (at.x, at.y, at.z)).tolist()]
