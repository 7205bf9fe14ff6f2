"""Plain baseline of the inverse kinematics; it shares no code with the tracker.

The hand model is made of medians. The palm is a rigid fit; each finger bends in the plane of the
palm's normal by the exact two-bone solution within wide limits, with DIP = 0.8 PIP; the thumb bends
in a plane of constant normal, its IP in proportion to its MCP.
"""

from typing import NamedTuple

import numpy as np

from ..core.numerics.vectors import unit_vectors

PLAIN_PALM = [0, 5, 17]
PLAIN_FINGERS = np.arange(5, 21).reshape(4, 4)  # MCP, PIP, DIP and tip
PLAIN_THUMB = np.arange(1, 5)                   # CMC, MCP, IP and tip
# Limits of MCP abduction and of MCP, PIP and DIP flexion [rad]: wide; ours, unsourced.
ABDUCTION_LIMITS, MCP_LIMITS, PIP_LIMITS, DIP_LIMITS = np.radians(
    ((-30, 30), (-45, 90), (-10, 115), (-10, 90)))
DIP_OF_PIP = .8
THUMB_RATIOS = np.linspace(0., 3., 61)    # tried ratios of IP to MCP flexion [1]
# Tried flexions of the thumb's MCP [rad].
THUMB_BENDS = np.radians(np.linspace(-10., 120., 521))


class PlainHand(NamedTuple):
    """Model of a right hand, medians over a recording.

    Attributes
    ----------
    template : ndarray, shape (21, 3)
        Joints in the palm's frame [m].
    bones : ndarray, shape (4, 3)
        Lengths of the fingers' phalanges [m].
    thumb_bones : ndarray, shape (3,)
        Lengths of the thumb's bones [m].
    thumb_normal : ndarray, shape (3,)
        Normal of the thumb's plane, in the palm's frame.
    thumb_ratio : float
        Ratio of IP to MCP flexion [1].
    """

    template: np.ndarray
    bones: np.ndarray
    thumb_bones: np.ndarray
    thumb_normal: np.ndarray
    thumb_ratio: float


