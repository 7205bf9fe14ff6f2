"""Kinematics of a digit with markers on its links, for many frames at once, with derivatives.

A digit turns about its abduction axis, which leans, and flexes at three hinges, from the
direction that it has without lean. A thumb may abduct at its second joint, too: then its angles
are five. A marker is attached to one of
its three links at an offset from that link's distal end. Skin over a joint turns with a share of
its flexion, and takes the marker along.
"""

import math
from typing import NamedTuple

import numpy as np

ANGLES = 4       # turn about the abduction axis, then the flexions of the three hinges
ASIDE = 4        # row of the second joint's abduction, where there is one
ROOT_PART = slice(0, 3)
LEAN_PART = slice(3, 5)
BONE_PART = slice(5, 8)
SECOND_BONE = 6
COUPLING_PART = slice(8, 10)
FIRST_OFFSET = 10
LEAN_STEP = 1e-5  # of the central difference of the base by the axis's lean [1]


class Chain(NamedTuple):
    """Constants of a digit's fit.

    Attributes
    ----------
    base : ndarray, shape (3, 3)
        Axes of the base without lean, as columns, in the palm's frame: x ahead, z the axis of
        abduction.
    links : ndarray of int, shape (m,)
        Link of each marker, 0 to 2.
    """

    base: np.ndarray
    links: np.ndarray

    @property
    def size(self) -> int:
        """Number of shape parameters: root 3, lean 2, bones 3, coupling 2, offsets 3 m, shares m.

        A marker's share is that of its link's distal joint in whose flexion it turns.
        """
        return FIRST_OFFSET + 4 * len(self.links)


class Placed(NamedTuple):
    """Markers of a digit in n frames, with derivatives.

    Attributes
    ----------
    points : ndarray, shape (n, m, 3)
        In the palm's frame [m].
    by_angle : ndarray, shape (n, m, 3, 4 or 5)
        [m/rad]
    by_shape : ndarray, shape (n, m, 3, p)
        By the shape parameters of `Chain`.
    """

    points: np.ndarray
    by_angle: np.ndarray
    by_shape: np.ndarray


def offsets_of(shape: np.ndarray) -> np.ndarray:
    """Return the markers' offsets of shape parameters (..., p), shape (..., m, 3) [m]."""
    markers = (shape.shape[-1] - FIRST_OFFSET) // 4
    return shape[..., FIRST_OFFSET:FIRST_OFFSET + 3 * markers].reshape(*shape.shape[:-1], -1, 3)


