"""Messages that the tracker takes as they are, by the values of its parameter `marker_message`."""

from __future__ import annotations

from ..messages.message_kinds import (
    MARKER_ARRAY_KIND,
    MOCAP4R2_MARKERS,
    POINT_CLOUD,
    RIGID_BODIES,
    MessageKind,
)
from .hand_landmarks import LANDMARK_POSES

MARKER_MESSAGES: dict[str, MessageKind] = {
    'marker_array': MARKER_ARRAY_KIND, 'mocap4r2_markers': MOCAP4R2_MARKERS,
    'mocap4r2_rigid_bodies': RIGID_BODIES, 'pose_array': LANDMARK_POSES,
    'point_cloud': POINT_CLOUD}
