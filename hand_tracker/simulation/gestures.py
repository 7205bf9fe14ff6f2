"""Hand shapes of fingerspelling (American manual alphabet) and of grasps, in degrees per joint.

The grasps are those of Napier, J. Bone Joint Surg. 38-B (1956). The numbers are ours, unsourced,
within Table 1 of the paper and within the bounds on the difference of neighbouring fingers.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import Hand
from .poses import (
    FIST_FINGERS,
    FOUR_FINGERS,
    FREE_JOINTS,
    ONE_FINGER,
    OPPOSING_FINGERS,
    RELAXED_HAND,
    SPREAD_FINGERS,
    STRAIGHT_FINGERS,
    THREE_FINGERS,
    THUMB_OPPOSED,
    THUMB_OUT,
    THUMB_RELAXED,
    TWO_FINGERS,
    limits_of,
    without_overlaps,
)

HOOKED_FINGERS = ((2, 10, 82), (0, 12, 84), (-1, 12, 84), (-2, 12, 80))
ROUND_FINGERS = ((2, 38, 42), (0, 40, 44), (-1, 40, 44), (-2, 40, 42))
CLOSED_ROUND_FINGERS = ((2, 52, 52), (0, 54, 52), (-2, 54, 50), (-4, 54, 48))
LITTLE_FINGER_UP = ((-2, 74, 92), (0, 70, 92), (-2, 46, 88), (6, 8, 8))
INDEX_FINGER_HOOK = ((2, 28, 82), (0, 66, 94), (-2, 70, 94), (-3, 70, 92))
TWO_FINGERS_TOGETHER = ((-6, 4, 5), (-4, 6, 6), (-2, 48, 90), (-3, 62, 92))

# [degrees] (CMC abduction, CMC flexion, MCP abduction, MCP flexion)
THUMB_ACROSS = (14, 14, 0, 24)
THUMB_OVER = (22, 16, 0, 22)
THUMB_ALONG = (-6, 4, 0, 10)
THUMB_KEY = (4, 12, 0, 18)

Shape = tuple[ArrayLike, ArrayLike]

# Name: fingers (MCP abduction, MCP flexion, PIP flexion), and the thumb's four angles [degrees].
LETTER_SHAPES: dict[str, Shape] = {
    'A': (FIST_FINGERS, THUMB_ALONG),
    'B': (STRAIGHT_FINGERS, THUMB_ACROSS),
    'C': (ROUND_FINGERS, THUMB_OPPOSED),
    'D': (ONE_FINGER, THUMB_OVER),
    'E': (HOOKED_FINGERS, THUMB_ACROSS),
    'I': (LITTLE_FINGER_UP, THUMB_OVER),
    'L': (ONE_FINGER, THUMB_OUT),
    'O': (CLOSED_ROUND_FINGERS, THUMB_OVER),
    'S': (FIST_FINGERS, THUMB_OVER),
    'U': (TWO_FINGERS_TOGETHER, THUMB_OVER),
    'V': (TWO_FINGERS, THUMB_OVER),
    'W': (THREE_FINGERS, THUMB_OVER),
    'X': (INDEX_FINGER_HOOK, THUMB_OVER),
    'Y': (LITTLE_FINGER_UP, THUMB_OUT),
    '5': (SPREAD_FINGERS, THUMB_OUT),
    '4': (FOUR_FINGERS, THUMB_ACROSS),
}

# Preshape before the grasp, then the grasps of the smallest and of the largest object.
PRESHAPED_FINGERS = ((8, 14, 16), (1, 14, 16), (6, 15, 16), (9, 16, 16))
POWER_FINGERS = (((0, 74, 84), (0, 76, 86), (-1, 77, 86), (-2, 78, 84)),
         ((5, 36, 46), (0, 38, 48), (3, 40, 48), (6, 42, 48)))
PRECISION_FINGERS = (((1, 48, 50), (0, 52, 50), (-2, 46, 52), (-3, 44, 50)),
             ((3, 26, 32), (0, 28, 32), (0, 30, 36), (0, 32, 38)))
LATERAL_FINGERS = (((-2, 56, 72), (0, 64, 78), (-1, 68, 80), (-3, 70, 80)),
           ((-1, 44, 60), (0, 54, 68), (-1, 58, 72), (-3, 60, 72)))
GRASPS = {
    'power': ((PRESHAPED_FINGERS, THUMB_OPPOSED), POWER_FINGERS, (THUMB_OVER, (28, -2, 0, 8))),
    'precision': ((OPPOSING_FINGERS, THUMB_OPPOSED), PRECISION_FINGERS,
                  ((26, 12, 0, 14), (28, 0, 0, 8))),
    'lateral': ((RELAXED_HAND, THUMB_OUT), LATERAL_FINGERS, (THUMB_KEY, (-4, 2, 0, 10))),
}
REST_SHAPE = (RELAXED_HAND, THUMB_RELAXED)


def shape_angles(shape: Shape, hand: Hand) -> np.ndarray:
    """Return the joint angles of a hand shape.

    Parameters
    ----------
    shape : (fingers, thumb)
        As in `LETTER_SHAPES`, shapes (4, 3) and (4,) [degrees].
    hand : Hand

    Returns
    -------
    ndarray, shape (25,)
        Within the hand's limits and Table 1; DIP and thumb IP follow from the coupling [rad].
    """
    fingers, thumb = shape
    lower, upper = limits_of(hand)
    free = np.radians(np.concatenate((np.ravel(fingers), thumb)).astype(float))
    return without_overlaps(
        hand, np.clip(free, lower[FREE_JOINTS], upper[FREE_JOINTS]), lower, upper)


def grasp_shape(kind: str, size: float) -> Shape:
    """Return the hand shape of a grasp, interpolated by the size of the object.

    Parameters
    ----------
    kind : {'power', 'precision', 'lateral'}
    size : float
        Of the object, 0 (smallest) to 1 (largest) [1].

    Returns
    -------
    (fingers, thumb)
        Shapes (4, 3) and (4,) [degrees].
    """
    _, fingers, thumb = GRASPS[kind]
    (small, large), (thumb_small, thumb_large) = fingers, thumb
    return ((1. - size) * np.array(small) + size * np.array(large),
            (1. - size) * np.array(thumb_small) + size * np.array(thumb_large))
