"""The tracker node: markers in; joint states, TF and a picture of the hand out."""

import sys
import time
from contextlib import contextmanager

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..core.errors import HandTrackerError
from ..core.model.hand import DIGITS, JOINTS
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import marker_positions
from ..core.numerics import jit
from ..core.tracker import HandTracker
from ..messages.builders import (
    diagnostics,
    fill_transforms,
    link_frames,
    new_transforms,
    time_message,
    tip_frames,
    transform_numbers,
    wrist_frames,
)
from ..messages.cdr import MalformedMessage, Stamp
from ..messages.marker_array import FrameTime, seconds
from ..messages.rviz_markers import hand_markers
from ..tracking.diagnostics import PERIOD, Diagnosis
from ..tracking.distal_flexion import DISTAL_JOINTS, DistalFlexion
from ..tracking.input_monitor import Watch, who_publishes
from ..tracking.rate_limit import Throttle, period_ns
from .fast_path.kernel import ANGLES, CONFIDENCE, TRANSFORMS
from .fast_path.middleware import Direct
from .fast_path.rcl import Unavailable
from .runner import declare, names_of, run
from .serialization import TFMessage, Wire
from .tracker_parameters import START, TOPICS, live_settings, live_table, starting_hand

try:
    from tf2_ros import StaticTransformBroadcaster
except ImportError:
    StaticTransformBroadcaster = None

WATCH_PERIOD = .25      # [s]
# Timers of ROS time would stand still without /clock.
STEADY = Clock(clock_type=ClockType.STEADY_TIME)
NAMELESS = 'world'      # frame of markers that have none, as TF needs one
DIAGNOSTICS_DEPTH = 10
TF_DEPTH = 100          # that of tf2_ros


