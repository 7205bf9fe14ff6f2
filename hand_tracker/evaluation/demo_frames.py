"""Markers and ground truth of the demo motion, and the hand model with calibration errors."""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import Hand, preset_limits
from ..core.model.kinematics import Pose, forward, joint_table
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..simulation.motion import demo_motion
from ..simulation.packaged_recordings import RECORDING_RATE
from ..simulation.simulator import calibrated


class DemoFrames(NamedTuple):
    """Markers and ground truth of the demo motion.

    Attributes
    ----------
    hand : Hand
        The moving hand.
    angles : ndarray, shape (n, 25)
        [rad]
    pose : Pose
    wrist_rotation : ndarray, shape (n, 3, 3)
    wrist_position : ndarray, shape (n, 3)
        [m]
    markers : ndarray, shape (n, 8, 3)
        Of the paper's layout, without noise [m].
    joints : ndarray, shape (n, 21, 3)
        In the order of `LANDMARKS` [m].
    """

    hand: Hand
    angles: np.ndarray
    pose: Pose
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    markers: np.ndarray
    joints: np.ndarray


def demo_frames(rate: float = RECORDING_RATE) -> DemoFrames:
    """Sample the demo motion of the mean hand at a rate [Hz]."""
    hand = Hand.scaled()
    motion = demo_motion(hand)
    times = np.arange(int(motion.duration * rate) + 1) / rate
    angles, rotation, position = motion.sample(times)
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(MarkerLayout().mounting(hand), pose, rotation, position)
    return DemoFrames(hand, angles, pose, rotation, position, markers,
                      landmark_positions(hand, pose, position))


def tracked_hand(hand: Hand, seed: int, scale: float = 1.) -> tuple[Hand, MarkerLayout]:
    """Return hand model and layout with calibration errors and a factor on all lengths.

    Parameters
    ----------
    hand : Hand
        The moving hand.
    seed : int
        Of the calibration errors.
    scale : float
        Factor on all lengths [1].

    Returns
    -------
    hand : Hand
        With the limits 'wide': with wrong lengths the solution exceeds the moving hand's limits.
    layout : MarkerLayout
    """
    hand, layout = calibrated(hand, MarkerLayout(), seed)
    return hand.replace(limits=preset_limits('wide'), **{
        name: scale * getattr(hand, name) for name in (
            'finger_cmc', 'finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones',
            'thumb_axis_distance')}), layout
