"""Collision geometry: capsules around the bones, pairs that can touch, and their distances.

A digit has one capsule around each of its three bones, the palm one around each finger's
metacarpal. All coordinates are of a right hand in the wrist's frame.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit
from ..numerics.packs import indexed, packed
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import Vector, add, clamp, dot, scale, subtract, vector
from .hand import DIGITS, FINGERS, LINKS, Hand
from .kinematics import JointTable, joint_table, place_digit_links

BONES_PER_DIGIT = 3
FINGER_COUNT = len(FINGERS)
FIRST_METACARPAL = len(DIGITS) * BONES_PER_DIGIT  # of the capsules
CAPSULE_COUNT = FIRST_METACARPAL + 2 * FINGER_COUNT
# Bones of different digits, and the two outer bones of a digit with metacarpals.
PAIR_COUNT = (len(DIGITS) * (len(DIGITS) - 1) // 2 * BONES_PER_DIGIT ** 2
              + len(DIGITS) * (BONES_PER_DIGIT - 1) * FINGER_COUNT)
PALM_INDEX = len(DIGITS)     # of the palm where digits are numbered
WEB_SHARE = .4               # of the proximal phalanx: up to here skin joins neighbours; unsourced
MIN_SQUARED_LENGTH = 1e-12   # [m²] below which a segment is a point


class Capsules(NamedTuple):
    """Capsules of a right hand, and the pairs of them that can touch.

    Attributes
    ----------
    parent, rotation, translation, axis : ndarray, shapes (25,), (25, 3, 3), (25, 3) and (25, 3)
        Fields of the hand's `JointTable`.
    link : ndarray of int, shape (c,)
        Link of each capsule: 5 x 3 bones, index finger to thumb, 4 metacarpals, and the 4
        proximal phalanges once more, from the web on.
    start, end : ndarray, shape (c, 3)
        Ends of the capsule's axis, in the link's frame [m].
    first, second : ndarray of int, shape (p,)
        Capsules of each pair: of a digit, and of a later digit or the palm.
    digits : ndarray of int, shape (p, 2)
        Digits of each pair; `PALM_INDEX` is the palm.
    apart : ndarray, shape (p,)
        Distance of the axes at which the pair touches [m].
    reach : ndarray, shape (p,)
        Distance of the axes' midpoints beyond which the pair cannot touch [m].
    side : ndarray, shape (p, 3)
        Unit direction from second to first at rest, of neighbouring fingers and of a finger
        and the palm; zero for other pairs.
    """

    parent: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    axis: np.ndarray
    link: np.ndarray
    start: np.ndarray
    end: np.ndarray
    first: np.ndarray
    second: np.ndarray
    digits: np.ndarray
    apart: np.ndarray
    reach: np.ndarray
    side: np.ndarray


class Placement(NamedTuple):
    """Links and capsules of a pose, in the wrist's frame.

    Attributes
    ----------
    rotations, positions : ndarray, shape (25, 3, 3) and (25, 3)
        Frames of the links [m].
    ends : ndarray, shape (c, 3, 3)
        Start, end and middle of each capsule's axis [m].
    """

    rotations: np.ndarray
    positions: np.ndarray
    ends: np.ndarray


def blank_placement() -> Placement:
    """Return a placement of zeros, to be replaced."""
    return Placement(np.zeros((len(LINKS), 3, 3)), np.zeros((len(LINKS), 3)),
                     np.zeros((CAPSULE_COUNT, 3, 3)))


def capsule_ends(hand: Hand) -> np.ndarray:
    """Return the ends of the digits' capsule axes in their links, shape (5, 3, 3) [m]."""
    ends = hand.bone_ends()
    # Tips lie on the skin; the other ends of bones lie inside joints.
    ends[:, 2, 0] = np.maximum(ends[:, 2, 0] - hand.radii[:, 2], 0.)
    return ends


