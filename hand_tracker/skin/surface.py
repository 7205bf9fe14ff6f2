"""The mesh of a hand's flesh: marching cubes, then vertices spread evenly over the surface."""

import numpy as np
from scipy.sparse import coo_matrix

from ..core.errors import MissingLibrary
from ..drawing.mesh import normals
from .signed_distance import distance

SPACING = 3.1   # [mm of the mean hand] of the grid
MARGIN = 20.    # [mm of the mean hand] around the skeleton
ROUNDS = 6      # of spreading and returning to the surface


def surface(flesh):
    """Return the closed mesh of a hand's flesh.

    Parameters
    ----------
    flesh : Flesh

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.
    """
    try:
        from skimage.measure import marching_cubes
    except ImportError:
        raise MissingLibrary(
            'making the skin of a hand needs scikit-image: pip install scikit-image') from None
    step = SPACING * flesh.size
    low = flesh.points.min(axis=0) - (MARGIN + 8.) * flesh.size
    high = flesh.points.max(axis=0) + MARGIN * flesh.size
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high)]
    grid = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1)
    values = distance(flesh, grid.reshape(-1, 3)).reshape(grid.shape[:3])
    vertices, faces, _, _ = marching_cubes(values, 0., gradient_direction='descent')
    vertices, faces = low + step * vertices.astype(float), faces.astype(np.int64)
    for _ in range(ROUNDS):
        vertices = _returned(flesh, _spread(vertices, faces), .1 * step)
    return vertices, faces


def neighbours(faces, count):
    """Return which vertices an edge joins, as a symmetric sparse matrix of ones."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    joined = coo_matrix((np.ones(start.size), (start, end)), (count, count)).tocsr()
    joined = joined + joined.T
    joined.data[:] = 1.
    return joined


def _spread(vertices, faces):
    """Move vertices half way to the middle of their neighbours, along the surface."""
    joined = neighbours(faces, len(vertices))
    mean = joined @ vertices / joined.getnnz(axis=1)[:, None]
    move, normal = .5 * (mean - vertices), normals(vertices, faces)
    return vertices + move - np.einsum('vi,vi->v', move, normal)[:, None] * normal


def _returned(flesh, vertices, step):
    """Move vertices back onto the surface, by one step of Newton's method."""
    gradient = np.stack([
        (distance(flesh, vertices + h) - distance(flesh, vertices - h)) / (2. * step)
        for h in step * np.eye(3)], axis=1)
    square = np.maximum(np.einsum('vi,vi->v', gradient, gradient), .1)
    return vertices - (distance(flesh, vertices) / square)[:, None] * gradient
