"""Inverse kinematics of the palm: wrist pose and palm joints from the markers r, p and q.

Two constructions: a rigid fit of the palm to its three markers, and the paper's Σp ∨ Σq ∨ Φx,
the intersection of two spheres with the hand plane. The vector forms equal the paper's conformal
geometric algebra; the hand's chirality resolves its ±, so that no history is needed.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.states import COINCIDENT, COLLINEAR, TOO_CLOSE, TOO_FAR_APART, TRACKED
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
    inverse,
    length,
    rotate,
    scale,
    subtract,
    unit,
    vector,
)

RELATIVE_ROUNDING = 1e-12  # [1] a difference below this share of the whole is rounding


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
def rigid_palm(r: Vector, p: Vector, q: Vector, template_r: Vector, template_p: Vector,
               template_q: Vector) -> tuple[Frame, Vector]:
    """Return the wrist pose of the least-squares rigid fit to the palm markers.

    Kabsch's rotation in closed form: of two triangles of the same orientation it aligns the
    planes and then turns within the plane.

    Parameters
    ----------
    r, p, q : vector
        Markers [m]; not collinear.
    template_r, template_p, template_q : vector
        The same markers in the wrist's frame [m].

    Returns
    -------
    axes : frame
        Axes of the wrist's frame.
    origin : vector
        Origin of the wrist's frame [m].
    """
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
def triad_palm(r: Vector, p: Vector, q: Vector, template_r: Vector, template_p: Vector,
               template_q: Vector) -> tuple[Frame, Vector]:
    """Return the wrist pose of the paper: orientation of Φx and the line pq, position of r.

    Parameters and returns as for `rigid_palm`. The wrist has the full noise of r.
    """
    axes = compose(triad(r, p, q), inverse(triad(template_r, template_p, template_q)))
    return axes, subtract(r, rotate(axes, template_r))


@jit
def spheres_and_plane(p: Vector, q: Vector, radius_p: float, radius_q: float, normal: Vector,
                      offset: float, side: Vector) -> Vector:
    """Intersect two spheres and a plane: Σp ∨ Σq ∨ Φ (Eqs. 3 to 5).

    Parameters
    ----------
    p, q : vector
        Centres of the spheres [m].
    radius_p, radius_q : float
        Distances of the joint from p and q [m].
    normal : vector
        Unit normal of the plane.
    offset : float
        Distance of the plane from the origin along `normal` [m].
    side : vector
        Direction that selects the farther one of the two solutions.

    Returns
    -------
    vector
        The joint; the centre of the spheres' circle where they do not meet (C² ≤ 0), the
        point of the circle nearest the plane where the plane misses it (B² ≤ 0) [m].
    """
    span = subtract(q, p)
    d = length(span)
    size = max(radius_p, radius_q)
    if d <= RELATIVE_ROUNDING * size:
        return p
    u = scale(span, 1.0 / d)
    a = (d * d + radius_p * radius_p - radius_q * radius_q) / (2.0 * d)
    center = add(p, scale(u, a))
    h2 = radius_p * radius_p - a * a
    if h2 <= 0.0:
        return center
    across = subtract(normal, scale(u, dot(normal, u)))
    s2 = dot(across, across)
    e = dot(normal, center) - offset
    if s2 <= RELATIVE_ROUNDING:
        toward = subtract(side, scale(u, dot(side, u)))
        return add(center, scale(unit(toward), math.sqrt(h2)))
    foot = subtract(center, scale(across, e / s2))
    b2 = h2 - e * e / s2
    if b2 <= 0.0:
        return subtract(center, scale(across, math.copysign(math.sqrt(h2 / s2), e)))
    chord = scale(cross(u, across), math.sqrt(b2 / s2))
    if dot(chord, side) < 0.0:
        chord = scale(chord, -1.0)
    return add(foot, chord)


@jit
def spheres_joint(p: Vector, q: Vector, joint: Vector, template_r: Vector, template_p: Vector,
                  template_q: Vector) -> Vector:
    """Return a palm joint by the paper's construction, in the wrist's frame.

    The plane is parallel to Φx through the joint's place in the template; the side of pq on
    which the joint lies there (chirality) selects the solution.

    Parameters
    ----------
    p, q : vector
        Markers in the wrist's frame of `triad_palm` [m].
    joint, template_r, template_p, template_q : vector
        The joint and the markers in the template [m].

    Returns
    -------
    vector
        [m]
    """
    axes = triad(template_r, template_p, template_q)
    normal = axes[2]
    away = subtract(joint, template_p)
    off_line = subtract(away, scale(axes[1], dot(away, axes[1])))
    return spheres_and_plane(
        p, q, distance(joint, template_p), distance(joint, template_q),
        normal, dot(normal, joint), off_line)


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
    if _area(markers) < limits.flatness * size * size * _area(template):
        return COLLINEAR
    return TRACKED


@jit
def _area(points: np.ndarray) -> float:
    """Return the area of a triangle, its corners as rows [m²]."""
    r = vector(points[0])
    return 0.5 * length(cross(
        subtract(vector(points[1]), r), subtract(vector(points[2]), r)))


@jit
def place_palm(markers: np.ndarray, template: np.ndarray, by_spheres: bool, rotation: np.ndarray,
               position: np.ndarray, roots: np.ndarray) -> None:
    """Place the wrist and the first joints of the digits by the palm's markers.

    Parameters
    ----------
    markers, template : ndarray, shape (3, >= 3) and (3, 3)
        r, p, q as measured and on the hand [m].
    by_spheres : bool
        Use the paper's construction instead of the rigid fit.
    rotation, position : ndarray, shape (3, 3) and (3,)
        Pose of the wrist in the markers' frame, replaced [m].
    roots : ndarray, shape (5, 3)
        First joints of the digits on the hand, in the wrist's frame; the paper's
        construction replaces them by measured ones [m].
    """
    r, p, q = vector(markers[0]), vector(markers[1]), vector(markers[2])
    tr, tp, tq = vector(template[0]), vector(template[1]), vector(template[2])
    if by_spheres:
        axes, origin = triad_palm(r, p, q, tr, tp, tq)
        p_local = components(axes, subtract(p, origin))
        q_local = components(axes, subtract(q, origin))
        for digit in (1, 2, 4):
            joint = spheres_joint(p_local, q_local, vector(roots[digit]), tr, tp, tq)
            for k in range(3):
                roots[digit, k] = joint[k]
        for k in range(3):
            roots[0, k] += p_local[k] - tp[k]
            roots[3, k] += q_local[k] - tq[k]
    else:
        axes, origin = rigid_palm(r, p, q, tr, tp, tq)
    for i in range(3):
        position[i] = origin[i]
        for k in range(3):
            rotation[i, k] = axes[k][i]
