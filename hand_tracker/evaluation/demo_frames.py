"""The packaged demo motion as frames of markers, and the truth to judge by.

The hand that is tracked is never just the one that moves: its sizes are wrong as those of a
calibrated hand are.
"""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.hand import Hand, preset_limits
from ..core.kinematics import Pose, forward, joint_table
from ..core.layout import MarkerLayout, marker_positions
from ..simulation.motion import demo_motion

RATE = 120.             # [Hz]
CALIBRATION_ERROR = .001  # [m] standard deviation of bones and joints' places; ours


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


def calibrated(hand, seed, error=CALIBRATION_ERROR, scale=1.):
    """Return a hand as a calibration would have it.

    Parameters
    ----------
    hand : Hand
    seed : int
    error : float
        Standard deviation of each bone and each coordinate of a joint of the palm [m].
    scale : float
        By which all sizes are wrong besides.

    Returns
    -------
    Hand
        With limits 'wide', as errors of size lead past those of the moving hand.
    """
    random = np.random.RandomState(seed)
    return hand.replace(limits=preset_limits('wide'), **{
        name: scale * (getattr(hand, name) + random.normal(0., error, getattr(hand, name).shape))
        for name in ('finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones')})
