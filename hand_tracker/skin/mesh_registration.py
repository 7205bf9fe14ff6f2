"""Registration of a scanned hand mesh: read it from a file and align it with the hand model."""

from collections.abc import Iterator
from itertools import product
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..core.errors import InvalidMesh, MissingLibrary

MESH_FORMATS = ('.obj', '.ply', '.stl')
VERTEX_COUNT_RANGE = (200, 200_000)
COARSE_ICP_ROUNDS, FINE_ICP_ROUNDS = 15, 60
ICP_SAMPLES = 1500             # vertices of the mesh that are matched
MAX_REGISTRATION_ERROR = .010  # [m] mean distance from the model, above which it is no hand


class Similarity(NamedTuple):
    """Similarity transform x -> scale * rotation @ x + translation.

    Attributes
    ----------
    scale : float
    rotation : ndarray, shape (3, 3)
    translation : ndarray, shape (3,)
    """

    scale: float
    rotation: np.ndarray
    translation: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Return the transformed points, shape (n, 3)."""
        return self.scale * points @ self.rotation.T + self.translation


def read_mesh(path: str | PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """Read a closed mesh.

    Parameters
    ----------
    path : path-like
        OBJ, PLY or STL.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the file's unit.
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.

    Raises
    ------
    InvalidMesh
        Naming the file, what is wrong and what is expected.
    MissingLibrary
        If trimesh is not installed.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingLibrary('reading a mesh needs trimesh: pip install trimesh') from None
    path = Path(path).expanduser()
    if path.suffix.lower() not in MESH_FORMATS:
        raise InvalidMesh(f"{path}: '{path.suffix}'; expected is one of {', '.join(MESH_FORMATS)}")
    try:
        mesh = trimesh.load_mesh(path, process=True)
        if isinstance(mesh, trimesh.Scene):
            mesh = mesh.to_geometry()
        vertices = np.array(mesh.vertices, dtype=float)
        faces = np.array(mesh.faces, dtype=np.int64)
    except OSError as error:
        raise InvalidMesh(f'{path}: {error.strerror or error}') from None
    # trimesh's readers raise exceptions of any type on broken files.
    except Exception as error:
        raise InvalidMesh(f'{path}: no mesh: {error}') from None
    fewest, most = VERTEX_COUNT_RANGE
    if not fewest <= len(vertices) <= most:
        raise InvalidMesh(f'{path}: {len(vertices)} vertices; allowed is {fewest} to {most}')
    if not np.isfinite(vertices).all():
        raise InvalidMesh(f'{path}: vertices that are not finite')
    if not mesh.is_watertight:
        raise InvalidMesh(f'{path}: it has holes, or edges of more than two triangles; '
                          'expected is a closed mesh')
    if mesh.volume < 0.:
        faces = faces[:, ::-1].copy()
    return vertices, faces


def register(vertices: np.ndarray, model: np.ndarray) -> tuple[np.ndarray, float]:
    """Align vertices with a model by rotation, translation and scale.

    Iterated closest points, started from each rotation of the principal axes onto those of the
    model. Mirroring is excluded, so that a hand of the other side does not fit.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        In any unit.
    model : ndarray, shape (M, 3)
        [m]

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        Aligned [m].
    distance : float
        Mean distance between the nearest vertices of both, in both directions [m].
    """
    samples = vertices[::max(1, len(vertices) // ICP_SAMPLES)]
    tree = cKDTree(model)
    found = []
    for start in _principal_axis_alignments(samples, model):
        fit = _iterate_closest_points(samples, model, tree, start, COARSE_ICP_ROUNDS)
        found.append((_chamfer_distance(samples, model, tree, fit), fit))
    _, fit = min(found, key=lambda candidate: candidate[0])
    fit = _iterate_closest_points(samples, model, tree, fit, FINE_ICP_ROUNDS)
    return fit.apply(vertices), _chamfer_distance(samples, model, tree, fit)


def _principal_axis_alignments(vertices: np.ndarray, model: np.ndarray) -> Iterator[Similarity]:
    """Yield the proper similarities that carry principal axes onto principal axes."""
    middle, goal = vertices.mean(axis=0), model.mean(axis=0)
    size, axes = _principal_axes(vertices - middle)
    goal_size, goal_axes = _principal_axes(model - goal)
    scale = goal_size / size
    for signs in product((1., -1.), repeat=3):
        rotation = goal_axes @ np.diag(signs) @ axes.T
        if np.linalg.det(rotation) > 0.:
            yield Similarity(scale, rotation, goal - scale * rotation @ middle)


def _principal_axes(offsets: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the spread along the first principal axis, and the axes as columns."""
    _, values, axes = np.linalg.svd(offsets, full_matrices=False)
    return values[0] / np.sqrt(len(offsets)), axes.T


def _iterate_closest_points(vertices: np.ndarray, model: np.ndarray, tree: cKDTree,
                            fit: Similarity, rounds: int) -> Similarity:
    """Refine a similarity by rounds of closest points in both directions (ICP)."""
    for _ in range(rounds):
        placed = fit.apply(vertices)
        onto = model[tree.query(placed)[1]]
        back = cKDTree(placed).query(model[::4])[1]
        fit = _fit_similarity(np.concatenate((vertices, vertices[back])),
                              np.concatenate((onto, model[::4])))
    return fit


def _fit_similarity(points: np.ndarray, goals: np.ndarray) -> Similarity:
    """Return the least-squares similarity from points to goals, both (n, 3): Umeyama (1991)."""
    middle, goal = points.mean(axis=0), goals.mean(axis=0)
    centred, wanted = points - middle, goals - goal
    u, values, vt = np.linalg.svd(wanted.T @ centred)
    signs = np.array((1., 1., np.sign(np.linalg.det(u @ vt))))
    rotation = u * signs @ vt
    scale = values @ signs / np.einsum('ni,ni->', centred, centred)
    return Similarity(scale, rotation, goal - scale * rotation @ middle)


def _chamfer_distance(vertices: np.ndarray, model: np.ndarray, tree: cKDTree,
                      fit: Similarity) -> float:
    """Return the mean nearest distance of both point sets, averaged over both directions [m]."""
    placed = fit.apply(vertices)
    return .5 * (tree.query(placed)[0].mean() + cKDTree(placed).query(model)[0].mean())
