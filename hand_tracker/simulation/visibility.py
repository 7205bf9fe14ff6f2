"""What cameras see of a hand: which markers, and how well two or more cameras place them.

Markers are small lights on the skin. A camera sees one when it lies in the camera's field
of view and the straight line between them meets none of the hand's capsules, the marker's
own finger included: the centre of a marker on the skin stands its radius off the capsule,
so that its own finger hides it from behind and not from beside.

The paper puts the markers at the joints. A tracker that is told so errs by some 10 degrees a
joint with markers on the skin; told where on the skin they are, by some 2 (`MarkerLayout`).
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS, JOINTS
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..core.model.skeleton import SKELETON_BONES, bone_radii, skeleton_points
from .cameras import camera_coordinates

MARKER_RADIUS = .004  # [m]
NEEDED = 2            # cameras that place a marker
CHUNK = 250           # frames at once: what fits into the processor's cache


class Sight(NamedTuple):
    """What the cameras make of markers.

    Attributes
    ----------
    positions : ndarray, shape (n, m, 3)
        Measured; NaN where fewer than two cameras see the marker [m].
    seen : ndarray of bool, shape (n, m, c)
    covariance : ndarray, shape (n, m, 3, 3)
        Of the measured positions; NaN where there is none [m^2].
    truth : ndarray, shape (n, m, 3)
        Where the markers are [m].
    """

    positions: np.ndarray
    seen: np.ndarray
    covariance: np.ndarray
    truth: np.ndarray


def skin_layout(hand, marker_radius=MARKER_RADIUS):
    """Return the paper's markers on the skin: dorsal of their joints, by capsule and marker.

    The paper puts each marker at its joint, where the light of a real one never is.

    Parameters
    ----------
    hand : Hand
    marker_radius : float
        [m]

    Returns
    -------
    MarkerLayout
    """
    # A finger's DIP is covered by the middle phalanx, the thumb's tip by the distal one.
    radii = [hand.palm_radius] * 3 + [*hand.radii[:4, 1], hand.radii[DIGITS.index('thumb'), 2]]
    offsets = np.zeros((len(radii), 3))
    offsets[:, 2] = np.array(radii) + marker_radius
    return MarkerLayout(offsets=offsets)


def look(rig, hand, layout, angles, rotation, position, noise):
    """Return what a rig sees of a moving hand.

    Parameters
    ----------
    rig : CameraRig
    hand : Hand
    layout : MarkerLayout
        Where the markers truly are.
    angles : ndarray, shape (n, 25)
        [rad]
    rotation, position : ndarray, shape (n, 3, 3) and (n, 3)
        Of the wrist [m].
    noise : ndarray, shape (n, m, c, 2)
        Standard normal, of each picture's two coordinates.

    Returns
    -------
    Sight
    """
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(layout.mounting(hand), pose, rotation, position)
    points = skeleton_points(tip_offsets(hand), pose, position)
    seen = unobstructed(rig, markers, points, bone_radii(hand)) & in_view(rig, markers)
    return triangulate(rig, markers, seen, noise)


def markers_inside(hand, layout):
    """Return which markers lie inside the capsules of the hand at rest, where none is seen.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout

    Returns
    -------
    ndarray of bool, shape (8,)
    """
    pose = forward(joint_table(hand), np.zeros(len(JOINTS)))
    markers = marker_positions(layout.mounting(hand), pose)
    start, end = skeleton_points(tip_offsets(hand), pose, np.zeros(3))[np.array(SKELETON_BONES).T]
    bone, apart = end - start, markers[:, None] - start
    along = np.clip((apart * bone).sum(axis=-1) / np.maximum(
        (bone ** 2).sum(axis=-1), 1e-12), 0., 1.)
    gaps = np.linalg.norm(apart - along[..., None] * bone, axis=-1)
    return (gaps < bone_radii(hand)).any(axis=1)


def in_view(rig, markers):
    """Return which cameras have which markers in their picture, shape (n, m, c)."""
    x, y, z = camera_coordinates(rig, markers)
    edge = np.tan(.5 * rig.field_of_view) * z
    return (z > 0.) & (np.abs(x) <= edge) & (np.abs(y) <= edge)


def unobstructed(rig, markers, points, radii):
    """Return from which cameras the way to a marker meets no capsule.

    Parameters
    ----------
    rig : CameraRig
    markers : ndarray, shape (n, m, 3)
        [m]
    points : ndarray, shape (n, 31, 3)
        From `skeleton_points` [m].
    radii : ndarray, shape (b,)
        Of the capsules around `SKELETON_BONES` [m].

    Returns
    -------
    ndarray of bool, shape (n, m, c)
    """
    clear = np.empty((*markers.shape[:2], len(rig.positions)), dtype=bool)
    bones = np.array(SKELETON_BONES)
    for first in range(0, len(markers), CHUNK):
        part = slice(first, first + CHUNK)
        ends = points[part][:, bones]  # (n, b, 2, 3)
        clear[part] = _clear(rig.positions, markers[part], ends[:, :, 0], ends[:, :, 1], radii)
    return clear


def _clear(cameras, markers, starts, ends, radii):
    """Return which ways from marker to camera keep off all capsules, shape (n, m, c).

    The least distance of two segments after Ericson, Real-Time Collision Detection (2005),
    5.1.9: s along the way from the marker [m], t along the bone [1].
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
    return (gap >= radii ** 2).all(axis=-1)


def triangulate(rig, markers, seen, noise):
    """Return where cameras place markers, by least squares over their pictures.

    A camera at distance z tells two coordinates across its view with the standard deviation
    of pixel noise z / focal, and none along it. To first order the information of all that
    see a marker adds up, and its inverse is the covariance.

    Parameters
    ----------
    rig : CameraRig
    markers : ndarray, shape (n, m, 3)
        True places [m].
    seen : ndarray of bool, shape (n, m, c)
    noise : ndarray, shape (n, m, c, 2)
        Standard normal, of each picture's two coordinates.

    Returns
    -------
    Sight
    """
    x, y, z = camera_coordinates(rig, markers)
    # Rows of the picture's derivative in metres^-1, over the noise: d(x / z), d(y / z).
    scale = rig.focal / max(rig.pixel_noise, 1e-9) / z
    right, down, ahead = rig.rotations.swapaxes(0, 1)            # (c, 3) each
    rows = np.stack((scale[..., None] * (right - (x / z)[..., None] * ahead),
                     scale[..., None] * (down - (y / z)[..., None] * ahead)), axis=-2)
    rows = np.where(seen[..., None, None], rows, 0.)             # (n, m, c, 2, 3)
    flat = rows.reshape(*rows.shape[:2], -1, 3)
    information = np.matmul(flat.swapaxes(-1, -2), flat)
    placed = seen.sum(axis=-1) >= NEEDED
    information[~placed] = np.eye(3)
    covariance = np.linalg.inv(information)
    pull = np.matmul(flat.swapaxes(-1, -2), noise.reshape(*flat.shape[:3], 1))
    positions = markers + np.matmul(covariance, pull)[..., 0]
    positions[~placed] = np.nan
    covariance[~placed] = np.nan
    return Sight(positions, seen, covariance, markers)
