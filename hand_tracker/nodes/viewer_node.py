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
from threading import Event
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
from ..core.model.hand import BOTH, JOINTS, SIDES, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MarkerLayout
from ..core.model.skeleton import SKELETON_POINTS, skeleton_points
from ..core.model.states import MarkerState, PalmState
from ..core.options import TrackerOptions
from ..core.tracker import HandState, HandTracker
from ..messages.rviz_markers import HELD_OPACITY, JOINTS_SHOWN, STATE_COLOURS
from ..messages.stamps import Time
from ..tracking.stream import Stream, TrackedFrame, read_or_warn
from ..viewer.serve import add_page_options, view
from .hand_description import follow_hand
from .runner import names_of, run, spinning
from .serialization import Serialization
from .tracker_parameters import (
    AUTO,
    SEPARATE,
    SHARED,
    START,
    START_OF_BOTH,
    common_table,
    hand_table,
    labels_of_both,
    labels_table,
    live_settings,
    markers_parameter,
)

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
        Nodes of the tracker and of what plays a recording to it; empty for no player.
    side : {'right', 'left'}, optional
        Of the hand, of a tracker of both; where left out, such a tracker's right hand is shown,
        and the left one `beside` it.

    Attributes
    ----------
    hand, constraints
        As a `ViewerRecording` has them.
    playhead : Player or None
        None without rosbag2_interfaces.
    beside : Live or None
        None before `prepare`.
    """

    def __init__(self, node: Node, tracker: str = 'hand_tracker', player: str = 'replay',
                 side: str = '') -> None:
        self._node, self._tracker, self._side = node, tracker, side
        self.playhead = Player(node, player) if srv and player else None
        self.beside: Live | None = None
        self._joint_states: deque[bytes] = deque(maxlen=KEPT)
        self._hand_markers: deque[bytes] = deque(maxlen=1)
        self._state: HandState | None = None
        self._numbers: dict[str, str] = {}
        self._progress: dict[str, tuple[str, dict[str, float]] | None] = {}
        self._bare_state: HandState | None = None
        self._bare_hand: Hand | None = None
        self._subscriptions: dict[str, Subscription] = {}
        self._topics = {name: name for name in ('joint_states', 'hand_markers', 'markers')}
        self._scope = ''    # before the names of the hand's parameters
        self._causes: set[str] = set()  # warned of

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
        topics = SHARED
        if start['side'] == BOTH:
            both = self._values(row.name for row in START_OF_BOTH)
            topics = both['marker_topics']
            if not self._side:
                self._side, left = SIDES
                self.beside = Live(self._node, self._tracker, '', left)
            self._topics.update(hand_markers=f'{self._side}/hand_markers')
            if both['joint_state_topics'] == SEPARATE:
                self._topics.update(joint_states=f'{self._side}/joint_states')
            if topics == SEPARATE:
                self._topics.update(markers=f'{self._side}/markers')
        self._scope = f'{self._side}.' if self._side else ''
        known = Event()

        def take(hand: Hand, layout: MarkerLayout) -> None:
            # A tracker of the other hand may publish on this topic too.
            if start['side'] in (AUTO, BOTH, hand.side):
                self._take_hand(hand, layout)
                known.set()

        follow_hand(self._node, take, f'{self._side}/' if self._side else '')
        known.wait()
        names = self._layout.names
        rows = (*hand_table(self.hand, self._scope), *common_table(), *labels_table(names))
        if self._side:
            rows += tuple(markers_parameter(side, topics) for side in SIDES)
        values = self._values(row.name for row in rows)
        self._settings = live_settings(
            self.hand, values, names, self._scope,
            labels_of_both(values, topics, names)[self._side] if self._side else None)
        self.constraints = frozenset(
            name for name, (_, off) in self._changes.items()
            if any(values[parameter] != value for parameter, value in off.items()))
        self._names = names_of(self.hand, start['prefix'], start['wrist_frame'])
        self._serialization = Serialization()
        self._mocap_frame = start['mocap_frame']
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        if self.beside is not None:
            self.beside.prepare(say)
        say('Waiting for the hand: markers come in, and the palm is seen?')

    def _take_hand(self, hand: Hand, layout: MarkerLayout) -> None:
        """Show another hand."""
        self._layout = layout
        self._changes = {name: _change(hand, name, self._scope) for name in CONSTRAINTS}
        rest = forward(joint_table(hand), np.zeros(len(JOINTS)))
        self._template = skeleton_points(tip_offsets(hand), rest, np.zeros(3))[PALM_POINTS]
        self.hand = hand

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
        if self._bare_hand is not self.hand and 'markers' in self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop('markers'))
        for topic in self._subscriptions.keys() - wanted:
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        for topic in wanted - self._subscriptions.keys():
            self._subscriptions[topic] = self._subscribe(topic)
        if not compared:
            self._bare_state = None

    def _subscribe(self, topic: str) -> Subscription:
        if topic == 'markers':
            self._bare_hand = self.hand
            hand, options = constrained(self.hand, self._settings.options, ())
            stream = Stream(HandTracker(hand, self._layout, options), self._serialization.markers(
                self._settings, self._mocap_frame))
            return self._node.create_subscription(
                MarkerArray, self._topics[topic], partial(self._on_markers, stream),
                QoSProfile(depth=100), raw=self._serialization.raw)
        kind, frames = (JointState, self._joint_states) if topic == 'joint_states' else (
            MarkerArray, self._hand_markers)
        # As bytes: of most messages nothing is ever looked at.
        return self._node.create_subscription(
            kind, self._topics[topic], lambda data: frames.append(data), LATEST, raw=True)

    def constrain(self, constraints: Collection[str]) -> None:
        """Have the tracker track with these constraints from now on.

        What the tracker refuses is as before in `constraints` again, once it has answered.
        """
        if self.beside is not None:
            self.beside.constrain(constraints)
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
        message, first = deserialize_message(joint_state, JointState), self._names.joints[0]
        # Of both hands one follows the other.
        at = message.name.index(first) if first in message.name else 0
        angles = np.array(message.position[at:at + len(JOINTS)])
        shown = {marker.ns.removeprefix(self._names.prefix): marker for marker in
                 deserialize_message(hand_markers, MarkerArray).markers}
        if not {'joints', 'markers'} <= shown.keys() or len(angles) != len(JOINTS):
            return None
        joints, known = shown['joints'], shown['markers']
        if len(joints.points) != len(JOINTS_SHOWN) or len(known.points) > len(self._layout.names):
            return None
        rotation, position = np.empty((3, 3)), np.empty(3)
        place_palm(_array(joints.points)[PALM_SHOWN], self._template, False, rotation, position,
                   np.zeros((5, 3)))
        count = len(self._layout.names)
        markers = np.tile(position, (count, 1))
        states = np.full(count, int(MarkerState.ABSENT))
        if known.points:
            markers[:len(known.points)] = _array(known.points)
            colours = np.array([(tone.r, tone.g, tone.b) for tone in known.colors])
            nearest = np.abs(colours[:, None] - TONES).sum(axis=2).argmin(axis=1)
            states[:len(nearest)] = [KINDS[i] for i in nearest]
        unknown = np.full(count, np.nan)
        found = joints.color.a > .5 * (1. + HELD_OPACITY)
        return HandState(
            PalmState.TRACKED if found else PalmState.LOST, angles, rotation, position,
            forward(joint_table(self.hand), angles, rotation, position), markers, states,
            hidden_for=unknown, confidence=np.full(len(JOINTS), np.nan), residuals=unknown,
            iterations=0)

    def bare_state(self) -> HandState | None:
        """Return the hand tracked here without any constraint; None before the first frame."""
        return self._bare_state

    def _on_markers(self, stream: Stream, message: Any) -> None:
        markers = read_or_warn(stream.reader, message, self._warn_once)
        if markers is None:
            return
        frame = stream.track(markers, time.monotonic(), self._receipt_stamp)
        if isinstance(frame, TrackedFrame) and frame.is_valid:
            self._bare_state = frame.state

    def _warn_once(self, key: str, text: str) -> None:
        if key not in self._causes:
            self._causes.add(key)
            self._node.get_logger().warning(text)

    def _receipt_stamp(self) -> Time:
        return self._node.get_clock().now().to_msg()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            node, _, hand = status.name.partition(': ')
            if self._side and node == self._tracker and not hand.startswith(self._side):
                continue
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


def _change(hand: Hand, name: str, scope: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the parameters of a constraint, with their values while it is on and off."""
    on, off = (_parameters(hand, constraints, scope) for constraints in (
        CONSTRAINTS.keys(), CONSTRAINTS.keys() - {name}))
    changed = [parameter for parameter in on if on[parameter] != off[parameter]]
    return ({parameter: on[parameter] for parameter in changed},
            {parameter: off[parameter] for parameter in changed})


def _parameters(hand: Hand, constraints: Collection[str], scope: str) -> dict[str, Any]:
    constrained_hand, options = constrained(hand, TrackerOptions(), constraints)
    values = {row.name: row.default for row in hand_table(constrained_hand, scope)}
    return {**values, **asdict(options)}


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
