"""Bone heat skinning weights: which share of each vertex follows each bone.

Baran and Popovic, Automatic rigging and animation of 3D characters (2007), section 4: heat
equilibrium on the surface, where each vertex takes the temperature of its nearest visible bone,
-Δw + H w = H p with H = c / d².
"""

import numpy as np
from scipy.sparse import coo_matrix, diags, spmatrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..drawing.mesh import vertex_normals
from .surface import vertex_adjacency

HEAT_CONSTANT = 3.     # c; 1 in the paper, with which bent fingers get too thin
EQUIDISTANCE = 1e-4    # relative difference up to which two bones count as equally near
MIN_COTANGENT = 1e-3   # smaller ones would let weights leave 0 to 1
MIN_BONE_DISTANCE = 1e-6  # [m]


def bone_weights(vertices: np.ndarray, faces: np.ndarray, bones: np.ndarray,
                 columns: np.ndarray, count: int) -> np.ndarray:
    """Return the bone heat weights of a mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.
    bones : ndarray, shape (S, 2, 3)
        Ends of the bones [m].
    columns : ndarray of int, shape (S,)
        Column of the result to which each bone's weight is added.
    count : int
        Number of columns.

    Returns
    -------
    ndarray, shape (V, count)
        0 to 1; each row sums to 1.
    """
    closest, distances = _closest_points_on_bones(vertices, bones)
    least = distances.min(axis=1)
    near = distances <= least[:, None] * (1. + EQUIDISTANCE)
    target = closest[np.arange(len(vertices)), near.argmax(axis=1)]
    visible = _is_line_of_sight_inside(vertices, faces, target)
    _, part = connected_components(vertex_adjacency(faces, len(vertices)), directed=False)
    # A part of the mesh without any visible bone follows its nearest bones.
    visible |= ~np.isin(part, part[visible])
    source = np.zeros((len(vertices), count))
    np.add.at(source.T, columns, (near / near.sum(axis=1, keepdims=True)).T)
    heat = _vertex_areas(vertices, faces) * np.where(
        visible, HEAT_CONSTANT / np.maximum(least, MIN_BONE_DISTANCE)**2, 0.)
    solved = splu((_cotangent_laplacian(vertices, faces) + diags(heat)).tocsc()).solve(
        heat[:, None] * source)
    solved = np.clip(solved, 0., 1.)
    return solved / solved.sum(axis=1, keepdims=True)


def _closest_points_on_bones(vertices: np.ndarray,
                             bones: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the closest point of each bone to each vertex, and its distance.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        [m]
    bones : ndarray, shape (S, 2, 3)
        Ends of the bones [m].

    Returns
    -------
    points : ndarray, shape (V, S, 3)
        [m]
    distances : ndarray, shape (V, S)
        [m]
    """
    start, along = bones[:, 0], bones[:, 1] - bones[:, 0]
    square = np.maximum(np.einsum('si,si->s', along, along), 1e-18)
    t = np.clip(np.einsum('vsi,si->vs', vertices[:, None] - start, along) / square, 0., 1.)
    points = start + t[:, :, None] * along
    return points, np.linalg.norm(vertices[:, None] - points, axis=2)


def _cotangent_laplacian(vertices: np.ndarray, faces: np.ndarray) -> spmatrix:
    """Return the cotangent Laplacian of a mesh, positive semidefinite, shape (V, V) [1]."""
    rows, columns, values = [], [], []
    for corner in range(3):
        a, b, c = (faces[:, (corner + i) % 3] for i in range(3))
        u, v = vertices[b] - vertices[a], vertices[c] - vertices[a]
        cotangent = np.einsum('fi,fi->f', u, v) / np.maximum(
            np.linalg.norm(np.cross(u, v), axis=1), 1e-18)
        rows += [b, c]
        columns += [c, b]
        values += 2 * [.5 * cotangent]
    count = len(vertices)
    weights = coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                         (count, count)).tocsr()
    weights.data = np.maximum(weights.data, MIN_COTANGENT)
    return diags(np.asarray(weights.sum(axis=1)).ravel()) - weights


def _vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return a third of the area of each vertex's triangles, shape (V,) [m²]."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.
    return np.bincount(faces.ravel(), np.repeat(third, 3), len(vertices))


def _is_line_of_sight_inside(vertices: np.ndarray, faces: np.ndarray,
                             targets: np.ndarray) -> np.ndarray:
    """Test whether the segment from each vertex to its target stays inside the mesh.

    Parameters
    ----------
    vertices, targets : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.

    Returns
    -------
    ndarray of bool, shape (V,)
    """
    segments = targets - vertices
    length = np.linalg.norm(segments, axis=1)
    inwards = np.einsum('vi,vi->v', segments, vertex_normals(vertices, faces)) < 0.
    corners = vertices[faces]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max()
    # A triangle that meets a segment has its centre near the segment's middle.
    near = cKDTree(centres).query_ball_point(vertices + .5 * segments, .5 * length + reach)
    vertex = np.repeat(np.arange(len(vertices)), [len(found) for found in near])
    face = np.concatenate([np.asarray(found, dtype=int) for found in near])
    adjacent = (faces[face] == vertex[:, None]).any(axis=1)
    vertex, face = vertex[~adjacent], face[~adjacent]
    blocked = _segments_cross_triangles(vertices[vertex], targets[vertex], corners[face])
    clear = np.ones(len(vertices), dtype=bool)
    clear[vertex[blocked]] = False
    return inwards & clear


def _segments_cross_triangles(start: np.ndarray, end: np.ndarray,
                              corners: np.ndarray) -> np.ndarray:
    """Test n segments against n triangles, pair by pair: Möller and Trumbore (1997).

    Parameters
    ----------
    start, end : ndarray, shape (n, 3)
        Ends of the segments [m].
    corners : ndarray, shape (n, 3, 3)
        Corners of the triangles [m].

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    segment = end - start
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    segment_x_v = np.cross(segment, v)
    determinant = np.einsum('ni,ni->n', u, segment_x_v)
    parallel = np.abs(determinant) < 1e-18
    determinant = np.where(parallel, 1., determinant)
    offset = start - corners[:, 0]
    s = np.einsum('ni,ni->n', offset, segment_x_v) / determinant
    offset_x_u = np.cross(offset, u)
    t = np.einsum('ni,ni->n', segment, offset_x_u) / determinant
    along = np.einsum('ni,ni->n', v, offset_x_u) / determinant  # 0 at start, 1 at end
    return ~parallel & (s >= 0.) & (t >= 0.) & (s + t <= 1.) & (along > 0.) & (along < 1.)
