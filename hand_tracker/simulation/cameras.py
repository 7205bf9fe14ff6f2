"""Camera rig of a motion capture system: poses, field of view, resolution and pixel noise."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import HandTrackerError

CAMERAS_RANGE = (2, 24)
PAPER_CAMERAS = 8
# Unsourced: a ring around the hand, looking down at it by 30 degrees.
RING_CENTRE = (0., 0., 1.10)       # [m]
RING_RADIUS = 1.6                  # [m]
RING_HEIGHT = .9                   # [m] above the centre
# Unsourced: figures of the PhaseSpace Impulse X2, the kind of system used in the paper. The noise
# is ours.
CAMERA_FIELD_OF_VIEW = np.radians(60.)   # [rad]
CAMERA_RESOLUTION = 3600                 # [pixels]
PIXEL_NOISE = .5                         # [pixels]


class InvalidRig(HandTrackerError, ValueError):
    """Number or parameters of cameras out of range."""


@dataclass(frozen=True, eq=False)
class CameraRig:
    """Static cameras with equal intrinsic parameters.

    Parameters
    ----------
    positions : array_like, shape (c, 3)
        [m]
    rotations : array_like, shape (c, 3, 3)
        World to camera frame: x right, y down, z along the optical axis.
    field_of_view : float
        Full angle across the square image [rad].
    resolution : int
        Width and height of the image [pixels].
    pixel_noise : float
        Standard deviation of a marker's image coordinates [pixels].

    Raises
    ------
    InvalidRig
        Naming the field, its value and the allowed range.
    """

    positions: np.ndarray
    rotations: np.ndarray
    field_of_view: float = CAMERA_FIELD_OF_VIEW
    resolution: int = CAMERA_RESOLUTION
    pixel_noise: float = PIXEL_NOISE

    def __post_init__(self) -> None:
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
    def ring(cls, count: int = PAPER_CAMERAS, radius: float = RING_RADIUS,
             height: float = RING_HEIGHT, centre: ArrayLike = RING_CENTRE,
             **fields: Any) -> 'CameraRig':
        """Return cameras evenly spaced on a ring, looking at a point below its centre.

        Parameters
        ----------
        count : int
        radius : float
            Of the ring [m].
        height : float
            Of the ring above the point [m].
        centre : array_like, shape (3,)
            The point [m].
        **fields
            Other fields of `CameraRig`.

        Raises
        ------
        InvalidRig
            If `count` is out of `CAMERAS_RANGE`.
        """
        lowest, highest = CAMERAS_RANGE
        if not lowest <= count <= highest:
            raise InvalidRig(f'cameras: {count}; allowed is {lowest} to {highest}')
        angle = 2. * np.pi * np.arange(count) / count
        # Two opposite cameras cannot triangulate: two are at a right angle.
        angle = angle / 2. if count == 2 else angle
        places = centre + np.column_stack((
            radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)))
        return cls(places, looking_at(places, centre), **fields)

    @property
    def focal(self) -> float:
        """Focal length [pixels]."""
        return float(.5 * self.resolution / np.tan(.5 * self.field_of_view))


def looking_at(places: ArrayLike, target: ArrayLike) -> np.ndarray:
    """Return the rotations of upright cameras that look at a point.

    Parameters
    ----------
    places : array_like, shape (c, 3)
        Positions of the cameras [m].
    target : array_like, shape (3,)
        [m]

    Returns
    -------
    ndarray, shape (c, 3, 3)
        World to camera frame.

    Raises
    ------
    InvalidRig
        If a camera is at the target.
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


def camera_coordinates(rig: CameraRig, places: np.ndarray) -> np.ndarray:
    """Transform points from the world into the frame of each camera.

    Parameters
    ----------
    rig : CameraRig
    places : ndarray, shape (n, m, 3)
        [m]

    Returns
    -------
    ndarray, shape (3, n, m, c)
        [m]
    """
    local = np.einsum('cij,nmcj->icnm', rig.rotations, places[:, :, None] - rig.positions,
                      optimize=True)
    return np.moveaxis(local, 1, -1)
