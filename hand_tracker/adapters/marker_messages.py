"""Message types of motion capture systems; which of them the tracker reads directly.

The tracker reads those of its parameter `marker_message`; a source node converts the others, and
filters or turns points.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ..messages.landmark_kinds import LANDMARK_MARKERS, LANDMARK_POSES, NAMED_LANDMARKS
from ..messages.marker_ids import SOURCE_FRAME
from ..messages.message_kinds import (
    MARKER_ARRAY_KIND,
    MOCAP4R2_MARKERS,
    POINT_CLOUD,
    RIGID_BODIES,
    MessageKind,
)

DEFAULT_MESSAGE, NAMED_POSE_MESSAGE = 'marker_array', 'named_pose_array'
LANDMARKS_AS_MARKERS = {count: f'landmark_markers_{count}' for count in LANDMARK_MARKERS}
MARKER_MESSAGES: dict[str, MessageKind] = {
    DEFAULT_MESSAGE: MARKER_ARRAY_KIND, 'mocap4r2_markers': MOCAP4R2_MARKERS,
    'mocap4r2_rigid_bodies': RIGID_BODIES, 'pose_array': LANDMARK_POSES,
    NAMED_POSE_MESSAGE: NAMED_LANDMARKS,
    **{LANDMARKS_AS_MARKERS[count]: kind for count, kind in LANDMARK_MARKERS.items()},
    'point_cloud': POINT_CLOUD}
# By their types, of those of one type the first.
MESSAGE_OF_TYPE = {kind.type: name for name, kind in reversed(MARKER_MESSAGES.items())}
# Of the source node: messages of each source, the usual one first; FIRST stands for it.
MESSAGES_OF = {'point_cloud': ('point_cloud',), 'mocap4r2': ('markers', 'rigid_bodies'),
               'landmarks': ('pose_array', NAMED_POSE_MESSAGE, 'marker_array')}
FIRST = 'first'
SERVED = 'natnet', 'qualisys'   # systems of which a client takes packets
# Topic that each message comes on where the parameter names none.
USUAL_TOPICS = {'point_cloud': '/pointCloud', 'markers': '/markers',
                'rigid_bodies': '/rigid_bodies', 'pose_array': 'landmarks',
                NAMED_POSE_MESSAGE: '/xr_teleop/hand', 'marker_array': 'landmarks'}
TAKEN_AS_THEY_ARE = {
    ('point_cloud', 'point_cloud'): 'point_cloud', ('mocap4r2', 'markers'): 'mocap4r2_markers',
    ('mocap4r2', 'rigid_bodies'): 'mocap4r2_rigid_bodies',
    ('landmarks', 'pose_array'): 'pose_array',
    ('landmarks', NAMED_POSE_MESSAGE): NAMED_POSE_MESSAGE}
UP_AS_TOLD = 'auto'             # upward axis: as the source says, else z
# Parameters of the source node with the values at which it does nothing to the points.
UNCHANGED = {'subject': ('',), 'up': (UP_AS_TOLD, 'z', '+z'), 'frame': (SOURCE_FRAME,)}
USUAL_LANDMARKS = min(LANDMARK_MARKERS)   # of a MarkerArray


class DirectInput(NamedTuple):
    """Direct input of the tracker: a value of `marker_message`, and the topic."""

    message: str
    topic: str


def direct_input(parameters: Mapping[str, Any]) -> DirectInput | None:
    """Return how the tracker reads a source's messages directly, without a source node.

    Parameters
    ----------
    parameters : mapping of str to object
        Values given for parameters of the source node, others among them.

    Returns
    -------
    DirectInput or None
        None where a source node is needed.
    """
    source = parameters['source']
    message = parameters.get('message', FIRST)
    if message == FIRST:
        message = MESSAGES_OF.get(source, (FIRST,))[0]
    taken = TAKEN_AS_THEY_ARE.get((source, message))
    if (source, message) == ('landmarks', 'marker_array'):
        taken = LANDMARKS_AS_MARKERS.get(parameters.get('landmarks', USUAL_LANDMARKS))
    if taken is None or any(
            parameters.get(name, values[0]) not in values for name, values in UNCHANGED.items()):
        return None
    return DirectInput(taken, parameters.get('topic') or USUAL_TOPICS[message])
