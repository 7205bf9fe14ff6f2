"""Hand shapes of finger spelling and of grasps, in degrees per joint.

The forms follow the American manual alphabet and the grasps named by Napier, J. Bone Joint
Surg. 38-B (1956); the numbers are ours, unsourced, within Table 1 of the paper and within
the bounds on how far neighbouring fingers differ.
"""

import numpy as np

from .poses import (
    AWAITING,
    FIST,
    FOUR,
    FREE,
    ONE,
    RELAXED,
    SPREAD,
    STRAIGHT,
    THREE,
    THUMB_OUT,
    THUMB_READY,
    THUMB_RELAXED,
    TWO,
    apart,
    limits_of,
)

HOOKED = ((2, 10, 82), (0, 12, 84), (-1, 12, 84), (-2, 12, 80))
ROUND = ((2, 38, 42), (0, 40, 44), (-1, 40, 44), (-2, 40, 42))
CLOSED_ROUND = ((2, 52, 52), (0, 54, 52), (-2, 54, 50), (-4, 54, 48))
LITTLE_UP = ((-2, 74, 92), (0, 70, 92), (-2, 46, 88), (6, 8, 8))
INDEX_HOOK = ((2, 28, 82), (0, 66, 94), (-2, 70, 94), (-3, 70, 92))
TOGETHER = ((-6, 4, 5), (-4, 6, 6), (-2, 48, 90), (-3, 62, 92))

# [degrees] (CMC abduction, CMC flexion, MCP abduction, MCP flexion)
THUMB_ACROSS = (14, 14, 0, 24)
THUMB_OVER = (22, 16, 0, 22)
THUMB_ALONG = (-6, 4, 0, 10)
THUMB_KEY = (4, 12, 0, 18)

# Name: fingers (MCP abduction, MCP flexion, PIP flexion), and the thumb's four angles.
LETTERS = {
    'A': (FIST, THUMB_ALONG), 'B': (STRAIGHT, THUMB_ACROSS), 'C': (ROUND, THUMB_READY),
    'D': (ONE, THUMB_OVER), 'E': (HOOKED, THUMB_ACROSS), 'I': (LITTLE_UP, THUMB_OVER),
    'L': (ONE, THUMB_OUT), 'O': (CLOSED_ROUND, THUMB_OVER), 'S': (FIST, THUMB_OVER),
    'U': (TOGETHER, THUMB_OVER), 'V': (TWO, THUMB_OVER), 'W': (THREE, THUMB_OVER),
    'X': (INDEX_HOOK, THUMB_OVER), 'Y': (LITTLE_UP, THUMB_OUT), '5': (SPREAD, THUMB_OUT),
    '4': (FOUR, THUMB_ACROSS),
}

# Grasp: how the hand opens for the object, and how it closes on a small and on a large one.
PRESHAPE = ((8, 14, 16), (1, 14, 16), (6, 15, 16), (9, 16, 16))
POWER = (((0, 74, 84), (0, 76, 86), (-1, 77, 86), (-2, 78, 84)),
         ((5, 36, 46), (0, 38, 48), (3, 40, 48), (6, 42, 48)))
PRECISION = (((1, 48, 50), (0, 52, 50), (-2, 46, 52), (-3, 44, 50)),
             ((3, 26, 32), (0, 28, 32), (0, 30, 36), (0, 32, 38)))
LATERAL = (((-2, 56, 72), (0, 64, 78), (-1, 68, 80), (-3, 70, 80)),
           ((-1, 44, 60), (0, 54, 68), (-1, 58, 72), (-3, 60, 72)))
GRASPS = {
    'power': ((PRESHAPE, THUMB_READY), POWER, (THUMB_OVER, (28, -2, 0, 8))),
    'precision': ((AWAITING, THUMB_READY), PRECISION, ((26, 12, 0, 14), (28, 0, 0, 8))),
    'lateral': ((RELAXED, THUMB_OUT), LATERAL, (THUMB_KEY, (-4, 2, 0, 10))),
}
REST = (RELAXED, THUMB_RELAXED)


def shape_angles(shape, hand):
    """Return the 25 angles of a hand shape.

    Parameters
    ----------
    shape : (fingers, thumb)
        As in `LETTERS` [degrees].
    hand : Hand

    Returns
    -------
    ndarray, shape (25,)
        Within the hand's limits and Table 1; DIP and thumb IP follow the hand's coupling [rad].
    """
    fingers, thumb = shape
    lower, upper = limits_of(hand)
    free = np.radians(np.concatenate((np.ravel(fingers), thumb)).astype(float))
    return apart(hand, np.clip(free, lower[FREE], upper[FREE]), lower, upper)


def grasp_shape(kind, size):
    """Return the hand shape of a grasp on an object.

    Parameters
    ----------
    kind : {'power', 'precision', 'lateral'}
    size : float
        Of the object, 0 to 1: the smallest to the largest.

    Returns
    -------
    (fingers, thumb)
        [degrees]
    """
    _, fingers, thumb = GRASPS[kind]
    return tuple((1. - size) * np.array(small) + size * np.array(large)
                 for small, large in (fingers, thumb))
