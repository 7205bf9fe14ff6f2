"""Convert fitted digits to `Hand` and `MarkerLayout` of the tracker."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..core.model.hand import (
    ABDUCTION_JOINTS,
    ANGLE_RANGE,
    COUPLING_OFFSET_RANGE,
    COUPLING_SPREAD_RANGE,
    DIGITS,
    FINGERS,
    FLEXION_JOINTS,
    JOINTS,
    LEFT_HAND_MIRROR,
    LINKS,
    MCP_OF_LENGTH,
    SLOPE_RANGE,
    SPLAY_RANGE,
    THUMB_MCP_ABDUCTION_RANGE,
    WEARER_LIMITS,
    Hand,
    cmc_joints,
    preset_limits,
)
from ..core.model.kinematics import (
    ABDUCTION_SIGN,
    digit_base,
    direction_in_base,
    forward,
    joint_table,
)
from ..core.model.marker_layout import (
    MARKERS,
    PALM_LANDMARKS,
    PAPER_PLACES,
    MarkerLayout,
    Mounting,
    landmark_on_link,
    marker_positions,
)
from .digit_chain import (
    ASIDE,
    BONE_PART,
    COUPLING_PART,
    LEAN_PART,
    ROOT_PART,
    Chain,
    leaning,
    offsets_of,
    shares_of,
)

SHOWN_PERCENTILES = (.5, 99.5)         # of a take's angles, the ends of the shown range
SHOWN_MARGIN = np.radians(3.)          # beyond them
STRAIGHT_FLEXION = np.radians(45.)     # below which a finger shows its splay


class FittedDigit(NamedTuple):
    """A digit's chain, shape and markers.

    Attributes
    ----------
    chain : Chain
    shape : ndarray, shape (p,)
    names : tuple of str
        Of its markers.
    postures : ndarray, shape (n, 4 or 5)
        In the take, as angles of the chain [rad].
    """

    chain: Chain
    shape: np.ndarray
    names: tuple[str, ...]
    postures: np.ndarray


class MarkerMount(NamedTuple):
    """Place of a marker on a right hand.

    Attributes
    ----------
    link : int
        Row of `LINKS`; -1 is the wrist.
    end : ndarray, shape (3,)
        End of the link's bone, in the link's frame [m].
    offset : ndarray, shape (3,)
        Marker from there [m].
    share : float
        Of the flexion of the joint at that end by which the offset turns [1].
    """

    link: int
    end: np.ndarray
    offset: np.ndarray
    share: float


def fitted_hand(scaled: Hand, digits: Sequence[FittedDigit | None], side: str,
                limits: str) -> tuple[Hand, np.ndarray]:
    """Return the hand of fitted digits.

    Parameters
    ----------
    scaled : Hand
        The mean hand in the person's size: source of all parameters without an estimate.
    digits : sequence of FittedDigit or None
        Index finger to thumb.
    side : {'right', 'left'}
    limits : str
        One of `LIMIT_PRESETS`; 'wearer' is widened to the postures.

    Returns
    -------
    hand : Hand
    angles : ndarray, shape (n, 25)
        Postures of the take, the digits' as long as they go, else 0 [rad].
    """
    fields: dict[str, Any] = {name: np.array(getattr(scaled, name)) for name in (
        'finger_mcp', 'finger_bones', 'finger_abduction_axes', 'splay', 'coupling',
        'coupling_spread')}
    for row, digit in enumerate(digits):
        if digit is None:
            continue
        shape = digit.shape
        slope, offset = shape[COUPLING_PART]
        fields['coupling'][row] = (
            np.clip(slope, *SLOPE_RANGE), np.clip(offset, *COUPLING_OFFSET_RANGE))
        if (digit.chain.links == 2).any() and (digit.chain.links < 2).any():
            # Only markers before and behind the last joint show how it leaves its coupling.
            off = digit.postures[:, 3] - slope * digit.postures[:, 2] - offset
            fields['coupling_spread'][row] = np.clip(
                np.sqrt(np.mean(off ** 2)) if len(off) else 0., *COUPLING_SPREAD_RANGE)
        axis = leaning(digit.chain, shape[LEAN_PART]).base[:, 2]
        if DIGITS[row] in FINGERS:
            fields['finger_mcp'][row] = shape[ROOT_PART]
            fields['finger_bones'][row] = shape[BONE_PART]
            fields['finger_abduction_axes'][row] = axis
            fields['splay'][row] = _splay(digit, axis, preset_limits(limits)[ABDUCTION_JOINTS[row]]
                                          * ABDUCTION_SIGN[row])
        else:
            fields.update(
                thumb_cmc=shape[ROOT_PART], thumb_bones=shape[BONE_PART], thumb_abduction_axis=axis,
                thumb_rest_direction=_rest_direction(
                    digit, scaled.thumb_rest_direction,
                    None if limits == WEARER_LIMITS else preset_limits(limits)))
            if digit.postures[:, ASIDE:].size:
                fields['thumb_mcp_abduction'] = np.clip(
                    np.median(digit.postures[:, ASIDE]), *THUMB_MCP_ABDUCTION_RANGE)
    mcp, middle = fields['finger_mcp'], FINGERS.index('middle')
    fields['finger_cmc'] = cmc_joints(mcp, mcp[middle, 0] / MCP_OF_LENGTH[middle])
    hand = scaled.replace(side='right', **fields)
    angles = _hand_angles(hand, digits)
    shown = measured_range(angles)
    return hand.replace(side=side, range_of_motion=shown,
                        limits=preset_limits(limits, shown)), angles


def _hand_angles(hand: Hand, digits: Sequence[FittedDigit | None]) -> np.ndarray:
    """Return the postures of fitted digits as the hand's angles, shape (n, 25) [rad]."""
    frames = max((len(digit.postures) for digit in digits if digit is not None), default=0)
    angles = np.zeros((frames, len(JOINTS)))
    for row, digit in enumerate(digits):
        if digit is None or not len(digit.postures):
            continue
        old, old_tilt = leaning(digit.chain, digit.shape[LEAN_PART])
        new, _, tilt = digit_base(hand, row)
        ahead = old.T @ new[:, 0]
        turn = np.arctan2(ahead[1], ahead[0])
        rows = slice(0, len(digit.postures))
        angles[rows, ABDUCTION_JOINTS[row]] = ABDUCTION_SIGN[row] * (digit.postures[:, 0] - turn)
        angles[rows, FLEXION_JOINTS[row, 0]] = (
            digit.postures[:, 1] + old_tilt - tilt)
        angles[rows, FLEXION_JOINTS[row, 1]] = digit.postures[:, 2]
        angles[rows, FLEXION_JOINTS[row, 2]] = digit.postures[:, 3]
        if digit.postures.shape[1] > ASIDE:
            angles[rows, JOINTS.index('thumb_mcp_abduction')] = digit.postures[:, ASIDE]
    return angles


