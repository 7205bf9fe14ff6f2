"""Geometry of triangle meshes, for rendering and skinning."""

import numpy as np

from ..core.numerics.vectors import unit_vectors


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the outward unit normals of a mesh's vertices, weighted by area.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.

    Returns
    -------
    ndarray, shape (V, 3)
    """
    a, b, c = vertices[faces].swapaxes(0, 1)
    normals = np.stack([np.bincount(faces.ravel(), np.repeat(component, 3), len(vertices))
                        for component in np.cross(b - a, c - a).T], axis=1)
    return unit_vectors(normals)
