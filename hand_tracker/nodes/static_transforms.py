"""Transforms at rest, on /tf_static."""

from __future__ import annotations

from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from .serialization import TFMessage


class StaticTransforms:
    """Publisher of the latest transform of each child frame, all in one message.

    Parameters
    ----------
    node : Node
        Where tf2_msgs is installed.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(TFMessage, '/tf_static', QoSProfile(
            depth=1, reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL))
        # tf2_ros' own goes on sending the first of each frame on Jazzy, the last call on Humble.
        self._by_child: dict[str, TransformStamped] = {}

    def send(self, transforms: Iterable[TransformStamped]) -> None:
        """Publish transforms, which are kept, and those of all other frames sent before."""
        self._by_child.update((one.child_frame_id, one) for one in transforms)
        self._publisher.publish(TFMessage(transforms=list(self._by_child.values())))
