"""Publishers that show a tracked hand: markers for RViz, labelled markers, its description."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from visualization_msgs.msg import MarkerArray

from ..core.model.hand import Hand
from ..core.model.kinematics import tip_offsets
from ..core.model.marker_layout import MarkerLayout
from ..core.tracker import HandState
from ..files.urdf_file import urdf
from ..messages.builders import Names, time_message
from ..messages.rviz_markers import hand_markers, labelled_markers
from ..messages.stamps import Time
from ..tracking.rate_limit import RateLimiter
from .hand_description import HandDescription
from .robot_description import RobotDescription


class HandDisplay:
    """Publish one hand for RViz, robot_state_publisher and other nodes that show it.

    Parameters
    ----------
    node : Node
    hand : Hand
        Which robot_state_publisher was started with.
    layout : MarkerLayout
    names : Names
        Of the hand's joints and frames.
    namespace : str
        Before the names of the topics: empty, or 'right/'.
    qos : mapping of str to QoSProfile
        Of the topics.

    Attributes
    ----------
    has_viewers : bool
        Whether `hand_markers` has subscribers, as of `follow_viewers`.
    """

    def __init__(self, node: Node, hand: Hand, layout: MarkerLayout, names: Names,
                 namespace: str, qos: Mapping[str, QoSProfile]) -> None:
        self._names = names
        self._hand_markers = node.create_publisher(
            MarkerArray, f'{namespace}hand_markers', qos['hand_markers'])
        self._labelled_markers = node.create_publisher(
            MarkerArray, f'{namespace}labelled_markers', qos['labelled_markers'])
        self._robot_description = RobotDescription(node, urdf(hand, names.prefix), namespace)
        self._hand_description = HandDescription(node, namespace)
        self._hand_description.publish(hand, layout)
        self._tips = tip_offsets(hand)
        self._limiter = RateLimiter()
        self.has_viewers = False

    def show(self, stamp: Time, frame_id: str, state: HandState, rate: float) -> None:
        """Publish the markers for RViz, at a rate [Hz] at most."""
        if self._limiter.due(time.monotonic(), rate):
            self._hand_markers.publish(hand_markers(
                time_message(stamp), frame_id, self._names, self._tips, state))

    def show_labelled(self, stamp: Time, frame_id: str, positions: np.ndarray,
                      marker_names: Sequence[str]) -> None:
        """Publish the markers with their names; positions have shape (M, 3) [m]."""
        self._labelled_markers.publish(labelled_markers(
            time_message(stamp), frame_id, self._names.prefix, positions, marker_names))

    def follow_viewers(self) -> bool:
        """Show the hand while there are subscribers; return whether there are."""
        self.has_viewers = self._hand_markers.get_subscription_count() > 0
        return self.has_viewers

    def set_hand(self, hand: Hand, file_hand: Hand, layout: MarkerLayout) -> None:
        """Show another hand.

        Parameters
        ----------
        hand : Hand
            As it is tracked.
        file_hand : Hand
            As its hand file has it: without limits and couplings that are set as parameters.
        layout : MarkerLayout
        """
        self._tips = tip_offsets(hand)
        self._robot_description.wanted = urdf(hand, self._names.prefix)
        self._robot_description.update()
        self._hand_description.publish(file_hand, layout)

    def update(self) -> None:
        """Give robot_state_publisher the hand's URDF, as soon as it runs."""
        self._robot_description.update()
