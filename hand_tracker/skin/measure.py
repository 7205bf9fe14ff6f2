"""Quality of a deformed skin: enclosed volume and self-intersection."""

import math

import numpy as np

from ..core.numerics.jit import jit
from ..core.numerics.vectors import cross, dot, subtract, vector
from ..drawing.mesh import vertex_normals

PROBE_OFFSET = 2e-4  # [m] outside of a vertex, at which the winding number is evaluated
PROBE_STRIDE = 3     # every third vertex is evaluated


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the volume that a closed mesh encloses [m³]."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    return np.einsum('fi,fi->', a, np.cross(b, c)) / 6.


def self_intersection_share(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the share of a mesh's vertices that lie inside the mesh.

    Just outside of a vertex the winding number of the mesh is 0, or 1 within another part of it.

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
    probes = (vertices + PROBE_OFFSET * vertex_normals(vertices, faces))[::PROBE_STRIDE]
    return float(np.mean(winding_numbers(vertices[faces], probes) > .5))


@jit
def winding_numbers(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the winding numbers of a mesh about points: van Oosterom and Strackee (1983).

    Parameters
    ----------
    corners : ndarray, shape (F, 3, 3)
        Of the triangles [m].
    points : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    ndarray, shape (n,)
    """
    winding = np.zeros(len(points))
    for i in range(len(points)):
        point = vector(points[i])
        for face in range(len(corners)):
            a = subtract(vector(corners[face, 0]), point)
            b = subtract(vector(corners[face, 1]), point)
            c = subtract(vector(corners[face, 2]), point)
            la, lb, lc = math.sqrt(dot(a, a)), math.sqrt(dot(b, b)), math.sqrt(dot(c, c))
            winding[i] += math.atan2(
                dot(a, cross(b, c)),
                la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb)
    return winding / (2. * math.pi)
