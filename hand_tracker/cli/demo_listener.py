"""The demo's listener: receives markers and the joint states that answer them, with latency."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import PALM_MARKERS, marker_positions
from ..core.model.palm_triangle import fit_wrist
from ..core.numerics.rigid_fit import fit_rigid
from ..messages.builders import prefixed_names
from ..messages.cdr import MarkerReader
from ..messages.joint_states import JointStateReader
from ..messages.labels import LabelMap, default_labels
from ..messages.points import PointReader
from ..messages.stamps import nanoseconds
from .demo_anonymous import PointOwners
from .recording_options import WornHand

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

LISTENER_DEPTH = 2000  # messages that wait at most while this program has no turn


class ReceivedFrames(NamedTuple):
    """Frames of which both the markers and the joint state arrived.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        [ns]
    angles : ndarray, shape (n, 25)
        [rad]
    markers : ndarray, shape (n, m, 3)
        In the wrist's frame [m].
    places : ndarray, shape (n, m, 3)
        Of the markers on the tracked hand, in the wrist's frame [m].
    """

    stamps: np.ndarray
    angles: np.ndarray
    markers: np.ndarray
    places: np.ndarray


class ReceivedHand:
    """Markers and joint states of one hand, as they were received.

    Parameters
    ----------
    worn : WornHand
    """

    def __init__(self, worn: WornHand) -> None:
        self.hand, self.layout, self.labels = worn
        self.joints = prefixed_names(f'{self.hand.side}_').joints
        self.markers: dict[int, np.ndarray] = {}  # by stamp [ns]
        self.angles: dict[int, Sequence[float] | np.ndarray] = {}

    @property
    def palm_rows(self) -> list[int]:
        """Rows of the three principal markers of the palm."""
        return list(self.layout.principal[:len(PALM_MARKERS)])

    def load_kernels(self) -> None:
        """Load the kernels of `received_frames`, or compile them where they are not on disk."""
        rest = marker_positions(
            self.layout.mounting(self.hand), forward(joint_table(self.hand), np.zeros(25)))
        palm = rest[self.palm_rows]
        fit_wrist(palm, palm, np.eye(3), np.zeros(3))
        fit_rigid(rest, rest, np.ones(len(rest)), np.eye(3), np.zeros(3))

    def received_frames(self, recent: float | None = None) -> ReceivedFrames:
        """Return the whole frames of the last so many seconds, or all, with the palm fitted.

        By its markers, or by all where one of them is hidden.
        """
        stamps = [stamp for stamp in self.angles if stamp in self.markers]
        if recent is not None and stamps:
            stamps = [stamp for stamp in stamps if stamp > stamps[-1] - 1e9 * recent]
        angles = np.array([self.angles[stamp] for stamp in stamps]).reshape(-1, 25)
        palm = self.palm_rows
        template = self.layout.principal_mounting(self.hand).position[:len(palm)]
        # Nothing is known of the palm before its markers were all seen.
        rotation, position = np.eye(3), np.full(3, np.nan)
        markers = np.empty((len(stamps), len(self.layout.names), 3))
        # Contiguous, as the kernels that are on disk take them.
        places = np.ascontiguousarray(marker_positions(
            self.layout.mounting(self.hand), forward(joint_table(self.hand), angles)))
        for stamp, local, place in zip(stamps, markers, places):
            frame = self.markers[stamp]
            seen = np.isfinite(frame).all(axis=1)
            if seen[palm].all():
                fit_wrist(frame[palm], template, rotation, position)
            elif np.isfinite(position).all() and seen.sum() > len(palm):
                fit_rigid(place, frame, seen.astype(float), rotation, position)
            local[:] = (frame - position) @ rotation
        return ReceivedFrames(np.array(stamps, dtype=np.int64), angles, markers, places)


class Listener:
    """Collect the messages of the nodes, as bytes: building objects would cost the tracker's time.

    Parameters
    ----------
    node : rclpy.node.Node
    hands : sequence of WornHand
    owners : PointOwners, optional
        Of the points, where they have no labels; empty where that is not known.

    Attributes
    ----------
    hands : list of ReceivedHand
    is_anonymous : bool
        Whether markers come as points without labels, which the tracker gives them.
    knows_owners : bool
        Whether these labels can be judged.
    transforms : int
        Messages on /tf.
    """

    def __init__(self, node: Node, hands: Sequence[WornHand],
                 owners: PointOwners | None = None) -> None:
        self.hands = [ReceivedHand(hand) for hand in hands]
        self.transforms = 0
        self._latencies: list[float] = []  # [s]
        self._frames: set[int] = set()     # stamps of markers [ns]
        self._owners = owners or {}
        self.is_anonymous, self.knows_owners = owners is not None, bool(owners)
        self._label_counts = [0, 0]        # right ones, and all
        self._marker_readers = [MarkerReader(hand.labels) for hand in self.hands]
        self._point_reader = PointReader()
        self._joint_reader = JointStateReader()
        for hand in self.hands if self.is_anonymous else ():
            scope = f'{hand.hand.side}/' if len(self.hands) > 1 else ''
            node.create_subscription(MarkerArray, f'{scope}labelled_markers', partial(
                self._on_labelled, hand, MarkerReader(LabelMap(
                    default_labels(hand.layout.names), hand.layout.names))),
                LISTENER_DEPTH, raw=True)
        self._node = node
        node.create_subscription(
            JointState, 'joint_states', self._on_angles, LISTENER_DEPTH, raw=True)
        if TFMessage is not None:
            node.create_subscription(
                TFMessage, '/tf', self._on_transforms, LISTENER_DEPTH, raw=True)

    def listen_to_markers(self) -> None:
        """Subscribe to the markers, for which the replay waits: the last topic of all."""
        quick = QoSProfile(depth=LISTENER_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._node.create_subscription(MarkerArray, 'markers', self._on_markers, quick, raw=True)

    def _on_labelled(self, hand: ReceivedHand, reader: MarkerReader, message: bytes) -> None:
        frame = reader.read(message)
        if frame.stamp is not None:
            hand.markers[nanoseconds(frame.stamp)] = frame.positions
            for row, place in enumerate(frame.positions):
                if np.isfinite(place).all():
                    owner = self._owners.get(place.tobytes())
                    self._label_counts[0] += owner == (hand.hand.side, row)
                    self._label_counts[1] += 1

    def _on_markers(self, message: bytes) -> None:
        if self.is_anonymous:
            points = self._point_reader.read(message)
            if points.stamp is not None:
                self._frames.add(nanoseconds(points.stamp))
            return
        for hand, reader in zip(self.hands, self._marker_readers):
            frame = reader.read(message)
            if frame.stamp is not None:
                stamp = nanoseconds(frame.stamp)
                hand.markers[stamp] = frame.positions
                self._frames.add(stamp)

    def _on_angles(self, message: bytes) -> None:
        joints = self._joint_reader.read(message)
        stamp = nanoseconds(joints.stamp)
        # The replay stamps a frame with the time at which it is due.
        self._latencies.append(1e-9 * (time.time_ns() - stamp))
        for hand in self.hands:
            if hand.joints[0] in joints.names:
                first = joints.names.index(hand.joints[0])
                hand.angles[stamp] = joints.positions[first:first + len(hand.joints)]

    def _on_transforms(self, _: bytes) -> None:
        self.transforms += 1

    @property
    def counts(self) -> tuple[int, int]:
        """Return the numbers of received frames of markers and of joint states."""
        return len(self._frames), len(self._latencies)

    @property
    def label_counts(self) -> tuple[int, int]:
        """Return how many labels of points are those of their owners, and how many there are."""
        right, count = self._label_counts
        return right, count

    def before_first(self) -> int:
        """Return the number of received frames before the first answered one."""
        return len(self._frames) - self.left_out()[1]

    def left_out(self) -> tuple[int, int]:
        """Return the numbers of unanswered and of all frames since the first answered one.

        Frames before the first answer do not count: the palm may not be seen in them.
        """
        answered = set().union(*(hand.angles for hand in self.hands))
        first = min(answered, default=0)
        played = {stamp for stamp in self._frames if stamp >= first}
        return len(played - answered), len(played)

    def line(self) -> str:
        """Return a line on the last second of frames."""
        received = [hand.received_frames(1.) for hand in self.hands]
        if min(len(one.stamps) for one in received) < 2:
            return 'waiting for the first frames'
        stamps = received[0].stamps
        seen = np.concatenate([np.isfinite(one.markers[-1]).all(axis=1) for one in received])
        return (f'{(len(stamps) - 1) / np.ptp(stamps) * 1e9:6.1f} Hz   '
                f'{self.summary(received, len(stamps))}   markers seen '
                f'{seen.sum()} of {len(seen)}')

    def summary(self, received: Sequence[ReceivedFrames], recent: int = 0) -> str:
        """Return latency and residual of frames in words.

        Parameters
        ----------
        received : sequence of ReceivedFrames
            Whose residual it is.
        recent : int, optional
            Whose latency it is: that of so many last joint states; of all when 0.
        """
        misses = np.concatenate([np.linalg.norm(one.places - one.markers, axis=2)
                                 for one in received])
        p50, p99 = 1e3 * np.percentile(self._latencies[-recent:], (50, 99))
        return (f'latency p50 {p50:.2f} ms, p99 {p99:.2f} ms   '
                f'residual {1e3 * np.nanmean(misses):.2f} mm')
