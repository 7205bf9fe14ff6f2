"""One hand of the tracker node: settings, stream of frames, display topics and log lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from ..adapters.hand_landmarks import LandmarkChecks, named_points
from ..adapters.marker_messages import MARKER_MESSAGES
from ..calibration.hand_labels import ids_of_both_hands
from ..calibration.live_take import LiveTake
from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
from ..core.tracker import HandState, HandTracker
from ..files.hand_file import file_notes, unknown_range_note
from ..messages.builders import diagnostics
from ..messages.cdr import MarkerReader
from ..messages.labels import WITHOUT_LABELS, LabelMap
from ..messages.landmark_kinds import LANDMARK_KINDS, kind_of_hand
from ..messages.marker_array import MarkerFrame
from ..messages.marker_ids import layout_ids
from ..messages.points import PointReader
from ..messages.stamps import Time, nanoseconds
from ..tracking.auto_size import AutoSize
from ..tracking.diagnostics import Level, Status
from ..tracking.distal_flexion import DISTAL_JOINTS, DistalFlexion
from ..tracking.exchange_search import exchange_check_for
from ..tracking.monitor import Monitor, TrackedFrames
from ..tracking.point_labels import PointLabelReader, PointLabels, usual_shape_warning
from ..tracking.stream import UNNAMED_FRAME, Stream, TrackedFrame, read_or_warn
from ..tracking.unobserved_note import unobserved_note
from .hand_display import HandDisplay
from .hand_services import HandServices
from .runner import declare, log_line, names_of
from .serialization import Serialization
from .tracker_parameters import (
    AUTO,
    Settings,
    hand_table,
    labels_table,
    learns_size,
    live_settings,
    starting_hand,
    tracks_alike,
)

if TYPE_CHECKING:
    from .tracker_node import TrackerNode

OTHER_CLOCK = 5.    # [s] that stamps may be off the node's time


class TrackedHand:
    """Per-hand state of the tracker node.

    Parameters
    ----------
    node : TrackerNode
        Has declared the parameters of the start and `common_table`.
    start : mapping of str to object
        Value of each of `START`, for this hand.
    scope : str
        Before the names of its parameters, topics and services, where the node tracks both
        hands: 'right' or 'left'; else empty.
    serialization : Serialization
    qos : mapping of str to QoSProfile
        Of the topics.
    labels : callable, optional
        Returns the hand's LabelMap for the values of the parameters; where left out, they are
        `labels.*`.
    point_labels : PointLabels, optional
        Labels of points without usable ones, shared with the other hand in their messages.

    Attributes
    ----------
    hand : Hand
        With the limits of its parameters' defaults.
    names : Names
    topics : str
        Before the names of its topics.
    stream : Stream
    settings : Settings
        In use.
    labels_points : bool
        Whether markers come as points without usable labels.
    display : HandDisplay
    services : HandServices
    other : TrackedHand or None
        The other hand, where both are tracked.
    """

    def __init__(self, node: TrackerNode, start: Mapping[str, Any], scope: str,
                 serialization: Serialization, qos: Mapping[str, QoSProfile],
                 labels: Callable[[Mapping[str, Any]], LabelMap] | None = None,
                 point_labels: PointLabels | None = None) -> None:
        self._node, self._serialization, self._labels = node, serialization, labels
        self.hand, layout = starting_hand(start)
        note = unknown_range_note(start['limits.preset'], self.hand)
        self._hand_notes = [note] if note else []
        if start['hand_file']:
            # Without a side it is the file's own.
            self._hand_notes += file_notes(
                Path(start['hand_file']).expanduser(),
                self.hand.side if start['side'] != AUTO else None, start['layout'])
        self._scope, self.topics = (f'{scope}.', f'{scope}/') if scope else ('', '')
        self._marker_names = layout.names
        self._rows = self._table(self.hand)
        declare(node, self._rows)
        self.settings = self._settings_of(self.hand, self._values())
        self._topic = ''
        self.other: TrackedHand | None = None
        self._monitor = Monitor(time.monotonic(), self._topic, self.settings.labels)
        self._has_new_settings = False
        self._new_hand: tuple[Hand, MarkerLayout] | None = None
        self._mocap_frame = start['mocap_frame']
        self.names = names_of(
            self.hand, start['prefix'], start['wrist_frame'], start['on_body'])
        self._tracker = HandTracker(self.settings.hand, layout, self.settings.options)
        auto_size = (AutoSize(self.settings.hand, layout, in_background=True)
                     if learns_size(start) else None)
        self._starts_without_labels = start['labels.from'] == WITHOUT_LABELS
        self.labels_points = self._starts_without_labels
        self._point_labels = point_labels or PointLabels()
        kind = MARKER_MESSAGES[start['marker_message']]
        # Landmarks are each hand's own.
        self._shares_names = point_labels is not None and kind not in LANDMARK_KINDS
        # Points of both hands are labelled together.
        self._kind = kind if self.labels_points else kind_of_hand(kind, self.hand.side)
        self._landmark_checks = LandmarkChecks(
            self.hand.side, self.warn_once) if kind in LANDMARK_KINDS else None
        self.stream = Stream(self._tracker, self._new_reader(), auto_size)

        # The launch file gives robot_state_publisher the hand of the hand file.
        self.display = HandDisplay(node, self.hand, layout, self.names, self.topics, qos)
        self._shown_hand = self.hand
        self._distal_flexion = DistalFlexion(self.names.prefix)
        node.create_subscription(
            JointState, f'{self.topics}distal_flexion', self._on_distal_flexion,
            qos['distal_flexion'])
        self._published: list[TrackedFrames] = []  # that are not monitored yet
        self._latest: tuple[Time, str, HandState] | None = None
        self._compared_stamp: int | None = None     # with the node's time [ns]
        self._is_of_other_clock = False
        self.services = HandServices(node, self, start, layout, self._scope, self.topics)

    def listen_to(self, topic: str) -> None:
        """Monitor the markers that come from a topic, by its resolved name."""
        self._topic = topic
        self._monitor = Monitor(time.monotonic(), topic, self.settings.labels)
        self._monitor.check_side(self.hand, self._tracker.layout)
        for note in self._hand_notes:
            self._monitor.warn_once(('hand', note), note)
        if self.labels_points:
            self._warn_of_usual_shape()
        self._check_exchange()
        if self.other is not None:
            self._monitor.pair_with(self.other._monitor)

    # Frames

    def read(self, message: Any) -> MarkerFrame | None:
        """Return its markers in a message by the present settings; None of a malformed message."""
        if self._has_new_settings:
            self._apply_settings()
        reader = self.stream.reader
        markers = read_or_warn(reader, message, self._monitor.received_unreadable)
        if (self._landmark_checks is not None and markers is not None
                and isinstance(reader, MarkerReader)):
            self._landmark_checks.check(named_points(reader.points(message)))
        return markers

    def track(self, markers: MarkerFrame, received: float) -> TrackedFrame | None:
        """Track the markers of a message, received at a time [s]; None where it has none."""
        frame = self._monitor.judge(received, self.stream.track(
            markers, received, self._receipt_stamp,
            self._measured_flexion() if self._distal_flexion.heard else None))
        if frame is not None and not frame.markers.frame_id:
            self._monitor.warn_once('frame_id', f"the markers have no frame; '{UNNAMED_FRAME}' is "
                                    'used (mocap_frame)')
        return frame

    @property
    def needs_each_frame(self) -> bool:
        """Whether the next frame is to take the slow path, too."""
        return self.stream.needs_each_frame or self._monitor.needs_each_frame

    def published(self, frame: TrackedFrame) -> None:
        """Note a frame of the slow path, published if it is valid."""
        self._published.append(TrackedFrames.of(frame, time.monotonic()))
        self._latest = frame.stamp, frame.frame_id, frame.state
        if not frame.is_valid:
            return
        if self.display.has_viewers:
            self._show()
        if self.labels_points:
            self.display.show_labelled(
                frame.stamp, frame.frame_id, frame.markers.positions, self._marker_names)

    def published_by_fast_path(self, frames: TrackedFrames) -> None:
        """Note frames of the fast path."""
        assert self._latest is not None
        self._latest = frames.stamp, self._latest[1], frames.state
        self._published.append(frames)
        if self.display.has_viewers:
            self._show()

    def monitor(self) -> None:
        """Monitor the frames published since the last call."""
        published, self._published = self._published, []
        for frames in published:
            if self._monitor.update(frames):
                self.publish_status(frames.published[-1])

    @property
    def label_fault(self) -> str | None:
        """Why the labels of the markers are of no use, None where they are, or are not used."""
        return None if self.labels_points else self._monitor.label_fault

    def label_points(self, reason: str, beside: TrackedHand | None = None) -> None:
        """Label points by the hand's shape from the next message on, as another hand may, too."""
        self._monitor.warn_once(
            ('labels', self.settings.labels.labels), f'{reason}: points are labelled by the shape '
            "of the hand, as with labels:='none', until other labels.* are set")
        self.labels_points = True
        self._warn_of_usual_shape()
        self._check_exchange()
        self.stream.reader = self._new_reader()
        self.stream.compile_for_points(None if beside is None else beside.stream)
        self._node.disable_fast_path()

    def _check_exchange(self) -> None:
        """Check the labels of the markers in the frames to come, where they have any."""
        self._monitor.check_exchange(
            None if self.labels_points else exchange_check_for(self._tracker))

    def _warn_of_usual_shape(self) -> None:
        warning = usual_shape_warning(self.hand, self._tracker.layout)
        if warning is not None:
            self._monitor.warn_once('shape', warning)

    def left_out(self, count: int) -> None:
        """Count frames that were left out, see `Monitor.left_out`."""
        self._monitor.left_out(count)

    def warn_once(self, key: str, text: str) -> None:
        """Log a warning once for each key."""
        self._monitor.warn_once(key, text)

    def _receipt_stamp(self) -> Time:
        self._monitor.warn_once(
            'stamp', 'the markers have no stamp; the time of receipt is used')
        return self._node.now()

    def _on_distal_flexion(self, message: JointState) -> None:
        unknown = self._distal_flexion.received(
            self._now(), message.name, message.position)
        self._node.disable_fast_path()
        if unknown:
            self._monitor.warn_once(
                'distal_flexion', f"distal_flexion: left out is '{unknown[0]}', expected are "
                f"{', '.join(DISTAL_JOINTS)}, with '{self.names.prefix}' before or without")

    def _measured_flexion(self) -> np.ndarray | None:
        """Return the measured flexion of the last joints [rad]; None if it is too old."""
        return self._distal_flexion.fresh(self._now(), self.settings.distal_flexion_timeout)

    def _now(self) -> float:
        """Return the node's time [s]."""
        return 1e-9 * nanoseconds(self._node.now())

    # Settings

    def _table(self, hand: Hand) -> tuple[Parameter, ...]:
        """Return the parameters that are this hand's alone and act from the next frame on."""
        rows = hand_table(hand, self._scope)
        return rows if self._labels is not None else rows + labels_table(self._marker_names)

    def _new_reader(self) -> Any:
        if self.labels_points:
            return PointLabelReader(
                self._tracker.hand, self._tracker.layout, PointReader(
                    self._mocap_frame, self.settings.unit_scale, self.settings.zero_is_missing,
                    self._kind),
                self._point_labels)
        return self._serialization.markers(
            self.settings, self._mocap_frame, self._kind, self.warn_once,
            (ids_of_both_hands if self._shares_names else layout_ids)(self._tracker.layout))

    def _values(self) -> dict[str, Any]:
        """Return the value of each parameter that acts from the next frame on."""
        return self._node.live_values() | {
            row.name: self._node.get_parameter(row.name).value for row in self._rows}

    def _settings_of(self, hand: Hand, values: Mapping[str, Any]) -> Settings:
        """Return the settings that values of the parameters stand for, see `live_settings`."""
        return live_settings(
            hand, values, self._marker_names, self._scope,
            None if self._labels is None else self._labels(values))

    def require_allowed(self, changes: Mapping[str, Any]) -> None:
        """Raise a HandTrackerError that names a changed parameter whose value is not allowed."""
        self._settings_of(self.hand, {**self._values(), **changes})

    def renew_settings(self) -> None:
        """Apply the parameters before the next frame."""
        self._has_new_settings = True

    def _apply_settings(self) -> None:
        self._has_new_settings = False
        hand, layout = self._new_hand or (self._tracker.hand, None)
        self._new_hand = None
        former, self.settings = self.settings, self._settings_of(hand, self._values())
        if layout is not None:
            self.stream.replace_hand(self.settings.hand, layout, self.settings.options)
        elif not tracks_alike(former, self.settings):
            # It derives all that it tracks with anew: several frames long.
            self._tracker.configure(hand=self.settings.hand, options=self.settings.options)
        has_other_labels = former.labels.labels != self.settings.labels.labels
        uses_labels_again = has_other_labels and self.labels_points != self._starts_without_labels
        if uses_labels_again:
            self.labels_points = self._starts_without_labels
            self._node.get_logger().info('the labels of the markers are used again')
        if uses_labels_again or layout is not None:
            self._check_exchange()
        has_other_unit = former.unit_scale != self.settings.unit_scale
        if has_other_unit:
            self._forget_frames()
        if has_other_labels or has_other_unit:
            # The former frames were read as those of another hand.
            self.stream.learn_size_anew()
        self.stream.reader = self._new_reader()
        self._monitor.set_labels(self.settings.labels)
        if has_other_labels or has_other_unit or layout is not None:
            self._monitor.forget_fit()

    def collect(self, take: LiveTake | None) -> None:
        """Collect frames for a calibration from the next one on; None to end that."""
        self.stream.take = take
        self._node.disable_fast_path()

    def replace_hand(self, hand: Hand, layout: MarkerLayout) -> None:
        """Track with another hand from the next frame on.

        Limits and couplings set as parameters stay; the others become the hand's.

        Parameters
        ----------
        hand : Hand
            Of the same side.
        layout : MarkerLayout
        """
        now, rows = self._values(), self._table(hand)
        self._node.set_parameters_atomically([
            Parameter(row.name, value=row.default) for row, former in zip(rows, self._rows)
            if now[row.name] == former.default != row.default])
        self.hand, self._rows, self._new_hand = hand, rows, (hand, layout)
        self._has_new_settings = True
        self._node.disable_fast_path()

    def reset(self) -> None:
        """Track as if no frame had come yet, without a calibration."""
        self.services.stop()    # which also ends the fast path
        self._published.clear()
        self._forget_frames()
        self.labels_points = self._starts_without_labels
        self.stream.learn_size_anew()
        self.stream.reader = self._new_reader()
        self.listen_to(self._topic)

    def _forget_frames(self) -> None:
        self._tracker.reset()
        self._point_labels.reset()

    # What it shows and logs

    def _show(self) -> None:
        assert self._latest is not None
        self.display.show(*self._latest, self.settings.display_rate)

    def new_hand_to_show(self) -> Hand | None:
        """Return the tracker's hand if it is another than the one shown, and show it."""
        hand = self._tracker.hand
        self.display.update()
        if hand is self._shown_hand:
            return None
        self._shown_hand = hand
        self.display.set_hand(hand, hand.replace(
            limits=self.hand.limits, coupling=self.hand.coupling), self._tracker.layout)
        return hand

    def log_unobserved_joints(self) -> None:
        """Log the joints that the layout does not show, where it is not the paper's."""
        if note := unobserved_note(self._tracker):
            self._node.get_logger().info(note)

    def log(self) -> None:
        """Log the lines of the monitor and of the stream."""
        self._monitor.set_labelling(self.stream.awaits_labelling, self.stream.why_not_found)
        lines = (*self.stream.pop_log_lines(), *self.services.pop_log_lines(),
                 *self._monitor.log_lines(time.monotonic(), self._who_publishes))
        self.stream.judge_labels(self._monitor.labels_are_right)
        if self.needs_each_frame:
            self._node.disable_fast_path()
        for is_warning, line in lines:
            # One of both hands is named.
            log_line(self._node, is_warning,
                     f'{self.hand.side} hand: {line}' if self._scope else line)

    def publish_status(self, now: float) -> None:
        """Publish the status on /diagnostics."""
        self._warn_of_other_clock()
        self._monitor.set_size(self.stream.size, self.stream.learned_size)
        self._monitor.set_calibration(self.services.progress())
        self._tell(self._monitor.status(now, self._who_publishes))

    def publish_inactive(self) -> None:
        """Publish on /diagnostics that markers are left out, as the node is not active."""
        self._tell(Status(Level.STALE, 'not active: markers are left out', {}))

    def _tell(self, status: Status) -> None:
        self._node.diagnostics.publish(diagnostics(
            self._node.now(), f'{self._node.get_name()}: {self.hand.side} hand', self._topic,
            status))

    def _warn_of_other_clock(self) -> None:
        """Warn once where new stamps are far from the node's time, at two statuses in a row."""
        stamp = None if self._latest is None else nanoseconds(self._latest[0])
        now = self._now()
        if stamp is None or stamp == self._compared_stamp or not now:
            return
        self._compared_stamp = stamp
        was_far, ahead = self._is_of_other_clock, 1e-9 * stamp - now
        self._is_of_other_clock = abs(ahead) > OTHER_CLOCK
        if was_far and self._is_of_other_clock:
            side = 'ahead of' if ahead > 0. else 'behind'
            self._monitor.warn_once(
                'clock', f"the markers' stamps are {abs(ahead):.0f} s {side} this clock, and so "
                'are joint states, /tf and commands: synchronise the clocks, or, for a recording '
                'that publishes /clock, set use_sim_time')

    def _who_publishes(self) -> str | None:
        return self._node.who_publishes(self._topic)
