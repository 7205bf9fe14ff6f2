"""rosbag2 recordings of the messages of points that live sources send, written by rosbags."""

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from hand_tracker.calibration.landmarks import landmark_positions
from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.files.bags import TYPE_STORE
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS, OPENXR
from helpers.clouds import cloud
from helpers.point_files import demo

RECORDING_START = 1_700_000_000 * 10**9 + 7   # [ns] of the first stamp
RECORDED_LATER = 3 * 10**6          # [ns] than the stamps
RECORDED_PERIOD = 8_333_333                  # [ns]
FRAME_ID = 'stage'
TYPES = TYPE_STORE.types
STORAGES = {'.mcap': StoragePlugin.MCAP, '.db3': StoragePlugin.SQLITE3}


def stamp_ns(number):
    """Return the stamp of a frame [ns]."""
    return RECORDING_START + number * RECORDED_PERIOD


def header(number):
    return TYPES['std_msgs/msg/Header'](
        TYPES['builtin_interfaces/msg/Time'](*divmod(stamp_ns(number), 10**9)), FRAME_ID)


def point(position):
    return TYPES['geometry_msgs/msg/Point'](*map(float, position))


def pose(position):
    return TYPES['geometry_msgs/msg/Pose'](
        point(position), TYPES['geometry_msgs/msg/Quaternion'](0., 0., 0., 1.))


def marker(name, position):
    return TYPES['mocap4r2_msgs/msg/Marker'](0, 0, name, point(position))


def cloud_message(positions, number):
    """Return the seen markers as a cloud, in another order in each frame."""
    seen = positions[np.isfinite(positions).all(axis=1)]
    message = cloud(np.roll(seen, number, axis=0), form='f8')
    message.header = header(number)
    return message


def markers_message(positions, number):
    return TYPES['mocap4r2_msgs/msg/Markers'](header(number), number, [
        marker(name, at) for name, at in zip(MARKERS, positions)])


def bodies_message(positions, number):
    return TYPES['mocap4r2_msgs/msg/RigidBodies'](header(number), number, [
        TYPES['mocap4r2_msgs/msg/RigidBody']('RHand', [
            marker(name, at) for name, at in zip(MARKERS, positions)], pose((0., 0., 0.)))])


def poses_message(landmarks, number):
    return TYPES['geometry_msgs/msg/PoseArray'](header(number), [pose(at) for at in landmarks])


def named_message(landmarks, number):
    """Return the landmarks of the right hand, and a left one half a metre beside."""
    name_of = {landmark: name for name, landmark in OPENXR.items()}
    names = [name_of[landmark] for landmark in LANDMARK_ORDERS[21]]
    return TYPES['teleop_ros2_interfaces/msg/NamedPoseArray'](
        header(number), [f'{side}_{name}' for side in ('left', 'right') for name in names],
        [*map(pose, LEFT_HAND_MIRROR * landmarks + .5), *map(pose, landmarks)],
        np.array([True] * len(names) + [name != 'LITTLE_TIP' for name in names]))


# By a short name: type, topic, the function that makes a message, and whether of landmarks.
MADE = {
    'cloud': ('sensor_msgs/msg/PointCloud2', '/pointCloud', cloud_message, False),
    'markers': ('mocap4r2_msgs/msg/Markers', '/mocap', markers_message, False),
    'bodies': ('mocap4r2_msgs/msg/RigidBodies', '/rigid_bodies', bodies_message, False),
    'poses': ('geometry_msgs/msg/PoseArray', '/landmarks', poses_message, True),
    'named': ('teleop_ros2_interfaces/msg/NamedPoseArray', '/xr_teleop/hand', named_message, True),
}


def positions_of(kind, frames):
    """Return what `write_point_bag` writes: markers (T, 8, 3), or landmarks (T, 21, 3) [m]."""
    recording = demo('right')
    if not MADE[kind][3]:
        return recording.markers[:frames]
    hand = Hand.scaled()
    return landmark_positions(hand, forward(joint_table(hand), recording.angles[:frames]))


def write_point_bag(folder, kinds, suffix='.mcap', frames=60, types=TYPE_STORE):
    """Write a recording with a topic for each kind of messages; return its file."""
    with Writer(folder, version=8, storage_plugin=STORAGES[suffix]) as writer:
        for kind in kinds:
            name, topic, make, _ = MADE[kind]
            connection = writer.add_connection(topic, name, typestore=types)
            for number, positions in enumerate(positions_of(kind, frames)):
                writer.write(connection, stamp_ns(number) + RECORDED_LATER,
                             types.serialize_cdr(make(positions, number), name))
    return folder / f'{folder.name}{suffix}'
