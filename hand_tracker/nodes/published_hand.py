"""The hand that a tracker publishes, from its joint states and its markers for RViz."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..core.model.hand import JOINTS, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MarkerLayout
from ..core.model.palm_triangle import fit_wrist
from ..core.model.skeleton import SKELETON_POINTS, skeleton_points
from ..core.model.states import MarkerState, PalmState
from ..core.tracker import HandState
from ..messages.builders import Names
from ..messages.joint_states import angles_of
from ..messages.rviz_markers import HELD_OPACITY, JOINTS_SHOWN, states_of_colours

KEPT = 100           # joint states that may wait for the markers of their stamp
# In bytes: behind the encapsulation, and there behind the number of markers.
JOINTS_STAMP, MARKERS_STAMP = slice(4, 12), slice(8, 16)
# Of the palm, within which no joint moves: they determine where the wrist is.
PALM_POINTS = [SKELETON_POINTS.index(name)
               for name in ('wrist', 'index_proximal', 'little_proximal')]
PALM_SHOWN = [JOINTS_SHOWN.index(point) for point in PALM_POINTS]


class PublishedHand:
    """Read the state of a hand from serialized messages of a tracker.

    Parameters
    ----------
    names : Names
        Of the hand's joints and frames.
    hand : Hand
    layout : MarkerLayout

    Attributes
    ----------
    joint_states, hand_markers : deque of bytes
        Messages received, the newest last: a JointState and a MarkerArray of one stamp make a
        state.
    """

    def __init__(self, names: Names, hand: Hand, layout: MarkerLayout) -> None:
        self.joint_states: deque[bytes] = deque(maxlen=KEPT)
        self.hand_markers: deque[bytes] = deque(maxlen=1)
        self._names = names
        self._state: HandState | None = None
        self.set_hand(hand, layout)

    def set_hand(self, hand: Hand, layout: MarkerLayout) -> None:
        """Read messages of another hand from now on."""
        self._hand, self._layout = hand, layout
        rest = forward(joint_table(hand), np.zeros(len(JOINTS)))
        self._template = skeleton_points(tip_offsets(hand), rest, np.zeros(3))[PALM_POINTS]

    def state(self) -> HandState | None:
        """Return the hand as it was published last; None before the first frame."""
        for markers in tuple(self.hand_markers):
            stamp = markers[MARKERS_STAMP]
            for joints in reversed(tuple(self.joint_states)):
                if joints[JOINTS_STAMP] == stamp:
                    self._state = self.read(joints, markers) or self._state
                    break
        return self._state

    def read(self, joint_state: bytes, hand_markers: bytes) -> HandState | None:
        """Return the hand of two messages, as far as they determine it.

        None if they are not this tracker's.
        """
        angles = angles_of(deserialize_message(joint_state, JointState), self._names.joints)
        shown = {marker.ns.removeprefix(self._names.prefix): marker for marker in
                 deserialize_message(hand_markers, MarkerArray).markers}
        if angles is None or not {'joints', 'markers'} <= shown.keys():
            return None
        joints, known = shown['joints'], shown['markers']
        if len(joints.points) != len(JOINTS_SHOWN) or len(known.points) > len(self._layout.names):
            return None
        rotation, position = np.empty((3, 3)), np.empty(3)
        fit_wrist(_array(joints.points)[PALM_SHOWN], self._template, rotation, position)
        count = len(self._layout.names)
        markers = np.tile(position, (count, 1))
        states = np.full(count, int(MarkerState.ABSENT))
        if known.points:
            markers[:len(known.points)] = _array(known.points)
            states[:len(known.colors)] = states_of_colours(known.colors)
        unknown = np.full(count, np.nan)
        found = joints.color.a > .5 * (1. + HELD_OPACITY)
        return HandState(
            PalmState.TRACKED if found else PalmState.LOST, angles, rotation, position,
            forward(joint_table(self._hand), angles, rotation, position), markers, states,
            hidden_for=unknown, deviation=np.full(len(JOINTS), np.nan), residuals=unknown,
            iterations=0)


def _array(points: Sequence[Point]) -> np.ndarray:
    return np.array([(point.x, point.y, point.z) for point in points])
