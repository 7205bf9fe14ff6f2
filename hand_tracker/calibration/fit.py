"""Fit a hand: medians of bones and joints, then fingers, thumb and radii."""

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InvalidHand
from ..core.model.hand import (
    FINGERS,
    LEFT_HAND_MIRROR,
    MCP_OF_LENGTH,
    SIDES,
    Hand,
    cmc_joints,
    preset_limits,
)
from .fingers import fit_fingers
from .landmarks import FINGER_ROWS, INDEX_MCP, LANDMARKS, LITTLE_MCP, MIDDLE_MCP, THUMB_ROWS
from .palm_frame import median_lengths, palm_areas, palm_coordinates
from .radii import fit_radii
from .thumb import fit_thumb

MIN_CALIBRATION_FRAMES = 10
MIN_PALM_AREA = 1e-4  # [m²]


def fit_hand(joints: ArrayLike, side: str, limits: ArrayLike | None = None) -> Hand:
    """Return the hand that fits recorded joint positions.

    Parameters
    ----------
    joints : array_like, shape (T, 21, 3)
        In the order of `LANDMARKS`, NaN where not recorded [m].
    side : {'right', 'left'}
        Of the recorded hand.
    limits : array_like, shape (25, 2), optional
        Joint limits of the hand; the preset 'paper' when left out [rad].

    Returns
    -------
    Hand
        Of `side`, with palm, bones, axes and coupling of all digits and radii of the capsules
        fitted. `hand.replace(coupling=preset_coupling())` restores the usual coupling.

    Raises
    ------
    InvalidHand
        If the side is unknown, the shape is wrong, or too few frames are complete.
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

    limits = preset_limits() if limits is None else np.array(limits, dtype=float)
    local = palm_coordinates(complete)
    palm = np.median(local, axis=0)
    mcp = palm[FINGER_ROWS[:, 0]]
    length = float(np.linalg.norm(palm[MIDDLE_MCP])) / MCP_OF_LENGTH[FINGERS.index('middle')]
    fingers = local[:, FINGER_ROWS]
    thumb = local[:, THUMB_ROWS]
    scaled = Hand.scaled(length, float(np.linalg.norm(palm[INDEX_MCP] - palm[LITTLE_MCP])))
    hand = scaled.replace(
        finger_mcp=mcp,
        finger_cmc=cmc_joints(mcp, length),
        finger_bones=median_lengths(fingers),
        thumb_cmc=palm[THUMB_ROWS[0]], thumb_bones=median_lengths(thumb), limits=limits, side=side)
    return fit_radii(fit_thumb(fit_fingers(hand, fingers), thumb), local)
