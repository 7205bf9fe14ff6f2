"""Missing markers: for now they are held where they were in the palm's frame.

A hidden palm marker is carried by the palm markers that are seen, as rigidly as they
tell; a hidden finger marker moves with the palm.
"""

import math

from .jit import jit
from .palm import PalmState
from .vectors import (
    add, components, cross, dot, frame, length, mix, scale, subtract, turn, unit, vector)

# Kernels return plain integers.
TRACKED = int(PalmState.TRACKED)
CARRIED = int(PalmState.CARRIED)
LOST = int(PalmState.LOST)
WAITING = int(PalmState.WAITING)

FARTHEST = 1e3  # [m] a coordinate beyond this is no measurement


@jit
def visible(markers, seen):
    """Mark in `seen` which rows are measurements.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Replaced.
    """
    for i in range(markers.shape[0]):
        good = True
        for k in range(3):
            good = good and abs(markers[i, k]) <= FARTHEST  # false for NaN
        seen[i] = good


@jit
def reject_frozen(markers, seen, last, still, patience):
    """Take markers that some drivers repeat when they lost them for not seen.

    A marker is frozen when it stays in place to the last bit while at least two other
    markers of the palm move. One at the origin is left to whoever reads the messages.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Cleared where frozen.
    last : ndarray, shape (8, 3)
        The markers of the last frame, replaced [m].
    still : ndarray of int, shape (8,)
        Frames for which each marker has repeated its place, replaced.
    patience : int
        Frames after which it counts as frozen; 0 is never.
    """
    moved = 0
    for i in range(3):
        if seen[i] and not _same(markers[i], last[i]):
            moved += 1
    for i in range(markers.shape[0]):
        if not seen[i]:
            continue
        if not _same(markers[i], last[i]) or not markers[i].any():
            still[i] = 0
        elif moved >= 2:
            still[i] += 1
        for k in range(3):
            last[i, k] = markers[i, k]
        if 0 < patience <= still[i]:
            seen[i] = False


@jit
def _same(a, b):
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@jit
def complete_palm(markers, seen, template, rotation, position, placed):
    """Fill in the palm markers that are not seen.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        The first three rows that are not seen are replaced [m].
    seen : ndarray of bool, shape (8,)
    template : ndarray, shape (3, 3)
        The palm markers in the wrist's frame [m].
    rotation, position : ndarray, shape (3, 3) and (3,)
        The previous pose of the wrist [m].
    placed : bool
        Whether there is one.

    Returns
    -------
    int
        TRACKED, CARRIED, LOST or WAITING, of `PalmState`.
    """
    if seen[0] and seen[1] and seen[2]:
        return TRACKED
    if not placed:
        return WAITING
    if not (seen[0] or seen[1] or seen[2]):
        return LOST
    axes = frame(rotation)
    origin = vector(position)
    carried = carry_palm(
        (vector(markers[0]), vector(markers[1]), vector(markers[2])),
        (add(origin, mix(axes, vector(template[0]))),
         add(origin, mix(axes, vector(template[1]))),
         add(origin, mix(axes, vector(template[2])))),
        (seen[0], seen[1], seen[2]))
    for i in range(3):
        if not seen[i]:
            for k in range(3):
                markers[i, k] = carried[i][k]
    return CARRIED


@jit
def hold_digits(markers, seen, rotation, position, rest, local, known):
    """Take the digits' markers into the palm's frame, where the hidden ones are held.

    Parameters
    ----------
    markers : ndarray, shape (5, 3)
        [m]
    seen : ndarray of bool, shape (5,)
    rotation, position : ndarray, shape (3, 3) and (3,)
        Pose of the wrist [m].
    rest : ndarray, shape (5, 3)
        The markers of the hand at rest, in the wrist's frame: for those never seen [m].
    local : ndarray, shape (5, 3)
        The markers in the wrist's frame; rows that are seen are replaced [m].
    known : ndarray of bool, shape (5,)
        Set where a marker is seen.
    """
    axes = frame(rotation)
    origin = vector(position)
    for i in range(5):
        if seen[i]:
            known[i] = True
            v = components(axes, subtract(vector(markers[i]), origin))
            for k in range(3):
                local[i, k] = v[k]
        elif not known[i]:
            for k in range(3):
                local[i, k] = rest[i, k]


@jit
def carry_palm(points, expected, seen):
    """Return the three palm markers, the hidden ones carried by those seen.

    Parameters
    ----------
    points : tuple of three vectors
        Measured r, p, q; those not seen are not read [m].
    expected : tuple of three vectors
        Where the previous pose of the palm has them [m].
    seen : tuple of three bool

    Returns
    -------
    tuple of three vectors
        With one hidden the expected triangle turns by the smallest rotation that lays
        the seen side right; with two hidden it is shifted [m].
    """
    r, p, q = points
    if seen[0] and seen[1] and not seen[2]:
        q = _carry(r, p, expected[0], expected[1], expected[2])
    elif seen[0] and seen[2] and not seen[1]:
        p = _carry(r, q, expected[0], expected[2], expected[1])
    elif seen[1] and seen[2] and not seen[0]:
        r = _carry(p, q, expected[1], expected[2], expected[0])
    else:
        for i in range(3):
            if seen[i]:
                shift = subtract(points[i], expected[i])
                if not seen[0]:
                    r = add(expected[0], shift)
                if not seen[1]:
                    p = add(expected[1], shift)
                if not seen[2]:
                    q = add(expected[2], shift)
    return r, p, q


@jit
def _carry(a, b, expected_a, expected_b, expected_c):
    """Return c when a and b are seen and all three were expected elsewhere."""
    before = unit(subtract(expected_b, expected_a))
    now = unit(subtract(b, a))
    axis = cross(before, now)
    angle = math.atan2(length(axis), dot(before, now))
    middle = scale(add(a, b), 0.5)
    expected_middle = scale(add(expected_a, expected_b), 0.5)
    arm = subtract(expected_c, expected_middle)
    return add(middle, turn(unit(axis), angle, arm))
