"""Marker layout: landmark and offset of each of the eight markers on the hand.

Markers in the paper's order: r on the wrist, p and q on the knuckles of index and little
finger, one at the DIP joint of each finger, one at the thumb's tip.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidLayout
from .hand import DIGITS, FINGERS, LEFT_HAND_MIRROR, LINKS, Hand
from .kinematics import Pose

MARKERS = ('wrist', 'index_mcp', 'little_mcp', 'index', 'middle', 'ring', 'little', 'thumb')
PALM_MARKERS = MARKERS[:3]
PAPER_PLACES = ('wrist', 'index_mcp', 'little_mcp',
                'index_dip', 'middle_dip', 'ring_dip', 'little_dip', 'thumb_tip')

# A landmark is the distal end of a bone; a marker there is attached to that bone.
PALM_LANDMARKS = ('wrist', 'thumb_cmc') + tuple(
    f'{finger}_{joint}' for finger in FINGERS for joint in ('cmc', 'mcp'))
DIGIT_LANDMARKS = {
    **{finger: (f'{finger}_dip', f'{finger}_tip') for finger in FINGERS},
    'thumb': ('thumb_ip', 'thumb_tip'),
}
OFFSET_RANGE = .06  # [m] greatest offset on each axis
DEVIATION_RANGE = 0., .01  # [m]
MIN_LEVER = .005    # [m] least height of the palm's triangle, distance of a marker from its hinge


class Mounting(NamedTuple):
    """Mounting of the markers on one hand: link and position of each.

    Attributes
    ----------
    link : ndarray of int, shape (8,)
        Link that each marker is attached to; -1 is the wrist.
    position : ndarray, shape (8, 3)
        Marker in that link's frame [m].
    deviation : ndarray, shape (8,)
        Standard deviation of the marker from there, by skin that moves; 0 where unknown [m].
    """

    link: np.ndarray
    position: np.ndarray
    deviation: np.ndarray


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """Landmarks and offsets of the eight markers, for hands of any size.

    Parameters
    ----------
    places : sequence of str
        Landmark of each of `MARKERS`: for the first three a place on the palm
        ('wrist', 'index_cmc', 'index_mcp', ...), for a finger its 'dip' or 'tip',
        for the thumb its 'ip' or 'tip'.
    offsets : array_like, shape (8, 3)
        Marker from its landmark, along the axes of the link that ends there (x along the
        bone, y towards the thumb, z dorsal), as on a right hand [m].
    deviations : array_like, shape (8,)
        Standard deviation of each marker from its place on an axis, as skin moves on the bones;
        0 where it is not known [m]. That of a digit's marker says how far its reach is believed
        beside `Hand.natural_flexion`, and that two bends of a digit with its marker at the tip
        are told apart by it.

    Raises
    ------
    InvalidLayout
        With the marker, its value and the allowed values.
    """

    places: tuple[str, ...] = PAPER_PLACES
    offsets: np.ndarray = field(default_factory=lambda: np.zeros((len(MARKERS), 3)))
    deviations: np.ndarray = field(default_factory=lambda: np.zeros(len(MARKERS)))

    def __post_init__(self) -> None:
        places = tuple(self.places)
        if len(places) != len(MARKERS):
            raise InvalidLayout(f'places: {len(places)} given; expected one for each of {MARKERS}')
        for marker, place in zip(MARKERS, places):
            allowed = DIGIT_LANDMARKS.get(marker, PALM_LANDMARKS)
            if place not in allowed:
                raise InvalidLayout(
                    f'marker {marker}: place {place!r} is not one of {", ".join(allowed)}')
        offsets = np.array(self.offsets, dtype=float)
        if offsets.shape != (len(MARKERS), 3):
            raise InvalidLayout(f'offsets: shape {offsets.shape}; expected {(len(MARKERS), 3)}')
        if not (np.abs(offsets) <= OFFSET_RANGE).all():
            worst = MARKERS[int(np.argmin((np.abs(offsets) <= OFFSET_RANGE).all(axis=1)))]
            raise InvalidLayout(
                f'marker {worst}: offset {offsets[MARKERS.index(worst)]} m; '
                f'allowed is {-OFFSET_RANGE:g} to {OFFSET_RANGE:g} m on each axis')
        deviations = np.array(self.deviations, dtype=float)
        if deviations.shape != (len(MARKERS),):
            raise InvalidLayout(f'deviations: shape {deviations.shape}; expected {(len(MARKERS),)}')
        least, most = DEVIATION_RANGE
        for marker, value in zip(MARKERS, deviations):
            if not least <= value <= most:
                raise InvalidLayout(f'marker {marker}: deviation {value:g}; '
                                    f'allowed is {least:g} to {most:g} m')
        offsets.setflags(write=False)
        deviations.setflags(write=False)
        object.__setattr__(self, 'deviations', deviations)
        object.__setattr__(self, 'places', places)
        object.__setattr__(self, 'offsets', offsets)

    def mounting(self, hand: Hand) -> Mounting:
        """Return the mounting of the markers on `hand`, of its own side.

        Parameters
        ----------
        hand : Hand

        Returns
        -------
        Mounting
        """
        links, landmarks = zip(*(landmark_on_link(hand, place) for place in self.places))
        positions = np.array(landmarks) + self.offsets
        if hand.side == 'left':
            positions = positions * LEFT_HAND_MIRROR
        return Mounting(np.array(links), positions, self.deviations.copy())


def require_solvable(mounting: Mounting) -> None:
    """Check that wrist and digits can be solved from the markers.

    Parameters
    ----------
    mounting : Mounting

    Raises
    ------
    InvalidLayout
        If the palm markers are collinear, or a digit's marker lies on its hinge axis.
    """
    palm, digits = np.split(mounting.position, [len(PALM_MARKERS)])
    sides = np.roll(palm, -1, axis=0) - palm
    height = np.linalg.norm(np.cross(sides[0], sides[1])) / max(
        np.linalg.norm(sides, axis=1).max(), MIN_LEVER)
    if height < MIN_LEVER:
        raise InvalidLayout(
            f'markers {", ".join(PALM_MARKERS)}: they lie within {1e3 * height:.1f} mm of one '
            f'line on this hand; the palm needs a triangle at least {1e3 * MIN_LEVER:g} mm high')
    for marker, (x, _, z) in zip(MARKERS[len(PALM_MARKERS):], digits):
        if np.hypot(x, z) < MIN_LEVER:
            raise InvalidLayout(
                f'marker {marker}: its offset puts it within {1e3 * MIN_LEVER:g} mm of the axis '
                'about which it turns')


def landmark_on_link(hand: Hand, place: str) -> tuple[int, np.ndarray]:
    """Return the link and position of a landmark on the right hand.
    Parameters
    ----------
    hand : Hand
    place : str
        Of `PALM_LANDMARKS` or `DIGIT_LANDMARKS`.

    Returns
    -------
    link : int
        Row of `LINKS`; -1 is the wrist.
    position : ndarray, shape (3,)
        In that link's frame [m].
    """
    digit, _, joint = place.partition('_')
    if place == 'wrist':
        return -1, np.zeros(3)
    if place == 'thumb_cmc':
        return -1, hand.thumb_cmc
    index = DIGITS.index(digit)
    if joint in ('cmc', 'mcp') and digit in FINGERS:
        return -1, (hand.finger_cmc if joint == 'cmc' else hand.finger_mcp)[index]
    bone, link = {'dip': (1, 'middle'), 'ip': (1, 'proximal'), 'tip': (2, 'distal')}[joint]
    bones = hand.thumb_bones if digit == 'thumb' else hand.finger_bones[index]
    return LINKS.index(f'{digit}_{link}'), np.array((bones[bone], 0., 0.))


def marker_positions(mounting: Mounting, pose: Pose, wrist_rotation: ArrayLike | None = None,
                     wrist_position: ArrayLike | None = None) -> np.ndarray:
    """Return the positions of the markers of a hand in a pose.

    Parameters
    ----------
    mounting : Mounting
    pose : Pose
        With or without a leading dimension n.
    wrist_rotation, wrist_position : array_like, shape (..., 3, 3) and (..., 3), optional
        As given to `forward`.

    Returns
    -------
    ndarray, shape (..., 8, 3)
        [m]
    """
    turned = np.eye(3) if wrist_rotation is None else np.asarray(wrist_rotation)
    moved = np.zeros(3) if wrist_position is None else np.asarray(wrist_position)
    shape = pose.position.shape[:-2] + (1,)
    rotation = np.concatenate(
        (pose.rotation, np.broadcast_to(turned[..., None, :, :], shape + (3, 3))), axis=-3)
    position = np.concatenate(
        (pose.position, np.broadcast_to(moved[..., None, :], shape + (3,))), axis=-2)
    # Link -1, the wrist, is the last row.
    return position[..., mounting.link, :] + np.einsum(
        '...ij,...j->...i', rotation[..., mounting.link, :, :], mounting.position)
