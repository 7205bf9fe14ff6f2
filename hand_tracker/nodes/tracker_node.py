"""The tracker node: markers in; joint states, TF and a picture of the hand out."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..calibration.live_take import LiveTake
from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.kinematics import tip_offsets
from ..core.model.marker_layout import MarkerLayout
from ..core.numerics import jit
from ..core.tracker import HandState, HandTracker
from ..files.urdf_file import urdf
from ..messages.builders import diagnostics, time_message
from ..messages.marker_array import MarkerFrame
from ..messages.rviz_markers import hand_markers
from ..messages.stamps import Time, seconds
from ..tracking.auto_size import AutoSize
from ..tracking.compile_kernels import compile_tracking
from ..tracking.diagnostics import STATUS_PERIOD
from ..tracking.distal_flexion import DISTAL_JOINTS, DistalFlexion
from ..tracking.input_monitor import who_publishes
from ..tracking.monitor import Monitor, TrackedFrames
from ..tracking.rate_limit import RateLimiter, period_ns
from ..tracking.stream import UNNAMED_FRAME, Stream, TrackedFrame, read_or_warn
from .fast_path import FastPath, FastPathUnavailable
from .fast_path.compile_fast_path import FAST_PATH_PROGRAM, FAST_PATH_SET
from .fast_path.middleware import AT_ONCE, require_fast_path
from .hand_services import HandServices
from .replies import Replies
from .robot_description import RobotDescription
from .runner import declare, names_of, qos_of, run
from .serialization import Serialization
from .tracker_parameters import (
    START,
    TOPICS,
    learns_size,
    live_settings,
    live_table,
    starting_hand,
)

REPORT_PERIOD = .1      # [s] between two looks at what is to be logged
CALIBRATION_PERIOD = .25  # [s] between two looks at a calibration's whole take
# Timers of ROS time would stand still without /clock.
STEADY_CLOCK = Clock(clock_type=ClockType.STEADY_TIME)
DIAGNOSTICS_DEPTH = 10


class TrackerNode(Node):
    """Track one hand."""

    def __init__(self) -> None:
        super().__init__('hand_tracker')
        start = declare(self, START)
        self._hand, layout = starting_hand(start)
        self._live = live_table(self._hand)
        self._settings = live_settings(self._hand, declare(self, self._live))
        self._has_new_settings = False
        self._new_hand: tuple[Hand, MarkerLayout] | None = None
        self._mocap_frame = start['mocap_frame']
        self._names = names_of(self._hand, start['prefix'], start['wrist_frame'])
        self._serialization = Serialization(self._names)
        if not self._serialization.raw:
            self.get_logger().warning(
                'rclpy lays messages out in a way that the codec does not know: slower')
        self._tracker = HandTracker(self._settings.hand, layout, self._settings.options)
        auto_size = (AutoSize(self._settings.hand, layout, in_background=True)
                     if learns_size(start) else None)
        self._stream = Stream(self._tracker, self._new_reader(), auto_size)
        self._fast_path: FastPath | None = None
        self._loaded_fast_path: FastPath | None = None
        self._prepare_kernels(start['fast_path'])

        qos = {topic: qos_of(start, topic) for topic in TOPICS}
        self._replies = Replies(self, self._hand, self._names, self._serialization, qos,
                                start['broadcast'])
        self._hand_markers = self.create_publisher(
            MarkerArray, 'hand_markers', qos['hand_markers'])
        # The launch file gives robot_state_publisher the hand of the hand file.
        self._description = RobotDescription(self, urdf(self._hand, self._names.prefix))
        self._hand_shown = self._hand
        self._display = RateLimiter()
        self._tips = tip_offsets(self._hand)
        self._diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', DIAGNOSTICS_DEPTH)
        self._distal_flexion = DistalFlexion(self._names.prefix)
        self._distal_subscription = self.create_subscription(
            JointState, 'distal_flexion', self._on_distal_flexion, qos['distal_flexion'])
        self._subscription = self.create_subscription(
            MarkerArray, 'markers', self._on_markers, qos['markers'],
            raw=self._serialization.raw)
        self._waiting: list[tuple[Any, float]] = []
        self._newest_timer = self.create_timer(AT_ONCE, self._track_newest, clock=STEADY_CLOCK)
        self._newest_timer.cancel()
        self._reliability = start['qos.markers.reliability']
        self._topic = self.resolve_topic_name('markers')
        self._monitor = Monitor(time.monotonic(), self._topic, self._settings.labels)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        self.create_timer(REPORT_PERIOD, self._report, clock=STEADY_CLOCK)
        self.create_timer(STATUS_PERIOD, self._publish_status_of_all, clock=STEADY_CLOCK)
        self.create_timer(CALIBRATION_PERIOD, self._update_calibration, clock=STEADY_CLOCK)
        self._latest: tuple[Time, str, HandState] | None = None
        self._published: list[TrackedFrames] = []  # that are not monitored yet
        self._has_viewers = False
        self._hand_services = HandServices(self, start, self._hand.side, layout)
        self.get_logger().info(
            f'{self._hand.side} hand: listening for markers on {self._topic}')

    def _new_reader(self) -> Any:
        return self._serialization.markers(self._settings, self._mocap_frame)

    def _prepare_kernels(self, wants_fast_path: bool) -> None:
        """Load the kernels that are on disk, or have them compiled in the background."""
        loaders = {}
        if not jit.JIT_IS_ON:
            cause, cure = (('HAND_TRACKER_JIT=0 turns numba off', 'unset it') if jit.HAS_NUMBA
                           else ('numba is not installed', 'pip install numba'))
            self.get_logger().warning(
                f'{cause}: the tracker is some hundred times slower; {cure}')
            return
        if jit.COMPILED:
            if not jit.is_ready(jit.TRACKING_SET):
                self.get_logger().info('compiling the kernels, once, for about a minute')
            # Loaded before the first frame would wait for them.
            compile_tracking()
        if wants_fast_path and self._serialization.raw:
            try:
                require_fast_path()
                if jit.DEFERRED or jit.SWITCH == 'background' and not jit.is_ready(FAST_PATH_SET):
                    loaders[FAST_PATH_SET] = self._load_fast_path
                else:
                    self._load_fast_path(None)
            except FastPathUnavailable as error:
                self.get_logger().info(f'no fast path, frames are slower: {error}')
        self._stream.compile_in_background(FAST_PATH_PROGRAM, **loaders)

    def _load_fast_path(self, folder: Path | None) -> None:
        """Load the fast path's kernels; in a thread of its own where they were compiled."""
        scratch = HandTracker()
        if not scratch.is_compiled:
            scratch.use_loaded_kernels()
        self._loaded_fast_path = FastPath(scratch.kernel_arguments(), folder)

    @contextmanager
    def served_by_events(self) -> Iterator[None]:
        """Use the fast path while an EventsExecutor serves the node."""
        self._is_served_by_events = True
        self._drain_timer = self.create_timer(REPORT_PERIOD, self._drain, clock=STEADY_CLOCK)
        self._drain_timer.cancel()
        self._start_fast_path()
        try:
            yield
        finally:
            if self._fast_path is not None:
                self._fast_path.stop()
            self._fast_path = None
            self._is_served_by_events = False
            self.destroy_timer(self._drain_timer)

    _is_served_by_events = False

    def _start_fast_path(self) -> None:
        """Start the fast path as soon as its kernels are loaded, and those of the tracker."""
        if (self._loaded_fast_path is None or self._fast_path is not None
                or not self._is_served_by_events or not self._tracker.is_compiled):
            return
        self._fast_path = self._loaded_fast_path
        self._fast_path.start(self, self._subscription, self._drain_fast_path, self._on_markers)

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Those that executors serve.

        Executors have no other way to leave out the one that the fast path takes from: rclpy
        would set a callback of its own in place of the fast path's.
        """
        return (subscription for subscription in super().subscriptions
                if self._fast_path is None or subscription is not self._subscription)

    def destroy_node(self) -> None:
        """End a calibration too."""
        self._hand_services.stop()
        super().destroy_node()

    def _on_markers(self, message: Any) -> None:
        received = time.monotonic()
        if not self._stream.is_fast:
            # Plain Python may be slower than frames come: all that wait are taken before the
            # newest is tracked, and other callbacks have their turn in between.
            self._waiting.append((message, received))
            if self._newest_timer.is_canceled():
                self._newest_timer.reset()
        elif (markers := self._read(message)) is not None:
            self._track(markers, received)

    def _track_newest(self) -> None:
        """Track the newest frame that waits, and count those that are left out."""
        self._newest_timer.cancel()
        # Executors that wait for conditions bring one message at a time.
        take, kind = self._subscription.handle.take_message, self._subscription.msg_type
        while (taken := take(kind, self._serialization.raw)) is not None:
            self._waiting.append((taken[0], time.monotonic()))
        waiting, self._waiting = self._waiting, []
        for older, (message, received) in reversed(list(enumerate(waiting))):
            markers = self._read(message)
            if markers is None:
                continue
            self._track(markers, received)
            if markers.stamp is not None:
                self._drain()
                self._monitor.left_out(older)
                return

    def _read(self, message: Any) -> MarkerFrame | None:
        """Return the markers of a message by the present settings; None where it has no such."""
        if self._has_new_settings:
            self._apply_settings()
        return read_or_warn(self._stream.reader, message, self._monitor.warn_once)

    def _track(self, markers: MarkerFrame, received: float) -> None:
        frame = self._stream.track(
            markers, received, self._receipt_stamp, self._measured_flexion())
        if isinstance(frame, MarkerFrame):
            # A message without any marker of the hand may be of something else.
            self._drain()
            self._monitor.received_none(received, frame)
            return
        if self._fast_path is not None:
            self._fast_path.invalidate()
        if not frame.markers.frame_id:
            self._monitor.warn_once('frame_id', f"the markers have no frame; '{UNNAMED_FRAME}' is "
                                    'used (mocap_frame)')
        if frame.is_valid and not self._replies.publish(frame):
            self._monitor.warn_once('repeated', 'stamps repeat: /tf has each stamp only once')
        self._published.append(TrackedFrames.of(frame, time.monotonic()))
        self._latest = frame.stamp, frame.frame_id, frame.state
        if not frame.is_valid:
            return
        if self._has_viewers:
            self._show()
        if (frame.is_regular and self._fast_path is not None
                and not self._stream.needs_each_frame):
            self._install(frame)

    def _install(self, frame: TrackedFrame) -> None:
        """Let the fast path process messages like this one."""
        signature = self._stream.reader.signature
        assert self._fast_path is not None and signature is not None
        self._fast_path.install(
            self._tracker.kernel_arguments(), signature, frame.stamp,
            self._settings.unit_scale, self._settings.zero_is_missing, self._replies.templates())

    def _drain_fast_path(self) -> None:
        """Take over the frames that the fast path has processed, before those that follow."""
        frames = None if self._fast_path is None else self._fast_path.drain()
        if frames is None or self._latest is None:
            return
        self._replies.published_until(frames.stamp)
        self._latest = frames.stamp, self._latest[1], frames.state
        self._published.append(frames)
        if self._has_viewers:
            self._show()

    def _drain(self) -> None:
        """Monitor the frames that either path has published since."""
        self._drain_fast_path()
        published, self._published = self._published, []
        for frames in published:
            if self._monitor.update(frames):
                self._publish_status(frames.published[-1])

    def _on_distal_flexion(self, message: JointState) -> None:
        unknown = self._distal_flexion.received(
            seconds(self._now()) or 0., message.name, message.position)
        if self._fast_path is not None:
            self._fast_path.disable()
        if unknown:
            self._monitor.warn_once(
                'distal_flexion', f"distal_flexion: left out is '{unknown[0]}', expected are "
                f"{', '.join(DISTAL_JOINTS)}, with '{self._names.prefix}' before or without")

    def _measured_flexion(self) -> np.ndarray | None:
        if not self._distal_flexion.heard:
            return None
        return self._distal_flexion.fresh(
            seconds(self._now()) or 0., self._settings.distal_flexion_timeout)

    def _show(self) -> None:
        assert self._latest is not None
        stamp, frame_id, state = self._latest
        if self._display.due(time.monotonic(), self._settings.display_rate):
            self._hand_markers.publish(hand_markers(
                time_message(stamp), frame_id, self._names, self._tips, state))

    def _receipt_stamp(self) -> Time:
        self._monitor.warn_once(
            'stamp', 'the markers have no stamp; the time of receipt is used')
        return self._now()

    def _now(self) -> Time:
        return self.get_clock().now().to_msg()

    def _on_set_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        values = {parameter.name: parameter.value for parameter in parameters}
        try:
            live_settings(self._hand, {**self._live_values(), **values})
        except HandTrackerError as error:
            return SetParametersResult(successful=False, reason=str(error))
        # Not applied yet: another callback may still refuse the whole set.
        self._has_new_settings = True
        if self._fast_path is not None:
            self._fast_path.disable()
        return SetParametersResult(successful=True)

    def collect(self, take: LiveTake | None) -> None:
        """Collect frames for a calibration from the next one on; None to end that."""
        self._stream.take = take
        if self._fast_path is not None:
            self._fast_path.disable()

    def replace_hand(self, hand: Hand, layout: MarkerLayout) -> None:
        """Track with another hand from the next frame on.

        Limits and couplings that were set as parameters stay; the others become the hand's.

        Parameters
        ----------
        hand : Hand
            Of the same side.
        layout : MarkerLayout
        """
        now, rows = self._live_values(), live_table(hand)
        self.set_parameters_atomically([
            Parameter(row.name, value=row.default) for row, former in zip(rows, self._live)
            if now[row.name] == former.default != row.default])
        self._hand, self._live, self._new_hand = hand, rows, (hand, layout)
        self._has_new_settings = True
        if self._fast_path is not None:
            self._fast_path.disable()

    def _apply_settings(self) -> None:
        self._has_new_settings = False
        hand, layout = self._new_hand or (self._tracker.hand, None)
        self._new_hand = None
        self._settings = live_settings(hand, self._live_values())
        if layout is None:
            self._tracker.configure(hand=self._settings.hand, options=self._settings.options)
        else:
            self._stream.replace_hand(self._settings.hand, layout, self._settings.options)
        self._stream.reader = self._new_reader()
        self._monitor.set_labels(self._settings.labels)

    def _live_values(self) -> dict[str, Any]:
        return {row.name: self.get_parameter(row.name).value for row in self._live}

    def _report(self) -> None:
        self._drain()
        self._start_fast_path()
        if self._hand_shown is not self._tracker.hand:
            self._show_hand()
        self._description.update()
        if self._replies.follow_listeners() and self._fast_path is not None:
            self._fast_path.disable()
        self._follow_viewers()
        log = self.get_logger()
        for is_warning, line in (
                *self._stream.news(), *self._hand_services.news(), *self._monitor.log_lines(
                    time.monotonic(), self._who_publishes)):
            if is_warning:
                log.warning(line)
            else:
                log.info(line)

    def _show_hand(self) -> None:
        """Give a hand that was learned, loaded or given other limits to all that shows it."""
        hand = self._hand_shown = self._tracker.hand
        self._tips = tip_offsets(hand)
        self._replies.show_tips(hand)
        self._description.wanted = urdf(hand, self._names.prefix)

    def _follow_viewers(self) -> None:
        """Draw while somebody looks; for that, drain the fast path at the display's rate."""
        self._has_viewers = self._hand_markers.get_subscription_count() > 0
        if self._fast_path is None:
            return
        if not self._has_viewers:
            self._drain_timer.cancel()
            return
        self._drain_timer.timer_period_ns = period_ns(self._settings.display_rate)
        if self._drain_timer.is_canceled():
            self._drain_timer.reset()

    def _update_calibration(self) -> None:
        if self._hand_services.update():
            self._publish_status(time.monotonic())

    def _publish_status_of_all(self) -> None:
        self._drain()
        self._publish_status(time.monotonic())

    def _publish_status(self, now: float) -> None:
        self._monitor.set_size(self._stream.size)
        self._monitor.set_calibration(self._hand_services.progress())
        status = self._monitor.status(now, self._who_publishes)
        self._diagnostics.publish(diagnostics(
            self._now(), f'{self.get_name()}: {self._hand.side} hand', self._topic, status))

    def _who_publishes(self) -> str:
        return who_publishes(self.get_publishers_info_by_topic(self._topic), self._reliability)


def main(args: list[str] | None = None) -> int:
    """Run the tracker node until it is interrupted; return its exit code."""
    return run(TrackerNode, args=args)


if __name__ == '__main__':
    sys.exit(main())