def hand_capsules(hand: Hand) -> Capsules:
    """Return the capsules of a hand, as a right hand.

    Pairs that overlap at zero angles, as fingers of a narrow hand do, count as touching there:
    that overlap is an error of the radii, not of the pose.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    Capsules
    """
    right = hand.as_right()
    table = joint_table(right)
    links = [LINKS.index(f'{digit}_{bone}') for digit in DIGITS for bone in (
        ('metacarpal', 'proximal', 'distal') if digit == 'thumb'
        else ('proximal', 'middle', 'distal'))]
    ends = capsule_ends(right).reshape(-1, 3)
    knuckles = table.translation[[LINKS.index(f'{finger}_knuckle') for finger in FINGERS]]
    proximal = [BONES_PER_DIGIT * finger for finger in range(len(FINGERS))]
    webbed = dict(zip(proximal, range(len(links) + len(FINGERS), len(links) + 2 * len(FINGERS))))
    start = np.concatenate((np.zeros((len(links) + len(FINGERS), 3)), WEB_SHARE * ends[proximal]))
    radii = np.concatenate((right.radii.ravel(), np.full(len(FINGERS), right.palm_radius)))

    first: list[int] = []
    second: list[int] = []
    digits: list[tuple[int, int]] = []
    apart: list[float] = []
    side: list[Vector] = []

    def add_pair(a: int, b: int, of: tuple[int, int],
                 direction: Vector = (0., 0., 0.)) -> None:
        joined = of[1] - of[0] == 1 and of[1] < len(FINGERS)
        first.append(webbed.get(a, a) if joined else a)
        second.append(webbed.get(b, b) if joined else b)
        digits.append(of)
        apart.append(radii[a] + radii[b])
        side.append(direction)

    for i in range(len(DIGITS)):
        for j in range(i + 1, len(DIGITS)):
            for a in range(BONES_PER_DIGIT):
                for b in range(BONES_PER_DIGIT):
                    add_pair(BONES_PER_DIGIT * i + a, BONES_PER_DIGIT * j + b, (i, j),
                             (0., 1., 0.) if j < len(FINGERS) else (0., 0., 0.))
        for a in range(1, BONES_PER_DIGIT):
            for metacarpal in range(len(FINGERS)):
                add_pair(BONES_PER_DIGIT * i + a, len(links) + metacarpal, (i, PALM_INDEX),
                         (0., 0., -1.) if i < len(FINGERS) else (0., 0., 0.))

    end = np.concatenate((ends, knuckles, ends[proximal]))
    halves = .5 * np.linalg.norm(end - start, axis=1)
    found = Capsules(
        *table, np.array(links + [LINKS.index(f'{finger}_metacarpal') for finger in FINGERS]
                         + [links[row] for row in proximal]),
        start, end, np.array(first), np.array(second), np.array(digits), np.array(apart),
        np.array(apart) + halves[first] + halves[second], np.array(side))
    return found._replace(
        apart=found.apart + np.minimum(pair_gaps(found, np.zeros(len(LINKS))), 0.))


def pair_gaps(capsules: Capsules, angles: np.ndarray) -> np.ndarray:
    """Return the distance between the surfaces of each pair in a pose.

    Parameters
    ----------
    capsules : Capsules
    angles : ndarray, shape (25,)
        [rad]

    Returns
    -------
    ndarray, shape (p,)
        Negative where they overlap [m].
    """
    placement = blank_placement()
    place_capsules(packed(capsules)[0][0], np.array(angles, dtype=float), placement)
    ends = placement.ends
    return np.array([nearest_points(ends[a], ends[b])[2] for a, b in zip(
        capsules.first, capsules.second)]) - capsules.apart


@jit
def place_digit_capsules(capsules: Capsules, digit: int, angles: np.ndarray,
                         placement: Placement) -> None:
    """Write a digit's links and capsules in a pose.

    Parameters
    ----------
    capsules : Capsules
    digit : int
    angles : ndarray, shape (25,)
        [rad]
    placement : Placement
        Changed.
    """
    turned, moved = local_floats((3, 3)), local_floats(3)
    turned[0, 0] = turned[1, 1] = turned[2, 2] = 1.
    # Slices, as those of one pose in many, are arrays to numba, and fields are not.
    table = JointTable(
        capsules.parent[:], capsules.rotation[:], capsules.translation[:], capsules.axis[:])
    place_digit_links(table, digit, angles, turned, moved, placement.rotations, placement.positions)
    for bone in range(BONES_PER_DIGIT):
        _place_capsule(capsules, BONES_PER_DIGIT * digit + bone, placement)
    if digit < FINGER_COUNT:
        _place_capsule(capsules, FIRST_METACARPAL + digit, placement)
        _place_capsule(capsules, FIRST_METACARPAL + FINGER_COUNT + digit, placement)


