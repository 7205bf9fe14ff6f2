"""Inverse kinematics of the palm: wrist pose and palm joints from the markers r, p and q.

The paper's construction Σp ∨ Σq ∨ Φx, the intersection of two spheres with the hand plane; the
rigid fit of the palm to its three markers is `fit_wrist`, of the palm's triangle. The vector forms
equal the paper's conformal geometric algebra; the hand's chirality resolves its ±, so that no
history is needed.
"""

import math

import numpy as np

from ..model.palm_triangle import triad
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
    store,
    store_pose,
    subtract,
    unit,
    vector,
)

RELATIVE_ROUNDING = 1e-12  # [1] a difference below this share of the whole is rounding


@jit
def triad_palm(r: Vector, p: Vector, q: Vector, template_r: Vector, template_p: Vector,
               template_q: Vector) -> tuple[Frame, Vector]:
    """Return the wrist pose of the paper: orientation of Φx and the line pq, position of r.

    The wrist has the full noise of r.

    Parameters
    ----------
    r, p, q : vector
        Markers [m]; not collinear.
    template_r, template_p, template_q : vector
        The same markers in the wrist's frame [m].

    Returns
    -------
    axes, origin : frame, vector
        As of `rigid_palm`.
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
        Direction towards the wanted one of the two solutions.

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
def place_palm_by_spheres(markers: np.ndarray, template: np.ndarray, rotation: np.ndarray,
                          position: np.ndarray, roots: np.ndarray) -> None:
    """Place the wrist and the first joints of the digits by the paper's construction.

    Parameters
    ----------
    markers, template : ndarray, shape (>= 3, 3) and (3, 3)
        r, p, q as measured and on the hand [m].
    rotation, position : ndarray, shape (3, 3) and (3,)
        Pose of the wrist in the markers' frame, replaced [m].
    roots : ndarray, shape (5, 3)
        First joints of the digits on the hand, in the wrist's frame, replaced by those found [m].
    """
    r, p, q = vector(markers[0]), vector(markers[1]), vector(markers[2])
    tr, tp, tq = vector(template[0]), vector(template[1]), vector(template[2])
    axes, origin = triad_palm(r, p, q, tr, tp, tq)
    p_local = components(axes, subtract(p, origin))
    q_local = components(axes, subtract(q, origin))
    for digit in (1, 2, 4):
        store(roots, digit, spheres_joint(p_local, q_local, vector(roots[digit]), tr, tp, tq))
    for k in range(3):
        roots[0, k] += p_local[k] - tp[k]
        roots[3, k] += q_local[k] - tq[k]
    store_pose(rotation, position, axes, origin)
