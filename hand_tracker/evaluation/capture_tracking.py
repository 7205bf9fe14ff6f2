"""Run the tracker over arrays of markers."""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import Hand
from ..core.model.kinematics import Pose
from ..core.tracker import HandState, HandTracker


class Tracked(NamedTuple):
    """Tracking results of n frames.

    Attributes
    ----------
    angles : ndarray, shape (n, 25)
        [rad]
    wrist_rotation : ndarray, shape (n, 3, 3)
    wrist_position : ndarray, shape (n, 3)
        [m]
    pose : Pose
    markers : ndarray, shape (n, 8, 3)
        Marker positions used, measured or predicted [m].
    iterations : ndarray of int, shape (n,)
        Of FABRIK, summed over digits.
    """

    angles: np.ndarray
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    pose: Pose
    markers: np.ndarray
    iterations: np.ndarray


def advance(tracker: HandTracker, frame: np.ndarray, index: int, rate: float,
            flexion: np.ndarray | None = None) -> HandState:
    """Track frame number `index` of a sequence at `rate` [Hz] and return the state."""
    return tracker.update(frame, index / rate, flexion)


def track_markers(tracker: HandTracker, markers: np.ndarray, rate: float, first: int = 0,
                  flexion: np.ndarray | None = None) -> Tracked:
    """Track a sequence of frames and return the results as arrays.

    Parameters
    ----------
    tracker : HandTracker
    markers : ndarray, shape (n, 8, 3)
        NaN where not seen [m].
    rate : float
        [Hz]
    first : int
        Number of the first frame, which determines its time.
    flexion : ndarray, shape (n, 5), optional
        Measured flexion of the distal joints [rad].

    Returns
    -------
    Tracked
    """
    states = [advance(tracker, frame, first + i, rate, None if flexion is None else flexion[i])
              for i, frame in enumerate(markers)]
    return Tracked(
        np.array([state.angles for state in states]),
        np.array([state.wrist_rotation for state in states]),
        np.array([state.wrist_position for state in states]),
        Pose(*(np.array(part) for part in zip(*(state.pose for state in states)))),
        np.array([state.markers for state in states]),
        np.array([state.iterations for state in states]))


def tracked_joints(hand: Hand, tracked: Tracked) -> np.ndarray:
    """Return the positions of the 21 landmarks of tracked frames, shape (n, 21, 3) [m]."""
    return landmark_positions(hand, tracked.pose, tracked.wrist_position)
