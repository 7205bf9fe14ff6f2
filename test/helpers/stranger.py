"""A stranger in the domain: sends markers, reads the hand, sets a parameter, engages the robot.

    python -m helpers.stranger

Every tenth of a second it prints as a line of JSON what it has reached so far.
"""

import json
import sys
from itertools import count

import rclpy
from builtin_interfaces.msg import Time
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.messages.builders import prefixed_names
from helpers.hands import hand_at

STRANGER_MODULE = 'helpers.stranger'
PARAMETER, WANTED = 'relax_time', 1.75
ROUND_PERIOD = 8_333_333  # of its rounds [ns]
TOLD_EVERY = 12        # rounds
STRANGER_ANGLE = .05   # of each joint of the robot [rad]
STRANGER_FRAME = 'stranger'  # of its markers
WAYS = 7               # in which it tries


def markers(number):
    """Return a hand's markers as a message."""
    # Not of helpers.bench, with which it would come into a ROS domain of its own.
    array, (sec, nanosec) = MarkerArray(), divmod(number * ROUND_PERIOD, 10**9)
    for label, position in enumerate(hand_at()):
        marker = Marker(ns='leds', id=label, type=Marker.SPHERE)
        marker.header.frame_id = STRANGER_FRAME
        marker.header.stamp = Time(sec=sec, nanosec=nanosec)
        at = marker.pose.position
        at.x, at.y, at.z = map(float, position)
        array.markers.append(marker)
    return array


class Stranger:
    """Its endpoints, where it is let have them, and what comes of them."""

    def __init__(self, node):
        self.node = node
        self.reached = {'refused': [], 'frames read': 0, 'listeners': {}, 'set': 0,
                        'engaged': 0, 'nodes': []}
        self._publishers = {topic: self._try(topic, node.create_publisher, kind, topic, 10)
                            for topic, kind in (
                                ('markers', MarkerArray), ('robot/joint_states', JointState),
                                ('retarget/engage', Bool), ('retarget/deadman', Bool))}
        self._try('joint_states', node.create_subscription, JointState, 'joint_states',
                  self._on_hand, 10)
        self._setter, self._engager = (
            self._try(f'{service} service', node.create_client, kind, service)
            for kind, service in (
                (SetParametersAtomically, 'hand_tracker/set_parameters_atomically'),
                (SetBool, 'retarget/engage')))

    def _try(self, name, make, *args):
        try:
            return make(*args)
        except Exception as error:  # RCLError has no public name
            print(f'{name}: {error}', flush=True)
            self.reached['refused'].append(name)
            return None

    def _on_hand(self, _):
        self.reached['frames read'] += 1

    def act(self, number):
        """Send all that it can, once."""
        names = [name.removeprefix('right_') for name in prefixed_names('right_').joints]
        for topic, sent in (
                ('markers', markers(number)),
                ('robot/joint_states', JointState(
                    name=names, position=[STRANGER_ANGLE] * len(names))),
                ('retarget/engage', Bool(data=True)), ('retarget/deadman', Bool(data=True))):
            if publisher := self._publishers[topic]:
                publisher.publish(sent)
                self.reached['listeners'][topic] = max(
                    self.reached['listeners'].get(topic, 0), publisher.get_subscription_count())
        # It asks whether or not it sees anybody who would answer.
        if self._setter and number % 10 == 0:
            wanted = Parameter(PARAMETER, value=WANTED).to_parameter_msg()
            self._setter.call_async(SetParametersAtomically.Request(
                parameters=[wanted])).add_done_callback(self._on_set)
        if self._engager and number % 10 == 5:
            self._engager.call_async(SetBool.Request(data=True)).add_done_callback(
                self._on_engaged)
        self.reached['nodes'] = sorted(set(self.node.get_node_names()) - {self.node.get_name()})

    def _on_set(self, future):
        self.reached['set'] += future.result().result.successful

    def _on_engaged(self, future):
        self.reached['engaged'] += future.result().success


def main():
    """Try until interrupted."""
    rclpy.init()
    node = rclpy.create_node('stranger', start_parameter_services=False, parameter_overrides=[
        Parameter('start_type_description_service', value=False)])
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stranger = Stranger(node)
    try:
        for number in count():
            stranger.act(number)
            until = node.get_clock().now().nanoseconds + ROUND_PERIOD
            while (left := until - node.get_clock().now().nanoseconds) > 0:
                executor.spin_once(left * 1e-9)
            if number % TOLD_EVERY == 0:
                print(json.dumps({'rounds': number, **stranger.reached}), flush=True)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


if __name__ == '__main__':
    sys.exit(main())
