"""Marker layout: landmark and offset of each marker on the hand.

The paper's eight, in its order: r on the wrist, p and q on the knuckles of index and little
finger, one at the DIP joint of each finger, one at the thumb's tip. Other layouts list other
markers, each at a landmark; of those three of the palm and one of each digit, the principal
markers, stand for the paper's eight wherever the method wants eight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidLayout
from .hand import DIGITS, FINGERS, JOINTS, LEFT_HAND_MIRROR, LINKS, Hand

if TYPE_CHECKING:
    from .kinematics import Pose

MARKERS = ('wrist', 'index_mcp', 'little_mcp', 'index', 'middle', 'ring', 'little', 'thumb')
PALM_MARKERS = MARKERS[:3]
PAPER_PLACES = ('wrist', 'index_mcp', 'little_mcp',
                'index_dip', 'middle_dip', 'ring_dip', 'little_dip', 'thumb_tip')

# A landmark is the distal end of a bone; a marker there is attached to that bone.
PALM_LANDMARKS = ('wrist', 'thumb_cmc') + tuple(
    f'{finger}_{joint}' for finger in FINGERS for joint in ('cmc', 'mcp'))
OF_PALM = 'palm'    # what these move with
DIGIT_LANDMARKS = {
    **{finger: (f'{finger}_dip', f'{finger}_tip') for finger in FINGERS},
    'thumb': ('thumb_ip', 'thumb_tip'),
}
# Landmarks at which a further marker of a digit may be, beside those of its principal one.
LANDMARKS_OF_DIGIT = {
    **{finger: tuple(f'{finger}_{joint}' for joint in ('pip', 'dip', 'tip'))
       for finger in FINGERS},
    'thumb': ('thumb_mcp', 'thumb_ip', 'thumb_tip'),
}
ALL_LANDMARKS = PALM_LANDMARKS + tuple(
    place for places in LANDMARKS_OF_DIGIT.values() for place in places)
# Link that a marker may be said to ride on, and the landmark at that link's distal end.
LANDMARK_OF_LINK = {
    'wrist': 'wrist', **{
        f'{finger}_{link}': f'{finger}_{joint}' for finger in FINGERS for link, joint in (
            ('metacarpal', 'mcp'), ('proximal', 'pip'), ('middle', 'dip'), ('distal', 'tip'))},
    'thumb_metacarpal': 'thumb_mcp', 'thumb_proximal': 'thumb_ip', 'thumb_distal': 'thumb_tip'}
LINK_OF_LANDMARK = {place: link for link, place in LANDMARK_OF_LINK.items()}
# Joint with whose flexion skin turns at the end of a digit's link: rows of `JOINTS` and `LINKS`.
SKIN_JOINTS = {LINKS.index(link): JOINTS.index(f'{place}_flexion')
               for link, place in LANDMARK_OF_LINK.items()
               if place not in PALM_LANDMARKS and f'{place}_flexion' in JOINTS}
COUNT_RANGE = 3, 60  # markers of a layout
OFFSET_RANGE = .06  # [m] greatest offset on each axis
DEVIATION_RANGE = 0., .01  # [m]
SKIN_SHARE_RANGE = -1., 1.5
MIN_LEVER = .005    # [m] least height of the palm's triangle, distance of a marker from its hinge


class Mounting(NamedTuple):
    """Mounting of n markers on one hand: link, position and skin of each.

    Attributes
    ----------
    link : ndarray of int, shape (n,)
        Link that each marker is attached to; -1 is the wrist.
    position : ndarray, shape (n, 3)
        Marker in that link's frame, the joint at its landmark at zero [m].
    deviation : ndarray, shape (n,)
        Standard deviation of the marker from there, by skin that moves; 0 where unknown [m].
    offset : ndarray, shape (n, 3)
        Marker from its landmark, in that link's frame [m].
    share : ndarray, shape (n,)
        Share of the flexion of the joint at the landmark by which the offset turns [1].
    """

    link: np.ndarray
    position: np.ndarray
    deviation: np.ndarray
    offset: np.ndarray
    share: np.ndarray


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """Landmarks and offsets of the markers, for hands of any size.

    Parameters
    ----------
    places : sequence of str
        Landmark of each marker. Of the paper's eight markers, for the first three a place on the
        palm ('wrist', 'index_cmc', 'index_mcp', ...), for a finger its 'dip' or 'tip', for the
        thumb its 'ip' or 'tip'; of markers with `names` any of `ALL_LANDMARKS`.
    offsets : array_like, shape (n, 3), optional
        Marker from its landmark, along the axes of the link that ends there (x along the
        bone, y towards the thumb, z dorsal), as on a right hand; zero when left out [m].
    deviations : array_like, shape (n,), optional
        Standard deviation of each marker from its place on an axis, as skin moves on the bones;
        0 where it is not known [m]. That of a digit's marker says how far its reach is believed
        beside `Hand.natural_flexion`, and that two bends of a digit with its marker at the tip
        are distinguished by it.
    names : sequence of str, optional
        Names of 3 to 60 markers, three of them on the palm; the paper's eight, `MARKERS`, when
        left out.
    skin_shares : array_like, shape (n,), optional
        Share of the flexion of the joint at its landmark by which each marker's offset turns, as
        skin over a joint does; zero when left out [1].

    Attributes
    ----------
    principal : tuple of int
        Row of the marker that stands for each of `MARKERS`; -1 where there is none.

    Raises
    ------
    InvalidLayout
        With the marker, its value and the allowed values.
    """

    places: Sequence[str] = PAPER_PLACES
    offsets: np.ndarray = None  # type: ignore[assignment]
    deviations: np.ndarray = None  # type: ignore[assignment]
    names: Sequence[str] = MARKERS
    skin_shares: np.ndarray = None  # type: ignore[assignment]
    principal: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        places, names = tuple(self.places), tuple(self.names)
        is_paper = names == MARKERS
        if is_paper and len(places) != len(MARKERS):
            raise InvalidLayout(f'places: {len(places)} given; expected one for each of {MARKERS}')
        if not is_paper:
            _require_names(names, places)
        for marker, place in zip(names, places):
            allowed = (DIGIT_LANDMARKS.get(marker, PALM_LANDMARKS) if is_paper else ALL_LANDMARKS)
            if place not in allowed:
                raise InvalidLayout(
                    f'marker {marker}: place {place!r} is not one of {", ".join(allowed)}')
        offsets = _rows('offsets', self.offsets, (len(names), 3))
        if not (np.abs(offsets) <= OFFSET_RANGE).all():
            worst = int(np.argmin((np.abs(offsets) <= OFFSET_RANGE).all(axis=1)))
            raise InvalidLayout(
                f'marker {names[worst]}: offset {offsets[worst]} m; '
                f'allowed is {-OFFSET_RANGE:g} to {OFFSET_RANGE:g} m on each axis')
        deviations = _rows('deviations', self.deviations, (len(names),))
        _require_range('deviation', names, deviations, DEVIATION_RANGE, ' m')
        shares = _rows('skin_shares', self.skin_shares, (len(names),))
        _require_range('skin_share', names, shares, SKIN_SHARE_RANGE, '')
        object.__setattr__(self, 'names', names)
        object.__setattr__(self, 'places', places)
        object.__setattr__(self, 'offsets', offsets)
        object.__setattr__(self, 'deviations', deviations)
        object.__setattr__(self, 'skin_shares', shares)
        object.__setattr__(self, 'principal', tuple(range(len(MARKERS))) if is_paper
                           else _principal_markers(places, offsets))

    @property
    def further(self) -> tuple[int, ...]:
        """Rows of the markers that are not principal ones."""
        return tuple(row for row in range(len(self.names)) if row not in self.principal)

    @property
    def digits(self) -> tuple[str, ...]:
        """The digit that each marker moves with, by its place, or `OF_PALM`."""
        return tuple(OF_PALM if place in PALM_LANDMARKS else place.partition('_')[0]
                     for place in self.places)

    def with_offsets(self, offsets: ArrayLike) -> MarkerLayout:
        """Return the same markers at other offsets, shape (n, 3) [m]."""
        return replace(self, offsets=np.array(offsets, dtype=float))

    def in_order(self, names: Sequence[str]) -> MarkerLayout:
        """Return the layout of these markers of it, in their order."""
        rows = [self.names.index(name) for name in names]
        return replace(self, places=[self.places[row] for row in rows], names=names,
                       offsets=self.offsets[rows], deviations=self.deviations[rows],
                       skin_shares=self.skin_shares[rows])

    def mounting(self, hand: Hand) -> Mounting:
        """Return the mounting of the markers on `hand`, of its own side.

        Parameters
        ----------
        hand : Hand

        Returns
        -------
        Mounting
        """
        return self._mounting(hand, range(len(self.names)), rides=self.names != MARKERS)

    def principal_mounting(self, hand: Hand) -> Mounting:
        """Return the mounting of the principal markers, palm flat; parameters as of `mounting`.

        Where there is no marker it is the paper's.
        """
        found = self._mounting(hand, [max(row, 0) for row in self.principal], rides=False)
        usual = MarkerLayout().mounting(hand) if -1 in self.principal else found
        missing = np.array(self.principal) < 0
        return Mounting(*(np.where(missing[:, None] if part.ndim > 1 else missing, other, part)
                          for part, other in zip(found, usual)))

    def _mounting(self, hand: Hand, rows: Sequence[int], rides: bool) -> Mounting:
        """Return the mounting of some rows; knuckles ride on their metacarpals or on the wrist."""
        right, chosen = hand.as_right(), list(rows)
        links, landmarks = zip(*(
            landmark_on_link(right, self.places[row], rides) for row in chosen))
        mirror = LEFT_HAND_MIRROR if hand.side == 'left' else np.ones(3)
        offsets = self.offsets[chosen]
        return Mounting(np.array(links), (np.array(landmarks) + offsets) * mirror,
                        self.deviations[chosen], offsets * mirror, self.skin_shares[chosen])


def _require_names(names: tuple[str, ...], places: tuple[str, ...]) -> None:
    """Refuse names of markers that are not as many as the places, or stand twice."""
    least, most = COUNT_RANGE
    if not least <= len(names) <= most:
        raise InvalidLayout(f'names: {len(names)} given; allowed is {least} to {most} markers')
    if len(places) != len(names):
        raise InvalidLayout(f'places: {len(places)} given; expected one for each of the '
                            f'{len(names)} names')
    for name in names:
        if not isinstance(name, str) or not name:
            raise InvalidLayout(f'names: {name!r}; expected a text')
        if names.count(name) > 1:
            raise InvalidLayout(f'names: {name!r} stands twice')


def _rows(name: str, values: ArrayLike | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return a field as a read-only array of a shape; zeros when it is None."""
    try:
        array = np.zeros(shape) if values is None else np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InvalidLayout(f'{name}: {values!r} is not made of numbers') from None
    if array.shape != shape:
        raise InvalidLayout(f'{name}: shape {array.shape}; expected {shape}')
    array.setflags(write=False)
    return array


