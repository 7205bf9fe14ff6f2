"""Skin node: subscribe to joint states, publish the hand's skin as triangles for RViz.

The hand is the one that the tracker beside it publishes on `hand_description`, until then that of
the parameters. It computes only for subscribers: while `hand_skin` has none, it hears no angles.
"""

import sys
import time

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker

from ..background import NewestCall
from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MarkerLayout
from ..messages.joint_states import angles_of
from ..skin import deform, load_skin
from ..skin.load import has_skin_of
from ..skin.skinning import Skin
from .executors import steady_clock
from .hand_description import follow_hand
from .parameters import Parameter
from .runner import declare, names_of, run
from .serialization import Serialization
from .tracker_parameters import START, starting_hand, with_defaults

# A reliable subscriber asks for lost fragments when the next message comes: keep the last few.
SKIN_DEPTH = 5
# Those that the tracker has too and that shape the hand; limits and coupling do not.
HAND_PARAMETERS = ('hand_file', 'side', 'hand_length', 'hand_breadth', 'thumb', 'prefix',
                   'wrist_frame')
SKIN_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    *(row for row in START if row.name in HAND_PARAMETERS),
    Parameter('mesh', '', 'Closed mesh of the hand with straight joints (OBJ, PLY, STL), in '
              'any place and size; empty for one made from the hand'),
    Parameter('rate', 30., 'Of hand_skin at most [Hz]', range=(.1, 30.)),
    Parameter('dual_quaternions', False, 'Blend dual quaternions in place of matrices: bent '
              'joints keep their volume'),
))


class SkinNode(Node):
    """Node that publishes the skin of one hand."""

    def __init__(self) -> None:
        super().__init__('hand_skin')
        values = declare(self, SKIN_PARAMETERS)
        hand, _ = starting_hand(with_defaults(values))
        self._names = names_of(hand, values['prefix'], values['wrist_frame'])
        self._dual_quaternions = values['dual_quaternions']
        self._side, mesh = hand.side, values['mesh'] or None
        self._loading: NewestCall[Hand, Skin] = NewestCall(
            lambda another: load_skin(another, mesh))
        start = time.monotonic()
        self._skin = load_skin(hand, mesh)
        self._joints = joint_table(hand)
        self._serialization = Serialization()
        self._triangles = self._serialization.skin(self._names, self._skin.faces.size)
        self._own = self._names.joints[0].encode()
        self._subscription = None
        self._data: bytes | None = None
        self._publisher = self.create_publisher(Marker, 'hand_skin', SKIN_DEPTH)
        self._hand, self._followed = hand, follow_hand(self, self._on_hand)
        self.create_timer(1. / values['rate'], self._show,
                          clock=steady_clock())
        self.get_logger().info(
            f'{hand.side} hand: a skin of {len(self._skin.vertices)} vertices, '
            f'ready after {time.monotonic() - start:.1f} s')

    def _on_hand(self, hand: Hand, _: MarkerLayout) -> None:
        # A tracker of the other hand may publish on this topic too.
        if hand.side == self._side and not has_skin_of(hand, self._hand):
            self._hand = hand
            self._loading.ask(hand)

    def _take_hand(self) -> None:
        """Take over the skin of another hand, when it is loaded."""
        try:
            loaded = self._loading.poll()
        except HandTrackerError as error:
            self.get_logger().error(f'the skin stays that of the former hand: {error}')
            return
        if loaded is not None:
            hand, self._skin = loaded
            self._joints = joint_table(hand)
            self._triangles = self._serialization.skin(self._names, self._skin.faces.size)
            self.get_logger().info(f'a skin of {len(self._skin.vertices)} vertices, of the hand '
                                   'that the tracker has now')

    def _show(self) -> None:
        is_subscribed = self._publisher.get_subscription_count() > 0
        if is_subscribed and not self._subscription:
            latest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._subscription = self.create_subscription(
                JointState, 'joint_states', self._on_joint_states, latest, raw=True)
        elif self._subscription and not is_subscribed:
            self.destroy_subscription(self._subscription)
            self._subscription = self._data = None
        if is_subscribed:
            self._take_hand()
        if is_subscribed and self._data:
            data, self._data = self._data, None
            self._publish(deserialize_message(data, JointState))

    def _on_joint_states(self, data: bytes) -> None:
        # A robot's joint states may come on this topic too.
        if self._own in data:
            self._data = data

    def _publish(self, message: JointState) -> None:
        angles = angles_of(message, self._names.joints)
        if angles is None:
            return
        vertices = deform(self._skin, forward(self._joints, angles), self._dual_quaternions)
        self._publisher.publish(
            self._triangles.fill(message.header.stamp, vertices[self._skin.faces]))


def main(args: list[str] | None = None) -> int:
    """Run the skin node until it is interrupted; return its exit code."""
    return run(SkinNode, args=args, name='skin')


if __name__ == '__main__':
    sys.exit(main())
