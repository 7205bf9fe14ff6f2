"""Cameras around a hand: where they stand, where they look and how finely they see."""

from dataclasses import dataclass

import numpy as np

from ..core.errors import HandTrackerError

CAMERAS_RANGE = (2, 24)
PAPER_CAMERAS = 8
# Unsourced: a truss around the hand's middle, looking down on it at 30 degrees.
RING_CENTRE = (0., 0., 1.10)       # [m]
RING_RADIUS = 1.6                  # [m]
RING_HEIGHT = .9                   # [m] above the centre
# From memory, unsourced: the cameras of the paper's kind of system, PhaseSpace Impulse X2. The
# noise, half a picture element, is ours.
FIELD_OF_VIEW = np.radians(60.)
RESOLUTION = 3600
PIXEL_NOISE = .5


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


def camera_coordinates(rig, places):
    """Return x, y and z of places in the cameras' frames.

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
