"""Fields of the messages of points whose packages are not part of ROS 2. No ROS."""

from __future__ import annotations

from .message_kinds import MOCAP4R2_MARKERS, RIGID_BODIES

NAMED_POSE_ARRAY = 'teleop_ros2_interfaces/msg/NamedPoseArray'
_MARKER = {'id_type': 'int8', 'marker_index': 'int32', 'marker_name': 'string',
           'translation': 'geometry_msgs/Point'}
_LIST = {'header': 'std_msgs/Header', 'frame_number': 'uint32'}
# By the type, of each message that it is made of, in the words of rclpy.
KNOWN_FIELDS = {
    MOCAP4R2_MARKERS.type: {
        'Markers': {**_LIST, 'markers': 'sequence<mocap4r2_msgs/Marker>'}, 'Marker': _MARKER},
    RIGID_BODIES.type: {
        'RigidBodies': {**_LIST, 'rigidbodies': 'sequence<mocap4r2_msgs/RigidBody>'},
        'RigidBody': {'rigid_body_name': 'string', 'markers': 'sequence<mocap4r2_msgs/Marker>',
                      'pose': 'geometry_msgs/Pose'},
        'Marker': _MARKER},
    NAMED_POSE_ARRAY: {
        'NamedPoseArray': {
            'header': 'std_msgs/Header', 'name': 'sequence<string>',
            'pose': 'sequence<geometry_msgs/Pose>', 'is_valid': 'sequence<boolean>'}}}


def _as_in_file(field_type: str) -> str:
    """Return the type of a field as a .msg file has it."""
    element = field_type.removeprefix('sequence<').removesuffix('>').replace('boolean', 'bool')
    return element + '[]' * field_type.startswith('sequence<')


# Of each of these messages, as in a .msg file, by its type.
DEFINITIONS = {f'{kind.partition("/")[0]}/msg/{name}': '\n'.join(
    f'{_as_in_file(field_type)} {field}' for field, field_type in fields.items())
    for kind, parts in KNOWN_FIELDS.items() for name, fields in parts.items()}
