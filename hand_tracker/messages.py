"""Messages to arrays and arrays to messages: pure functions, no node.

A message is one frame: what it does not hold was not seen.
"""

import math
from array import array
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from .core.hand import DIGITS, JOINTS, LINKS, ROOT
from .core.layout import MARKERS

POINT_TYPES = frozenset((Marker.CUBE, Marker.SPHERE, Marker.CYLINDER))
LIST_TYPES = frozenset((Marker.CUBE_LIST, Marker.SPHERE_LIST, Marker.POINTS))
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

    stamp: Time
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
        if marker.action != Marker.ADD:
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


class Names(NamedTuple):
    """Names that one hand's messages use.

    Attributes
    ----------
    prefix : str
    joints, links : tuple of str
        25 each.
    tips : tuple of str
        Frames of the five tips.
    wrist : str
        Frame of the wrist.
    """

    prefix: str
    joints: tuple
    links: tuple
    tips: tuple
    wrist: str


def prefixed_names(prefix, wrist=None):
    """Return the names of a hand whose joints and frames begin with `prefix`.

    Parameters
    ----------
    prefix : str
    wrist : str, optional
        The wrist's frame, when it is not to be the URDF's root.

    Returns
    -------
    Names
    """
    return Names(
        prefix, *(tuple(prefix + name for name in names)
                  for names in (JOINTS, LINKS, [f'{digit}_tip' for digit in DIGITS])),
        prefix + ROOT if wrist is None else wrist)


def joint_state(stamp, names, angles):
    """Return the JointState of a hand.

    Parameters
    ----------
    stamp : Time
    names : Names
    angles : ndarray, shape (25,)
        [rad]

    Returns
    -------
    JointState
    """
    return JointState(header=Header(stamp=stamp), name=names.joints,
                      position=array('d', np.asarray(angles, dtype=float).tobytes()))


def quaternion(rotation):
    """Return a rotation matrix as a quaternion.

    Parameters
    ----------
    rotation : sequence of sequence of float, shape (3, 3)

    Returns
    -------
    tuple of float
        x, y, z, w of unit length, w not negative.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    # Rows of 4 q qᵀ: that of the greatest diagonal is q times a number far from zero.
    diagonal = (1. + xx - yy - zz, 1. - xx + yy - zz, 1. - xx - yy + zz, 1. + xx + yy + zz)
    greatest = diagonal.index(max(diagonal))
    x, y, z, w = (
        (diagonal[0], xy + yx, xz + zx, zy - yz), (xy + yx, diagonal[1], yz + zy, xz - zx),
        (xz + zx, yz + zy, diagonal[2], yx - xy), (zy - yz, xz - zx, yx - xy, diagonal[3]),
    )[greatest]
    norm = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    return x / norm, y / norm, z / norm, w / norm


def new_transforms(frames):
    """Return transforms for TF whose numbers are yet to be filled in.

    Parameters
    ----------
    frames : iterable of (str, str)
        Parent and child of each.

    Returns
    -------
    list of TransformStamped
    """
    messages = []
    for parent, child in frames:
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        messages.append(message)
    return messages


def fill_transforms(messages, stamp, rotation, position):
    """Fill transforms in place: building them anew costs ten times as much.

    Parameters
    ----------
    messages : list of TransformStamped, length n
    stamp : Time
    rotation : ndarray, shape (n, 3, 3)
        From each child's frame to its parent's.
    position : ndarray, shape (n, 3)
        Each child's origin in its parent's frame [m].
    """
    for message, turned, at in zip(messages, rotation.tolist(), position.tolist()):
        message.header.stamp = stamp
        transform = message.transform
        to, turn = transform.translation, transform.rotation
        to.x, to.y, to.z = at
        turn.x, turn.y, turn.z, turn.w = quaternion(turned)


def wrist_frames(names, frame_id):
    """Return (parent, child) of the wrist in the frame of the markers."""
    return ((frame_id, names.wrist),)


def link_frames(names, table):
    """Return (parent, child) of the 25 links, as the URDF has them."""
    parents = names.links + (names.wrist,)  # link -1 is the wrist
    return tuple((parents[parent], child) for parent, child in zip(table.parent, names.links))


def tip_frames(names):
    """Return (parent, child) of the five tips."""
    return tuple((f'{names.prefix}{digit}_distal', tip) for digit, tip in zip(DIGITS, names.tips))


def relative_pose(table, state):
    """Return the 25 links' frames in their parents'.

    Parameters
    ----------
    table : JointTable
        Of the tracked hand.
    state : HandState

    Returns
    -------
    rotation : ndarray, shape (25, 3, 3)
    position : ndarray, shape (25, 3)
        [m]
    """
    # Link -1, the wrist, is the last row.
    rotation = np.concatenate((state.pose.rotation, state.wrist_rotation[None]))
    position = np.concatenate((state.pose.position, state.wrist_position[None]))
    to_parent = rotation[table.parent].swapaxes(-1, -2)
    moved = state.pose.position - position[table.parent]
    return to_parent @ state.pose.rotation, (to_parent @ moved[..., None])[..., 0]