def measured_range(angles: np.ndarray) -> np.ndarray:
    """Return the range of each joint in postures, with a margin.

    Parameters
    ----------
    angles : ndarray, shape (n, 25)
        NaN where a posture does not show a joint [rad].

    Returns
    -------
    ndarray, shape (25, 2)
        As `Hand.range_of_motion`: 0 of joints that do not move [rad].
    """
    found = np.zeros((angles.shape[1], 2))
    for joint, seen in enumerate(angles.T):
        seen = seen[np.isfinite(seen)]
        lower, upper = np.percentile(seen, SHOWN_PERCENTILES) if len(seen) else (0., 0.)
        if upper > lower:
            found[joint] = lower - SHOWN_MARGIN, upper + SHOWN_MARGIN
    return np.clip(found, -ANGLE_RANGE, ANGLE_RANGE)


def mount_markers(hand: Hand, digits: Sequence[FittedDigit | None],
                  palm: dict[str, np.ndarray]) -> dict[str, MarkerMount]:
    """Return the mount of every marker on a right hand.

    Parameters
    ----------
    hand : Hand
    digits : sequence of FittedDigit or None
    palm : dict of str to ndarray, shape (3,)
        Palm markers in the wrist's frame [m].

    Returns
    -------
    dict of str to MarkerMount
    """
    mounts = {name: MarkerMount(-1, np.zeros(3), place, 0.) for name, place in palm.items()}
    for row, digit in enumerate(digits):
        if digit is None:
            continue
        ends = hand.bone_ends()[row]
        for name, link, offset, share in zip(
                digit.names, digit.chain.links, offsets_of(digit.shape), shares_of(digit.shape)):
            mounts[name] = MarkerMount(
                LINKS.index(f'{DIGITS[row]}_{_link_names(row)[link]}'),
                ends[link], offset, float(share))
    return mounts


