"""The palm: wrist pose and palm joints from the markers r, p and q.

Two constructions: a rigid fit of the palm to its three markers, and the paper's
Σp ∨ Σq ∨ Φx, two spheres cut by the hand plane. The vector forms equal the paper's
conformal algebra; chirality settles its ±, so that the first frame needs no history.
"""

import math

from ..model.states import COINCIDENT, COLLINEAR, TOO_CLOSE, TOO_FAR_APART, TRACKED
from ..numerics.jit import jit
from ..numerics.vectors import (
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

ROUNDING = 1e-12  # below this share of the whole a difference is rounding


@jit
def triad(r, p, q):
    """Return the frame of the triangle r p q: y from q to p, z its dorsal normal.

    The normal of Φx (Eq. 8) is made unit length and points dorsally on a right hand,
    because p lies on the thumb's side of q.

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
def rigid_palm(r, p, q, template_r, template_p, template_q):
    """Return the pose of the palm that fits its three markers best.

    Kabsch's least-squares rotation in closed form: for two triangles of the same
    orientation it lays plane on plane and turns within the plane.

    Parameters
    ----------
    r, p, q : vector
        Markers [m]; not collinear.
    template_r, template_p, template_q : vector
        The same in the wrist's frame [m].

    Returns
    -------
    axes : frame
        Of the wrist.
    origin : vector
        The wrist [m].
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
def triad_palm(r, p, q, template_r, template_p, template_q):
    """Return the palm's pose as the paper has it: the plane Φx, the line pq and r.

    Parameters and returns as for `rigid_palm`; noise of r moves the wrist in full.
    """
    axes = compose(triad(r, p, q), inverse(triad(template_r, template_p, template_q)))
    return axes, subtract(r, rotate(axes, template_r))


@jit
def spheres_and_plane(p, q, radius_p, radius_q, normal, offset, side):
    """Return the joint on two spheres and a plane: Σp ∨ Σq ∨ Φ (Eqs. 3 to 5).

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
        Of the two solutions the one farther along this direction is taken.

    Returns
    -------
    vector
        Where the spheres do not meet (C² ≤ 0) the centre of their circle; where the
        plane misses the circle (B² ≤ 0) the circle's point nearest the plane [m].
    """
    span = subtract(q, p)
    d = length(span)
    size = max(radius_p, radius_q)
    if d <= ROUNDING * size:
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
    if s2 <= ROUNDING:
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
def spheres_joint(p, q, joint, template_r, template_p, template_q):
    """Return a palm joint by the paper's construction, in the wrist's frame.

    The plane is Φx moved in parallel through the joint's place in the template; the
    chirality of the template, the side of pq on which the joint lies, chooses the solution.

    Parameters
    ----------
    p, q : vector
        Markers in the frame of the wrist, as `triad_palm` places it [m].
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
def palm_fault(markers, template, stretch, shrink, flatness):
    """Return what is wrong with the triangle of the palm markers.

    Parameters
    ----------
    markers, template : ndarray, shape (3, 3)
        r, p, q as measured and on the hand [m].
    stretch, shrink : float
        Largest and least side allowed, as shares of the side on the hand.
    flatness : float
        Least area allowed for sides as long as these, as a share of that on the hand.

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
    if longest > stretch:
        return TOO_FAR_APART
    if longest < shrink:
        return TOO_CLOSE if shortest > 0.0 else COINCIDENT
    if shortest < shrink:
        return COINCIDENT
    if _area(markers) < flatness * size * size * _area(template):
        return COLLINEAR
    return TRACKED


@jit
def _area(points):
    r = vector(points[0])
    return 0.5 * length(cross(
        subtract(vector(points[1]), r), subtract(vector(points[2]), r)))


@jit
def place_palm(markers, template, by_spheres, rotation, position, roots):
    """Place the wrist and the first joints of the digits.

    Parameters
    ----------
    markers, template : ndarray, shape (3, 3)
        r, p, q as measured and on the hand [m].
    by_spheres : bool
        The paper's construction instead of the rigid fit.
    rotation, position : ndarray, shape (3, 3) and (3,)
        From the wrist's frame to that of the markers; replaced [m].
    roots : ndarray, shape (5, 3)
        First joints of the digits on the hand, in the wrist's frame. The paper's
        construction replaces those that carry no marker [m].
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
