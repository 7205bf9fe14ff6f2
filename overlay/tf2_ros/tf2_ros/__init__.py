"""The two broadcasters of tf2_ros, for the ROS 2 wheels, which come without it."""

from tf2_ros.broadcasters import StaticTransformBroadcaster, TransformBroadcaster

__all__ = ['StaticTransformBroadcaster', 'TransformBroadcaster']
