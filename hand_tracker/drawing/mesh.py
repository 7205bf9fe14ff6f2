"""What meshes of triangles are made of, whoever draws or deforms them."""

import numpy as np


def normals(vertices, faces):
    """Return the unit normals of the vertices, outwards, shape (V, 3).

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.
    """
    a, b, c = vertices[faces].swapaxes(0, 1)
    found = np.stack([np.bincount(faces.ravel(), np.repeat(along, 3), len(vertices))
                      for along in np.cross(b - a, c - a).T], axis=1)
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)
