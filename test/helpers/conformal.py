"""The paper's conformal algebra, by multivectors: an oracle for the vector forms.

Blades are numbered by the bits of their basis vectors e1, e2, e3, e+ and e-; e- squares to -1.
"""

from __future__ import annotations

import numpy as np

BLADES = np.arange(32)
GRADE = np.array([bin(blade).count('1') for blade in BLADES])
PSEUDOSCALAR = 31


def sign_of_product(a, b):
    """Return the sign of the product of two blades: of their swaps, and of e-²."""
    swaps = sum(bin(a >> shift & b).count('1') for shift in range(1, 5))
    return (-1.) ** (swaps + (a & b & 16 > 0))


# GEOMETRIC[k, i, j]: what blades i and j give of blade k.
GEOMETRIC = np.zeros((32, 32, 32))
for i in BLADES:
    for j in BLADES:
        GEOMETRIC[i ^ j, i, j] = sign_of_product(i, j)
OUTER = GEOMETRIC * (GRADE[:, None, None] == GRADE[:, None] + GRADE)
INNER = (GEOMETRIC * (GRADE[:, None, None] == abs(GRADE[:, None] - GRADE))
         * (GRADE[:, None] * GRADE > 0))


class Multivector:
    """Sum of blades with geometric (`*`), outer (`^`) and inner (`|`) product."""

    def __init__(self, values):
        self.values = np.asarray(values, float)

    def __add__(self, other):
        return Multivector(self.values + other.values)

    def __rmul__(self, factor):
        return Multivector(factor * self.values)

    def __mul__(self, other):
        return self._product(GEOMETRIC, other)

    def __xor__(self, other):
        return self._product(OUTER, other)

    def __or__(self, other):
        return self._product(INNER, other)

    def __abs__(self):
        return np.linalg.norm(self.values)

    def _product(self, table, other):
        return Multivector(table @ other.values @ self.values)

    @property
    def scalar(self):
        return self.values[0]

    @property
    def euclidean(self):
        """Return the part of e1, e2 and e3 as an array."""
        return self.values[[1, 2, 4]]

    @property
    def dual(self):
        """Return the product with the inverse of the pseudoscalar, whose square is -1."""
        return -1. * self * blade(PSEUDOSCALAR)


def blade(number):
    return Multivector(BLADES == number)


E_PLUS, E_MINUS = blade(8), blade(16)
INFINITY = E_MINUS + E_PLUS
ORIGIN = .5 * (E_MINUS + -1. * E_PLUS)


def vector_of(v):
    """Return the Euclidean vector as a multivector."""
    values = np.zeros(32)
    values[[1, 2, 4]] = v
    return Multivector(values)


def up(point):
    """Return the null vector that stands for a Euclidean point."""
    point = np.asarray(point, float)
    return vector_of(point) + .5 * (point @ point) * INFINITY + ORIGIN


def down(null_vector):
    """Return the Euclidean point that a null vector of any weight stands for."""
    return null_vector.euclidean / -(null_vector | INFINITY).scalar


def plane_through(*points):
    """Return the unit normal and the offset of the plane P ∧ Q ∧ R ∧ n."""
    p, q, r = (up(point) for point in points)
    normal = (p ^ q ^ r ^ INFINITY).dual.euclidean
    normal = normal / np.linalg.norm(normal)
    return normal, float(normal @ points[0])


def spheres_and_plane(p, q, radius_p, radius_q, normal, offset):
    """Return the two points of Σp ∨ Σq ∨ Φ, or None where they are not real."""
    sphere_p = up(p) + -.5 * radius_p ** 2 * INFINITY
    sphere_q = up(q) + -.5 * radius_q ** 2 * INFINITY
    plane = vector_of(normal) + float(offset) * INFINITY
    pair = (sphere_p ^ sphere_q ^ plane).dual
    square = (pair * pair).scalar
    if square <= 0.:
        return None
    direction = -1. * (INFINITY | pair)
    inverse = 1. / (direction * direction).scalar * direction
    root = np.sqrt(square) * blade(0)
    return [down((pair + sign * root) * inverse) for sign in (1., -1.)]
