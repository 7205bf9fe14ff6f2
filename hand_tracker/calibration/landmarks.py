"""The 21 hand landmarks, in the order of public data sets, and their forward kinematics."""

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import (
    ABDUCTION_JOINTS,
    DIGITS,
    FINGERS,
    FLEXION_JOINTS,
    JOINTS,
    LINKS,
    Hand,
)
from ..core.model.kinematics import ABDUCTION_SIGN, Pose, digit_base, tip_offsets

# The wrist, then each digit from root to tip, the thumb first.
LANDMARKS = ('wrist', 'thumb_cmc', 'thumb_mcp', 'thumb_ip', 'thumb_tip') + tuple(
    f'{finger}_{joint}' for finger in FINGERS for joint in ('mcp', 'pip', 'dip', 'tip'))
# The link of each landmark after the wrist, which is the root.
LANDMARK_LINKS = np.array([LINKS.index(link) for link in (
    'thumb_metacarpal', 'thumb_proximal', 'thumb_distal', 'thumb_distal') + tuple(
        f'{finger}_{link}' for finger in FINGERS
        for link in ('proximal', 'middle', 'distal', 'distal'))])
TIP_ROWS = np.array([LANDMARKS.index(f'{digit}_tip') for digit in FINGERS + ('thumb',)])

FINGER_ROWS = np.array([[LANDMARKS.index(f'{finger}_{joint}') for joint in (
    'mcp', 'pip', 'dip', 'tip')] for finger in FINGERS])
THUMB_ROWS = np.array([LANDMARKS.index(f'thumb_{joint}') for joint in ('cmc', 'mcp', 'ip', 'tip')])
WRIST, INDEX_MCP, MIDDLE_MCP, LITTLE_MCP = (LANDMARKS.index(name) for name in (
    'wrist', 'index_mcp', 'middle_mcp', 'little_mcp'))
PLANE_ROUNDS = 6  # of a digit of which a bone leaves its plane
STRONG_FLEXION = np.radians(60.)  # above which a bone hardly shows its abduction


def landmark_positions(hand: Hand, pose: Pose,
                       wrist_position: ArrayLike = (0., 0., 0.)) -> np.ndarray:
    """Return the positions of the 21 landmarks in a pose.

    Parameters
    ----------
    hand : Hand
    pose : Pose
        With or without a leading dimension n.
    wrist_position : array_like, shape (..., 3), optional
        As given to `forward` [m].

    Returns
    -------
    ndarray, shape (..., 21, 3)
        In the order of `LANDMARKS` [m].
    """
    points = pose.position[..., LANDMARK_LINKS, :]
    distal = pose.rotation[..., LANDMARK_LINKS[TIP_ROWS - 1], :, :]
    points[..., TIP_ROWS - 1, :] += np.einsum('...ij,...j->...i', distal, tip_offsets(hand))
    wrist = np.broadcast_to(wrist_position, points.shape[:-2] + (3,))
    return np.concatenate((wrist[..., None, :], points), axis=-2)


def digit_angles(hand: Hand, digit: int, joints: np.ndarray) -> np.ndarray:
    """Return the angles of a digit in recorded postures.

    A finger's flexions are measured in the plane that contains the abduction axis and fits all
    bones between the joints best, so that a single bone along the axis does not turn it; the
    thumb's plane is that of its metacarpal.

    Parameters
    ----------
    hand : Hand
        Whose joints' axes are used.
    digit : int
        0 to 4, index finger to thumb.
    joints : ndarray, shape (T, 4, 3)
        From the digit's root to its tip, on a right hand, in the wrist's frame [m].

    Returns
    -------
    ndarray, shape (T, 4)
        Abduction, then the three flexions [rad].
    """
    base, _, tilt = digit_base(hand, digit)
    if DIGITS[digit] == 'thumb':
        return _thumb_angles(hand, np.diff(joints, axis=1) @ base, tilt)
    x, y, z = np.moveaxis(np.diff(joints, axis=1) @ base, -1, 0)
    level = x + 1j * y
    aside = 1j * hand.bone_ends()[digit, :, 1]
    turn = np.zeros((len(joints), 1))
    for _ in range(PLANE_ROUNDS if aside.any() else 1):
        # Squared, as opposite directions lie in the same plane.
        turn = np.angle(((level - aside * np.exp(1j * turn)) ** 2).sum(
            axis=1, keepdims=True)) / 2.
    bent = np.arctan2(-z, (level * np.exp(-1j * turn)).real)
    flexions = np.diff(bent, axis=1, prepend=tilt)
    return np.column_stack((ABDUCTION_SIGN[digit] * turn,
                            (flexions + np.pi) % (2. * np.pi) - np.pi))


def _thumb_angles(hand: Hand, bones: np.ndarray, tilt: float) -> np.ndarray:
    """Return abduction and flexions (T, 4) of a thumb [rad].

    The metacarpal tells abduction and its own flexion, the phalanges their flexions about it.
    `bones` (T, 3, 3) are in its base, at whose zero the metacarpal is flexed by `tilt`.
    """
    x, y, z = bones[:, 0].T
    turn, flexion = np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))
    phalanges = np.einsum('ijt,tkj->tki', metacarpal_axes(turn, flexion), bones[:, 1:])
    straight, bent = (phalanges @ phalanx_axes(hand.thumb_mcp_abduction, hand.thumb_roll)).T
    mcp, both = np.unwrap(np.arctan2(bent, straight), axis=0)
    return np.column_stack((turn, flexion - tilt, mcp, both - mcp))


def metacarpal_axes(turn: np.ndarray, flexion: np.ndarray) -> np.ndarray:
    """Return where thumbs' metacarpals point in the base, across and to the palm, (3, 3, n).

    Abducted and flexed by angles of shape (n,) from the x axis of the base [rad].
    """
    c, s, cf, sf = np.cos(turn), np.sin(turn), np.cos(flexion), np.sin(flexion)
    return np.array(((c * cf, s * cf, -sf), (-s, c, 0. * s), (-c * sf, -s * sf, -cf)))


def phalanx_axes(aside: float, roll: float) -> np.ndarray:
    """Return straight and bent phalanges on a thumb's metacarpal: forward, aside, down, (3, 2).

    By the thumb's MCP abduction and its roll [rad].
    """
    ca, sa, cr, sr = np.cos(aside), np.sin(aside), np.cos(roll), np.sin(roll)
    return np.array(((ca, 0.), (cr * sa, sr), (-sr * sa, cr)))


def landmark_angles(hand: Hand, local: np.ndarray) -> np.ndarray:
    """Return the joint angles of recorded landmarks.

    Parameters
    ----------
    hand : Hand
        Whose joints' axes are used.
    local : ndarray, shape (T, 21, 3)
        Landmarks of a right hand in the wrist's frame, in the order of `LANDMARKS` [m].

    Returns
    -------
    ndarray, shape (T, 25)
        0 of joints that landmarks do not show; NaN of an abduction that the digit's first bone,
        strongly bent, does not show [rad].
    """
    angles = np.zeros((len(local), len(JOINTS)))
    for digit, rows in enumerate((*FINGER_ROWS, THUMB_ROWS)):
        found = digit_angles(hand, digit, local[:, rows])
        if DIGITS[digit] in FINGERS:
            found[np.abs(found[:, 1]) > STRONG_FLEXION, 0] = np.nan
        angles[:, ABDUCTION_JOINTS[digit]] = found[:, 0]
        angles[:, FLEXION_JOINTS[digit]] = found[:, 1:]
    return angles
