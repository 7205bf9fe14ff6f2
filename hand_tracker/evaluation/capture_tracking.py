"""Run the tracker over frames of markers, as a user would."""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.kinematics import Pose


class Tracked(NamedTuple):
    """What the tracker said of n frames.

    Attributes
    ----------
    angles : ndarray, shape (n, 25)
        [rad]
    wrist_rotation : ndarray, shape (n, 3, 3)
    wrist_position : ndarray, shape (n, 3)
        [m]
    pose : Pose
    markers : ndarray, shape (n, 8, 3)
        The positions used, measured or predicted [m].
    iterations : ndarray of int, shape (n,)
    """

    angles: np.ndarray
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    pose: Pose
    markers: np.ndarray
    iterations: np.ndarray


def advance(tracker, frame, index, rate, flexion=None):
    """Return the state after one more frame, the `index`-th at `rate` [Hz].

    The one place where evaluations call the tracker.
    """
    return tracker.update(frame, index / rate, flexion)


def track(tracker, markers, rate, first=0, flexion=None):
    """Return what a tracker says of frames.

    Parameters
    ----------
    tracker : HandTracker
    markers : ndarray, shape (n, 8, 3)
        NaN where not seen [m].
    rate : float
        [Hz]
    first : int
        Index of the first frame, for its time.
    flexion : ndarray, shape (n, 5), optional
        Measured flexion of the last joints [rad].

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


def tracked_joints(hand, tracked):
    """Return the 21 joints of tracked frames, shape (n, 21, 3) [m]."""
    return landmark_positions(hand, tracked.pose, tracked.wrist_position)
