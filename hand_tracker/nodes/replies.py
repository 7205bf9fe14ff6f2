"""Answers to each frame: their publishers, templates and numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from ..core.model.hand import Hand
from ..core.model.kinematics import joint_table, tip_offsets
from ..core.pose.deviation import unknown_deviation
from ..core.tracker import HandState
from ..messages.builders import (
    Names,
    fill_transforms,
    link_frames,
    new_transforms,
    tip_frames,
    wrist_frames,
)
from ..messages.stamps import NO_STAMP, Stamp, Time, is_repeated
from ..messages.templates import ANGLE_DEVIATIONS, JOINT_STATES, TRANSFORMS, transform_numbers
from ..tracking.stream import TrackedFrame
from .serialization import Reply, Serialization, TFMessage
from .static_transforms import StaticTransforms

TF_DEPTH = 100       # that of tf2_ros
TEMPLATES_KEPT = 64  # hostile messages may name a new frame each
TOPIC_OF = {JOINT_STATES: 'joint_states', ANGLE_DEVIATIONS: 'joint_confidence'}


class AnsweredHand(NamedTuple):
    """A hand of the messages that are answered.

    Attributes
    ----------
    hand : Hand
    names : Names
    topics : str
        Before the names of its own topics: empty, or 'right/'.
    """

    hand: Hand
    names: Names
    topics: str


class Replies:
    """Joint states, transforms and deviations of the hands in the messages of one topic.

    Hands of one stamp are answered together. They are numbered as they are given.

    Parameters
    ----------
    node : Node
    hands : sequence of AnsweredHand
    serialization : Serialization
    qos : mapping of str to QoSProfile
        Of the topics.
    broadcast : {'wrist', 'all', 'none'}
        Frames on /tf.
    has_separate_topics : bool, optional
        Whether joint states and deviations of each hand go out on a topic of their own.
    """

    def __init__(self, node: Node, hands: Sequence[AnsweredHand], serialization: Serialization,
                 qos: Mapping[str, QoSProfile], broadcast: str,
                 has_separate_topics: bool = False) -> None:
        self._names = [hand.names for hand in hands]
        self._serialization = serialization
        self._tables = [joint_table(hand.hand) for hand in hands]
        self._links = [link_frames(names, table) if broadcast == 'all' else ()
                       for names, table in zip(self._names, self._tables)]
        self._is_separate = has_separate_topics
        self._publishers = {
            (kind, number): node.create_publisher(JointState, topics + topic, qos[topic])
            for kind, topic in TOPIC_OF.items()
            for number, topics in enumerate(
                [hand.topics for hand in hands] if has_separate_topics else [''])}
        self._has_listeners = False
        self._templates: dict[Any, Any] = {}
        self._tf: Publisher | None = None
        self._last_transform = [NO_STAMP] * len(hands)
        self._tips: StaticTransforms | None = None
        if broadcast == 'none':
            return
        if TFMessage is None:
            node.get_logger().warning(
                'tf2_msgs is not installed: nothing is broadcast on /tf; the rest works')
            return
        self._tf = node.create_publisher(TFMessage, '/tf', TF_DEPTH)
        if broadcast == 'all':
            self._clock = node.get_clock()
            self._tips = StaticTransforms(node)
            for number, (hand, _, _) in enumerate(hands):
                self.show_tips(number, hand)

    def show_tips(self, number: int, hand: Hand) -> None:
        """Broadcast the tips of a hand, by its number, where all frames are broadcast."""
        if self._tips is None:
            return
        tips = new_transforms(tip_frames(self._names[number]))
        fill_transforms(tips, self._clock.now().to_msg(), np.hstack(
            (tip_offsets(hand), np.tile((0., 0., 0., 1.), (len(tips), 1)))))
        self._tips.send(tips)

    def publish(self, frames: Mapping[int, TrackedFrame]) -> bool:
        """Publish the replies to the frames of a message.

        Parameters
        ----------
        frames : mapping of int to TrackedFrame
            By the hand's number, in its order.

        Returns
        -------
        bool
            Whether all went out: of a repeated stamp transforms do not.
        """
        has_sent_all = True
        for stamp, of_one_stamp in groupby(
                frames.items(), lambda item: Stamp(item[1].stamp.sec, item[1].stamp.nanosec)):
            together = dict(of_one_stamp)
            new = {number: frame for number, frame in together.items()
                   if not is_repeated(*stamp, *self._last_transform[number])}
            for publisher, template, kind, numbers in (
                    *self._joint_replies(together), *self._transform_replies(new)):
                publisher.publish(template.fill(stamp, np.concatenate(
                    [self._numbers(kind, number, together[number].state) for number in numbers])))
            for number in together:
                self._last_transform[number] = stamp
            has_sent_all = has_sent_all and (self._tf is None or len(new) == len(together))
        return has_sent_all

    def replies_to(self, frames: Mapping[int, TrackedFrame]) -> list[Reply]:
        """Return the messages that answer frames of one stamp, for the fast path.

        Parameters
        ----------
        frames : mapping of int to TrackedFrame
            As for `publish`.
        """
        return [*self._joint_replies(frames), *self._transform_replies(frames)]

    def _joint_replies(self, frames: Mapping[int, TrackedFrame]) -> list[Reply]:
        kinds = [JOINT_STATES, ANGLE_DEVIATIONS] if self._has_listeners else [JOINT_STATES]
        groups = [(number,) for number in frames] if self._is_separate else [tuple(frames)]
        replies = []
        for kind in kinds:
            for group in groups:
                # Constant between two changes of the limits, each of which makes another template.
                unknown = () if kind == JOINT_STATES else tuple(np.concatenate(
                    [unknown_deviation(frames[number].limits) for number in group]).tolist())
                template = self._template(
                    (kind, group, unknown),
                    lambda group=group, unknown=unknown: self._serialization.joint_states(
                        [joint for number in group for joint in self._names[number].joints],
                        unknown))
                replies.append(Reply(
                    self._publishers[kind, group[0] if self._is_separate else 0], template, kind,
                    group))
        return replies

    def _transform_replies(self, frames: Mapping[int, TrackedFrame]) -> list[Reply]:
        if self._tf is None or not frames:
            return []
        parents = tuple((number, frame.frame_id) for number, frame in frames.items())
        template = self._template((TRANSFORMS, parents), lambda: self._serialization.transforms(
            [pair for number, frame_id in parents
             for pair in wrist_frames(self._names[number], frame_id) + self._links[number]]))
        return [Reply(self._tf, template, TRANSFORMS, tuple(frames))]

    def _template(self, key: Any, new: Any) -> Any:
        """Return the template of a key; a new one where there is none."""
        if key not in self._templates:
            if len(self._templates) >= TEMPLATES_KEPT:
                self._templates.clear()
            self._templates[key] = new()
        return self._templates[key]

    def _numbers(self, kind: int, number: int, state: HandState) -> np.ndarray:
        """Return the numbers of a hand in a message of a kind."""
        if kind == TRANSFORMS:
            return transform_numbers(
                self._tables[number], state, 1 + len(self._links[number])).ravel()
        return state.angles if kind == JOINT_STATES else state.deviation

    def published_until(self, number: int, stamp: Time) -> None:
        """Note the stamp of the last frame of a hand that the fast path has answered."""
        self._last_transform[number] = Stamp(stamp.sec, stamp.nanosec)

    def follow_listeners(self) -> bool:
        """Publish deviations only while somebody listens; return whether that has changed."""
        # To ask in each frame would cost more than filling the message.
        had_listeners, self._has_listeners = self._has_listeners, any(
            publisher.get_subscription_count() > 0
            for (kind, _), publisher in self._publishers.items() if kind == ANGLE_DEVIATIONS)
        return self._has_listeners != had_listeners
