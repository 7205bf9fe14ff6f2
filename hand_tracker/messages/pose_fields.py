"""Numbers of messages of poses."""

from __future__ import annotations

from typing import Any, NamedTuple


class PoseNumbers(NamedTuple):
    """Numbers of a pose.

    Attributes
    ----------
    position : tuple of float
        x, y, z [m].
    rotation : tuple of float
        Quaternion x, y, z, w, of any length.
    """

    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


def pose_numbers(message: Any) -> PoseNumbers:
    """Return the numbers of a geometry_msgs/Pose or geometry_msgs/Transform."""
    if hasattr(message, 'translation'):
        at, turn = message.translation, message.rotation
    else:
        at, turn = message.position, message.orientation
    return PoseNumbers((at.x, at.y, at.z), (turn.x, turn.y, turn.z, turn.w))
