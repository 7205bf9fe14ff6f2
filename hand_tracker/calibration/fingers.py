"""What no marker shows of the fingers: their abduction axes, and how the DIP follows the PIP.

The axes are fitted so that the plane through MCP, DIP and axis holds the recorded PIP.
"""

import numpy as np

from ..core.model.hand import COUPLING_OFFSET_RANGE, FINGERS, SLOPE_RANGE
from ..core.model.kinematics import digit_base
from .least_squares import regularised_fit

FIT_FRAMES = 400  # spread over the recording
STRONG_FLEXION = np.radians(60.)  # above it a finger's direction says little of its abduction
SEEN = (1., 99.)  # [percentile] of the angles that count as the range of motion

# How far an axis may lean from dorsal, one standard deviation; ours, unsourced.
LEAN_SPREAD = np.tan(np.radians(15.))
LEAN_BOUND = 2.5  # [LEAN_SPREAD]

# Variance of the recorded PIP [rad^2] at which a fitted slope is half its own, half the usual one:
# a few grasps tell little of the slope in the next. Ours, from captures.
USUAL_SLOPE_WORTH = .1


def fit_fingers(hand, fingers):
    """Return `hand` with the abduction axes, the splay and the coupling of its fingers fitted.

    Parameters
    ----------
    hand : Hand
        With MCP joints, bones and the usual coupling.
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
    splay = [_middle_of_abduction(hand, finger, fingers[:, finger, 1] - fingers[:, finger, 0])
             for finger in range(len(FINGERS))]
    coupling = hand.coupling.copy()
    for finger in range(len(FINGERS)):
        coupling[finger] = _fitted_coupling(
            *_flexions(hand, finger, fingers[:, finger]), coupling[finger, 0])
    return hand.replace(splay=splay, coupling=coupling)


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


def _flexions(hand, finger, joints):
    """Return the flexion of PIP and DIP (T,) in the planes that hold a finger's axis [rad].

    A plane is as near as can be to all bones between the joints (T, 4, 3), so that one bone
    along the axis does not turn it.
    """
    base, _, _ = digit_base(hand, finger)
    x, y, z = np.moveaxis(np.diff(joints, axis=1) @ base, -1, 0)
    # Squared, as bones that point back lie in the same plane.
    turn = np.angle(((x + 1j * y) ** 2).sum(axis=1, keepdims=True)) / 2.
    bent = np.arctan2(-z, x * np.cos(turn) + y * np.sin(turn))
    pip, dip = ((np.diff(bent, axis=1) + np.pi) % (2. * np.pi) - np.pi).T
    return pip, dip


def _fitted_coupling(pip, dip, usual):
    """Return slope and offset of the line through recorded flexions, near the usual slope."""
    covariance = np.cov(pip, dip, bias=True)
    slope = np.clip((covariance[0, 1] + USUAL_SLOPE_WORTH * usual)
                    / (covariance[0, 0] + USUAL_SLOPE_WORTH), *SLOPE_RANGE)
    return slope, np.clip(dip.mean() - slope * pip.mean(), *COUPLING_OFFSET_RANGE)
