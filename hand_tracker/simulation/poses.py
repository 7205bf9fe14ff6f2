"""Named hand poses as joint angles, and thumb contacts solved by bounded least squares.

A pose lists the free joints in degrees. In a contact pose the thumb's angles depend on the hand:
bounded least squares over them brings the thumb's pad to the contact point.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.least_squares import least_squares
from ..core.model.capsules import blank_placement, hand_capsules
from ..core.model.hand import DIGITS, FINGERS, JOINTS, LINKS, Hand, preset_limits
from ..core.model.kinematics import Pose, forward, joint_table, tip_offsets
from ..core.numerics.packs import as_item
from ..core.pose.contact import MAX_ROUNDS, Mobility, separate

# [degrees] (MCP abduction, MCP flexion, PIP flexion); the DIP follows the PIP.
STRAIGHT_FINGERS = ((3, 4, 5), (0, 3, 5), (2, 3, 5), (4, 4, 5))
RELAXED_HAND = ((2, 18, 28), (0, 22, 32), (0, 26, 34), (2, 28, 32))
SPREAD_FINGERS = ((15, -4, 2), (3, -4, 2), (12, -4, 2), (15, -5, 2))
FIST_FINGERS = ((-3, 82, 94), (0, 84, 94), (-2, 84, 94), (-4, 82, 92))
ROLLED_FINGERS = ((0, 42, 62), (0, 44, 64), (0, 44, 64), (0, 42, 60))
# A finger beside folded neighbours cannot extend fully.
ONE_FINGER = ((2, 8, 6), (0, 60, 94), (-2, 68, 94), (-3, 68, 92))
TWO_FINGERS = ((9, 6, 5), (-8, 12, 8), (-2, 54, 92), (-3, 64, 92))
THREE_FINGERS = ((9, 3, 4), (0, 5, 5), (9, 14, 10), (-4, 56, 90))
FOUR_FINGERS = ((9, 4, 4), (1, 4, 4), (5, 4, 4), (10, 4, 4))
OPPOSING_FINGERS = ((3, 26, 30), (0, 28, 32), (0, 30, 32), (2, 32, 30))

# [degrees] (CMC abduction, CMC flexion, MCP abduction, MCP flexion); the IP follows the MCP.
THUMB_BESIDE = (-10, -8, 0, 4)
THUMB_RELAXED = (8, 2, 0, 12)
THUMB_OUT = (-22, -19, 0, -3)
THUMB_OPPOSED = (24, 0, 0, 12)

REACHING_FINGER = (0, 45, 45)   # [degrees] initial guess of a finger that meets the thumb
POSTURE_SIGMA = np.radians(20.)  # [rad] weight of the initial guess
CONTACT_SIGMA = .001            # [m] weight of the gap
# Share of each digit in resolving an overlap, index finger to thumb: mostly the thumb moves.
CONTACT_MOBILITY = np.array((.05, .05, .05, .05, 1., 0.))
ALLOWED_OVERLAP = .0005         # [m] depth of contact that remains
ANGLE_RESOLUTION = .1           # [degrees] of solved angles, so that all machines agree


class Touch(NamedTuple):
    """Contact point of the thumb's pad on a finger.

    Attributes
    ----------
    place : {'tip', 'back', 'root'}
        'tip': the finger's pad, where the finger moves too; 'back': the dorsal side of the
        flexed middle phalanx; 'root': palmar of the MCP.
    finger : int
        0 to 3, index to little finger.
    share : float
        Position along the middle phalanx from PIP to DIP for 'back', or from wrist to MCP
        for 'root' [1].
    """

    place: str
    finger: int
    share: float = .5


Fingers = tuple[tuple[float, float, float], ...]
Thumb = tuple[float, float, float, float]

# Name: angles of the four fingers, and the thumb's four angles or its contact.
NAMED_POSES: dict[str, tuple[Fingers, Thumb | Touch]] = {
    'open': (STRAIGHT_FINGERS, THUMB_BESIDE),
    'relaxed': (RELAXED_HAND, THUMB_RELAXED),
    'spread': (SPREAD_FINGERS, THUMB_OUT),
    'rolled': (ROLLED_FINGERS, THUMB_RELAXED),
    'ready': (OPPOSING_FINGERS, THUMB_OPPOSED),
    # The thumb ends 22 mm short: to close over the fingers its IP would bend by 80 degrees alone.
    'fist': (FIST_FINGERS, Touch('back', 1, .2)),
    'one': (ONE_FINGER, Touch('back', 1)),
    'two': (TWO_FINGERS, Touch('back', 2)),
    'three': (THREE_FINGERS, Touch('back', 3, .2)),
    'four': (FOUR_FINGERS, Touch('root', 2, 1.15)),
    'five': (SPREAD_FINGERS, THUMB_OUT),
    'pinch': (FOUR_FINGERS, Touch('tip', 0)),
    **{f'oppose_{finger}': (OPPOSING_FINGERS, Touch('tip', i)) for i, finger in enumerate(FINGERS)},
}


def pose_angles(name: str, hand: Hand) -> np.ndarray:
    """Return the joint angles of a named pose.

    Parameters
    ----------
    name : str
        One of `NAMED_POSES`.
    hand : Hand

    Returns
    -------
    ndarray, shape (25,)
        In the order of `JOINTS`, within the limits of the hand and of Table 1 of the paper;
        DIP and thumb IP follow from the hand's coupling [rad].
    """
    fingers, thumb = NAMED_POSES[name]
    touch = thumb if isinstance(thumb, Touch) else None
    free = np.radians(np.concatenate(
        [np.ravel(fingers), THUMB_OPPOSED if touch else np.asarray(thumb)])).astype(float)
    if touch and touch.place == 'tip':
        free[3 * touch.finger:3 * touch.finger + 3] = np.radians(REACHING_FINGER)
    lower, upper = limits_of(hand)
    free = np.clip(free, lower[FREE_JOINTS], upper[FREE_JOINTS])
    if touch:
        free = _reach(hand, touch, free, lower, upper)
    return without_overlaps(hand, free, lower, upper)


def without_overlaps(hand: Hand, free: np.ndarray, lower: np.ndarray,
                     upper: np.ndarray) -> np.ndarray:
    """Return the joint angles with overlapping digits separated, mostly by moving the thumb.

    Parameters
    ----------
    hand : Hand
    free : ndarray, shape (16,)
        Angles of `FREE_JOINTS` [rad].
    lower, upper : ndarray, shape (25,)
        Limits [rad].

    Returns
    -------
    ndarray, shape (25,)
        [rad]
    """
    angles = _couple(hand, free, lower, upper)
    separate(as_item(hand_capsules(hand.as_right())), angles,
             Mobility(lower, upper, hand.coupling[:, 0].copy(), CONTACT_MOBILITY),
             ALLOWED_OVERLAP, blank_placement(), MAX_ROUNDS)
    free = np.clip(rounded(angles[FREE_JOINTS]), lower[FREE_JOINTS], upper[FREE_JOINTS])
    return _couple(hand, free, lower, upper)


def rounded(angles: np.ndarray) -> np.ndarray:
    """Round angles [rad] to `ANGLE_RESOLUTION`."""
    return np.radians(np.round(np.degrees(angles) / ANGLE_RESOLUTION) * ANGLE_RESOLUTION)


def _couple(hand: Hand, free: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return all 25 joint angles from the 16 free ones, by coupling and limits [rad]."""
    angles = np.zeros(len(JOINTS))
    angles[FREE_JOINTS] = free
    slope, offset = hand.coupling.T
    angles[COUPLING_JOINTS + 1] = slope * angles[COUPLING_JOINTS] + offset
    return np.clip(angles, lower, upper)


