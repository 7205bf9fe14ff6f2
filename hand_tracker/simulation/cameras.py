"""Cameras around a hand: which see a marker, and how well two or more of them place it.

Markers are small lights on the skin. A camera sees one when it lies in the camera's field
of view and the straight line between them meets none of the hand's capsules, the marker's
own finger included: the centre of a marker on the skin stands its radius off the capsule,
so that its own finger hides it from behind and not from beside.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError
from ..core.hand import DIGITS
from ..core.kinematics import forward, joint_table, tip_offsets
from ..core.layout import MarkerLayout, marker_positions
from ..core.skeleton import BONES, bone_radii, skeleton_points

CAMERAS_RANGE = (2, 24)
PAPER_CAMERAS = 8
# Unsourced: a truss around the hand's middle, looking down on it at 30 degrees.
RING_CENTRE = (0., 0., 1.10)       # [m]
RING_RADIUS = 1.6                  # [m]
RING_HEIGHT = .9                   # [m] above the centre
# The paper's PhaseSpace Impulse X2: 60 degrees, 3600 x 3600 after its maker; the noise, half
# a picture element, is ours.
FIELD_OF_VIEW = np.radians(60.)
RESOLUTION = 3600
PIXEL_NOISE = .5
MARKER_RADIUS = .004               # [m]
NEEDED = 2                         # cameras that place a marker
CHUNK = 250                        # frames at once: what fits into the processor's cache


class InvalidRig(HandTrackerError, ValueError):
    """Cameras are too few, too many or nowhere."""


@dataclass(frozen=True, eq=False)
class CameraRig:
    """Cameras that do not move.

    Parameters
    ----------
    positions : array_like, shape (c, 3)
        [m]
    rotations : array_like, shape (c, 3, 3)
        From the surroundings to each camera's frame: x right, y down, z along the view.
    field_of_view : float
        Full angle across the square picture [rad].
    resolution : int
        Picture elements along a side.
    pixel_noise : float
        Standard deviation of a light's place in the picture, along each side [pixels].

    Raises
    ------
    InvalidRig
        Naming the field, its value and what is allowed.
    """

    positions: np.ndarray
    rotations: np.ndarray
    field_of_view: float = FIELD_OF_VIEW
    resolution: int = RESOLUTION
    pixel_noise: float = PIXEL_NOISE

    def __post_init__(self):
        count = len(self.positions)
        lowest, highest = CAMERAS_RANGE
        if not lowest <= count <= highest:
            raise InvalidRig(f'cameras: {count}; allowed is {lowest} to {highest}')
        for name, shape in (('positions', (count, 3)), ('rotations', (count, 3, 3))):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidRig(f'{name}: shape {array.shape}; expected {shape}, all finite')
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name, lower, upper in (('field_of_view', 0., np.pi), ('resolution', 0., np.inf),
                                   ('pixel_noise', -np.inf, np.inf)):
            value = getattr(self, name)
            if not lower < value < upper or value < 0.:
                raise InvalidRig(f'{name}: {value!r} is not between {max(lower, 0.):g} '
                                 f'and {upper:g}')

    @classmethod
    def ring(cls, count=PAPER_CAMERAS, radius=RING_RADIUS, height=RING_HEIGHT,
             centre=RING_CENTRE, **fields):
        """Return cameras evenly around a centre, looking at it.

        Parameters
        ----------
        count : int
        radius, height : float
            Of the ring, above the centre [m].
        centre : array_like, shape (3,)
            [m]
        **fields
            Any other field of `CameraRig`.
        """
        lowest, highest = CAMERAS_RANGE
        if not lowest <= count <= highest:
            raise InvalidRig(f'cameras: {count}; allowed is {lowest} to {highest}')
        angle = 2. * np.pi * np.arange(count) / count
        # Two opposite cameras would not triangulate: two stand at a right angle.
        angle = angle / 2. if count == 2 else angle
        places = centre + np.column_stack((
            radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)))
        return cls(places, looking_at(places, centre), **fields)

    def subset(self, cameras):
        """Return a rig of some of these cameras.

        Parameters
        ----------
        cameras : sequence of int
        """
        cameras = list(cameras)
        return CameraRig(self.positions[cameras], self.rotations[cameras], self.field_of_view,
                         self.resolution, self.pixel_noise)

    @property
    def focal(self):
        """Focal length [pixels]."""
        return .5 * self.resolution / np.tan(.5 * self.field_of_view)


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


def looking_at(places, target):
    """Return rotations of cameras that look at a point, their pictures upright.

    Parameters
    ----------
    places : array_like, shape (c, 3)
        [m]
    target : array_like, shape (3,)
        [m]

    Returns
    -------
    ndarray, shape (c, 3, 3)
        From the surroundings to each camera's frame.
    """
    view = np.asarray(target, dtype=float) - places
    size = np.linalg.norm(view, axis=1, keepdims=True)
    if (size < 1e-9).any():
        raise InvalidRig('a camera stands where it looks')
    view = view / size
    right = np.cross(view, (0., 0., 1.))
    vertical = np.linalg.norm(right, axis=1) < 1e-9
    right[vertical] = (1., 0., 0.)
    right = right / np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack((right, np.cross(view, right), view), axis=1)


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


def in_view(rig, markers):
    """Return which cameras have which markers in their picture, shape (n, m, c)."""
    x, y, z = _camera_coordinates(rig, markers)
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
        Of the capsules around `BONES` [m].

    Returns
    -------
    ndarray of bool, shape (n, m, c)
    """
    clear = np.empty((*markers.shape[:2], len(rig.positions)), dtype=bool)
    bones = np.array(BONES)
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
    x, y, z = _camera_coordinates(rig, markers)
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


def _camera_coordinates(rig, markers):
    """Return x, y, z of markers in the cameras' frames, each of shape (n, m, c) [m]."""
    local = np.einsum('cij,nmcj->icnm', rig.rotations, markers[:, :, None] - rig.positions,
                      optimize=True)
    return np.moveaxis(local, 1, -1)
