"""Visibility of markers in cameras, and their triangulation with pixel noise.

Markers are LEDs on the skin. A camera sees a marker within its field of view if the line of sight
intersects none of the hand's capsules, that of the marker's own finger included: the LED's centre
is a marker radius off the skin, so that its own finger occludes it only from behind.

The paper's layout has the markers at the joints. With markers on the skin a tracker given that
layout errs by some 10 degrees a joint, one given the true offsets (`MarkerLayout`) by some 2.
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS, JOINTS, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..core.model.skeleton import SKELETON_BONES, bone_radii, skeleton_points
from .cameras import CameraRig, camera_coordinates

LED_RADIUS = .004            # [m] distance of a marker's centre from the skin
ROUNDING = 1e-9         # [m] a marker on the surface is outside on every machine
RAISE, MOST_RAISES = .0005, 80  # [m] at once of a marker inside the hand, and how often
LEAST_RADIUS_SHARE = .4  # of a capsule that a marker's place on a calibrated hand may make thinner
TRIANGULATING_CAMERAS = 2    # least number that see a marker
FRAMES_AT_ONCE = 250         # block of frames that fits into the processor's cache


class MarkerObservation(NamedTuple):
    """Triangulated markers of n frames, m markers and c cameras.

    Attributes
    ----------
    positions : ndarray, shape (n, m, 3)
        Measured; NaN where fewer than two cameras see the marker [m].
    seen : ndarray of bool, shape (n, m, c)
        Whether each camera sees each marker.
    covariance : ndarray, shape (n, m, 3, 3)
        Of the measured positions; NaN where not measured [m^2].
    truth : ndarray, shape (n, m, 3)
        True positions [m].
    """

    positions: np.ndarray
    seen: np.ndarray
    covariance: np.ndarray
    truth: np.ndarray


def skin_layout(hand: Hand) -> MarkerLayout:
    """Return the paper's marker layout with offsets onto the dorsal skin.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    MarkerLayout
    """
    # Capsule at the marker: middle phalanx at a finger's DIP, distal phalanx at the thumb's tip.
    radii = [hand.palm_radius] * 3 + [*hand.radii[:4, 1], hand.radii[DIGITS.index('thumb'), 2]]
    offsets = np.zeros((len(radii), 3))
    offsets[:, 2] = np.array(radii) + LED_RADIUS
    return MarkerLayout(offsets=offsets)


def raised_to_skin(hand: Hand, layout: MarkerLayout) -> MarkerLayout:
    """Return a layout whose markers inside the hand are raised to the dorsal skin.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout

    Returns
    -------
    MarkerLayout
        With other offsets along z.
    """
    offsets = layout.offsets.copy()
    raised = np.zeros(len(offsets), dtype=bool)
    for _ in range(MOST_RAISES):
        layout = layout.with_offsets(offsets)
        inside = markers_inside(hand, layout)
        if not inside.any():
            break
        raised |= inside
        offsets[inside, 2] += RAISE
    offsets[raised, 2] += LED_RADIUS
    return layout.with_offsets(offsets)


def observe(rig: CameraRig, hand: Hand, layout: MarkerLayout, angles: np.ndarray,
            rotation: np.ndarray, position: np.ndarray, noise: np.ndarray) -> MarkerObservation:
    """Return the markers of a moving hand as a camera rig measures them.

    Parameters
    ----------
    rig : CameraRig
    hand : Hand
    layout : MarkerLayout
        True marker layout.
    angles : ndarray, shape (n, 25)
        Joint angles [rad].
    rotation : ndarray, shape (n, 3, 3)
        Wrist frame to world.
    position : ndarray, shape (n, 3)
        Of the wrist [m].
    noise : ndarray, shape (n, m, c, 2)
        Standard normal draws for both image coordinates.

    Returns
    -------
    MarkerObservation
    """
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(layout.mounting(hand), pose, rotation, position)
    points = skeleton_points(tip_offsets(hand), pose, position)
    # Calibrated markers are where they are seen: a capsule around one is thinner than that.
    radii = np.minimum(bone_radii(hand), _distances(hand, layout) - ROUNDING)
    seen = has_line_of_sight(rig, markers, points, radii) & in_view(rig, markers)
    return triangulate(rig, markers, seen, noise)


def markers_inside(hand: Hand, layout: MarkerLayout, share: float = 1.) -> np.ndarray:
    """Return the mask of markers inside the capsules of the resting hand, seen by no camera.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    share : float, optional
        Of the capsules' radii, within which a marker is inside.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    inside = _distances(hand, layout) < share * bone_radii(hand) - ROUNDING
    return np.any(inside, axis=1)


def _distances(hand: Hand, layout: MarkerLayout) -> np.ndarray:
    """Return how far the markers are from the bones of the resting hand, shape (n, b) [m]."""
    pose = forward(joint_table(hand), np.zeros(len(JOINTS)))
    markers = marker_positions(layout.mounting(hand), pose)
    start, end = skeleton_points(tip_offsets(hand), pose, np.zeros(3))[np.array(SKELETON_BONES).T]
    bone, offset = end - start, markers[:, None] - start
    along = np.clip((offset * bone).sum(axis=-1) / np.maximum(
        (bone ** 2).sum(axis=-1), 1e-12), 0., 1.)
    return np.linalg.norm(offset - along[..., None] * bone, axis=-1)


