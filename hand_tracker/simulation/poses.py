"""Named hand poses, in degrees per joint, and poses in which the thumb touches something.

Where the thumb touches, its angles follow from the hand: least squares over them, within
the limits, bring its pad to the place.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ..core.model.capsules import capsules
from ..core.model.hand import DIGITS, FINGERS, JOINTS, LINKS, preset_limits
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.pose.contact import separate

# [degrees] (MCP abduction, MCP flexion, PIP flexion); the DIP follows the PIP.
STRAIGHT = ((3, 4, 5), (0, 3, 5), (2, 3, 5), (4, 4, 5))
RELAXED = ((2, 18, 28), (0, 22, 32), (0, 26, 34), (2, 28, 32))
SPREAD = ((15, -4, 2), (3, -4, 2), (12, -4, 2), (15, -5, 2))
FIST = ((-3, 82, 94), (0, 84, 94), (-2, 84, 94), (-4, 82, 92))
ROLLED = ((0, 42, 62), (0, 44, 64), (0, 44, 64), (0, 42, 60))
# Neighbours hold each other back: a straight finger beside a folded one is not quite straight.
ONE = ((2, 8, 6), (0, 60, 94), (-2, 68, 94), (-3, 68, 92))
TWO = ((9, 6, 5), (-8, 12, 8), (-2, 54, 92), (-3, 64, 92))
THREE = ((9, 3, 4), (0, 5, 5), (9, 14, 10), (-4, 56, 90))
FOUR = ((9, 4, 4), (1, 4, 4), (5, 4, 4), (10, 4, 4))
AWAITING = ((3, 26, 30), (0, 28, 32), (0, 30, 32), (2, 32, 30))

# [degrees] (CMC abduction, CMC flexion, MCP abduction, MCP flexion); the IP follows the MCP.
THUMB_BESIDE = (-10, -8, 0, 4)
THUMB_RELAXED = (8, 2, 0, 12)
THUMB_OUT = (-22, -19, 0, -3)
THUMB_READY = (24, 0, 0, 12)

TOUCHING = (0, 45, 45)     # [degrees] from which a finger reaches for the thumb
POSTURE_SPREAD = np.radians(20.)
CONTACT_SPREAD = .001      # [m]
MOBILITY = np.array((.05, .05, .05, .05, 1.))  # of digits in each other: the thumb gives way
OVERLAP = .0005            # [m] that is left to them
STEP = .1                  # [degrees] solved angles are rounded to: the same on any machine


class Touch(NamedTuple):
    """Where the thumb's pad goes.

    Attributes
    ----------
    place : str
        'tip', the finger's pad, which comes to meet it; 'back', the dorsal side of its
        folded middle phalanx; or 'root', before the straight finger's MCP.
    finger : int
        0 to 3, index to little finger.
    share : float
        How far along the middle phalanx from the PIP, or from the wrist to the MCP.
    """

    place: str
    finger: int
    share: float = .5


# Fingers of the pose and the thumb's four angles, or what it touches.
POSES = {
    'open': (STRAIGHT, THUMB_BESIDE),
    'relaxed': (RELAXED, THUMB_RELAXED),
    'spread': (SPREAD, THUMB_OUT),
    'rolled': (ROLLED, THUMB_RELAXED),
    'ready': (AWAITING, THUMB_READY),
    'fist': (FIST, Touch('back', 1, .2)),
    'one': (ONE, Touch('back', 1)),
    'two': (TWO, Touch('back', 2)),
    'three': (THREE, Touch('back', 3, .2)),
    'four': (FOUR, Touch('root', 2, 1.15)),
    'five': (SPREAD, THUMB_OUT),
    'pinch': (FOUR, Touch('tip', 0)),
    **{f'oppose_{finger}': (AWAITING, Touch('tip', i)) for i, finger in enumerate(FINGERS)},
}


def pose_angles(name, hand):
    """Return the angles of a named pose.

    Parameters
    ----------
    name : str
        One of `POSES`.
    hand : Hand

    Returns
    -------
    ndarray, shape (25,)
        Within the hand's limits and those of the preset 'paper'; DIP and thumb IP follow
        the hand's coupling [rad].
    """
    fingers, thumb = POSES[name]
    touch = thumb if isinstance(thumb, Touch) else None
    free = np.radians(np.concatenate(
        [np.ravel(fingers), THUMB_READY if touch else thumb])).astype(float)
    if touch and touch.place == 'tip':
        free[3 * touch.finger:3 * touch.finger + 3] = np.radians(TOUCHING)
    lower, upper = limits_of(hand)
    free = np.clip(free, lower[FREE], upper[FREE])
    if touch:
        free = _reach(hand, touch, free, lower, upper)
    return apart(hand, free, lower, upper)


def apart(hand, free, lower, upper):
    """Return all 25 angles, the thumb moved out of the fingers and these out of each other [rad].

    Parameters
    ----------
    hand : Hand
    free : ndarray, shape (16,)
        [rad]
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    """
    angles = couple(hand, free, lower, upper)
    separate(capsules(hand.replace(side='right')), angles, lower, upper,
             hand.coupling[:, 0].copy(), MOBILITY, OVERLAP)
    return couple(hand, np.clip(rounded(angles[FREE]), lower[FREE], upper[FREE]), lower, upper)


def rounded(angles):
    """Return angles as they are on any machine [rad]."""
    return np.radians(np.round(np.degrees(angles) / STEP) * STEP)


def couple(hand, free, lower, upper):
    """Return all 25 angles from the free ones, DIP and thumb IP coupled and limited [rad]."""
    angles = np.zeros(len(JOINTS))
    angles[FREE] = free
    angles[LEADERS + 1] = hand.coupling[:, 0] * angles[LEADERS] + hand.coupling[:, 1]
    return np.clip(angles, lower, upper)


def thumb_gap(hand, angles, touch):
    """Return the vector from the place that is touched to the thumb's pad, shape (3,) [m]."""
    pose = forward(joint_table(hand), angles)
    tips = tip_offsets(hand)

    def point(link, along, dorsal):
        row = LINKS.index(link)
        return pose.position[row] + pose.rotation[row] @ (along, 0., dorsal)

    # The pad: palmar of the distal phalanx, a third of its length short of the tip.
    def pad(digit):
        return point(f'{DIGITS[digit]}_distal', tips[digit, 0] * 2. / 3., -hand.radii[digit, 2])

    if touch.place == 'tip':
        return pad(4) - pad(touch.finger)
    if touch.place == 'back':
        return pad(4) - point(f'{FINGERS[touch.finger]}_middle',
                              touch.share * hand.finger_bones[touch.finger, 1],
                              hand.radii[touch.finger, 1])
    mirror = (1., 1. if hand.side == 'right' else -1., 1.)
    before = hand.finger_mcp[touch.finger] * (touch.share, 1., 1.) * mirror
    return pad(4) - before + (0., 0., 2. * hand.palm_radius)


