"""The tracker node: markers in; joint states, TF and RViz markers of one hand or of both out."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

from ..adapters.marker_messages import MARKER_MESSAGES, MESSAGE_OF_TYPE
from ..adapters.point_frame import SourceUnavailable
from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, SIDES
from ..core.numerics import jit
from ..core.point_labelling.cloud_labeller import compile_kernels as compile_labelling
from ..core.tracker import HandTracker
from ..messages.labels import LabelMap
from ..messages.landmark_kinds import NAMED_LANDMARKS
from ..messages.message_kinds import MARKER_ARRAY_KIND
from ..messages.stamps import Time
from ..tracking.compile_kernels import compile_tracking, prepare_kernels
from ..tracking.diagnostics import STATUS_PERIOD
from ..tracking.point_labels import PointLabels
from .executors import SubscriptionHidingNode, steady_clock
from .fast_path import FastPath, FastPathUnavailable
from .marker_input import MarkerInput
from .message_types import class_of
from .replies import AnsweredHand, Replies
from .runner import declare, qos_of, run
from .serialization import UNKNOWN_LAYOUT, Serialization
from .topic_publishers import full_name, who_publishes
from .tracked_hand import TrackedHand
from .tracker_parameters import (
    FIRST_PUBLISHER,
    SEPARATE,
    SHARED,
    START,
    START_OF_BOTH,
    TOPICS,
    common_table,
    labels_of_both,
    labels_table,
    markers_parameter,
    names_of_both,
    start_of_hand,
    values_of_hand,
)

REPORT_PERIOD = .1      # [s] between two checks of what is to be logged
CALIBRATION_PERIOD = .25  # [s] between two checks of a calibration's whole take
DIAGNOSTICS_DEPTH = 10


class TrackerNode(SubscriptionHidingNode):
    """Track one hand or both.

    Attributes
    ----------
    hands : tuple of TrackedHand
        The right one first.
    inputs : tuple of MarkerInput
        One for each topic of markers.
    diagnostics : rclpy.publisher.Publisher
        Of /diagnostics.
    """

    inputs: tuple[MarkerInput, ...] = ()

    def __init__(self) -> None:
        super().__init__('hand_tracker')
        start = declare(self, START)
        self._live = common_table()
        declare(self, self._live)
        self._serialization = Serialization()
        if not self._serialization.raw:
            self.get_logger().warning(f'{UNKNOWN_LAYOUT}: slower')
        self._qos = {topic: qos_of(start, topic) for topic in TOPICS}
        self.diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', DIAGNOSTICS_DEPTH)
        self._reliability = start['qos.markers.reliability']
        self._kind = MARKER_MESSAGES[start['marker_message']]
        message = class_of(self._kind)
        if not self._serialization.raw and self._kind is not MARKER_ARRAY_KIND:
            raise SourceUnavailable(
                f"marker_message: '{start['marker_message']}'; expected marker_array from a source "
                f'node, as {UNKNOWN_LAYOUT}')
        self._loaded_fast_paths: list[FastPath] = []
        self._is_served_by_events = False

        if start['side'] == BOTH:
            self.hands, groups, is_separate = self._both_hands(start)
            right, left = self.hands
            right.other, left.other = left, right
        else:
            self.hands = TrackedHand(self, start, '', self._serialization, self._qos),
            groups, is_separate = {'markers': self.hands}, False
        self._prepare_kernels(start['fast_path'], len(groups))
        self.inputs = tuple(MarkerInput(
            self, message, topic, self._qos['markers'], hands, Replies(
                self, [AnsweredHand(hand.hand, hand.names, hand.topics) for hand in hands],
                self._serialization, self._qos, start['broadcast'], is_separate),
            self._serialization.raw, start['publishers'] == FIRST_PUBLISHER)
            for topic, hands in groups.items())
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.create_timer(REPORT_PERIOD, self._report, clock=steady_clock())
        self.create_timer(STATUS_PERIOD, self._publish_status, clock=steady_clock())
        self.create_timer(CALIBRATION_PERIOD, self._update_calibrations, clock=steady_clock())
        self.get_logger().info(
            f"{' and '.join(hand.hand.side for hand in self.hands)} hand: listening for markers "
            f"on {' and '.join(one.topic for one in self.inputs)}")
        for hand in self.hands:
            hand.log_unobserved_joints()

    def _both_hands(self, start: Mapping[str, Any]) -> tuple[
            tuple[TrackedHand, ...], dict[str, tuple[TrackedHand, ...]], bool]:
        """Return both hands, those of each topic of markers, and whether joint states are apart."""
        of_hands = [row for side in SIDES for row in start_of_hand(side)]
        start = {**start, **declare(self, (*START_OF_BOTH, *of_hands))}
        topics = start['marker_topics']
        names = names_of_both(start)
        # Landmarks with names, too, are each hand's own, whatever their labels.
        labelled = SEPARATE if self._kind is NAMED_LANDMARKS else topics
        rows = labels_table(names) + tuple(markers_parameter(side, labelled) for side in SIDES)
        declare(self, rows)
        self._live += rows

        def labels(side: str, values: Mapping[str, Any]) -> LabelMap:
            return labels_of_both(values, labelled, names)[side]

        point_labels = PointLabels() if topics == SHARED else None
        hands = tuple(TrackedHand(
            self, values_of_hand(start, side), side, self._serialization, self._qos,
            partial(labels, side), point_labels) for side in SIDES)
        groups: dict[str, tuple[TrackedHand, ...]] = (
            {'markers': hands} if topics == SHARED
            else {f'{hand.topics}markers': (hand,) for hand in hands})
        return hands, groups, start['joint_state_topics'] == SEPARATE

    def _prepare_kernels(self, wants_fast_path: bool, count: int) -> None:
        """Load the kernels from disk, or start their compilation in the background.

        Parameters
        ----------
        wants_fast_path : bool
        count : int
            Of fast paths.
        """
        loaders = {}
        if not jit.JIT_IS_ON:
            cause, cure = (('HAND_TRACKER_JIT=0 turns numba off', 'unset it') if jit.HAS_NUMBA
                           else ('numba is not installed', 'pip install numba'))
            self.get_logger().warning(
                f'{cause}: the tracker is some hundred times slower; {cure}')
            return
        if jit.COMPILED:
            labels_points = any(hand.labels_points for hand in self.hands)
            prepare_kernels(self.get_logger().info, labels_points, interrupted_code=0)
            # Loaded before the first frame would wait for them.
            compile_tracking()
            if labels_points and not jit.LABELLING_IS_DEFERRED:
                compile_labelling()
        if wants_fast_path and self._serialization.raw:
            load = partial(self._load_fast_paths, count)
            try:
                FastPath.require()
                if jit.DEFERRED or (
                        jit.SWITCH == 'background' and not jit.is_ready(FastPath.KERNEL_SET)):
                    loaders[FastPath.KERNEL_SET] = load
                else:
                    load(None)
            except FastPathUnavailable as error:
                self.get_logger().info(f'no fast path, frames are slower: {error}')
        first, *others = (hand.stream for hand in self.hands)
        first.compile_in_background(FastPath.PROGRAM, **loaders)
        for other in others:
            other.share_compilation(first)

    def _load_fast_paths(self, count: int, folder: Path | None) -> None:
        """Load the fast path's kernels; in a thread of its own where they were compiled."""
        scratch = HandTracker()
        if not scratch.is_compiled:
            scratch.use_loaded_kernels()
        packs = scratch.kernel_arguments()
        self._loaded_fast_paths = [FastPath(packs, folder) for _ in range(count)]

    @contextmanager
    def served_by_events(self) -> Iterator[None]:
        """Use the fast path while an EventsExecutor serves the node."""
        self._is_served_by_events = True
        self._start_fast_path()
        try:
            yield
        finally:
            for one in self.inputs:
                one.stop_fast_path()
            self._is_served_by_events = False

    def _start_fast_path(self) -> None:
        """Start the fast path as soon as its kernels are loaded, and those of the tracker."""
        if not self._is_served_by_events or not all(hand.stream.is_compiled for hand in self.hands):
            return
        for one, fast_path in zip(self.inputs, self._loaded_fast_paths):
            if one.fast_path is None:
                one.start_fast_path(fast_path)

    def disable_fast_path(self) -> None:
        """Let the next message of each topic take the slow path."""
        for one in self.inputs:
            one.disable_fast_path()

    def hidden_subscriptions(self) -> list[Subscription]:
        """Return the subscriptions that the fast path serves now."""
        return [one.subscription for one in self.inputs
                if one.fast_path is not None and one.subscription is not None]

    def destroy_node(self) -> None:
        """End calibrations too."""
        for hand in self.hands:
            hand.services.stop()
        super().destroy_node()

    def now(self) -> Time:
        """Return the time of the node's clock."""
        return self.get_clock().now().to_msg()

    def live_values(self) -> dict[str, Any]:
        """Return the values of the parameters that act on every hand from the next frame on."""
        return {row.name: self.get_parameter(row.name).value for row in self._live}

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {parameter.name: parameter.value for parameter in parameters}
        try:
            for hand in self.hands:
                hand.require_allowed(changes)
        except HandTrackerError as error:
            return SetParametersResult(successful=False, reason=str(error))
        # Not applied yet: another callback may still refuse the whole set.
        for hand in self.hands:
            hand.renew_settings()
        self.disable_fast_path()
        return SetParametersResult(successful=True)

    def _report(self) -> None:
        self._start_fast_path()
        for one in self.inputs:
            one.drain()
            one.name_publishers()
            has_viewers = False
            for number, hand in enumerate(one.hands):
                new_hand = hand.new_hand_to_show()
                if new_hand is not None:
                    one.replies.show_tips(number, new_hand)
                has_viewers = hand.display.follow_viewers() or has_viewers
            _leave_useless_labels(one.hands)
            if one.replies.follow_listeners():
                one.disable_fast_path()
            one.drain_at(one.hands[0].settings.display_rate if has_viewers else None)
        for hand in self.hands:
            hand.log()

    def _update_calibrations(self) -> None:
        if any([hand.services.update() for hand in self.hands]):
            self._publish_status()

    def _publish_status(self) -> None:
        for one in self.inputs:
            one.drain()
        for hand in self.hands:
            hand.publish_status(time.monotonic())

    def who_publishes(self, topic: str) -> str | None:
        """Return a line on the publishers of a topic of markers."""
        return who_publishes(
            self.get_publishers_info_by_topic(topic), self._reliability, self._kind.type,
            MESSAGE_OF_TYPE)

    def publisher_name(self, topic: str, guid: bytes) -> str | None:
        """Return the full name of the node that publishes on a topic with a GUID.

        None while that node is not discovered, and when it is gone.
        """
        for endpoint in self.get_publishers_info_by_topic(topic):
            if bytes(endpoint.endpoint_gid[:len(guid)]) == guid:
                return full_name(endpoint)
        return None


def _leave_useless_labels(hands: Sequence[TrackedHand]) -> None:
    """Label the points of one topic by shape where the labels of none of its hands are of use.

    Points of both hands are labelled together: the markers of one may just be hidden.
    """
    if all(hand.labels_points or hand.label_fault for hand in hands):
        beside = None
        for hand in hands:
            if (fault := hand.label_fault) is not None:
                hand.label_points(fault, beside)
                beside = hand


def main(args: list[str] | None = None) -> int:
    """Run the tracker node until it is interrupted; return its exit code."""
    return run(TrackerNode, args=args)


if __name__ == '__main__':
    sys.exit(main())
