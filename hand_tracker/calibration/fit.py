"""Fit a hand: medians of bones and joints, then fingers, thumb and radii."""

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InvalidHand
from ..core.model.hand import (
    FINGERS,
    LEFT_HAND_MIRROR,
    MCP_OF_LENGTH,
    OTHER_SIDE,
    SIDES,
    WEARER_LIMITS,
    Hand,
    cmc_joints,
    preset_limits,
)
from ..core.model.marker_layout import PALM_LANDMARKS
from .fingers import fit_fingers
from .fitted_hand import measured_range
from .hand_faults import KNUCKLE_DISTANCE, bend_to_back, unit_of
from .landmarks import (
    FINGER_ROWS,
    INDEX_MCP,
    LANDMARKS,
    LITTLE_MCP,
    MIDDLE_MCP,
    THUMB_ROWS,
    landmark_angles,
)
from .palm_frame import median_lengths, palm_areas, palm_coordinates
from .palm_synergy import fit_palm_synergy
from .radii import fit_radii
from .thumb import fit_thumb

MIN_CALIBRATION_FRAMES = 10
MIN_PALM_AREA = 1e-4  # [m²]
TIP_RANGE, TIP_MARGIN = .03, .015  # [m] of tips over the palm that show the side, and above it


def fit_hand(joints: ArrayLike, side: str, limits: str | ArrayLike = WEARER_LIMITS) -> Hand:
    """Fit a hand to recorded joint positions.

    Parameters
    ----------
    joints : array_like, shape (T, 21, 3)
        In the order of `LANDMARKS`, NaN where not recorded [m].
    side : {'right', 'left'}
        Of the recorded hand.
    limits : str or array_like, shape (25, 2), optional
        Joint limits of the hand, a preset or of each joint; by default Table 1, widened to what
        the recording shows [rad].

    Returns
    -------
    Hand
        Of `side`, with palm, bones, axes and coupling of all digits, range of motion and radii of
        the capsules fitted. `hand.replace(coupling=preset_coupling())` restores the usual coupling.

    Raises
    ------
    InvalidHand
        If the side is unknown or another, the shape is wrong, too few frames are complete, or
        they are not in metres.
    """
    if side not in SIDES:
        raise InvalidHand(f'side: {side!r} is not one of {", ".join(SIDES)}')
    joints = np.array(joints, dtype=float)
    if joints.ndim != 3 or joints.shape[1:] != (len(LANDMARKS), 3):
        raise InvalidHand(
            f'joints: their shape is {joints.shape}; expected (T, {len(LANDMARKS)}, 3)')
    complete = joints[np.isfinite(joints).all(axis=(1, 2))]
    complete = complete[palm_areas(complete) > MIN_PALM_AREA]
    if len(complete) < MIN_CALIBRATION_FRAMES:
        raise InvalidHand(
            f'joints: {len(complete)} of {len(joints)} frames are complete, with wrist, index '
            f'and little MCP in a triangle; at least {MIN_CALIBRATION_FRAMES} are needed')
    if side == 'left':
        complete = complete * LEFT_HAND_MIRROR

    local = palm_coordinates(complete)
    palm = np.median(local, axis=0)
    breadth = float(np.linalg.norm(palm[INDEX_MCP] - palm[LITTLE_MCP]))
    _check_hand(local, palm, breadth, side)
    mcp = palm[FINGER_ROWS[:, 0]]
    length = float(np.linalg.norm(palm[MIDDLE_MCP])) / MCP_OF_LENGTH[FINGERS.index('middle')]
    fingers = local[:, FINGER_ROWS]
    thumb = local[:, THUMB_ROWS]
    scaled = Hand.scaled(length, breadth)
    hand = scaled.replace(
        finger_mcp=mcp,
        finger_cmc=cmc_joints(mcp, length),
        finger_bones=median_lengths(fingers),
        thumb_cmc=palm[THUMB_ROWS[0]], thumb_bones=median_lengths(thumb), side=side)
    # The thumb is solved within its limits: they are known before, and better after.
    hand = fit_thumb(_limited(fit_fingers(hand, fingers), local, limits), thumb)
    hand = hand.replace(palm_synergy=fit_palm_synergy(
        hand, {name: local[:, LANDMARKS.index(name)] for name in LANDMARKS
               if name in PALM_LANDMARKS}, landmark_angles(hand, local)))
    return fit_radii(_limited(hand, local, limits), local)


def _check_hand(local: np.ndarray, palm: np.ndarray, distance: float, side: str) -> None:
    """Refuse landmarks (T, 21, 3), of the median palm (21, 3), of another unit or side.

    `distance` is that of the knuckles of index and little finger [m].
    """
    unit = unit_of(distance)
    if unit != 'metres':
        raise InvalidHand(f'joints: index_mcp and little_mcp are {distance:.3g} apart'
                          + (f': {unit}, it seems; expected metres' if unit else ' m; expected '
                             f'{KNUCKLE_DISTANCE[0]:g} to {KNUCKLE_DISTANCE[1]:g} m, and the '
                             'joints in the order of LANDMARKS'))
    if bend_to_back(local[:, FINGER_ROWS[:, -1], 2], palm[FINGER_ROWS[:, 0], 2], TIP_RANGE,
                    TIP_MARGIN):
        raise InvalidHand(f'joints: the fingers bend to the back of a {side} hand; this is '
                          f'a {OTHER_SIDE[side]} one, or an axis is mirrored')


def _limited(hand: Hand, local: np.ndarray, limits: str | ArrayLike) -> Hand:
    """Return `hand` with the range of motion of landmarks (T, 21, 3), and with its limits."""
    shown = measured_range(landmark_angles(hand, local))
    return hand.replace(
        range_of_motion=shown,
        limits=preset_limits(limits, shown) if isinstance(limits, str) else limits)
