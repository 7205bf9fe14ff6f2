"""The messages that answer each frame: which go out, where, and how they are filled."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from ..core.model.hand import Hand
from ..core.model.kinematics import joint_table, tip_offsets
from ..core.tracker import HandState
from ..messages.builders import (
    Names,
    fill_transforms,
    link_frames,
    new_transforms,
    tip_frames,
    transform_numbers,
    wrist_frames,
)
from ..messages.stamps import nanoseconds
from ..tracking.stream import TrackedFrame
from .fast_path.kernel import CONFIDENCES, JOINT_STATES, TRANSFORMS
from .serialization import Serialization, TFMessage

try:
    from tf2_ros import StaticTransformBroadcaster
except ImportError:
    StaticTransformBroadcaster = None

TF_DEPTH = 100  # that of tf2_ros


class Reply(NamedTuple):
    """A message that answers each frame.

    Attributes
    ----------
    publisher : Publisher
    template : Template
        Or what fills message objects as a template does.
    numbers : callable
        Returns of a `HandState` the numbers to fill in.
    """

    publisher: Publisher
    template: Any
    numbers: Callable[[HandState], np.ndarray]


class Replies:
    """Joint states, transforms and confidences of one hand.

    Parameters
    ----------
    node : Node
    hand : Hand
    names : Names
    serialization : Serialization
    qos : mapping of str to QoSProfile
        Of the topics.
    broadcast : {'wrist', 'all', 'none'}
        Frames on /tf.
    """

    def __init__(self, node: Node, hand: Hand, names: Names, serialization: Serialization,
                 qos: Mapping[str, QoSProfile], broadcast: str) -> None:
        self._names, self._serialization = names, serialization
        self._table = joint_table(hand)
        self._links = link_frames(names, self._table) if broadcast == 'all' else ()
        self._replies = {JOINT_STATES: Reply(
            node.create_publisher(JointState, 'joint_states', qos['joint_states']),
            serialization.joint_states(), lambda state: state.angles)}
        self._confidences = Reply(
            node.create_publisher(JointState, 'joint_confidence', qos['joint_confidence']),
            serialization.joint_states(), lambda state: state.confidence)
        self._tf: Publisher | None = None
        self._frame_id: str | None = None
        self._last_transform: int | None = None  # stamp [ns]
        self._static_broadcaster: Any = None
        if broadcast == 'none':
            return
        if StaticTransformBroadcaster is None or TFMessage is None:
            node.get_logger().warning(
                'tf2_ros is not installed: nothing is broadcast on /tf; the rest works')
            return
        self._tf = node.create_publisher(TFMessage, '/tf', TF_DEPTH)
        if broadcast == 'all':
            self._clock = node.get_clock()
            self._static_broadcaster = StaticTransformBroadcaster(node)
            self.show_tips(hand)

    def show_tips(self, hand: Hand) -> None:
        """Broadcast the tips of a hand, where all frames are broadcast."""
        if self._static_broadcaster is None:
            return
        tips = new_transforms(tip_frames(self._names))
        fill_transforms(tips, self._clock.now().to_msg(), np.hstack(
            (tip_offsets(hand), np.tile((0., 0., 0., 1.), (len(tips), 1)))))
        self._static_broadcaster.sendTransform(tips)

    def publish(self, frame: TrackedFrame) -> bool:
        """Publish the replies to a frame.

        Parameters
        ----------
        frame : TrackedFrame

        Returns
        -------
        bool
            Whether all went out: listeners of TF refuse a second transform of one stamp, each
            with a warning, so that /tf has each stamp only once.
        """
        if self._tf is not None and frame.frame_id != self._frame_id:
            self._broadcast_in(frame.frame_id)
        time = nanoseconds(frame.stamp)
        is_new = time != self._last_transform
        for number, reply in self._replies.items():
            if number != TRANSFORMS or is_new:
                reply.publisher.publish(
                    reply.template.fill(frame.stamp, reply.numbers(frame.state)))
        self._last_transform = time
        return is_new or self._tf is None

    def _broadcast_in(self, frame_id: str) -> None:
        """Broadcast the wrist in another frame from now on."""
        assert self._tf is not None
        self._frame_id = frame_id
        frames = wrist_frames(self._names, frame_id) + self._links
        self._replies[TRANSFORMS] = Reply(
            self._tf, self._serialization.transforms(frames),
            lambda state: transform_numbers(self._table, state, len(frames)))

    def published_until(self, stamp: Any) -> None:
        """Note the stamp of the last frame that the fast path has answered."""
        self._last_transform = nanoseconds(stamp)

    def follow_listeners(self) -> bool:
        """Publish confidences only while somebody listens; return whether that has changed."""
        # To ask in each frame would cost more than filling the message.
        is_wanted = self._confidences.publisher.get_subscription_count() > 0
        if is_wanted == (CONFIDENCES in self._replies):
            return False
        if is_wanted:
            self._replies[CONFIDENCES] = self._confidences
        else:
            del self._replies[CONFIDENCES]
        return True

    def templates(self) -> dict[int, tuple[Publisher, Any]]:
        """Return publisher and template of each reply, by its number on the fast path."""
        return {number: (reply.publisher, reply.template)
                for number, reply in self._replies.items()}
