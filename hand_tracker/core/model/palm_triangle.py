"""The palm as the triangle of its markers r, p and q: wrist pose, hidden corners, faults."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit
from ..numerics.vectors import (
    Frame,
    Vector,
    add,
    components,
    compose,
    cross,
    distance,
    dot,
    frame,
    inverse,
    length,
    rotate,
    rotate_about,
    scale,
    store_pose,
    subtract,
    triangle_area,
    unit,
    vector,
)
from .states import COINCIDENT, COLLINEAR, TOO_CLOSE, TOO_FAR_APART, TRACKED

Corners = tuple[Vector, Vector, Vector]  # r, p, q [m]


class Wrist(NamedTuple):
    """Pose of the wrist.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        From the wrist's frame to the markers' frame.
    position : ndarray, shape (3,)
        Origin of the wrist's frame in the markers' frame [m].
    placed : ndarray of bool, shape (1,)
        Whether the palm has been seen, so that the pose is a measured one.
    """

    rotation: np.ndarray
    position: np.ndarray
    placed: np.ndarray


def wrist_at_origin() -> Wrist:
    """Return the `Wrist` before the palm is first seen."""
    return Wrist(np.eye(3), np.zeros(3), np.zeros(1, dtype=bool))


@jit
def triad(r: Vector, p: Vector, q: Vector) -> Frame:
    """Return the frame of the triangle r p q: y from q to p, z its dorsal normal.

    z is the unit normal of the hand plane Φx (Eq. 8); it points dorsally on a right hand,
    where p lies on the thumb's side of q.

    Parameters
    ----------
    r, p, q : vector
        Wrist, index and little knuckle [m]; not collinear.

    Returns
    -------
    frame
    """
    y = unit(subtract(p, q))
    z = unit(cross(subtract(q, r), subtract(p, r)))
    return (cross(y, z), y, z)


@jit
def rigid_palm(corners: Corners, template: np.ndarray) -> tuple[Frame, Vector]:
    """Return the wrist pose of the least-squares rigid fit to the palm markers.

    Kabsch's rotation in closed form: of two triangles of the same orientation it aligns the
    planes and then turns within the plane.

    Parameters
    ----------
    corners : tuple of three vectors
        Markers r, p, q [m]; not collinear.
    template : ndarray, shape (3, 3)
        The same markers in the wrist's frame [m].

    Returns
    -------
    axes : frame
        Axes of the wrist's frame.
    origin : vector
        Origin of the wrist's frame [m].
    """
    r, p, q = corners
    template_r, template_p, template_q = (
        vector(template[0]), vector(template[1]), vector(template[2]))
    center = scale(add(add(r, p), q), 1.0 / 3.0)
    template_center = scale(add(add(template_r, template_p), template_q), 1.0 / 3.0)
    axes = triad(r, p, q)
    template_axes = triad(template_r, template_p, template_q)
    sine = 0.0
    cosine = 0.0
    for marker, rest in ((r, template_r), (p, template_p), (q, template_q)):
        a = components(axes, subtract(marker, center))
        b = components(template_axes, subtract(rest, template_center))
        sine += b[0] * a[1] - b[1] * a[0]
        cosine += b[0] * a[0] + b[1] * a[1]
    size = math.sqrt(sine * sine + cosine * cosine)
    s = sine / size
    c = cosine / size
    turned = (
        add(scale(axes[0], c), scale(axes[1], s)),
        add(scale(axes[1], c), scale(axes[0], -s)),
        axes[2])
    fitted = compose(turned, inverse(template_axes))
    return fitted, subtract(center, rotate(fitted, template_center))


@jit
def fit_wrist(markers: np.ndarray, template: np.ndarray, rotation: np.ndarray,
              position: np.ndarray) -> None:
    """Place the wrist by the rigid fit to the palm's markers.

    Parameters
    ----------
    markers, template : ndarray, shape (>= 3, 3) and (3, 3)
        r, p, q as measured, not collinear, and on the hand [m].
    rotation, position : ndarray, shape (3, 3) and (3,)
        Pose of the wrist in the markers' frame, replaced [m].
    """
    axes, origin = rigid_palm((vector(markers[0]), vector(markers[1]), vector(markers[2])),
                              template)
    store_pose(rotation, position, axes, origin)


@jit
def palm_places(template: np.ndarray, wrist: Wrist) -> Corners:
    """Return the palm's markers at a pose of the wrist, three vectors [m].

    Parameters
    ----------
    template : ndarray, shape (3, 3)
        The markers in the wrist's frame [m].
    wrist : Wrist
    """
    axes = frame(wrist.rotation)
    origin = vector(wrist.position)
    return (add(origin, rotate(axes, vector(template[0]))),
            add(origin, rotate(axes, vector(template[1]))),
            add(origin, rotate(axes, vector(template[2]))))


@jit
def complete_palm(points: Corners, expected: Corners, seen: tuple[bool, bool, bool]) -> Corners:
    """Return the three palm markers, the hidden ones completed rigidly from the seen ones.

    With one hidden the expected triangle turns by the smallest rotation that lays its seen
    side on the measured one; with two hidden it is shifted.

    Parameters
    ----------
    points : tuple of three vectors
        Measured r, p, q; hidden ones are not read [m].
    expected : tuple of three vectors
        The same at the previous pose of the palm [m].
    seen : tuple of three bool

    Returns
    -------
    tuple of three vectors
        [m]
    """
    r, p, q = points
    if seen[0] and seen[1] and not seen[2]:
        q = _third_corner(r, p, expected[0], expected[1], expected[2])
    elif seen[0] and seen[2] and not seen[1]:
        p = _third_corner(r, q, expected[0], expected[2], expected[1])
    elif seen[1] and seen[2] and not seen[0]:
        r = _third_corner(p, q, expected[1], expected[2], expected[0])
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
def _third_corner(a: Vector, b: Vector, expected_a: Vector, expected_b: Vector,
                  expected_c: Vector) -> Vector:
    """Return the hidden corner c of a rigid triangle by its seen corners a and b [m]."""
    before = unit(subtract(expected_b, expected_a))
    now = unit(subtract(b, a))
    axis = cross(before, now)
    angle = math.atan2(length(axis), dot(before, now))
    middle = scale(add(a, b), 0.5)
    expected_middle = scale(add(expected_a, expected_b), 0.5)
    arm = subtract(expected_c, expected_middle)
    return add(middle, rotate_about(unit(axis), angle, arm))


class PalmLimits(NamedTuple):
    """Limits within which three markers are a hand's palm, as shares of the hand's own.

    Attributes
    ----------
    stretch, shrink : float
        Largest and smallest length of a side [1].
    flatness : float
        Smallest area for the mean length of the sides [1].
    """

    stretch: float
    shrink: float
    flatness: float


@jit
def palm_fault(markers: np.ndarray, template: np.ndarray, limits: PalmLimits) -> int:
    """Compare the triangle of the palm markers with the hand's.

    Parameters
    ----------
    markers, template : ndarray, shape (3, 3)
        r, p, q as measured and on the hand [m].
    limits : PalmLimits

    Returns
    -------
    int
        TRACKED, or the `PalmState` that names the fault.
    """
    longest = 0.0
    shortest = math.inf
    size = 0.0
    for i, j in ((0, 1), (1, 2), (2, 0)):
        ratio = distance(vector(markers[i]), vector(markers[j])) / distance(
            vector(template[i]), vector(template[j]))
        longest = max(longest, ratio)
        shortest = min(shortest, ratio)
        size += ratio / 3.0
    if longest > limits.stretch:
        return TOO_FAR_APART
    if longest < limits.shrink:
        return TOO_CLOSE if shortest > 0.0 else COINCIDENT
    if shortest < limits.shrink:
        return COINCIDENT
    if triangle_area(markers) < limits.flatness * size * size * triangle_area(template):
        return COLLINEAR
    return TRACKED
