"""The tracked hand as markers for RViz: bones, joints and the markers used."""

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..core.model.skeleton import SKELETON_BONES, skeleton_points
from ..core.model.states import MarkerState, PalmState
from ..drawing.palette import LIGHT_GREY, MARKER_COLOURS, SKIN_TONE, rgb

JOINTS_SHOWN = sorted({end for bone in SKELETON_BONES for end in bone})
COLOURS = {kind: rgb(colour) for kind, colour in MARKER_COLOURS.items()
           if kind != MarkerState.ABSENT}
SKIN_COLOUR, SKIN_OPACITY = rgb(SKIN_TONE), .6  # that shows what is under it
FADED = .3             # opacity of a pose that is kept for want of a palm
LINE_WIDTH = .004      # [m]
JOINT_DIAMETER = .008  # [m]
MARKER_DIAMETER = .012  # [m]
LIFETIME = Duration(sec=1)


def hand_markers(stamp, frame_id, names, tips, state):
    """Return a picture of the hand for RViz: bones, joints and the markers used.

    Markers are where they are taken to be: bluish green when seen, orange when predicted,
    vermillion when predicted because what is seen was rejected, sky blue when seen under the
    label of another, grey when stale; absent ones are left out. The hand fades while its palm
    is not found.

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
    grey = _colour(rgb(LIGHT_GREY), 1. if state.palm <= PalmState.CARRIED else FADED)
    known = np.flatnonzero(state.marker_states != MarkerState.ABSENT)
    colours = {kind: _colour(tone) for kind, tone in COLOURS.items()}
    header = Header(stamp=stamp, frame_id=frame_id)
    return MarkerArray(markers=[
        _marker(header, names.prefix + 'bones', Marker.LINE_LIST, LINE_WIDTH, grey,
                [points[i] for bone in SKELETON_BONES for i in bone]),
        _marker(header, names.prefix + 'joints', Marker.SPHERE_LIST, JOINT_DIAMETER, grey,
                [points[i] for i in JOINTS_SHOWN]),
        _marker(header, names.prefix + 'markers', Marker.SPHERE_LIST, MARKER_DIAMETER,
                colours[MarkerState.SEEN], _points(state.markers[known]),
                [colours[state.marker_states[i]] for i in known])])


def hand_skin(stamp, names, corners):
    """Return the skin of a hand for RViz, in the wrist's frame and staying with it.

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
                     Marker.TRIANGLE_LIST, 1., _colour(SKIN_COLOUR, SKIN_OPACITY),
                     _points(corners))
    marker.frame_locked = True
    return marker


def _points(positions):
    return [Point(x=x, y=y, z=z) for x, y, z in positions.tolist()]


def _colour(tone, opacity=1.):
    return ColorRGBA(r=tone[0], g=tone[1], b=tone[2], a=opacity)


def _marker(header, namespace, kind, size, colour, points, colours=()):
    marker = Marker(header=header, ns=namespace, type=kind, color=colour, points=points,
                    colors=colours, lifetime=LIFETIME)
    marker.pose.orientation.w = 1.
    marker.scale.x = marker.scale.y = marker.scale.z = size
    return marker
