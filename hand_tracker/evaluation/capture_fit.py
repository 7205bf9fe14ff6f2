"""The hand of a capture: fitted on its first part, which is not judged."""

import numpy as np

from ..calibration import LANDMARKS, fit_hand
from ..core.model.hand import FINGERS, MCP_OF_LENGTH, Hand, preset_limits
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from .capture_tracking import track, tracked_joints
from .plain_hand import fit_plain


def fitting_joints(capture):
    """Return the joints a hand is fitted on, those never captured as a mean hand has them.

    Parameters
    ----------
    capture : Capture

    Returns
    -------
    ndarray, shape (split, 21, 3)
        [m]
    """
    joints = capture.joints[:capture.split]
    absent = ~np.isfinite(joints).all(axis=2).any(axis=0)
    if not absent.any():
        return joints
    # A hand of the same palm, with its markers at the captured ones.
    palm, breadth = (np.nanmedian(np.linalg.norm(
        joints[:, LANDMARKS.index('index_mcp')] - joints[:, LANDMARKS.index(other)], axis=1))
        for other in ('wrist', 'little_mcp'))
    hand = Hand.scaled(palm / MCP_OF_LENGTH[FINGERS.index('index')], breadth,
                       side=capture.side)
    # What does not fit is the mean hand, not the labels.
    tracker = HandTracker(hand, options=TrackerOptions(outlier_gate=0., swap_margin=0.))
    mean = tracked_joints(hand, track(tracker, capture.markers[:capture.split], capture.rate))
    return np.where(absent[:, None], mean, joints)


def fitted_hand(capture, limits):
    """Return the hand of a capture.

    Parameters
    ----------
    capture : Capture
    limits : str
        Preset of its limits.

    Returns
    -------
    Hand
    """
    return fit_hand(fitting_joints(capture), capture.side, preset_limits(limits))


def fitted_plain(capture):
    """Return the plain hand of a capture, always a right one."""
    joints = fitting_joints(capture.right())
    return fit_plain(joints[np.isfinite(joints).all(axis=(1, 2))])
