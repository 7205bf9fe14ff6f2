"""The fingers' abduction axes, which no marker shows.

They are fitted so that the plane through MCP, DIP and axis holds the recorded PIP.
"""

import numpy as np

from ..core.hand import FINGERS
from ..core.kinematics import digit_base
from .regularised import regularised_fit

FIT_FRAMES = 400  # spread over the recording
STRONG_FLEXION = np.radians(60.)  # above it a finger's direction says little of its abduction
SEEN = (1., 99.)  # [percentile] of the angles that count as the range of motion

# How far an axis may lean from dorsal, one standard deviation; ours, unsourced.
LEAN_SPREAD = np.tan(np.radians(15.))
LEAN_BOUND = 2.5  # [LEAN_SPREAD]


def fit_fingers(hand, fingers):
    """Return `hand` with the abduction axes and the splay of its fingers fitted.

    Parameters
    ----------
    hand : Hand
        With MCP joints and bones.
    fingers : ndarray, shape (T, 4, 4, 3)
        MCP, PIP, DIP and tip of the fingers of a right hand in the palm's frame [m].

    Returns
    -------
    Hand
    """
    every = np.unique(np.linspace(0, len(fingers) - 1, FIT_FRAMES).astype(int))
    axes = []
    for finger in range(len(FINGERS)):
        pip, dip = (fingers[every, finger, joint] - fingers[every, finger, 0] for joint in (1, 2))
        reach = np.linalg.norm(dip, axis=1, keepdims=True)

        def misses(x, finger=finger, pip=pip, direction=dip / reach):
            # Not of unit length: a DIP straight below its MCP tells of no plane.
            normal = np.cross(_leaning(hand, finger, x).finger_abduction_axes[finger], direction)
            return (pip * normal).sum(axis=1, keepdims=True)

        lean = regularised_fit(misses, [np.zeros(2)], np.array([(-LEAN_BOUND, LEAN_BOUND)] * 2).T)
        axes.append(_leaning(hand, finger, lean).finger_abduction_axes[finger])
    hand = hand.replace(finger_abduction_axes=axes)
    return hand.replace(splay=[
        _middle_of_abduction(hand, finger, fingers[:, finger, 1] - fingers[:, finger, 0])
        for finger in range(len(FINGERS))])


def _leaning(hand, finger, lean):
    axes = hand.finger_abduction_axes.copy()
    axes[finger] = (LEAN_SPREAD * lean[0], LEAN_SPREAD * lean[1], 1.)
    return hand.replace(finger_abduction_axes=axes)


def _middle_of_abduction(hand, finger, proximal):
    """Return the splay about which a finger's proximal phalanx (T, 3) is seen to abduct [rad]."""
    base, _, _ = digit_base(hand, finger)
    x, y, z = (proximal @ base).T
    flexion = np.arctan2(-z, np.hypot(x, y))
    seen = (x > 0.) & (np.abs(flexion) < STRONG_FLEXION)
    if not seen.any():
        return hand.splay[finger]
    turn = np.percentile(np.arctan2(y, x)[seen], SEEN).mean()
    direction = base @ (np.cos(turn), np.sin(turn), 0.)
    # Where the plane through that direction and the axis cuts the palm.
    axis = base[:, 2]
    rest = direction - direction[2] / axis[2] * axis
    return np.arctan2(rest[1], rest[0])