FREE = np.array([JOINTS.index(f'{finger}_{joint}') for finger in FINGERS for joint in (
    'mcp_abduction', 'mcp_flexion', 'pip_flexion')] + [JOINTS.index(f'thumb_{joint}') for joint in (
        'cmc_abduction', 'cmc_flexion', 'mcp_abduction', 'mcp_flexion')])
THUMB_FREE = np.arange(12, 16)
# The joints that DIP and thumb IP follow; the follower is the next in `JOINTS`.
LEADERS = np.array([JOINTS.index(f'{finger}_pip_flexion') for finger in FINGERS]
                   + [JOINTS.index('thumb_mcp_flexion')])


def limits_of(hand):
    """Return lower and upper limits, those of the hand and of Table 1 at once [rad]."""
    paper = preset_limits('paper')
    return np.maximum(hand.limits[:, 0], paper[:, 0]), np.minimum(hand.limits[:, 1], paper[:, 1])


def _reach(hand, touch, natural, lower, upper):
    moving = THUMB_FREE
    if touch.place == 'tip':
        moving = np.append(np.arange(3) + 3 * touch.finger, THUMB_FREE)
    # A limit of zero width leaves nothing to solve.
    moving = moving[upper[FREE[moving]] > lower[FREE[moving]]]

    def with_moved(x):
        free = natural.copy()
        free[moving] = x
        return free

    def residuals(x):
        gap = thumb_gap(hand, couple(hand, with_moved(x), lower, upper), touch)
        return np.concatenate((gap / CONTACT_SPREAD, (x - natural[moving]) / POSTURE_SPREAD))

    low, high = lower[FREE[moving]], upper[FREE[moving]]
    solved = least_squares(residuals, natural[moving], bounds=(low, high),
                           xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=300)
    return with_moved(np.clip(rounded(solved.x), low, high))
