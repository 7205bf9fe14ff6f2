"""How well a deformed skin still is one: its volume, and how much of it is inside itself."""

import math

import numpy as np

from ..core.numerics.jit import jit
from ..core.numerics.vectors import cross, dot, subtract, vector
from ..drawing.mesh import normals

OUTSIDE = 2e-4  # [m] off the skin, where it is looked whether there is flesh
EVERY = 3       # vertex is looked at


def volume(vertices, faces):
    """Return the volume that a mesh encloses [m³]."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    return np.einsum('fi,fi->', a, np.cross(b, c)) / 6.


def buried_share(vertices, faces):
    """Return the share of a mesh's vertices that are inside it: where it goes through itself.

    Just outside of a vertex the winding number of the mesh is 0, or 1 in other flesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.

    Returns
    -------
    float
        0 to 1.
    """
    places = (vertices + OUTSIDE * normals(vertices, faces))[::EVERY]
    return float(np.mean(winding_numbers(vertices[faces], places) > .5))


@jit
def winding_numbers(corners, places):
    """Return how often a mesh winds around places: van Oosterom and Strackee (1983).

    Parameters
    ----------
    corners : ndarray, shape (F, 3, 3)
    places : ndarray, shape (n, 3)

    Returns
    -------
    ndarray, shape (n,)
    """
    found = np.zeros(len(places))
    for i in range(len(places)):
        place = vector(places[i])
        for face in range(len(corners)):
            a = subtract(vector(corners[face, 0]), place)
            b = subtract(vector(corners[face, 1]), place)
            c = subtract(vector(corners[face, 2]), place)
            la, lb, lc = math.sqrt(dot(a, a)), math.sqrt(dot(b, b)), math.sqrt(dot(c, c))
            found[i] += math.atan2(
                dot(a, cross(b, c)),
                la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb)
    return found / (2. * math.pi)
