"""Hand models fitted to the first part of a capture, which is not judged."""

import numpy as np

from ..calibration import LANDMARKS, fit_hand
from ..core.model.hand import FINGERS, MCP_OF_LENGTH, Hand
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from .capture_tracking import track_markers, tracked_joints
from .captures import Capture
from .plain_hand import PlainHand, fit_plain


def fitting_joints(capture: Capture) -> np.ndarray:
    """Return the joints to fit a hand to; joints never captured are those of a mean hand.

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
    # A mean hand scaled to the palm and tracked from the captured markers.
    palm, breadth = (np.nanmedian(np.linalg.norm(
        joints[:, LANDMARKS.index('index_mcp')] - joints[:, LANDMARKS.index(other)], axis=1))
        for other in ('wrist', 'little_mcp'))
    hand = Hand.scaled(palm / MCP_OF_LENGTH[FINGERS.index('index')], breadth,
                       side=capture.side)
    # Misfits are due to the mean hand, not to wrong labels.
    tracker = HandTracker(hand, options=TrackerOptions(outlier_gate=0., swap_margin=0.))
    tracked = track_markers(tracker, capture.markers[:capture.split], capture.rate)
    return np.where(absent[:, None], tracked_joints(hand, tracked), joints)


def fit_to_capture(capture: Capture, limits: str) -> Hand:
    """Fit a hand to a capture.

    Parameters
    ----------
    capture : Capture
    limits : str
        Preset of the joint limits.

    Returns
    -------
    Hand
    """
    return fit_hand(fitting_joints(capture), capture.side, limits)


def fitted_plain(capture: Capture) -> PlainHand:
    """Fit a plain hand, always a right one, to a capture."""
    joints = fitting_joints(capture.right())
    return fit_plain(joints[np.isfinite(joints).all(axis=(1, 2))])
