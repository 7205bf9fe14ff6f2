"""The packaged demo motion as frames of markers, and the truth to judge by.

The hand that is tracked is never just the one that moves: it is wrong as a calibrated hand
is (`calibrated`).
"""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import Hand, preset_limits
from ..core.model.kinematics import Pose, forward, joint_table
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..simulation.motion import demo_motion
from ..simulation.simulator import calibrated

RATE = 120.  # [Hz]


class DemoFrames(NamedTuple):
    """The demo motion of a hand.

    Attributes
    ----------
    hand : Hand
        That moves.
    angles : ndarray, shape (n, 25)
        [rad]
    pose : Pose
    wrist_rotation : ndarray, shape (n, 3, 3)
    wrist_position : ndarray, shape (n, 3)
        [m]
    markers : ndarray, shape (n, 8, 3)
        Without noise [m].
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


def demo_frames(rate=RATE):
    """Return the demo motion of the mean hand at a rate [Hz]."""
    hand = Hand.scaled()
    motion = demo_motion(hand)
    times = np.arange(int(motion.duration * rate) + 1) / rate
    angles, rotation, position = motion.sample(times)
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(MarkerLayout().mounting(hand), pose, rotation, position)
    return DemoFrames(hand, angles, pose, rotation, position, markers,
                      landmark_positions(hand, pose, position))


def tracked_hand(hand, seed, scale=1.):
    """Return hand and layout as a calibration would have them.

    Parameters
    ----------
    hand : Hand
        That moves.
    seed : int
    scale : float
        By which all sizes are wrong besides.

    Returns
    -------
    hand : Hand
        With limits 'wide', as errors of size lead past those of the moving hand.
    layout : MarkerLayout
    """
    hand, layout = calibrated(hand, MarkerLayout(), seed)
    return hand.replace(limits=preset_limits('wide'), **{
        name: scale * getattr(hand, name) for name in (
            'finger_cmc', 'finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones')}), layout
