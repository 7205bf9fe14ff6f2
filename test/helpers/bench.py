"""The tracker node on a bench: frames in, what it answers out."""

from contextlib import contextmanager
from threading import Event, Thread

import numpy as np
from builtin_interfaces.msg import Time
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.messages.stamps import seconds
from helpers.hands import hand_at
from helpers.ros_process import TRACKER_MODULE, NodeProcess, watching_node

PERIOD = 8_333_333  # of the frames [ns]
LATE = 120_000      # number of a frame long after those of a test
# However slow the machine is, nothing overwrites what waits.
LOSSLESS = {'qos.markers.reliability': 'reliable', 'qos.markers.depth': 1000,
            'qos.joint_states.depth': 1000}


def stamp_of(number):
    """Return the stamp of a frame; that of frame 0 is zero."""
    sec, nanosec = divmod(number * PERIOD, 10**9)
    return Time(sec=sec, nanosec=nanosec)


def message(positions, number, frame='mocap', ns='leds'):
    """Return the MarkerArray of a frame; rows of NaN are left out every other time."""
    array = MarkerArray()
    for slot, position in enumerate(positions):
        if number % 2 and np.isnan(position).all():
            continue
        marker = Marker(ns=ns, id=slot, type=Marker.SPHERE)
        marker.header.frame_id = frame
        marker.header.stamp = stamp_of(number)
        at = marker.pose.position
        at.x, at.y, at.z = map(float, position)
        array.markers.append(marker)
    return array


def begun_anew(tracker, frame):
    """Return a tracker for which time is to jump back, as for that of a bench."""
    for number in (LATE, LATE + 1, 1):
        tracker.update(frame, seconds(stamp_of(number)))
    return tracker


class Bench:
    """A tracker node and one that sends it markers and sees what comes of them."""

    def __init__(self, process, node, qos, name):
        self.process, self.node, self._name = process, node, name
        self.publisher = node.create_publisher(MarkerArray, 'markers', qos)
        self.joint_states = node.collect(JointState, 'joint_states')
        self.number = 0

    def send(self, positions, **fields):
        """Send a frame; return the stamp that it has."""
        self.number += 1
        self.publisher.publish(message(positions, self.number, **fields))
        return stamp_of(self.number)

    def answer(self, positions, **fields):
        """Send a frame; return the JointState of its stamp."""
        stamp = self.send(positions, **fields)
        self.node.spin_until(lambda: self.joint_states and (
            self.joint_states[-1].header.stamp == stamp))
        return self.joint_states[-1]

    def angles(self, positions, **fields):
        """Send a frame; return the angles of its JointState."""
        return np.array(self.answer(positions, **fields).position)

    def meet(self, positions, heard=(), **fields):
        """Send a frame until all that is to be heard is heard; then time jumps back."""
        self.process.wait_for_line('listening')
        self.node.spin_until(lambda: self.publisher.get_subscription_count() > 0)
        self.number = max(self.number, LATE)
        self.node.repeat(lambda: self.send(positions, **fields),
                         lambda: self.joint_states and all(heard), .05)
        self.jump_back(positions, **fields)

    def jump_back(self, positions, **fields):
        """Send an early frame, which may have a stray stamp; time jumps back with the next."""
        self.number = 0
        self.send(positions, **fields)

    def parameters(self, kind, service, **request):
        """Call one of the node's parameter services."""
        return self.node.call(kind, f'{self._name}/{service}', kind.Request(**request))

    def set(self, values):
        """Set parameters all at once; return the result."""
        return self.parameters(SetParametersAtomically, 'set_parameters_atomically',
                               parameters=messages(values)).result


def messages(values):
    """Return parameters as messages."""
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


@contextmanager
def tracking(parameters=None, qos=1000, remaps=None, environment=None):
    """Yield a bench that loses nothing; its node must end well in the middle of its work."""
    parameters = {**LOSSLESS, **(parameters or {})}
    # The bench's publisher is there while the process still starts: no time is lost to discovery.
    with watching_node() as node, \
            NodeProcess(TRACKER_MODULE, parameters, remaps, environment) as process:
        bench = Bench(process, node, qos, 'hand_tracker')
        yield bench
        process.wait_for_line('listening')
        with sending(bench):
            assert process.interrupt() == 0, process.output
        assert 'Traceback' not in process.output


@contextmanager
def sending(bench):
    """Send frames all the while."""
    ended, array = Event(), message(hand_at(), 1)

    def send():
        while not ended.wait(.0005):
            bench.publisher.publish(array)

    thread = Thread(target=send)
    thread.start()
    try:
        bench.node.spin_for(.05)
        yield
    finally:
        ended.set()
        thread.join()


def lines(process, text):
    """Return the lines of a process's output that have a text."""
    return [line for line in process.output.splitlines() if text in line]
