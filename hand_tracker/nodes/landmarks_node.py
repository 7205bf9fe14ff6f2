"""Landmarks node: publish the tracked hand as the landmarks of headsets, for their software.

From `joint_states` and the wrist's pose on /tf follow 21, 25 or 26 poses on `hand_landmarks`, as
geometry_msgs/PoseArray or as the NamedPoseArray of IsaacTeleop, with OpenXR's axes.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion, TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from ..adapters.openxr_hand import OpenXrHand
from ..messages.joint_states import angles_of
from ..messages.landmark_kinds import LANDMARK_ORDERS
from ..messages.pose_fields import pose_numbers
from ..messages.stamps import nanoseconds
from .message_types import imported_message
from .parameters import Parameter
from .runner import declare, names_of, run
from .skin_node import HAND_PARAMETERS
from .source_node import TELEOP
from .tracker_parameters import START, starting_hand, with_defaults

LANDMARKS_DEPTH = 10
WAITING_FRAMES = 100  # of joint states or of wrist poses whose counterpart has not come yet
LANDMARKS_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    *(row for row in START if row.name in (*HAND_PARAMETERS, 'on_body')),
    Parameter('landmarks', 25, 'How many: the 21 of MediaPipe, the 25 of WebXR and IsaacTeleop, '
              'the 26 of OpenXR', range=(min(LANDMARK_ORDERS), max(LANDMARK_ORDERS))),
    Parameter('message', 'pose_array', 'Message of hand_landmarks',
              choices=('pose_array', 'named_pose_array')),
))


class LandmarksNode(Node):
    """Node that publishes the landmarks of one hand."""

    def __init__(self) -> None:
        super().__init__('landmarks')
        values = declare(self, LANDMARKS_PARAMETERS)
        hand, _ = starting_hand(with_defaults(values))
        self._names = names_of(
            hand, values['prefix'], values['wrist_frame'], values['on_body'])
        self._hand = OpenXrHand(hand, values['landmarks'])
        self._named = (imported_message(TELEOP, 'NamedPoseArray')
                       if values['message'] == 'named_pose_array' else None)
        self._angles: dict[int, np.ndarray] = {}
        self._wrists: dict[int, TransformStamped] = {}
        self._publisher = self.create_publisher(
            self._named or PoseArray, 'hand_landmarks', LANDMARKS_DEPTH)
        qos = QoSProfile(depth=LANDMARKS_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(JointState, 'joint_states', self._on_joint_states, qos)
        self.create_subscription(
            imported_message('tf2_msgs', 'TFMessage'), '/tf', self._on_transforms, qos)
        self.get_logger().info(f'{hand.side} hand: publishing {values["landmarks"]} landmarks on '
                               f'{self._publisher.topic_name}')

    def _on_joint_states(self, message: JointState) -> None:
        angles = angles_of(message, self._names.joints)
        # A robot's joint states may come on this topic too.
        if angles is not None:
            self._take(self._angles, nanoseconds(message.header.stamp), angles)

    def _on_transforms(self, message: Any) -> None:
        for transform in message.transforms:
            if transform.child_frame_id == self._names.tracked:
                self._take(self._wrists, nanoseconds(transform.header.stamp), transform)

    def _take(self, waiting: dict[int, Any], stamp: int, value: Any) -> None:
        """Publish where the joints and the wrist of a stamp are both there."""
        waiting[stamp] = value
        if stamp in self._angles and stamp in self._wrists:
            self._publish(self._angles.pop(stamp), self._wrists.pop(stamp))
        elif len(waiting) > WAITING_FRAMES:
            del waiting[next(iter(waiting))]

    def _publish(self, angles: np.ndarray, wrist: TransformStamped) -> None:
        position, rotation = pose_numbers(wrist.transform)
        found = self._hand.poses(angles, rotation, np.array(position))
        poses = [Pose(position=Point(x=x, y=y, z=z),
                      orientation=Quaternion(x=i, y=j, z=k, w=w))
                 for (x, y, z), (i, j, k, w) in zip(found.positions.tolist(),
                                                    found.orientations.tolist())]
        if self._named is None:
            self._publisher.publish(PoseArray(header=wrist.header, poses=poses))
        else:
            self._publisher.publish(self._named(
                header=wrist.header, name=list(found.names), pose=poses,
                is_valid=[True] * len(poses)))


def main(args: list[str] | None = None) -> int:
    """Run the landmarks node until it is interrupted; return its exit code."""
    return run(LandmarksNode, args=args, name='landmarks')


if __name__ == '__main__':
    sys.exit(main())