def _require_range(name: str, markers: tuple[str, ...], values: np.ndarray,
                   allowed: tuple[float, float], unit: str) -> None:
    """Refuse a marker's value outside the allowed range."""
    least, most = allowed
    for marker, value in zip(markers, values):
        if not least <= value <= most:
            raise InvalidLayout(f'marker {marker}: {name} {value:g}; '
                                f'allowed is {least:g} to {most:g}{unit}')


def _principal_markers(places: tuple[str, ...], offsets: np.ndarray) -> tuple[int, ...]:
    """Return the rows that stand for the paper's eight markers; -1 where there is none."""
    def nearest(rows: list[int]) -> int:
        return min(rows, key=lambda row: float(np.linalg.norm(offsets[row])), default=-1)

    def at(landmark: str) -> int:
        return nearest([row for row, place in enumerate(places) if place == landmark])

    palm = tuple(at(landmark) for landmark in PAPER_PLACES[:3])
    if -1 in palm:
        palm = _largest_triangle(places, offsets)
    # The thumb's tip shows its last joint; a finger's DIP is the paper's.
    return palm + tuple(
        next((row for row in map(at, sorted(
            DIGIT_LANDMARKS[digit], key=PAPER_PLACES.__contains__, reverse=True)) if row >= 0), -1)
        for digit in MARKERS[3:])


