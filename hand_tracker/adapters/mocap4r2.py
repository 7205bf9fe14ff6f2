"""Markers of the messages of mocap4r2's drivers: mocap4r2_msgs/Markers and RigidBodies."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..messages.mocap4r2_parser import USE_INDEX
from .point_frame import SourceFrame, point_frame


def points_of_markers(message: Any) -> SourceFrame:
    """Return the markers of a Markers message.

    A marker with a name is named. One with an index alone is anonymous: drivers number the markers
    of each frame anew.

    Parameters
    ----------
    message : mocap4r2_msgs/Markers
    """
    names, markers, points = [], [], []
    for marker in message.markers:
        at = marker.translation.x, marker.translation.y, marker.translation.z
        if marker.id_type != USE_INDEX and marker.marker_name:
            names.append(marker.marker_name)
            markers.append(at)
        else:
            points.append(at)
    return point_frame(message.header.stamp, message.header.frame_id, names, markers, points)


def points_of_rigid_bodies(message: Any) -> SourceFrame:
    """Return the markers of a RigidBodies message, named 'body:marker'.

    Within a body an index, too, is the same marker in each frame: 'body:3'.

    Parameters
    ----------
    message : mocap4r2_msgs/RigidBodies
    """
    found = list(_of_bodies(message.rigidbodies))
    return point_frame(message.header.stamp, message.header.frame_id,
                       [name for name, _ in found], [at for _, at in found])


def _of_bodies(bodies: Iterable[Any]) -> Iterable[tuple[str, tuple[float, float, float]]]:
    for body in bodies:
        for marker in body.markers:
            is_indexed = marker.id_type == USE_INDEX or not marker.marker_name
            own = marker.marker_index if is_indexed else marker.marker_name
            at = marker.translation
            yield f'{body.rigid_body_name}:{own}', (at.x, at.y, at.z)
