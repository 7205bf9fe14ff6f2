"""The paper's conformal algebra, by the clifford package: an oracle for the vector forms."""

import numpy as np
from clifford.g3c import down, e1, e2, e3, einf, up


def to_multivector(v):
    """Return the Euclidean vector as a multivector."""
    return float(v[0]) * e1 + float(v[1]) * e2 + float(v[2]) * e3


def to_array(multivector):
    """Return the Euclidean part of a vector as an array."""
    return np.array([float((multivector | e)[()]) for e in (e1, e2, e3)])


def plane_through(*points):
    """Return the unit normal and the offset of the plane P ∧ Q ∧ R ∧ n, and its dual."""
    p, q, r = (up(to_multivector(point)) for point in points)
    dual = (p ^ q ^ r ^ einf).dual()
    normal = to_array(dual)
    dual = dual / np.linalg.norm(normal)
    normal = normal / np.linalg.norm(normal)
    return normal, float(normal @ points[0]), dual


def spheres_and_plane(p, q, radius_p, radius_q, normal, offset):
    """Return the two points of Σp ∨ Σq ∨ Φ, or None where they are not real."""
    sphere_p = up(to_multivector(p)) - 0.5 * radius_p ** 2 * einf
    sphere_q = up(to_multivector(q)) - 0.5 * radius_q ** 2 * einf
    plane = to_multivector(normal) + float(offset) * einf
    pair = (sphere_p ^ sphere_q ^ plane).dual()
    square = float((pair * pair)[()])
    if square <= 0.0:
        return None
    root = np.sqrt(square)
    direction = -(einf | pair)
    inverse = direction.inv()
    return [to_array(down((pair + sign * root) * inverse)) for sign in (1.0, -1.0)]