def _largest_triangle(places: tuple[str, ...], offsets: np.ndarray) -> tuple[int, ...]:
    """Return the rows of the three palm markers of the largest triangle, r, p and q."""
    hand = Hand.scaled()
    rows = [row for row, place in enumerate(places) if place in PALM_LANDMARKS]
    if len(rows) < 3:
        raise InvalidLayout(f'{len(rows)} markers at {", ".join(PALM_LANDMARKS)}; expected at '
                            'least three, which place the wrist')
    points = {row: landmark_on_link(hand, places[row])[1] + offsets[row] for row in rows}

    def area(a: int, b: int, c: int) -> float:
        return float(np.linalg.norm(np.cross(points[b] - points[a], points[c] - points[a])))

    # r is the nearest to the wrist, p on the thumb's side of q.
    largest = max(combinations(rows, 3), key=lambda three: area(*three))
    r, *ahead = sorted(largest, key=lambda row: float(points[row][0]))
    p, q = sorted(ahead, key=lambda row: -float(points[row][1]))
    return r, p, q


def require_solvable(mounting: Mounting) -> None:
    """Check that wrist and digits can be solved from the principal markers.

    Parameters
    ----------
    mounting : Mounting
        Of the principal markers.

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


def landmark_on_link(hand: Hand, place: str, rides: bool = False) -> tuple[int, np.ndarray]:
    """Return the link and position of a landmark on the right hand.

    Parameters
    ----------
    hand : Hand
    place : str
        Of `ALL_LANDMARKS`.
    rides : bool, optional
        Whether a knuckle is on its metacarpal, which turns as the palm cups; else on the wrist.

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
        return -1, hand.resting_thumb_cmc()
    index = DIGITS.index(digit)
    if joint == 'cmc' or joint == 'mcp' and digit in FINGERS and not rides:
        return -1, (hand.finger_cmc if joint == 'cmc' else hand.finger_mcp)[index]
    row = LINKS.index(LINK_OF_LANDMARK[place])
    if joint == 'mcp' and digit in FINGERS:
        return row, hand.finger_mcp[index] - hand.finger_cmc[index]
    return row, hand.bone_ends()[index, LANDMARKS_OF_DIGIT[digit].index(place)]


