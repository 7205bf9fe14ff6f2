"""A person's own mesh of a hand: read from a file and laid upon the hand model."""

from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..core.errors import InvalidMesh, MissingLibrary

FORMATS = ('.obj', '.ply', '.stl')
VERTICES = (200, 200_000)  # fewest and most
ROUGH_ROUNDS, FINE_ROUNDS = 15, 60
SAMPLES = 1500             # vertices by which a mesh is laid upon the model
FARTHEST = .010            # [m] from the model's surface in the mean, of what is taken as a hand


def read_mesh(path):
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
    """
    try:
        import trimesh
    except ImportError:
        raise MissingLibrary('reading a mesh needs trimesh: pip install trimesh') from None
    path = Path(path).expanduser()
    if path.suffix.lower() not in FORMATS:
        raise InvalidMesh(f"{path}: '{path.suffix}'; expected is one of {', '.join(FORMATS)}")
    try:
        mesh = trimesh.load_mesh(path, process=True)
        if isinstance(mesh, trimesh.Scene):
            mesh = mesh.to_geometry()
        vertices = np.array(mesh.vertices, dtype=float)
        faces = np.array(mesh.faces, dtype=np.int64)
    except OSError as error:
        raise InvalidMesh(f'{path}: {error.strerror or error}') from None
    # Readers of broken files raise whatever they stumble over.
    except Exception as error:
        raise InvalidMesh(f'{path}: no mesh: {error}') from None
    fewest, most = VERTICES
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


def laid_upon(vertices, model):
    """Return vertices turned, moved and scaled so that they lie upon a model.

    Every turn of the main axes onto those of the model is tried, and the nearest refined by
    iterated closest points. A mirrored hand fits nowhere.

    Parameters
    ----------
    vertices, model : ndarray, shape (V, 3) and (M, 3)

    Returns
    -------
    vertices : ndarray, shape (V, 3)
    distance : float
        From the model's vertices in the mean, of those of the mesh and back [m].
    """
    some = vertices[::max(1, len(vertices) // SAMPLES)]
    tree = cKDTree(model)
    found = []
    for turn in _turns(some, model):
        fit = _refined(some, model, tree, turn, ROUGH_ROUNDS)
        found.append((_apart(some, model, tree, fit), fit))
    _, fit = min(found, key=lambda candidate: candidate[0])
    fit = _refined(some, model, tree, fit, FINE_ROUNDS)
    scale, rotation, shift = fit
    return scale * vertices @ rotation.T + shift, _apart(some, model, tree, fit)


def _turns(vertices, model):
    """Yield the similarities that carry main axes onto main axes, without mirroring."""
    middle, goal = vertices.mean(axis=0), model.mean(axis=0)
    size, axes = _main_axes(vertices - middle)
    goal_size, goal_axes = _main_axes(model - goal)
    scale = goal_size / size
    for signs in product((1., -1.), repeat=3):
        rotation = goal_axes @ np.diag(signs) @ axes.T
        if np.linalg.det(rotation) > 0.:
            yield scale, rotation, goal - scale * rotation @ middle


def _main_axes(offsets):
    _, values, axes = np.linalg.svd(offsets, full_matrices=False)
    return values[0] / np.sqrt(len(offsets)), axes.T


def _refined(vertices, model, tree, fit, rounds):
    """Return a similarity after rounds of closest points, both ways, and Umeyama's fit (1991)."""
    for _ in range(rounds):
        scale, rotation, shift = fit
        placed = scale * vertices @ rotation.T + shift
        onto = model[tree.query(placed)[1]]
        back = cKDTree(placed).query(model[::4])[1]
        fit = similarity(np.concatenate((vertices, vertices[back])),
                         np.concatenate((onto, model[::4])))
    return fit


def similarity(points, goals):
    """Return scale, rotation and shift that bring points nearest to goals."""
    middle, goal = points.mean(axis=0), goals.mean(axis=0)
    centred, wanted = points - middle, goals - goal
    u, values, vt = np.linalg.svd(wanted.T @ centred)
    signs = np.array((1., 1., np.sign(np.linalg.det(u @ vt))))
    rotation = u * signs @ vt
    scale = values @ signs / np.einsum('ni,ni->', centred, centred)
    return scale, rotation, goal - scale * rotation @ middle


def _apart(vertices, model, tree, fit):
    scale, rotation, shift = fit
    placed = scale * vertices @ rotation.T + shift
    return .5 * (tree.query(placed)[0].mean() + cKDTree(placed).query(model)[0].mean())