class TrackerNode(Node):
    """Track one hand."""

    _direct = None

    def __init__(self):
        super().__init__('hand_tracker')
        start = declare(self, START)
        self._hand, layout = starting_hand(start)
        self._live = live_table(self._hand)
        self._settings = live_settings(self._hand, declare(self, self._live))
        self._changed = False
        self._mocap_frame = start['mocap_frame']
        self._tracker = HandTracker(self._settings.hand, layout, self._settings.options)
        if jit.COMPILED:
            self._compile(layout, start['direct'])
        else:
            cause, cure = (('numba is not installed', 'pip install numba') if jit.numba is None
                           else ('HAND_TRACKER_JIT=0 turns numba off', 'unset it'))
            self.get_logger().warning(
                f'{cause}: the tracker is some hundred times slower; {cure}')
        self._time = FrameTime()

        self._joints = joint_table(self._hand)
        self._tips = tip_offsets(self._hand)
        self._names = names_of(self._hand, start['prefix'], start['wrist_frame'])
        self._wire = Wire(self._names)
        if not self._wire.raw:
            self._direct = None
            self.get_logger().warning(
                'rclpy lays messages out in a way that the codec does not know: slower')
        self._reader = self._wire.markers(self._settings, self._mocap_frame)
        self._angles, self._confidences = self._wire.joint_states(), self._wire.joint_states()
        self._display = Throttle()

        qos = {topic: _qos(start, topic) for topic in TOPICS}
        self._joint_states = self.create_publisher(
            JointState, 'joint_states', qos['joint_states'])
        self._hand_markers = self.create_publisher(
            MarkerArray, 'hand_markers', qos['hand_markers'])
        self._joint_confidence = self.create_publisher(
            JointState, 'joint_confidence', qos['joint_confidence'])
        self._confidence_wanted = False
        self._diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', DIAGNOSTICS_DEPTH)
        self._open_tf(start['broadcast'])
        self._distal_flexion = DistalFlexion(self._names.prefix)
        self._distal_subscription = self.create_subscription(
            JointState, 'distal_flexion', self._on_distal_flexion, qos['distal_flexion'])
        self._subscription = self.create_subscription(
            MarkerArray, 'markers', self._on_markers, qos['markers'], raw=self._wire.raw)
        self._reliability = start['qos.markers.reliability']
        self._topic = self.resolve_topic_name('markers')
        self._watch = Watch(time.monotonic(), self._topic, self._settings.labels)
        self._diagnosis = Diagnosis(time.monotonic(), self._watch)
        self.add_on_set_parameters_callback(self._on_set)
        self.create_timer(WATCH_PERIOD, self._report, clock=STEADY)
        self.create_timer(PERIOD, self._diagnose, clock=STEADY)
        self._latest = None
        self.get_logger().info(
            f'{self._hand.side} hand: listening for markers on {self._topic}')

    def _compile(self, layout, direct):
        """Have the kernels compiled before the first frame waits for it."""
        self.get_logger().info('preparing; the very first start compiles for about a minute')
        start = time.monotonic()
        table = joint_table(self._hand)
        rest = forward(table, np.zeros(len(JOINTS)))
        tracker = HandTracker(self._hand, layout, self._settings.options)
        for measured in None, np.full(len(DIGITS), np.nan):
            state = tracker.update(
                marker_positions(layout.mounting(self._hand), rest), distal_flexion=measured)
        transform_numbers(table, state)
        if direct:
            try:
                self._direct = Direct(self._tracker)
            except Unavailable as error:
                self.get_logger().info(f'frames take the long way, which is slower: {error}')
        self.get_logger().info(f'ready after {time.monotonic() - start:.1f} s')

    def _open_tf(self, broadcast):
        self._tf = self._transforms = self._transforms_frame = None
        self._broadcast_stamp = None
        self._every_frame = broadcast == 'all'
        if broadcast == 'none':
            return
        if StaticTransformBroadcaster is None or TFMessage is None:
            self.get_logger().warning(
                'tf2_ros is not installed: nothing is broadcast on /tf; the rest works')
            return
        self._tf = self.create_publisher(TFMessage, '/tf', TF_DEPTH)
        if self._every_frame:
            tips = new_transforms(tip_frames(self._names))
            fill_transforms(tips, self._now(), np.hstack(
                (self._tips, np.tile((0., 0., 0., 1.), (len(tips), 1)))))
            self._static_broadcaster = StaticTransformBroadcaster(self)
            self._static_broadcaster.sendTransform(tips)

    @contextmanager
    def short_way(self):
        """Let regular frames pass an EventsExecutor, to which the node is added meanwhile."""
        if self._direct is None:
            yield
            return
        self._look_timer = self.create_timer(WATCH_PERIOD, self._look, clock=STEADY)
        self._look_timer.cancel()
        self._direct.open(self, self._subscription, self._look, self._on_markers)
        try:
            yield
        finally:
            self._direct.close()
            self.destroy_timer(self._look_timer)

    @property
    def _is_direct(self):
        return self._direct is not None and self._direct.is_used

    @property
    def subscriptions(self):
        """Those that executors serve: not the one whose messages take the short way."""
        return (subscription for subscription in super().subscriptions
                if not self._is_direct or subscription is not self._subscription)

    def _on_markers(self, message):
        received = time.monotonic()
        if self._changed:
            self._configure()
        try:
            frame = self._reader.read(message)
        except MalformedMessage as error:
            self._watch.once('malformed', f'left out is what is no message of markers: {error}')
            return
        if frame.stamp is not None:
            self._track(received, frame)
        # A message without any marker of the hand may be of something else.
        else:
            self._watch.received(received, frame)

    def _track(self, received, frame):
        stamp, frame_id = self._stamp(frame), self._frame_id(frame)
        time_of_frame = self._time.of(frame.stamp, seconds(stamp))
        measured = self._measured()
        if self._is_direct:
            self._direct.forget()
        state = self._tracker.update(frame.positions, time_of_frame, **measured)
        if self._tracker.placed:
            self._publish(stamp, frame_id, state)
        now = time.monotonic()
        # All that can wait comes after the publishing.
        self._diagnosis.published(received, now, time_of_frame)
        self._watch.received(received, frame)
        if self._tracker.restarted:
            self._watch.restarted()
        self._watch.tracked(now, state)
        if self._diagnosis.tracked(now, state):
            self._tell()
        self._latest = stamp, frame_id, state
        if self._tracker.placed:
            self._show(now)
            if self._is_direct and stamp is frame.stamp and not measured:
                self._teach(stamp)

    def _teach(self, stamp):
        """Let frames like this one take the short way."""
        answers = {ANGLES: (self._joint_states, self._angles)}
        if self._tf is not None:
            answers[TRANSFORMS] = self._tf, self._transforms
        if self._confidence_wanted:
            answers[CONFIDENCE] = self._joint_confidence, self._confidences
        self._direct.teach(self._reader.kind, stamp, self._settings.unit_scale,
                           self._settings.zero_is_missing, answers)

    def _look(self):
        """Hear of the frames that took the short way."""
        frames = self._direct.frames() if self._is_direct else None
        if frames is None:
            return
        stamp = Stamp(*frames.stamp)
        now = frames.published[-1]
        self._broadcast_stamp = stamp
        self._latest = stamp, self._latest[1], frames.state
        for times in zip(frames.received, frames.published, frames.times):
            self._diagnosis.published(*times)
        self._watch.passed(frames.received[-1], stamp)
        for at, glimpse in frames.glimpses:
            self._watch.tracked(at, glimpse)
        if self._diagnosis.tracked(now, frames.state, frames.count):
            self._tell()
        self._show(now)

    def _on_distal_flexion(self, message):
        unknown = self._distal_flexion.received(
            seconds(self._now()) or 0., message.name, message.position)
        if self._is_direct:
            self._direct.shut()
        if unknown:
            self._watch.once(
                'distal_flexion', f"distal_flexion: left out is '{unknown[0]}', expected are "
                f"{', '.join(DISTAL_JOINTS)}, with '{self._names.prefix}' before or without")

    def _measured(self):
        if not self._distal_flexion.heard:
            return {}
        flexion = self._distal_flexion.fresh(
            seconds(self._now()) or 0., self._settings.distal_flexion_timeout)
        return {} if flexion is None else {'distal_flexion': flexion}

    def _publish(self, stamp, frame_id, state):
        self._joint_states.publish(self._angles.fill(stamp, state.angles))
        if self._tf is not None:
            self._broadcast(stamp, frame_id, state)
        if self._confidence_wanted:
            self._joint_confidence.publish(self._confidences.fill(stamp, state.confidence))

    def _show(self, now):
        stamp, frame_id, state = self._latest
        if (self._display.due(now, self._settings.display_rate)
                and self._hand_markers.get_subscription_count()):
            self._hand_markers.publish(hand_markers(
                time_message(stamp), frame_id, self._names, self._tips, state))

    def _broadcast(self, stamp, frame_id, state):
        if frame_id != self._transforms_frame:
            self._transforms_frame = frame_id
            links = link_frames(self._names, self._joints) if self._every_frame else ()
            self._transforms = self._wire.transforms(wrist_frames(self._names, frame_id) + links)
            self._broadcast_count = 1 + len(links)
        # Listeners of TF refuse a second transform of one stamp, each with a warning.
        if stamp == self._broadcast_stamp:
            self._watch.once('repeated', 'stamps repeat: /tf has each stamp only once')
            return
        self._broadcast_stamp = stamp
        self._tf.publish(self._transforms.fill(
            stamp, transform_numbers(self._joints, state, self._broadcast_count)))

    def _stamp(self, frame):
        if frame.stamp.sec or frame.stamp.nanosec:
            return frame.stamp
        self._watch.once('stamp', 'the markers have no stamp; the time of receipt is used')
        return self._now()

    def _now(self):
        return self.get_clock().now().to_msg()

    def _frame_id(self, frame):
        if not frame.frame_id:
            self._watch.once('frame_id', f"the markers have no frame; '{NAMELESS}' is used "
                             '(mocap_frame)')
        return frame.frame_id or NAMELESS

    def _on_set(self, parameters):
        values = {parameter.name: parameter.value for parameter in parameters}
        try:
            live_settings(self._hand, {**self._live_values(), **values})
        except HandTrackerError as error:
            return SetParametersResult(successful=False, reason=str(error))
        # Not applied yet: another callback may still refuse the whole set.
        self._changed = True
        if self._is_direct:
            self._direct.shut()
        return SetParametersResult(successful=True)

    def _configure(self):
        self._changed = False
        self._settings = live_settings(self._hand, self._live_values())
        self._tracker.configure(hand=self._settings.hand, options=self._settings.options)
        self._reader = self._wire.markers(self._settings, self._mocap_frame)
        self._watch.labels = self._settings.labels

    def _live_values(self):
        return {row.name: self.get_parameter(row.name).value for row in self._live}

    def _report(self):
        self._look()
        self._heed_listeners()
        for is_warning, line in self._watch.report(time.monotonic(), self._who_publishes):
            if is_warning:
                self.get_logger().warning(line)
            else:
                self.get_logger().info(line)

    def _heed_listeners(self):
        # To ask in each frame would cost more than filling the message.
        wanted = self._joint_confidence.get_subscription_count() > 0
        if self._is_direct:
            if wanted != self._confidence_wanted:
                self._direct.shut()
            self._heed_viewers()
        self._confidence_wanted = wanted

    def _heed_viewers(self):
        if not self._hand_markers.get_subscription_count():
            self._look_timer.cancel()
            return
        self._look_timer.timer_period_ns = period_ns(self._settings.display_rate)
        if self._look_timer.is_canceled():
            self._look_timer.reset()

    def _diagnose(self):
        self._look()
        self._tell()

    def _tell(self):
        status = self._diagnosis.status(time.monotonic(), self._who_publishes)
        self._diagnostics.publish(diagnostics(
            self._now(), f'{self.get_name()}: {self._hand.side} hand', self._topic, status))

    def _who_publishes(self):
        return who_publishes(self.get_publishers_info_by_topic(self._topic), self._reliability)


def _qos(values, topic):
    return QoSProfile(
        depth=values[f'qos.{topic}.depth'],
        reliability=ReliabilityPolicy[values[f'qos.{topic}.reliability'].upper()])


def main(args=None):
    """Run the tracker node until it is interrupted; return its exit code."""
    return run(TrackerNode, args=args)


if __name__ == '__main__':
    sys.exit(main())