def shares_of(shape: np.ndarray) -> np.ndarray:
    """Return the markers' shares of shape parameters (..., p), shape (..., m) [1]."""
    return shape[..., FIRST_OFFSET + 3 * ((shape.shape[-1] - FIRST_OFFSET) // 4):]


class Swing(NamedTuple):
    """Abduction of a digit's second joint in n frames, before the turn about its first axis.

    Attributes
    ----------
    axis, pivot : ndarray, shape (n, 3)
        Dorsal axis of the first link, and the joint [1, m].
    rotation : ndarray, shape (n, 3, 3)
    """

    axis: np.ndarray
    pivot: np.ndarray
    rotation: np.ndarray


class Lean(NamedTuple):
    """Base of a digit whose axis leans.

    Attributes
    ----------
    base : ndarray, shape (3, 3)
        Axes of the base, as columns, in the palm's frame.
    tilt : float
        Flexion from its x axis to the x axis of the base without lean [rad].
    """

    base: np.ndarray
    tilt: float


def leaning(chain: Chain, lean: np.ndarray) -> Lean:
    """Return the base whose axis leans by tangents (2,) towards x and y."""
    x, y = float(lean[0]), float(lean[1])
    # In the base without lean: the axis is (x, y, 1), ahead (1, 0, 0) less its share of the axis.
    size = math.sqrt(x * x + y * y + 1.)
    a, b, c = x / size, y / size, 1. / size
    ahead = math.sqrt(1. - a * a)
    u, v, w = ahead, -a * b / ahead, -a * c / ahead
    axes = np.array(((u, b * w - c * v, a), (v, c * u - a * w, b), (w, a * v - b * u, c)))
    return Lean(chain.base @ axes, math.atan2(-a, u))


def place_markers(chain: Chain, shape: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the markers of a digit in n frames.

    Parameters
    ----------
    chain : Chain
    shape : ndarray, shape (p,)
        [m, 1, rad]
    angles : ndarray, shape (n, 4 or 5)
        [rad]

    Returns
    -------
    ndarray, shape (n, m, 3)
        In the palm's frame [m].
    """
    lean = leaning(chain, shape[LEAN_PART])
    planar = _in_plane(chain, shape, lean.tilt, angles)
    if angles.shape[1] > ASIDE:
        planar = _swung(planar, chain, _swing(shape, lean.tilt, angles))
    return shape[ROOT_PART] + _turned(planar, angles) @ lean.base.T


def place_with_derivatives(chain: Chain, shape: np.ndarray, angles: np.ndarray,
                           by_shape_too: bool = True) -> Placed:
    """Return the markers of a digit in n frames with their derivatives.

    Parameters as for `place_markers`; without `by_shape_too` there are none by the shape.

    Returns
    -------
    Placed
    """
    lean = leaning(chain, shape[LEAN_PART])
    planar = _in_plane(chain, shape, lean.tilt, angles)
    by_bend = _by_flexion(chain, shape, lean.tilt, angles)         # (n, m, 3, 3)
    swing = _swing(shape, lean.tilt, angles) if angles.shape[1] > ASIDE else None
    if swing is not None:
        planar = _swung(planar, chain, swing)
        by_bend = _by_bend_of_swung(by_bend, planar, chain, swing)  # (n, m, 4, 3)
    turned = _turned(planar, angles)
    frames, markers = len(angles), len(chain.links)
    to_palm = lean.base @ _turns(angles)                           # (n, 3, 3)
    to_frame = np.swapaxes(to_palm, 1, 2)

    by_angle = np.empty((frames, markers, angles.shape[1], 3))
    by_angle[:, :, 0] = np.stack(
        (-turned[..., 1], turned[..., 0], 0. * turned[..., 0]), axis=-1) @ lean.base.T
    by_angle[:, :, 1:] = (by_bend.reshape(frames, -1, 3) @ to_frame).reshape(
        frames, markers, -1, 3)
    by_angle = np.swapaxes(by_angle, 2, 3)
    points = shape[ROOT_PART] + turned @ lean.base.T
    if not by_shape_too:
        return Placed(points, by_angle, np.zeros((frames, markers, 3, 0)))

    by_shape = np.zeros((frames, markers, 3, chain.size))
    by_shape[..., range(3), range(3)] = 1.
    for k in range(2):
        step = LEAN_STEP * np.eye(2)[k]
        more = leaning(chain, shape[LEAN_PART] + step)
        less = leaning(chain, shape[LEAN_PART] - step)
        by_shape[..., LEAN_PART.start + k] = (
            turned @ (more.base - less.base).T + (more.tilt - less.tilt) * by_angle[..., 1]
        ) / (2. * LEAN_STEP)
    flexion = _flexions(lean.tilt, angles)
    offset_flexion = _offset_flexion(chain, shape, lean.tilt, angles)
    ahead, above = to_palm[:, :, 0], to_palm[:, :, 2]
    for i, link in enumerate(chain.links):
        for joint in range(link + 1):
            by_shape[:, i, :, BONE_PART.start + joint] = _along(flexion[:, joint], ahead, above)
        lean_of_offset = offset_flexion[:, i]
        first = FIRST_OFFSET + 3 * i
        by_shape[:, i, :, first] = _along(lean_of_offset, ahead, above)
        by_shape[:, i, :, first + 1] = to_palm[:, :, 1]
        by_shape[:, i, :, first + 2] = _along(lean_of_offset - np.pi / 2., ahead, above)
        if link < 2:
            along, _, height = offsets_of(shape)[i]
            sweep = (along * _along(lean_of_offset + np.pi / 2., ahead, above)
                     + height * _along(lean_of_offset, ahead, above))
            by_shape[:, i, :, FIRST_OFFSET + 3 * markers + i] = angles[:, link + 2, None] * sweep
    if swing is not None:
        behind = chain.links > 0
        by_shape[:, behind, :, SECOND_BONE:] = (
            to_palm @ swing.rotation @ to_frame)[:, None] @ by_shape[:, behind, :, SECOND_BONE:]
    return Placed(points, by_angle, by_shape)


def _along(flexion: np.ndarray, ahead: np.ndarray, above: np.ndarray) -> np.ndarray:
    """Return the directions of links at flexions (n,) in planes of axes (n, 3), shape (n, 3)."""
    return np.cos(flexion)[:, None] * ahead - np.sin(flexion)[:, None] * above


def _in_plane(chain: Chain, shape: np.ndarray, tilt: float, angles: np.ndarray) -> np.ndarray:
    """Return markers (n, m, 3) before the turn about the axis."""
    bones, offsets = shape[BONE_PART], offsets_of(shape)
    flexion = _flexions(tilt, angles)
    reach = np.cumsum(bones * np.cos(flexion), axis=1)
    drop = np.cumsum(bones * np.sin(flexion), axis=1)
    offset_flexion = _offset_flexion(chain, shape, tilt, angles)   # (n, m)
    c, s = np.cos(offset_flexion), np.sin(offset_flexion)
    along, aside, height = offsets.T
    return np.stack((reach[:, chain.links] + along * c + height * s,
                     np.broadcast_to(aside, c.shape),
                     -drop[:, chain.links] + height * c - along * s), axis=-1)


def _swing(shape: np.ndarray, tilt: float, angles: np.ndarray) -> Swing:
    """Return the abduction of the second joint at angles (n, 5)."""
    flexion = tilt + angles[:, 1]
    c, s, still = np.cos(flexion), np.sin(flexion), np.zeros(len(angles))
    axis = np.stack((s, still, c), axis=1)
    across = np.zeros((len(angles), 3, 3))                         # cross product with the axis
    across[:, 1, 0], across[:, 0, 1] = c, -c
    across[:, 2, 1], across[:, 1, 2] = s, -s
    aside = angles[:, ASIDE, None, None]
    rotation = np.eye(3) + np.sin(aside) * across + (1. - np.cos(aside)) * across @ across
    return Swing(axis, shape[BONE_PART.start] * np.stack((c, still, -s), axis=1), rotation)


def _swung(planar: np.ndarray, chain: Chain, swing: Swing) -> np.ndarray:
    """Return markers (n, m, 3) with those behind the second joint abducted there."""
    found, behind, pivot = planar.copy(), chain.links > 0, swing.pivot[:, None]
    found[:, behind] = pivot + (planar[:, behind] - pivot) @ np.swapaxes(swing.rotation, 1, 2)
    return found


def _by_bend_of_swung(by_flexion: np.ndarray, swung: np.ndarray, chain: Chain,
                      swing: Swing) -> np.ndarray:
    """Return derivatives of abducted markers by the flexions and the abduction, (n, m, 4, 3)."""
    found = np.zeros((*swung.shape[:2], 4, 3))
    found[:, :, :3] = by_flexion
    for i in np.flatnonzero(chain.links > 0):
        x, _, z = swung[:, i].T
        found[:, i, 0] = np.stack((z, 0. * z, -x), axis=1)
        found[:, i, 1:3] = by_flexion[:, i, 1:] @ np.swapaxes(swing.rotation, 1, 2)
        found[:, i, 3] = np.cross(swing.axis, swung[:, i] - swing.pivot)
    return found


def _by_flexion(chain: Chain, shape: np.ndarray, tilt: float, angles: np.ndarray) -> np.ndarray:
    """Return derivatives of the markers in the plane by the three flexions, (n, m, 3, 3).

    The last index is the coordinate.
    """
    bones, offsets, shares = shape[BONE_PART], offsets_of(shape), shares_of(shape)
    flexion = _flexions(tilt, angles)
    reach, drop = bones * np.cos(flexion), bones * np.sin(flexion)
    offset_flexion = _offset_flexion(chain, shape, tilt, angles)
    c, s = np.cos(offset_flexion), np.sin(offset_flexion)
    found = np.zeros((len(angles), len(chain.links), 3, 3))
    for i, link in enumerate(chain.links):
        along, _, height = offsets[i]
        # What a flexion moves: the bones from its joint on, and the offset.
        x = height * c[:, i] - along * s[:, i]
        z = -along * c[:, i] - height * s[:, i]
        if link < 2:
            found[:, i, link + 1, 0] = shares[i] * x
            found[:, i, link + 1, 2] = shares[i] * z
        for joint in range(link, -1, -1):
            x = x - drop[:, joint]
            z = z - reach[:, joint]
            found[:, i, joint, 0] = x
            found[:, i, joint, 2] = z
    return found


def _turns(angles: np.ndarray) -> np.ndarray:
    """Return the rotations about z by the first angles, shape (n, 3, 3)."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles[:, 0])
    turns[:, 1, 0] = np.sin(angles[:, 0])
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.
    return turns


def _flexions(tilt: float, angles: np.ndarray) -> np.ndarray:
    """Return the flexion of each link from the leaning base, shape (n, 3) [rad]."""
    return tilt + np.cumsum(angles[:, 1:ANGLES], axis=1)


def _offset_flexion(chain: Chain, shape: np.ndarray, tilt: float,
                    angles: np.ndarray) -> np.ndarray:
    """Return the flexion of each marker's offset, shape (n, m) [rad]."""
    flexion = _flexions(tilt, angles)[:, chain.links]
    following = np.column_stack((angles[:, 2:ANGLES], np.zeros(len(angles))))[:, chain.links]
    return flexion + shares_of(shape) * following


def _turned(planar: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return points (n, m, 3) turned about z by the first angles."""
    c, s = np.cos(angles[:, :1]), np.sin(angles[:, :1])
    x, y = planar[..., 0], planar[..., 1]
    return np.stack((c * x - s * y, s * x + c * y, planar[..., 2]), axis=-1)
