"""The movements that a calibration asks for, as hand shapes to move through.

Angles and times are those of a person who follows without haste; ours, unsourced.
"""

from collections.abc import Iterator

import numpy as np

from ..core.model.hand import FINGERS, JOINTS, Hand
from .gestures import shape_angles
from .motion import Keyframe
from .poses import (
    NAMED_POSES,
    STRAIGHT_FINGERS,
    THUMB_OUT,
    pose_angles,
)

APART_FINGERS = ((14, 0, 3), (2, 0, 3), (11, 0, 3), (14, 0, 3))
TOGETHER_FINGERS = ((-2, 3, 5), (0, 3, 5), (-1, 3, 5), (-2, 4, 5))
# [degrees] of the MCP and PIP of a finger that moves alone, and of its neighbours with it.
KNUCKLE_BEND, MIDDLE_BEND = (58, 12), (8, 80)
NEIGHBOUR_SHARE = .3
# The thumb's circle [degrees]: centre and radii of CMC abduction and flexion, bend of the MCP.
CIRCLE_CENTRE, CIRCLE_RADII, CIRCLE_BEND = (2., -2.), (22., 16.), 8.
CIRCLES, CIRCLE_CORNERS = 3, 8
MOVE, HOLD = .5, .3          # [s] of a movement, and of the rest after it
CORNER_MOVE = .16            # [s] from corner to corner of a circle


def range_of_motion(hand: Hand) -> Iterator[Keyframe]:
    """Yield the keyframes of one range of motion, about half a minute.

    Parameters
    ----------
    hand : Hand

    Yields
    ------
    Keyframe
    """
    straight, thumb_beside = NAMED_POSES['open']
    yield _keyframe((straight, thumb_beside), hand)
    yield Keyframe(pose_angles('fist', hand), MOVE, HOLD)
    for fingers in (STRAIGHT_FINGERS, APART_FINGERS, TOGETHER_FINGERS, STRAIGHT_FINGERS):
        yield _keyframe((fingers, THUMB_OUT), hand)
    for finger in range(len(FINGERS)):
        for bend in (KNUCKLE_BEND, MIDDLE_BEND):
            yield _keyframe((_alone(finger, bend), THUMB_OUT), hand)
            yield _keyframe((STRAIGHT_FINGERS, THUMB_OUT), hand)
    for name in FINGERS:
        yield Keyframe(pose_angles('ready', hand), MOVE, 0.)
        yield Keyframe(pose_angles(f'oppose_{name}', hand), MOVE, HOLD)
    yield from _thumb_circles(hand)
    yield _keyframe((straight, thumb_beside), hand)


def _keyframe(shape: tuple, hand: Hand) -> Keyframe:
    return Keyframe(shape_angles(shape, hand), MOVE, HOLD)


def _alone(finger: int, bend: tuple[float, float]) -> np.ndarray:
    """Return the angles of straight fingers of which one bends, shape (4, 3) [degrees]."""
    angles = np.array(STRAIGHT_FINGERS, dtype=float)
    angles[finger, 1:] = bend
    for neighbour in {finger - 1, finger + 1} & set(range(len(FINGERS))):
        angles[neighbour, 1:] += NEIGHBOUR_SHARE * np.array(bend)
    return angles


def _thumb_circles(hand: Hand) -> Iterator[Keyframe]:
    """Yield keyframes of a thumb that circles beside an open hand."""
    resting = shape_angles((STRAIGHT_FINGERS, THUMB_OUT), hand)
    joints = [JOINTS.index(f'thumb_cmc_{kind}') for kind in ('abduction', 'flexion')]
    bent = [JOINTS.index(f'thumb_{joint}_flexion') for joint in ('mcp', 'ip')]
    for corner in range(CIRCLES * CIRCLE_CORNERS):
        turn = 2. * np.pi * corner / CIRCLE_CORNERS
        angles = resting.copy()
        angles[joints] = np.radians(
            CIRCLE_CENTRE + np.array(CIRCLE_RADII) * (np.cos(turn), np.sin(turn)))
        angles[bent] = np.radians(CIRCLE_BEND)
        yield Keyframe(np.clip(angles, *hand.limits.T), MOVE if not corner else CORNER_MOVE, 0.)
