"""The tracked hand on the latched topic `hand_description`, as the text of a hand file.

The tracker publishes it whenever another hand is tracked; who shows the hand follows it, also one
that comes later. Limits and couplings that are set as parameters are not in it.
"""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_msgs.msg import String

from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
from ..files.hand_file import hand_text, parse_hand

HAND_DESCRIPTION = 'hand_description'
MOST_TRACKERS = 10  # on the topic, of all of which a late subscriber hears at once


def latched(depth: int) -> QoSProfile:
    """Return the QoS of a topic whose last messages a late subscriber gets."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


class HandDescription:
    """Publisher of the tracked hand.

    Parameters
    ----------
    node : Node
    namespace : str, optional
        Of the topic in the node's: empty, or 'right/'.
    """

    def __init__(self, node: Node, namespace: str = '') -> None:
        self._publisher = node.create_publisher(
            String, namespace + HAND_DESCRIPTION, latched(1))
        self._text = ''

    def publish(self, hand: Hand, layout: MarkerLayout) -> None:
        """Publish the hand, if it is another."""
        text = hand_text(hand, layout)
        if text != self._text:
            self._text = text
            self._publisher.publish(String(data=text))


def follow_hand(node: Node, on_hand: Callable[[Hand, MarkerLayout], object],
                namespace: str = '') -> Subscription:
    """Subscribe to the tracked hand.

    Parameters
    ----------
    node : Node
    on_hand : callable
        Called with each hand and its marker layout.
    namespace : str, optional
        See `HandDescription`.

    Returns
    -------
    Subscription
    """
    def on_description(message: String) -> None:
        try:
            hand, layout = parse_hand(message.data, HAND_DESCRIPTION)
        except HandTrackerError as error:
            node.get_logger().warning(str(error))
            return
        on_hand(hand, layout)

    return node.create_subscription(
        String, namespace + HAND_DESCRIPTION, on_description, latched(MOST_TRACKERS))