@jit
def _place_capsule(capsules: Capsules, row: int, placement: Placement) -> None:
    """Write the ends and the middle of a capsule's axis, its link placed."""
    turns, origins, ends = (indexed(placement.rotations), indexed(placement.positions),
                            indexed(placement.ends))
    link, start, end = capsules.link[row], indexed(capsules.start), indexed(capsules.end)
    for i in range(3):
        x, y, z = turns[link, i, 0], turns[link, i, 1], turns[link, i, 2]
        at = origins[link, i]
        ends[row, 0, i] = at + x * start[row, 0] + y * start[row, 1] + z * start[row, 2]
        ends[row, 1, i] = at + x * end[row, 0] + y * end[row, 1] + z * end[row, 2]
        ends[row, 2, i] = .5 * (ends[row, 0, i] + ends[row, 1, i])


@jit
def place_capsules(capsules: Capsules, angles: np.ndarray, placement: Placement) -> None:
    """Write all links and capsules in a pose.

    Parameters
    ----------
    capsules : Capsules
    angles : ndarray, shape (25,)
        [rad]
    placement : Placement
        Replaced.
    """
    for digit in range(5):
        place_digit_capsules(capsules, digit, angles, placement)


@jit
def may_touch(capsules: Capsules, ends: np.ndarray, pair: int, gap: float) -> bool:
    """Return whether a pair may be closer than a gap: broad-phase test by midpoints and axes.

    Parameters
    ----------
    capsules : Capsules
    ends : ndarray, shape (c, 3, 3)
        Of a `Placement`, `indexed` [m].
    pair : int
    gap : float
        Distance between the surfaces [m].

    Returns
    -------
    bool
    """
    first, second = capsules.first[pair], capsules.second[pair]
    first_middle, second_middle = _place_of(ends, first, 2), _place_of(ends, second, 2)
    between = subtract(first_middle, second_middle)
    square = dot(between, between)
    if square > (capsules.reach[pair] + gap) ** 2:
        return False
    # Halves of the axes, projected on the line between the midpoints.
    left = (square - abs(dot(subtract(_place_of(ends, first, 1), first_middle), between))
            - abs(dot(subtract(_place_of(ends, second, 1), second_middle), between)))
    return left <= 0. or left * left <= (capsules.apart[pair] + gap) ** 2 * square


@jit
def axis_of(ends: np.ndarray, row: int) -> tuple[Vector, Vector]:
    """Return start and end of a capsule's axis, row `row` of `ends`, shape (c, 3, 3) [m]."""
    return _place_of(ends, row, 0), _place_of(ends, row, 1)


@jit
def _place_of(ends: np.ndarray, row: int, which: int) -> Vector:
    """Return start (0), end (1) or middle (2) of a capsule's axis [m]."""
    return ends[row, which, 0], ends[row, which, 1], ends[row, which, 2]


@jit
def nearest_points(first: tuple[Vector, Vector] | np.ndarray,
                   second: tuple[Vector, Vector] | np.ndarray) -> tuple[float, float, float]:
    """Return the nearest points of two segments and their distance.

    C. Ericson, Real-Time Collision Detection (2005), 5.1.9.

    Parameters
    ----------
    first, second : pair of Vector, or ndarray, shape (2, 3)
        Start and end [m].

    Returns
    -------
    s, t : float
        Nearest point on the first and second segment, from 0, its start, to 1, its end [1].
    distance : float
        [m]
    """
    p = vector(first[0])
    q = vector(second[0])
    u = subtract(vector(first[1]), p)
    v = subtract(vector(second[1]), q)
    w = subtract(p, q)
    a = dot(u, u)
    b = dot(u, v)
    c = dot(u, w)
    e = dot(v, v)
    f = dot(v, w)
    s = 0.0
    t = 0.0
    if a <= MIN_SQUARED_LENGTH:
        if e > MIN_SQUARED_LENGTH:
            t = clamp(f / e, 0.0, 1.0)
    elif e <= MIN_SQUARED_LENGTH:
        s = clamp(-c / a, 0.0, 1.0)
    else:
        # Parallel segments have no unique nearest points: start from the middle.
        s = 0.5
        if a * e - b * b > 1e-9 * a * e:
            s = clamp((b * f - c * e) / (a * e - b * b), 0.0, 1.0)
        t = clamp((b * s + f) / e, 0.0, 1.0)
        s = clamp((b * t - c) / a, 0.0, 1.0)
        t = clamp((b * s + f) / e, 0.0, 1.0)
    d = subtract(add(w, scale(u, s)), scale(v, t))
    return s, t, math.sqrt(dot(d, d))