def marker_layout(hand: Hand, worn: Sequence[str], mounts: dict[str, MarkerMount],
                  noise: dict[str, float]) -> MarkerLayout:
    """Return the layout of the worn markers; a missing one stays at the paper's place.

    Parameters
    ----------
    hand : Hand
    worn : sequence of str
        Names of the worn markers, in the order of `MARKERS`; '' where there is none.
    mounts : dict of str to MarkerMount
    noise : dict of str to float
        Standard deviation of markers from their places; 0 of others [m].

    Returns
    -------
    MarkerLayout
    """
    places, offsets = list(PAPER_PLACES), np.zeros((len(MARKERS), 3))
    for i, name in enumerate(worn):
        if not name:
            continue
        mount = mounts[name]
        if mount.link >= 0:
            places[i], offsets[i] = name, mount.offset
            continue
        landmarks = {place: landmark_on_link(hand, place)[1] for place in PALM_LANDMARKS}
        if name not in landmarks:
            name = min(landmarks, key=lambda place: float(
                np.linalg.norm(mount.offset - landmarks[place])))
        places[i], offsets[i] = name, mount.offset - landmarks[name]
    deviations = np.array([noise.get(name, 0.) for name in worn])
    return MarkerLayout(tuple(places), offsets, deviations)


def place_mounted(hand: Hand, mounts: Sequence[MarkerMount], angles: np.ndarray,
                  rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the places of markers on a hand in n poses.

    Parameters
    ----------
    hand : Hand
    mounts : sequence of MarkerMount
    angles : ndarray, shape (n, 25)
        [rad]
    rotation, position : ndarray, shape (n, 3, 3) and (n, 3)
        Wrist in the markers' frame [m].

    Returns
    -------
    ndarray, shape (n, k, 3)
        [m]
    """
    link = np.array([mount.link for mount in mounts], dtype=int)
    end = np.reshape([mount.end for mount in mounts], (-1, 3))
    offset = np.reshape([mount.offset for mount in mounts], (-1, 3))
    share = np.array([mount.share for mount in mounts])
    points = marker_positions(Mounting(link, end + offset, np.zeros(len(mounts)), offset, share),
                              forward(joint_table(hand.as_right()), angles))
    if hand.side == 'left':
        points = points * LEFT_HAND_MIRROR
    return points @ np.swapaxes(rotation, 1, 2) + position[:, None]


def _splay(digit: FittedDigit, axis: np.ndarray, limits: np.ndarray) -> float:
    """Return a finger's splay: its median abduction when straight, shifted into limits [rad].

    `limits` (2,) are of the turn about the axis, in either order [rad].
    """
    base, _ = leaning(digit.chain, digit.shape[LEAN_PART])
    turn = 0.
    if len(digit.postures):
        nearly = digit.postures[np.abs(digit.postures[:, 1]) < STRAIGHT_FLEXION]
        shown = (nearly if len(nearly) else digit.postures)[:, 0]
        turn = float(np.median(shown))
        turn += _shift_into(shown - turn, np.sort(limits))
    direction = base @ (np.cos(turn), np.sin(turn), 0.)
    # The line in which the plane of that direction and the axis intersects the palm.
    rest = direction - direction[2] / axis[2] * axis
    return float(np.clip(np.arctan2(rest[1], rest[0]), -SPLAY_RANGE, SPLAY_RANGE))


def _rest_direction(digit: FittedDigit, usual: np.ndarray,
                    limits: np.ndarray | None) -> np.ndarray:
    """Return the thumb's rest direction: the usual, unless postures leave limits, shape (3,).

    So the zero of its angles is the same place in the palm, whatever a take shows. Limits that
    are widened to the postures (None) move it never.
    """
    row = DIGITS.index('thumb')
    base, tilt = leaning(digit.chain, digit.shape[LEAN_PART])
    x, y, z = base.T @ usual
    turn, flexion = float(np.arctan2(y, x)), float(np.arctan2(-z, np.hypot(x, y)))
    if limits is not None and len(digit.postures):
        turn += _shift_into(digit.postures[:, 0] - turn, limits[ABDUCTION_JOINTS[row]])
        flexion += _shift_into(digit.postures[:, 1] + tilt - flexion,
                               limits[FLEXION_JOINTS[row, 0]])
    return base @ direction_in_base(turn, flexion)


def _shift_into(angles: np.ndarray, limits: np.ndarray) -> float:
    """Return the least shift that brings angles within limits, or centres a wider range [rad]."""
    low, high = np.percentile(angles, SHOWN_PERCENTILES)
    below, above = low - limits[0], high - limits[1]
    if above - below > 0.:
        return float(above + below) / 2.
    return float(min(below, 0.) + max(above, 0.))


def _link_names(row: int) -> tuple[str, str, str]:
    """Return the names of a digit's three links behind its root."""
    return (('metacarpal', 'proximal', 'distal') if DIGITS[row] == 'thumb'
            else ('proximal', 'middle', 'distal'))
