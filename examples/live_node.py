"""A live node: MarkerArrays in, JointStates out. Needs ROS 2."""

import sys

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from hand_tracker import JOINTS, HandTracker
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.marker_array import markers_from_message
from hand_tracker.messages.stamps import seconds
from hand_tracker.nodes.runner import run


class LiveNode(Node):
    def __init__(self):
        super().__init__('live_hand')
        self.tracker, self.labels = HandTracker(), LabelMap()
        self.publisher = self.create_publisher(JointState, 'joint_states', 10)
        self.create_subscription(MarkerArray, 'markers', self.track, qos_profile_sensor_data)

    def track(self, message):
        frame = markers_from_message(message, self.labels)
        if frame.stamp is None:    # no marker of the hand
            return
        state = self.tracker.update(frame.positions, seconds(frame.stamp))
        if self.tracker.placed:
            answer = JointState(name=JOINTS, position=state.angles.tolist())
            answer.header.stamp = frame.stamp
            self.publisher.publish(answer)


if __name__ == '__main__':
    sys.exit(run(LiveNode))    # until Ctrl-C
