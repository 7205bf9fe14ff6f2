"""The viewer node: the hand that a running tracker publishes, in the browser.

Before --ros-args it takes --host ADDRESS and --port PORT; the parameter `tracker` names the
tracker's node, whose constraints it switches, and `player` that of the recording's player,
which it pauses and speeds up by rosbag2's services, where there is one.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from queue import Empty, Queue
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..calibration.live_take import told_progress
from ..core.constraints import CONSTRAINTS, constrained
from ..core.inverse_kinematics.palm import place_palm
from ..core.model.hand import JOINTS
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MARKERS
from ..core.model.skeleton import SKELETON_POINTS, skeleton_points
from ..core.model.states import MarkerState, PalmState
from ..core.options import TrackerOptions
from ..core.tracker import HandState, HandTracker
from ..messages.rviz_markers import HELD_OPACITY, JOINTS_SHOWN, STATE_COLOURS
from ..messages.stamps import seconds
from ..viewer.serve import add_page_options, view
from .runner import names_of, run, spinning
from .serialization import Serialization
from .tracker_parameters import START, live_settings, live_table, starting_hand

try:
    from rosbag2_interfaces import srv
except ImportError:
    srv = None

SERVICE_POLL = .1    # [s]
ASKED_EVERY = 1.     # [s] whether the player is paused: others may pause it too
KEPT = 100           # joint states that may wait for the markers of their stamp
# In bytes: behind the encapsulation, and there behind the number of markers.
JOINTS_STAMP, MARKERS_STAMP = slice(4, 12), slice(8, 16)
ANSWER = 1.          # [s] after which the tracker is asked again
# Of the palm, within which no joint moves: they tell where the wrist is.
PALM_POINTS = [SKELETON_POINTS.index(name)
               for name in ('wrist', 'index_proximal', 'little_proximal')]
PALM_SHOWN = [JOINTS_SHOWN.index(point) for point in PALM_POINTS]
KINDS, TONES = tuple(STATE_COLOURS), np.array(tuple(STATE_COLOURS.values()))
CALIBRATE_NODE = 'calibrate'  # beside the tracker
LATEST = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
NUMBERS = {'rate': ('rate [Hz]', 'Hz'), 'latency': ('latency p50 [ms]', 'ms'),
           'residual': ('mean residual [mm]', 'mm')}


class Player:
    """The node that plays the recording, as the viewer's playhead: that of rosbag2, or replay.

    Where it is in the recording it does not tell.

    Parameters
    ----------
    node : Node
    name : str
        Of the player.

    Attributes
    ----------
    duration : None
    playing : bool
    there : bool
        Whether the player answers.
    """

    duration = None

    def __init__(self, node: Node, name: str) -> None:
        self._is_paused, self._pause, self._resume, self._set_rate = (
            node.create_client(kind, f'{name}/{service}') for kind, service in (
                (srv.IsPaused, 'is_paused'), (srv.Pause, 'pause'), (srv.Resume, 'resume'),
                (srv.SetRate, 'set_rate')))
        self.playing, self.there = True, False
        self._asked = -np.inf

    def look(self) -> None:
        """Ask whether it is there and plays, when it is time."""
        now = time.monotonic()
        if now - self._asked < ASKED_EVERY:
            return
        self._asked = now
        if self._is_paused.service_is_ready():
            self._is_paused.call_async(srv.IsPaused.Request()).add_done_callback(self._on_answer)
        else:
            self.there = False

    def _on_answer(self, future: Future) -> None:
        self.playing, self.there = not future.result().paused, True

    def toggle(self) -> None:
        """Pause or go on."""
        if self.playing:
            self._pause.call_async(srv.Pause.Request())
        else:
            self._resume.call_async(srv.Resume.Request())
        self.playing = not self.playing

    def set_rate(self, rate: float) -> None:
        """Play so many times as fast as recorded [1]."""
        self._set_rate.call_async(srv.SetRate.Request(rate=rate))


class Live:
    """A running tracker as a source of the viewer.

    Parameters
    ----------
    node : Node
    tracker, player : str, optional
        Nodes of the tracker and of what plays a recording to it.

    Attributes
    ----------
    hand, constraints
        As a `ViewerRecording` has them.
    playhead : Player or None
        None without rosbag2_interfaces.
    """

    def __init__(self, node: Node, tracker: str = 'hand_tracker', player: str = 'replay') -> None:
        self._node, self._tracker = node, tracker
        self.playhead = Player(node, player) if srv else None
        self._joint_states: deque[bytes] = deque(maxlen=KEPT)
        self._hand_markers: deque[bytes] = deque(maxlen=1)
        self._state: HandState | None = None
        self._numbers: dict[str, str] = {}
        self._progress: dict[str, tuple[str, dict[str, float]] | None] = {}
        self._bare_state: HandState | None = None
        self._subscriptions: dict[str, Subscription] = {}

    def prepare(self, say: Callable[[str], object]) -> None:
        """Wait for the tracker, and ask it whose hand it tracks, and how.

        Parameters
        ----------
        say : callable
            Told in a line what it waits for.
        """
        self._get = self._node.create_client(GetParameters, f'{self._tracker}/get_parameters')
        self._set = self._node.create_client(
            SetParametersAtomically, f'{self._tracker}/set_parameters_atomically')
        say(f'Waiting for the tracker {self._tracker}')
        while not self._get.wait_for_service(SERVICE_POLL):
            pass
        start = self._values(row.name for row in START)
        self.hand, self._layout = starting_hand(start)
        values = self._values(row.name for row in live_table(self.hand))
        self._settings = live_settings(self.hand, values)
        self._changes = {name: self._change(name) for name in CONSTRAINTS}
        self.constraints = frozenset(
            name for name, (_, off) in self._changes.items()
            if any(values[parameter] != value for parameter, value in off.items()))
        self._names = names_of(self.hand, start['prefix'], start['wrist_frame'])
        self._reader = Serialization(self._names).markers(self._settings, start['mocap_frame'])
        self._template = self._points(np.zeros(len(JOINTS)))[PALM_POINTS]
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        say('Waiting for the hand: markers come in, and the palm is seen?')

    def _points(self, angles: np.ndarray) -> np.ndarray:
        """Return the skeleton's points in the wrist's frame [m]."""
        return skeleton_points(
            tip_offsets(self.hand), forward(joint_table(self.hand), angles), np.zeros(3))

    def _values(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the values of the tracker's parameters by name."""
        names = list(names)
        response = self._answer(self._get, GetParameters.Request(names=names))
        return {name: parameter_value_to_python(value)
                for name, value in zip(names, response.values)}

    def _answer(self, client: Client, request: Any) -> Any:
        answers: Queue[Any] = Queue()
        # An answer can be lost while the tracker has not discovered who asks.
        while True:
            client.call_async(request).add_done_callback(
                lambda future: answers.put(future.result()))
            with suppress(Empty):
                return answers.get(timeout=ANSWER)

    def _change(self, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the parameters of a constraint, with their values while it is on and off."""
        on, off = (self._parameters(constraints) for constraints in (
            CONSTRAINTS.keys(), CONSTRAINTS.keys() - {name}))
        changed = [parameter for parameter in on if on[parameter] != off[parameter]]
        return ({parameter: on[parameter] for parameter in changed},
                {parameter: off[parameter] for parameter in changed})

    def _parameters(self, constraints: Collection[str]) -> dict[str, Any]:
        hand, options = constrained(self.hand, TrackerOptions(), constraints)
        values = {row.name: row.default for row in live_table(hand)}
        return {**values, **asdict(options)}

    def set_demand(self, looked_at: bool, compared: bool) -> None:
        """Subscribe to the topics that are shown, and to no others.

        Parameters
        ----------
        looked_at : bool
        compared : bool
            Whether `bare_state` is asked for.
        """
        wanted = set()
        if looked_at and self.playhead is not None:
            self.playhead.look()
        if looked_at:
            wanted |= {'joint_states', 'hand_markers'}
        if compared:
            wanted |= {'markers'}
        for topic in self._subscriptions.keys() - wanted:
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        for topic in wanted - self._subscriptions.keys():
            self._subscriptions[topic] = self._subscribe(topic)
        if not compared:
            self._bare_state = None

    def _subscribe(self, topic: str) -> Subscription:
        if topic == 'markers':
            hand, options = constrained(self._settings.hand, self._settings.options, ())
            kind, quality = MarkerArray, QoSProfile(depth=100)
            callback: Callable[[bytes], None] = partial(
                self._on_markers, HandTracker(hand, self._layout, options))
        else:
            kind, frames = (JointState, self._joint_states) if topic == 'joint_states' else (
                MarkerArray, self._hand_markers)
            quality, callback = LATEST, lambda data: frames.append(data)
        # As bytes: of most messages nothing is ever looked at.
        return self._node.create_subscription(kind, topic, callback, quality, raw=True)

    def constrain(self, constraints: Collection[str]) -> None:
        """Have the tracker track with these constraints from now on.

        What the tracker refuses is as before in `constraints` again, once it has answered.
        """
        for name in self.constraints ^ frozenset(constraints):
            values = self._changes[name][0 if name in constraints else 1]
            request = SetParametersAtomically.Request(parameters=[
                Parameter(key, value=value).to_parameter_msg() for key, value in values.items()])
            self._set.call_async(request).add_done_callback(partial(self._on_answer, name))
        self.constraints = frozenset(constraints)

    def _on_answer(self, name: str, future: Future) -> None:
        result = future.result().result
        if not result.successful:
            self.constraints ^= {name}
            self._node.get_logger().warning(
                f"{self._tracker} does not switch '{name}': {result.reason}")

    def state(self) -> HandState | None:
        """Return the hand as it was published last; None before the first frame."""
        for markers in tuple(self._hand_markers):
            stamp = markers[MARKERS_STAMP]
            for joints in reversed(tuple(self._joint_states)):
                if joints[JOINTS_STAMP] == stamp:
                    self._state = self._frame(joints, markers) or self._state
                    break
        return self._state

    def _frame(self, joint_state: bytes, hand_markers: bytes) -> HandState | None:
        """Return the hand of two messages, as far as they tell it.

        None if they are not this tracker's.
        """
        angles = np.array(deserialize_message(joint_state, JointState).position)
        shown = {marker.ns.removeprefix(self._names.prefix): marker for marker in
                 deserialize_message(hand_markers, MarkerArray).markers}
        if not {'joints', 'markers'} <= shown.keys() or len(angles) != len(JOINTS):
            return None
        joints, known = shown['joints'], shown['markers']
        if len(joints.points) != len(JOINTS_SHOWN) or len(known.points) > len(MARKERS):
            return None
        rotation, position = np.empty((3, 3)), np.empty(3)
        place_palm(_array(joints.points)[PALM_SHOWN], self._template, False, rotation, position,
                   np.zeros((5, 3)))
        markers = np.tile(position, (len(MARKERS), 1))
        states = np.full(len(MARKERS), int(MarkerState.ABSENT))
        if known.points:
            markers[:len(known.points)] = _array(known.points)
            colours = np.array([(tone.r, tone.g, tone.b) for tone in known.colors])
            nearest = np.abs(colours[:, None] - TONES).sum(axis=2).argmin(axis=1)
            states[:len(nearest)] = [KINDS[i] for i in nearest]
        unknown = np.full(len(MARKERS), np.nan)
        found = joints.color.a > .5 * (1. + HELD_OPACITY)
        return HandState(
            PalmState.TRACKED if found else PalmState.LOST, angles, rotation, position,
            forward(joint_table(self.hand), angles, rotation, position), markers, states,
            hidden_for=unknown, confidence=np.full(len(JOINTS), np.nan), residuals=unknown,
            iterations=0)

    def bare_state(self) -> HandState | None:
        """Return the hand tracked here without any constraint; None before the first frame."""
        return self._bare_state

    def _on_markers(self, tracker: HandTracker, data: bytes) -> None:
        frame = self._reader.read(data)
        if frame.stamp is not None:
            state = tracker.update(frame.positions, seconds(frame.stamp))
            if tracker.placed:
                self._bare_state = state

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            node = status.name.partition(':')[0]
            values = {value.key: value.value for value in status.values}
            if node == self._tracker:
                self._numbers = values
            if node in (self._tracker, CALIBRATE_NODE):
                self._progress[node] = told_progress(values)

    def numbers(self, state: HandState) -> dict[str, str]:
        """Return the tracker's values on /diagnostics as texts, by name."""
        return {name: f'{float(text):.3g} {unit}' if (text := self._numbers.get(key)) else '–'
                for name, (key, unit) in NUMBERS.items()}

    def calibration(self) -> tuple[str, dict[str, float]] | None:
        """Return a calibration's prompt and the share of each movement; None if none runs."""
        return self._progress.get(self._tracker) or self._progress.get(CALIBRATE_NODE)


def _array(points: Sequence[Point]) -> np.ndarray:
    return np.array([(point.x, point.y, point.z) for point in points])


def main(args: list[str] | None = None) -> int:
    """Serve the page until interrupted; return the exit code."""
    parser = argparse.ArgumentParser(prog='viewer', description=__doc__.split('\n')[0])
    add_page_options(parser)
    options = parser.parse_args(remove_ros_args(args)[1:] if args is None else args)

    def make() -> Node:
        node = Node('viewer')
        node.declare_parameter('tracker', 'hand_tracker')
        node.declare_parameter('player', 'replay')
        return node

    def work(node: Node) -> None:
        with spinning(node):
            view(Live(node, *(node.get_parameter(name).value for name in ('tracker', 'player'))),
                 options)

    return run(make, work, args)


if __name__ == '__main__':
    sys.exit(main())