def marker_positions(mounting: Mounting, pose: Pose, wrist_rotation: ArrayLike | None = None,
                     wrist_position: ArrayLike | None = None) -> np.ndarray:
    """Return the positions of the markers of a hand in a pose; skin turns them as it says.

    Parameters
    ----------
    mounting : Mounting
    pose : Pose
        With or without a leading dimension n.
    wrist_rotation, wrist_position : array_like, shape (..., 3, 3) and (..., 3), optional
        As given to `forward`.

    Returns
    -------
    ndarray, shape (..., n, 3)
        [m]
    """
    turned = np.eye(3) if wrist_rotation is None else np.asarray(wrist_rotation)
    moved = np.zeros(3) if wrist_position is None else np.asarray(wrist_position)
    shape = pose.position.shape[:-2] + (1,)
    rotation = np.concatenate(
        (pose.rotation, np.broadcast_to(turned[..., None, :, :], shape + (3, 3))), axis=-3)
    position = np.concatenate(
        (pose.position, np.broadcast_to(moved[..., None, :], shape + (3,))), axis=-2)
    local = mounting.position
    if mounting.share.any():
        local = local + _skin_moves(mounting, pose)
    # Link -1, the wrist, is the last row.
    return position[..., mounting.link, :] + np.einsum(
        '...ij,...j->...i', rotation[..., mounting.link, :, :], local)


def _skin_moves(mounting: Mounting, pose: Pose) -> np.ndarray:
    """Return how far skin moves markers in the frames of their links, shape (..., n, 3) [m]."""
    moves = np.zeros((*pose.position.shape[:-2], *mounting.offset.shape))
    for i in np.flatnonzero(mounting.share):
        joint = SKIN_JOINTS.get(int(mounting.link[i]))
        if joint is not None:
            # The joint turns its link about the y axis of the link before it.
            along, after = pose.rotation[..., joint - 1, :, 0], pose.rotation[..., joint, :, :]
            turn = mounting.share[i] * np.arctan2(
                (along * after[..., 2]).sum(axis=-1), (along * after[..., 0]).sum(axis=-1))
            c, s = np.cos(turn), np.sin(turn)
            x, _, z = mounting.offset[i]
            moves[..., i, 0], moves[..., i, 2] = c * x + s * z - x, c * z - s * x - z
    return moves