def in_view(rig: CameraRig, markers: np.ndarray) -> np.ndarray:
    """Return whether markers (n, m, 3) [m] are in each camera's field of view, (n, m, c) bool."""
    x, y, z = camera_coordinates(rig, markers)
    edge = np.tan(.5 * rig.field_of_view) * z
    return (z > 0.) & (np.abs(x) <= edge) & (np.abs(y) <= edge)


def has_line_of_sight(rig: CameraRig, markers: np.ndarray, points: np.ndarray,
                      radii: np.ndarray) -> np.ndarray:
    """Return whether the line from camera to marker intersects none of the hand's capsules.

    Parameters
    ----------
    rig : CameraRig
    markers : ndarray, shape (n, m, 3)
        [m]
    points : ndarray, shape (n, 31, 3)
        From `skeleton_points` [m].
    radii : ndarray, shape (b,) or (m, b)
        Of the capsules around `SKELETON_BONES`, for all markers or for each [m].

    Returns
    -------
    ndarray of bool, shape (n, m, c)
    """
    clear = np.empty((*markers.shape[:2], len(rig.positions)), dtype=bool)
    bones = np.array(SKELETON_BONES)
    for first in range(0, len(markers), FRAMES_AT_ONCE):
        part = slice(first, first + FRAMES_AT_ONCE)
        ends = points[part][:, bones]  # (n, b, 2, 3)
        clear[part] = _clear(rig.positions, markers[part], ends[:, :, 0], ends[:, :, 1], radii)
    return clear


def _clear(cameras: np.ndarray, markers: np.ndarray, starts: np.ndarray, ends: np.ndarray,
           radii: np.ndarray) -> np.ndarray:
    """Return whether segments from marker to camera miss all capsules, shape (n, m, c).

    Closest points of two segments, Ericson, Real-Time Collision Detection (2005), 5.1.9: at s
    along the line of sight from the marker [m] and t along the bone [1].
    """
    way = cameras - markers[:, :, None]                          # (n, m, c, 3)
    length = np.linalg.norm(way, axis=-1)[..., None]             # (n, m, c, 1)
    way = way / length
    bone = ends - starts                                         # (n, b, 3)
    size = np.maximum((bone ** 2).sum(axis=-1), 1e-12)[:, None, None]   # (n, 1, 1, b)
    apart = markers[:, :, None] - starts[:, None]                # (n, m, b, 3)
    f = np.einsum('nbi,nmbi->nmb', bone, apart)[:, :, None]      # (n, m, 1, b)
    b = np.einsum('nmci,nbi->nmcb', way, bone, optimize=True)
    c = np.matmul(way, apart.swapaxes(-1, -2))                   # (n, m, c, b)
    denominator = size - b * b
    s = np.clip((b * f - c * size) / np.maximum(denominator, 1e-12 * size), 0., length)
    t = np.clip((b * s + f) / size, 0., 1.)
    s = np.clip(b * t - c, 0., length)
    squared = (apart ** 2).sum(axis=-1)[:, :, None]
    gap = squared + s * (s + 2. * (c - t * b)) + t * (t * size - 2. * f)
    return (gap >= radii[..., None, :] ** 2).all(axis=-1)


def triangulate(rig: CameraRig, markers: np.ndarray, seen: np.ndarray,
                noise: np.ndarray) -> MarkerObservation:
    """Triangulate markers by linearised least squares over noisy image coordinates.

    A camera at distance z measures the two coordinates across its view with a standard deviation
    of pixel_noise z / focal, and nothing along it. To first order the Fisher information of the
    cameras that see a marker adds up; its inverse is the covariance.

    Parameters
    ----------
    rig : CameraRig
    markers : ndarray, shape (n, m, 3)
        True positions [m].
    seen : ndarray of bool, shape (n, m, c)
        Whether each camera sees each marker.
    noise : ndarray, shape (n, m, c, 2)
        Standard normal draws for both image coordinates.

    Returns
    -------
    MarkerObservation
    """
    x, y, z = camera_coordinates(rig, markers)
    # Image Jacobian over the noise [1/m], rows d(x / z) and d(y / z).
    scale = rig.focal / max(rig.pixel_noise, 1e-9) / z
    right, down, ahead = rig.rotations.swapaxes(0, 1)            # (c, 3) each
    rows = np.stack((scale[..., None] * (right - (x / z)[..., None] * ahead),
                     scale[..., None] * (down - (y / z)[..., None] * ahead)), axis=-2)
    rows = np.where(seen[..., None, None], rows, 0.)             # (n, m, c, 2, 3)
    flat = rows.reshape(*rows.shape[:2], -1, 3)
    information = np.matmul(flat.swapaxes(-1, -2), flat)
    placed = seen.sum(axis=-1) >= TRIANGULATING_CAMERAS
    information[~placed] = np.eye(3)
    covariance = np.linalg.inv(information)
    pull = np.matmul(flat.swapaxes(-1, -2), noise.reshape(*flat.shape[:3], 1))
    positions = markers + np.matmul(covariance, pull)[..., 0]
    positions[~placed] = np.nan
    covariance[~placed] = np.nan
    return MarkerObservation(positions, seen, covariance, markers)
