"""Triangle mesh of a hand's surface: marching cubes, then relaxation to even triangles."""

from importlib import import_module

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from ..core.errors import MissingLibrary
from ..drawing.mesh import vertex_normals
from .signed_distance import HandShape, signed_distance

GRID_SPACING = 3.1   # [mm of the mean hand]
GRID_MARGIN = 20.    # [mm of the mean hand] around the skeleton
RELAXATION_ROUNDS = 6


def require_surface_library() -> None:
    """Raise a MissingLibrary where scikit-image is not installed, which makes the surface."""
    try:
        import_module('skimage.measure')
    except ImportError:
        raise MissingLibrary(
            'making the skin of a hand needs scikit-image: pip install scikit-image, or this '
            'package with its extra view') from None


def surface_mesh(shape: HandShape) -> tuple[np.ndarray, np.ndarray]:
    """Return the closed mesh of a hand's surface.

    Parameters
    ----------
    shape : HandShape

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.

    Raises
    ------
    MissingLibrary
        If scikit-image is not installed.
    """
    require_surface_library()
    from skimage.measure import marching_cubes

    step = GRID_SPACING * shape.millimetre
    low = shape.points.min(axis=0) - (GRID_MARGIN + 8.) * shape.millimetre
    high = shape.points.max(axis=0) + GRID_MARGIN * shape.millimetre
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high)]
    grid = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1)
    values = signed_distance(shape, grid.reshape(-1, 3)).reshape(grid.shape[:3])
    vertices, faces, _, _ = marching_cubes(values, 0., gradient_direction='descent')
    vertices, faces = low + step * vertices.astype(float), faces.astype(np.int64)
    for _ in range(RELAXATION_ROUNDS):
        vertices = _project_to_surface(shape, _relax_tangentially(vertices, faces), .1 * step)
    return vertices, faces


def vertex_adjacency(faces: np.ndarray, count: int) -> csr_matrix:
    """Return the symmetric adjacency matrix of `count` vertices: 1 where an edge joins two."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    adjacency = coo_matrix((np.ones(start.size), (start, end)), (count, count)).tocsr()
    adjacency = adjacency + adjacency.T
    adjacency.data[:] = 1.
    return adjacency


def _relax_tangentially(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Move vertices half way to the mean of their neighbours, within the tangent plane."""
    adjacency = vertex_adjacency(faces, len(vertices))
    mean = adjacency @ vertices / adjacency.getnnz(axis=1)[:, None]
    move, normal = .5 * (mean - vertices), vertex_normals(vertices, faces)
    return vertices + move - np.einsum('vi,vi->v', move, normal)[:, None] * normal


def _project_to_surface(shape: HandShape, vertices: np.ndarray, step: float) -> np.ndarray:
    """Move vertices onto the surface by one Newton step, with central differences [m]."""
    gradient = np.stack([
        (signed_distance(shape, vertices + h) - signed_distance(shape, vertices - h))
        / (2. * step) for h in step * np.eye(3)], axis=1)
    square = np.maximum(np.einsum('vi,vi->v', gradient, gradient), .1)
    return vertices - (signed_distance(shape, vertices) / square)[:, None] * gradient