def palm_poses(markers: np.ndarray, template: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit the palm rigidly to its markers by the Kabsch algorithm.

    Parameters
    ----------
    markers : ndarray, shape (n, 3, 3)
        Wrist, index MCP and little MCP; a frame with NaN has no pose [m].
    template : ndarray, shape (3, 3)
        The same in the palm's frame [m].

    Returns
    -------
    rotation : ndarray, shape (n, 3, 3)
        Palm frame to that of the markers.
    position : ndarray, shape (n, 3)
        [m]
    """
    rotation = np.full((len(markers), 3, 3), np.nan)
    seen = np.isfinite(markers).all(axis=(1, 2))
    center = markers.mean(axis=1)
    middle = template.mean(axis=0)
    # Least-squares rotation from the singular vectors of the correlation.
    u, _, vt = np.linalg.svd(np.swapaxes(markers - center[:, None], 1, 2)[seen]
                             @ (template - middle))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    rotation[seen] = u @ vt
    return rotation, center - rotation @ middle


def into_palm(points: np.ndarray, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Transform points (n, k, 3) into the palm's frame [m]."""
    return np.einsum('nji,nkj->nki', rotation, points - position[:, None])


def fit_plain(joints: np.ndarray) -> PlainHand:
    """Fit a plain hand to recorded joints.

    Parameters
    ----------
    joints : ndarray, shape (T, 21, 3)
        Of a right hand, all captured [m].

    Returns
    -------
    PlainHand
    """
    wrist = joints[:, 0]
    z = unit_vectors(np.cross(joints[:, 17] - wrist, joints[:, 5] - wrist))
    x = joints[:, 9] - wrist
    x = unit_vectors(x - (x * z).sum(axis=1, keepdims=True) * z)
    axes = np.stack((x, np.cross(z, x), z), axis=2)
    palm = np.median(into_palm(joints, axes, wrist)[:, PLAIN_PALM], axis=0)
    local = into_palm(joints, *palm_poses(joints[:, PLAIN_PALM], palm))
    template = np.median(local, axis=0)
    template[PLAIN_PALM] = palm
    lengths = np.median(np.linalg.norm(np.diff(local[:, PLAIN_FINGERS], axis=2), axis=3), axis=0)
    thumb = local[:, PLAIN_THUMB]
    thumb_bones = np.median(np.linalg.norm(np.diff(thumb, axis=1), axis=2), axis=0)
    bent = np.cross(thumb[:, 1] - thumb[:, 0], thumb[:, 3] - thumb[:, 0])
    normal = unit_vectors(np.median(bent, axis=0))
    turned = np.cross(thumb[:, 1:3] - thumb[:, :2], thumb[:, 2:] - thumb[:, 1:3]) @ normal
    along = (np.diff(thumb, axis=1)[:, :2] * np.diff(thumb, axis=1)[:, 1:]).sum(axis=2)
    mcp, ip = np.arctan2(turned, along).T
    ratio = THUMB_RATIOS[np.argmin([np.abs(ip - k * mcp).sum() for k in THUMB_RATIOS])]
    return PlainHand(template, lengths, thumb_bones, normal, float(ratio))


def plain_joints(hand: PlainHand, markers: np.ndarray) -> np.ndarray:
    """Solve the 21 joints of a right hand from its eight markers.

    Parameters
    ----------
    hand : PlainHand
    markers : ndarray, shape (n, 8, 3)
        In the order of `MARKERS`, all visible [m].

    Returns
    -------
    ndarray, shape (n, 21, 3)
        [m]
    """
    rotation, position = palm_poses(markers[:, :3], hand.template[PLAIN_PALM])
    local = into_palm(markers, rotation, position)
    joints = np.tile(hand.template, (len(markers), 1, 1))
    for finger, rows in enumerate(PLAIN_FINGERS):
        joints[:, rows[1:]] = _finger(
            hand.template[rows[0]], hand.bones[finger], local[:, 3 + finger])
    joints[:, PLAIN_THUMB[1:]] = _thumb(hand, local[:, 7])
    return np.einsum('nij,nkj->nki', rotation, joints) + position[:, None]


def _finger(root: np.ndarray, bones: np.ndarray, marker: np.ndarray) -> np.ndarray:
    """Return PIP, DIP and tip (n, 3, 3) of a finger from its DIP marker (n, 3)."""
    target = marker - root
    abduction = np.clip(np.arctan2(target[:, 1], target[:, 0]), *ABDUCTION_LIMITS)
    ahead = target[:, 0] * np.cos(abduction) + target[:, 1] * np.sin(abduction)
    reach = np.hypot(ahead, target[:, 2])
    bend = np.arccos(np.clip(
        (reach ** 2 - bones[0] ** 2 - bones[1] ** 2) / (2. * bones[0] * bones[1]), -1., 1.))
    pip = np.clip(bend, *PIP_LIMITS)
    mcp = np.clip(np.arctan2(-target[:, 2], ahead) - np.arctan2(
        bones[1] * np.sin(pip), bones[0] + bones[1] * np.cos(pip)), *MCP_LIMITS)
    flexion = np.cumsum((mcp, pip, np.clip(DIP_OF_PIP * pip, *DIP_LIMITS)), axis=0).T  # (n, 3)
    aim = np.stack((np.cos(abduction), np.sin(abduction), 0. * abduction), axis=1)
    steps = (np.cos(flexion)[..., None] * aim[:, None]
             - np.sin(flexion)[..., None] * np.array((0., 0., 1.))) * bones[:, None]
    return root + np.cumsum(steps, axis=1)


def _thumb(hand: PlainHand, marker: np.ndarray) -> np.ndarray:
    """Return MCP, IP and tip (n, 3, 3) of the thumb from its tip marker (n, 3)."""
    root, bones = hand.template[PLAIN_THUMB[0]], hand.thumb_bones
    target = marker - root
    # Distance of the tip from the root at every flexion; take the one nearest to the marker's.
    flexion = np.stack((0. * THUMB_BENDS, THUMB_BENDS, THUMB_BENDS * (1. + hand.thumb_ratio)))
    x, y = np.cumsum(bones[:, None] * (np.cos(flexion), np.sin(flexion)), axis=1)  # (3, bends)
    reach = np.hypot(x[2], y[2])
    best = np.argmin(np.abs(reach - np.linalg.norm(target, axis=1)[:, None]), axis=1)
    ahead = unit_vectors(target)
    left = unit_vectors(np.cross(hand.thumb_normal, ahead))
    c, s = x[2, best] / reach[best], y[2, best] / reach[best]
    along = c * x[:, best] + s * y[:, best]  # (3, n)
    across = c * y[:, best] - s * x[:, best]
    return root + np.moveaxis(along[..., None] * ahead + across[..., None] * left, 0, 1)
