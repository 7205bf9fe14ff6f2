"""Simulate node: publish the markers of a simulated hand live, as a camera system's driver does.

When the motion has ended it begins again. With `truth` the true joint angles, the wrist's true
pose and the true marker positions are published too, on topics of their own.
"""

import sys
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import count
from typing import NamedTuple

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..core.model.hand import SIDES
from ..messages.marker_array import MARKER_ARRAY
from ..messages.stamps import header_stamp, marker_stamps, restamp
from ..simulation.cameras import CAMERAS_RANGE, PAPER_CAMERAS, CameraRig
from ..simulation.faults import FAULT_RATE_RANGE, Faults
from ..simulation.motion_names import MOTION_DURATION
from ..simulation.motions import DURATION_RANGE, FRAME_RATE_RANGE, MOTIONS
from ..simulation.packaged_recordings import JOINT_TRUTH_TOPIC, MARKER_TOPIC, RECORDING_FRAME_ID
from ..simulation.simulator import (
    MARKER_TRUTH_TOPIC,
    WRIST_TRUTH_TOPIC,
    Simulation,
    frame_messages,
    simulated_hand,
)
from ..tracking.playback import read_ahead
from .executors import steady_clock
from .parameters import Parameter
from .runner import declare, run, spin

SIMULATE_AHEAD = 2000  # messages simulated in advance
SIMULATED_DEPTH = 10
TRUTH_DEPTH = 1000     # an evaluation needs every frame
TRUTH_TOPICS = {JOINT_TRUTH_TOPIC: JointState, WRIST_TRUTH_TOPIC: PoseStamped,
                MARKER_TRUTH_TOPIC: MarkerArray}

SIMULATE_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    Parameter('motion', 'demo', 'What the hand does', choices=tuple(MOTIONS)),
    Parameter('cameras', PAPER_CAMERAS, 'Cameras in the ring', CAMERAS_RANGE),
    Parameter('rate', 120., 'Frames per second [Hz]', FRAME_RATE_RANGE),
    Parameter('seed', 1, 'Of all that is drawn', (0, 2**31 - 1)),
    Parameter('duration', MOTION_DURATION, 'After which the motion begins again, at least [s]; '
              'the demo has its own', DURATION_RANGE),
    Parameter('hand_file', '', 'Hand file (YAML) of the simulated hand; empty for the mean hand'),
    Parameter('layout', '', "Markers that are worn: a layout preset's name, or a layout file "
              "(YAML); empty for the hand file's"),
    Parameter('side', 'file', "Side of the hand; 'file' for the hand file's",
              choices=('file', *SIDES)),
    Parameter('swaps', 0., 'Labels of neighbours exchanged [1/s]', FAULT_RATE_RANGE),
    Parameter('ghosts', 0., 'Reflections taken for markers [1/s]', FAULT_RATE_RANGE),
    Parameter('dropouts', 0., 'Labels lost [1/s]', FAULT_RATE_RANGE),
    Parameter('frozen', 0., 'Markers repeated where they were [1/s]', FAULT_RATE_RANGE),
    Parameter('truth', False, 'Publish the truth: joint_states_truth, wrist_truth, markers_truth'),
))


class SimulatedMessage(NamedTuple):
    """A simulated message that is to be published.

    Attributes
    ----------
    lap : int
        Number of repetitions of the motion before it.
    time : int
        When it is due, from the first message [ns].
    publisher : Publisher
    data : bytes
        Serialised (CDR).
    stamps : tuple of int
        Offsets of the stamps in it.
    """

    lap: int
    time: int
    publisher: Publisher
    data: bytes
    stamps: tuple


class SimulateNode(Node):
    """Node that publishes a simulated hand."""

    def __init__(self) -> None:
        super().__init__('simulate')
        values = declare(self, SIMULATE_PARAMETERS)
        side = None if values['side'] == 'file' else values['side']
        hand, layout = simulated_hand(values['hand_file'], side, values['layout'])
        self._simulation = Simulation(
            values['motion'], hand, layout, CameraRig.ring(values['cameras']), values['rate'],
            values['seed'], values['duration'],
            Faults(*(values[kind] for kind in Faults._fields)))
        # As drivers do: a late frame is worth nothing.
        quick = QoSProfile(depth=SIMULATED_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._markers = self.create_publisher(MarkerArray, MARKER_TOPIC.lstrip('/'), quick)
        self._truth = {topic: self.create_publisher(kind, topic.lstrip('/'), TRUTH_DEPTH)
                       for topic, kind in TRUTH_TOPICS.items() if values['truth']}
        self._lap = 0
        self._period = 1. / values['rate']
        self._messages = read_ahead(self._laps(), SIMULATE_AHEAD)

    def play(self) -> None:
        """Publish until interrupted."""
        with closing(self._messages):
            self._next = next(self._messages)
            self._wall, self._start = time.time_ns(), time.monotonic_ns()
            self.create_timer(self._period, self._publish,
                              clock=steady_clock())
            self.get_logger().info(
                f'{self._simulation.motion} at {self._simulation.rate:g} Hz, '
                f'frame {RECORDING_FRAME_ID}, '
                f'on {self._markers.topic_name}; it begins again after '
                f'{self._simulation.moving.duration:.0f} s')
            spin(self)

    def _publish(self) -> None:
        now = time.monotonic_ns() - self._start
        while self._next.time <= now:
            lap, time_ns, publisher, data, stamps = self._next
            if lap != self._lap:
                self._lap = lap
                self.get_logger().info(f'{self._simulation.motion} begins again, lap {lap + 1}')
            publisher.publish(restamp(data, stamps, self._wall + time_ns))
            self._next = next(self._messages)

    def _laps(self) -> Iterator[SimulatedMessage]:
        """Yield the messages of the motion, again and again."""
        side, period, frame = self._simulation.hand.side, 1e9 * self._period, 0
        for lap in count():
            for part in self._simulation.blocks():
                for markers, *truth in frame_messages(
                        part, side, bool(self._truth), self._simulation.layout.names):
                    due = round(frame * period)
                    yield SimulatedMessage(
                        lap, due, self._markers, markers.data, marker_stamps(markers.data))
                    for message in truth:
                        find = marker_stamps if message.type == MARKER_ARRAY else header_stamp
                        yield SimulatedMessage(lap, due, self._truth[message.topic],
                                               message.data, find(message.data))
                    frame += 1


def main(args: list[str] | None = None) -> int:
    """Run the simulate node until it is interrupted; return its exit code."""
    return run(SimulateNode, SimulateNode.play, args, 'simulate')


if __name__ == '__main__':
    sys.exit(main())