def thumb_gap(hand: Hand, pose: Pose, touch: Touch) -> np.ndarray:
    """Return the vector from the contact point to the thumb's pad, shape (3,) [m].

    Parameters
    ----------
    hand : Hand
    pose : Pose
        With the wrist at the origin.
    touch : Touch
    """
    tips = tip_offsets(hand)

    mirror = (1., 1. if hand.side == 'right' else -1., 1.)

    def point(link: str, place: ArrayLike) -> np.ndarray:
        row = LINKS.index(link)
        return pose.position[row] + pose.rotation[row] @ np.multiply(place, mirror)

    # The pad: palmar of the distal phalanx, a third of its length short of the tip.
    def pad(digit: int) -> np.ndarray:
        return point(f'{DIGITS[digit]}_distal',
                     (tips[digit, 0] * 2. / 3., 0., -hand.radii[digit, 2]))

    if touch.place == 'tip':
        return pad(4) - pad(touch.finger)
    if touch.place == 'back':
        along, aside, _ = touch.share * hand.bone_ends()[touch.finger, 1]
        return pad(4) - point(f'{FINGERS[touch.finger]}_middle',
                              (along, aside, hand.radii[touch.finger, 1]))
    mcp = hand.finger_mcp[touch.finger] * (touch.share, 1., 1.) * mirror
    return pad(4) - mcp + (0., 0., 2. * hand.palm_radius)


FREE_JOINTS = np.array([JOINTS.index(f'{finger}_{joint}') for finger in FINGERS for joint in (
    'mcp_abduction', 'mcp_flexion', 'pip_flexion')] + [JOINTS.index(f'thumb_{joint}') for joint in (
        'cmc_abduction', 'cmc_flexion', 'mcp_abduction', 'mcp_flexion')])
FREE_THUMB_JOINTS = np.arange(12, 16)
# Joints that DIP and thumb IP are coupled to; the coupled joint is the next in `JOINTS`.
COUPLING_JOINTS = np.array([JOINTS.index(f'{finger}_pip_flexion') for finger in FINGERS]
                   + [JOINTS.index('thumb_mcp_flexion')])


def limits_of(hand: Hand) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper joint limits, (25,) each: the hand's within Table 1 [rad]."""
    paper = preset_limits('paper')
    return np.maximum(hand.limits[:, 0], paper[:, 0]), np.minimum(hand.limits[:, 1], paper[:, 1])


def _reach(hand: Hand, touch: Touch, natural: np.ndarray, lower: np.ndarray,
           upper: np.ndarray) -> np.ndarray:
    """Return the free angles nearest to `natural` that bring the thumb's pad to the contact."""
    moving = FREE_THUMB_JOINTS
    if touch.place == 'tip':
        moving = np.append(np.arange(3) + 3 * touch.finger, FREE_THUMB_JOINTS)
    # A locked joint is no variable.
    moving = moving[upper[FREE_JOINTS[moving]] > lower[FREE_JOINTS[moving]]]

    table = joint_table(hand)

    def with_moved(x: np.ndarray) -> np.ndarray:
        free = natural.copy()
        free[moving] = x
        return free

    def residuals(x: np.ndarray) -> np.ndarray:
        pose = forward(table, _couple(hand, with_moved(x), lower, upper))
        gap = thumb_gap(hand, pose, touch)
        return np.concatenate((gap / CONTACT_SIGMA, (x - natural[moving]) / POSTURE_SIGMA))

    low, high = lower[FREE_JOINTS[moving]], upper[FREE_JOINTS[moving]]
    solved = least_squares(residuals, natural[moving], bounds=(low, high),
                           xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=300)
    return with_moved(np.clip(rounded(solved.x), low, high))
