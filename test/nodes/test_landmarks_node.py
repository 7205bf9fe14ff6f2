"""The landmarks node over DDS: joint states and the wrist's pose in, landmarks out."""

import json
from contextlib import contextmanager

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray, TransformStamped
from helpers.ros_process import watching_node
from sensor_msgs.msg import JointState
from teleop_ros2_interfaces.msg import NamedPoseArray
from tf2_msgs.msg import TFMessage

from hand_tracker.adapters.openxr_hand import OpenXrHand
from hand_tracker.adapters.point_frame import SourceUnavailable
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.nodes.landmarks_node import LandmarksNode
from hand_tracker.nodes.runner import spinning
from hand_tracker.simulation.poses import pose_angles

NEEDS = 'rclpy', 'teleop_ros2_interfaces', 'tf2_msgs'

pytestmark = pytest.mark.ros
STAMP = Time(sec=5, nanosec=6)


@contextmanager
def landmarks(**parameters):
    """Serve a landmarks node; yield a node that watches it."""
    arguments = ['--ros-args']
    for name, value in parameters.items():
        arguments += ['-p', f'{name}:={json.dumps(value)}']
    rclpy.init(args=arguments)
    try:
        node = LandmarksNode()
        with watching_node() as watch, spinning(node):
            yield watch
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_other_numbers_of_landmarks_are_refused():
    with pytest.raises(SourceUnavailable, match='22; expected one of 21, 25, 26'):
        with landmarks(landmarks=22):
            pass


@pytest.mark.parametrize('side, kind, count, on_body', [
    ('right', PoseArray, 25, False), ('left', NamedPoseArray, 25, False),
    ('right', NamedPoseArray, 26, False), ('right', PoseArray, 25, True)])
def test_the_hand_comes_out_as_landmarks(side, kind, count, on_body):
    hand = Hand.scaled(side=side)
    angles = pose_angles('relaxed', hand)
    wrist = TransformStamped(
        child_frame_id=f'{side}_wrist_tracked' if on_body else f'{side}_wrist')
    wrist.header.stamp, wrist.header.frame_id = STAMP, 'mocap'
    wrist.transform.translation.x, wrist.transform.rotation.z = .5, 1.
    wrist.transform.rotation.w = 0.
    other = TransformStamped(child_frame_id=f'{side}_wrist' if on_body else 'robot')
    other.header.stamp = STAMP
    states = JointState(name=[f'{side}_{joint}' for joint in JOINTS], position=angles.tolist())
    states.header.stamp = STAMP
    robots = JointState(name=['elbow'], position=[1.])
    robots.header.stamp = STAMP
    message = 'pose_array' if kind is PoseArray else 'named_pose_array'
    with landmarks(side=side, message=message, landmarks=count, on_body=on_body) as watch:
        found = watch.collect(kind, '/hand_landmarks')
        joints = watch.create_publisher(JointState, '/joint_states', 10)
        transforms = watch.create_publisher(TFMessage, '/tf', 10)

        def send():
            joints.publish(robots)
            joints.publish(states)
            transforms.publish(TFMessage(transforms=[other, wrist]))

        watch.repeat(send, lambda: found, .05)
    answer = found[0]
    poses = answer.poses if kind is PoseArray else answer.pose
    expected = OpenXrHand(hand, count).poses(angles, (0., 0., 1., 0.), np.array((.5, 0., 0.)))
    np.testing.assert_allclose(
        [(pose.position.x, pose.position.y, pose.position.z) for pose in poses],
        expected.positions, atol=1e-12)
    np.testing.assert_allclose(
        [(pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w)
         for pose in poses], expected.orientations, atol=1e-12)
    assert answer.header.stamp == STAMP and answer.header.frame_id == 'mocap'
    if kind is NamedPoseArray:
        assert tuple(answer.name) == expected.names and all(answer.is_valid)
