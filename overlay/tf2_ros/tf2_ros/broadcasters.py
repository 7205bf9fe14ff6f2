"""Send transforms to /tf and /tf_static, as the broadcasters of the real tf2_ros do."""

from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage


class TransformBroadcaster:
    """Publish transforms that change on /tf.

    Parameters
    ----------
    node : rclpy.node.Node
    qos : rclpy.qos.QoSProfile or int, optional
        Reliable with depth 100 unless given.
    """

    def __init__(self, node, qos=None):
        qos = QoSProfile(depth=100) if qos is None else qos
        self.pub_tf = node.create_publisher(TFMessage, '/tf', qos)

    def sendTransform(self, transform):
        """Send one TransformStamped, or several in one message."""
        self.pub_tf.publish(TFMessage(transforms=_as_list(transform)))


class StaticTransformBroadcaster:
    """Publish transforms that stay on /tf_static, latched for listeners that come later.

    Parameters
    ----------
    node : rclpy.node.Node
    qos : rclpy.qos.QoSProfile or int, optional
        Reliable and transient local with depth 1 unless given.
    """

    def __init__(self, node, qos=None):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        qos = latched if qos is None else qos
        self.pub_tf = node.create_publisher(TFMessage, '/tf_static', qos)
        self._by_child_frame = {}

    def sendTransform(self, transform):
        """Send one TransformStamped or several, along with every one sent before."""
        # Depth 1 keeps one message for late listeners, so it must hold all frames.
        self._by_child_frame.update((each.child_frame_id, each) for each in _as_list(transform))
        self.pub_tf.publish(TFMessage(transforms=list(self._by_child_frame.values())))


def _as_list(transform):
    return [transform] if isinstance(transform, TransformStamped) else list(transform)
