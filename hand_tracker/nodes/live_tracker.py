"""A running tracker as a source of the viewer: its hand, its constraints, its diagnostics."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from queue import Empty, Queue
from threading import Event
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..calibration.live_take import progress_from_diagnostics
from ..core.constraints import CONSTRAINTS, constrained
from ..core.model.hand import BOTH, SIDES, Hand
from ..core.model.marker_layout import MarkerLayout
from ..core.options import TrackerOptions
from ..core.tracker import HandState, HandTracker
from ..messages.stamps import Time
from ..tracking.rate_limit import OncePerKey
from ..tracking.stream import Stream, TrackedFrame, read_or_warn
from .hand_description import follow_hand
from .player_client import PlayerClient
from .published_hand import PublishedHand
from .runner import names_of
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

SERVICE_POLL = .1    # [s]
HINT_AFTER = 5.      # [s] without the tracker, before others are named
TRACKER_SERVICE = re.compile(f'(/({"|".join(SIDES)}))?/load_hand$')
ANSWER = 1.          # [s] after which the tracker is asked again
CALIBRATE_NODE = 'calibrate'  # beside the tracker
LATEST = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
NUMBERS = {'rate': ('rate [Hz]', 'Hz'), 'latency': ('latency p50 [ms]', 'ms'),
           'residual': ('mean residual [mm]', 'mm')}


class LiveTracker:
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
    playhead : PlayerClient or None
        None without rosbag2_interfaces.
    beside : LiveTracker or None
        None before `prepare`.
    """

    def __init__(self, node: Node, tracker: str = 'hand_tracker', player: str = 'replay',
                 side: str = '') -> None:
        self._node, self._tracker, self._side = node, tracker, side
        self.playhead = PlayerClient(node, player) if player and PlayerClient.is_available else None
        self.beside: LiveTracker | None = None
        self._published: PublishedHand | None = None
        self._numbers: dict[str, str] = {}
        self._progress: dict[str, tuple[str, dict[str, float]] | None] = {}
        self._bare_state: HandState | None = None
        self._bare_hand: Hand | None = None
        self._subscriptions: dict[str, Subscription] = {}
        self._topics = {name: name for name in ('joint_states', 'hand_markers', 'markers')}
        self._scope = ''    # before the names of the hand's parameters
        self._once = OncePerKey()

    def prepare(self, say: Callable[[str], object]) -> None:
        """Wait for the tracker, and ask it whose hand it tracks, and how.

        Parameters
        ----------
        say : callable
            Called with a line: what it waits for.
        """
        self._get = self._node.create_client(GetParameters, f'{self._tracker}/get_parameters')
        self._set = self._node.create_client(
            SetParametersAtomically, f'{self._tracker}/set_parameters_atomically')
        say(f'Waiting for the tracker {self._tracker}')
        begun, hint = time.monotonic(), ''
        while not self._get.wait_for_service(SERVICE_POLL):
            if not hint and time.monotonic() - begun >= HINT_AFTER and (
                    hint := self._hint_at_others()):
                line = f'Waiting for the tracker {self._tracker}, which is not there; {hint}'
                self._node.get_logger().warning(line)
                say(line)
        start = self._values(row.name for row in START)
        topics = SHARED
        if start['side'] == BOTH:
            both = self._values(row.name for row in START_OF_BOTH)
            topics = both['marker_topics']
            if not self._side:
                self._side, left = SIDES
                self.beside = LiveTracker(self._node, self._tracker, '', left)
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
        self._published = PublishedHand(
            names_of(self.hand, start['prefix'], start['wrist_frame']), self.hand, self._layout)
        self._serialization = Serialization()
        self._mocap_frame = start['mocap_frame']
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        if self.beside is not None:
            self.beside.prepare(say)
        say('Waiting for the hand: markers come in, and the palm is seen?')

    def _hint_at_others(self) -> str:
        """Name the trackers that are there, by a service that each has; empty where none is."""
        hints = []
        for path in sorted({TRACKER_SERVICE.sub('', name)
                            for name, _ in self._node.get_service_names_and_types()
                            if TRACKER_SERVICE.search(name)}):
            namespace, _, name = path.rpartition('/')
            moved = '' if (namespace or '/') == self._node.get_namespace() else (
                f'-r __ns:={namespace or "/"} ')
            hints.append(f'there is {path} (--ros-args {moved}-p tracker:={name})')
        return ', '.join(hints)

    def _take_hand(self, hand: Hand, layout: MarkerLayout) -> None:
        """Show another hand."""
        self._layout = layout
        self._changes = {name: _change(hand, name, self._scope) for name in CONSTRAINTS}
        if self._published is not None:
            self._published.set_hand(hand, layout)
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
            self.playhead.poll()
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
        assert self._published is not None
        kind, frames = (JointState, self._published.joint_states) if topic == 'joint_states' else (
            MarkerArray, self._published.hand_markers)
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
        return None if self._published is None else self._published.state()

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
        if self._once.allows(key):
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
                self._progress[node] = progress_from_diagnostics(values)

    def numbers(self, state: HandState) -> dict[str, str]:
        """Return the tracker's values on /diagnostics as texts, by name."""
        # `state`, of the interface, is for recordings: here diagnostics have the values.
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
