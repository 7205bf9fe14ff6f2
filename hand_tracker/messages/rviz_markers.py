"""Visualization markers of the tracked hand for RViz: bones, joints, hand markers and skin."""

import math
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..core.model.marker_layout import MARKERS
from ..core.model.skeleton import SKELETON_BONES, skeleton_points
from ..core.model.states import MarkerState, PalmState
from ..core.tracker import HandState
from ..drawing.palette import LIGHT_GREY, MARKER_COLOURS, SKIN_TONE, rgb
from .builders import Names

JOINTS_SHOWN = sorted({end for bone in SKELETON_BONES for end in bone})
STATE_COLOURS = {kind: rgb(colour) for kind, colour in MARKER_COLOURS.items()
                 if kind != MarkerState.ABSENT}
RVIZ_SKIN_COLOUR = rgb(SKIN_TONE)
RVIZ_SKIN_OPACITY = 1.  # RViz draws transparent triangles without depth: folds become stripes
HELD_OPACITY = .3       # while the last pose is held because the palm is not found
LINE_WIDTH = .004       # [m]
JOINT_DIAMETER = .008   # [m]
MARKER_DIAMETER = .012  # [m]
LIFETIME = Duration(sec=1)


def hand_markers(stamp: Time, frame_id: str, names: Names, tips: np.ndarray,
                 state: HandState) -> MarkerArray:
    """Return the hand for RViz: lines for bones, spheres for joints and for hand markers.

    A hand marker stands at its measured or predicted position: bluish green when seen, orange
    when predicted, vermillion when predicted because the measurement was rejected, sky blue when
    seen under another's label, grey when stale; absent ones are left out. Bones and joints are
    faded while the palm is not found.

    Parameters
    ----------
    stamp : Time
    frame_id : str
    names : Names
    tips : ndarray, shape (5, 3)
        From `tip_offsets` [m].
    state : HandState

    Returns
    -------
    MarkerArray
    """
    points = _points(skeleton_points(tips, state.pose, state.wrist_position))
    grey = _colour(rgb(LIGHT_GREY), 1. if state.palm <= PalmState.CARRIED else HELD_OPACITY)
    known = np.flatnonzero(state.marker_states != MarkerState.ABSENT)
    colours = {kind: _colour(tone) for kind, tone in STATE_COLOURS.items()}
    header = Header(stamp=stamp, frame_id=frame_id)
    return MarkerArray(markers=[
        _marker(header, names.prefix + 'bones', Marker.LINE_LIST, LINE_WIDTH, grey,
                [points[i] for bone in SKELETON_BONES for i in bone]),
        _marker(header, names.prefix + 'joints', Marker.SPHERE_LIST, JOINT_DIAMETER, grey,
                [points[i] for i in JOINTS_SHOWN]),
        _marker(header, names.prefix + 'markers', Marker.SPHERE_LIST, MARKER_DIAMETER,
                colours[MarkerState.SEEN], _points(state.markers[known]),
                [colours[state.marker_states[i]] for i in known])])


def states_of_colours(colours: Sequence[ColorRGBA]) -> np.ndarray:
    """Return the states of hand markers by their colours, as `hand_markers` gives them.

    Parameters
    ----------
    colours : sequence of ColorRGBA, length n

    Returns
    -------
    ndarray of int, shape (n,)
        `MarkerState` of the nearest colour.
    """
    shown = np.array([(one.r, one.g, one.b) for one in colours]).reshape(-1, 1, 3)
    tones = np.array(tuple(STATE_COLOURS.values()))      # (k, 3)
    nearest = np.abs(shown - tones).sum(axis=2).argmin(axis=1)
    return np.array(tuple(STATE_COLOURS), dtype=int)[nearest]


def labelled_markers(stamp: Time, frame_id: str, prefix: str,
                     positions: np.ndarray, names: Sequence[str] = MARKERS) -> MarkerArray:
    """Return the markers that are seen, each in a namespace of its name.

    Parameters
    ----------
    stamp : Time
    frame_id : str
    prefix : str
        Of the namespaces, as ``'right_'``.
    positions : ndarray, shape (M, 3)
        NaN where not seen [m].
    names : sequence of str, optional
        Of the M markers, in the order of the ids.

    Returns
    -------
    MarkerArray
    """
    header = Header(stamp=stamp, frame_id=frame_id)
    colour = _colour(STATE_COLOURS[MarkerState.SEEN])
    shown = []
    for number, (name, place) in enumerate(zip(names, positions.tolist())):
        if math.isfinite(place[0]):
            marker = _marker(header, prefix + name, Marker.SPHERE, MARKER_DIAMETER, colour, [])
            marker.id = number
            at = marker.pose.position
            at.x, at.y, at.z = place
            shown.append(marker)
    return MarkerArray(markers=shown)


def hand_skin(stamp: Time, names: Names, corners: np.ndarray) -> Marker:
    """Return the skin of a hand for RViz: triangles that move with the wrist's frame.

    Parameters
    ----------
    stamp : Time
    names : Names
    corners : ndarray, shape (3 F, 3)
        Of the triangles, anticlockwise seen from outside [m].

    Returns
    -------
    Marker
    """
    marker = _marker(Header(stamp=stamp, frame_id=names.wrist), names.prefix + 'skin',
                     Marker.TRIANGLE_LIST, 1., _colour(RVIZ_SKIN_COLOUR, RVIZ_SKIN_OPACITY),
                     _points(corners))
    marker.frame_locked = True
    return marker


def _points(positions: np.ndarray) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in positions.tolist()]


def _colour(tone: Sequence[float], opacity: float = 1.) -> ColorRGBA:
    return ColorRGBA(r=tone[0], g=tone[1], b=tone[2], a=opacity)


def _marker(header: Header, namespace: str, kind: int, size: float, colour: ColorRGBA,
            points: list[Point], colours: Sequence[ColorRGBA] = ()) -> Marker:
    marker = Marker(header=header, ns=namespace, type=kind, color=colour, points=points,
                    colors=colours, lifetime=LIFETIME)
    marker.pose.orientation.w = 1.
    marker.scale.x = marker.scale.y = marker.scale.z = size
    return marker
