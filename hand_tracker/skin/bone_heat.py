"""How much each vertex follows each bone: bone heat.

Baran and Popovic, Automatic rigging and animation of 3D characters (2007), section 4: each
vertex is warmed by the nearest bone that it sees, and warmth spreads over the surface,
-Δw + H w = H p with H = c / d².
"""

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..drawing.mesh import normals
from .surface import neighbours

HEAT = 3.            # c; 1 in the paper, which leaves bent fingers thin
EQUALLY_NEAR = 1e-4  # share by which bones at one distance may differ
SMALLEST = 1e-3      # cotangents below would let weights leave 0 to 1


def bone_weights(vertices, faces, bones, carriers, count):
    """Return the weights of a mesh.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.
    bones : ndarray, shape (S, 2, 3)
        Ends of the bones [m].
    carriers : ndarray of int, shape (S,)
        Which column each bone's weight is added to.
    count : int
        Columns.

    Returns
    -------
    ndarray, shape (V, count)
        0 to 1; each row sums to 1.
    """
    nearest, distances = nearest_on_bones(vertices, bones)
    least = distances.min(axis=1)
    near = distances <= least[:, None] * (1. + EQUALLY_NEAR)
    first = nearest[np.arange(len(vertices)), near.argmax(axis=1)]
    seen = sees(vertices, faces, first)
    _, part = connected_components(neighbours(faces, len(vertices)), directed=False)
    # What sees no bone at all follows its nearest.
    seen |= ~np.isin(part, part[seen])
    source = np.zeros((len(vertices), count))
    np.add.at(source.T, carriers, (near / near.sum(axis=1, keepdims=True)).T)
    heat = areas(vertices, faces) * np.where(seen, HEAT / np.maximum(least, 1e-6)**2, 0.)
    solved = splu((laplacian(vertices, faces) + diags(heat)).tocsc()).solve(
        heat[:, None] * source)
    solved = np.clip(solved, 0., 1.)
    return solved / solved.sum(axis=1, keepdims=True)


def nearest_on_bones(vertices, bones):
    """Return the nearest point of each bone to each vertex (V, S, 3), and how far (V, S) [m]."""
    start, along = bones[:, 0], bones[:, 1] - bones[:, 0]
    square = np.maximum(np.einsum('si,si->s', along, along), 1e-18)
    t = np.clip(np.einsum('vsi,si->vs', vertices[:, None] - start, along) / square, 0., 1.)
    points = start + t[:, :, None] * along
    return points, np.linalg.norm(vertices[:, None] - points, axis=2)


def laplacian(vertices, faces):
    """Return the cotangent Laplacian, positive semidefinite, of no unit."""
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
    weights.data = np.maximum(weights.data, SMALLEST)
    return diags(np.asarray(weights.sum(axis=1)).ravel()) - weights


def areas(vertices, faces):
    """Return the area of each vertex: a third of its triangles', shape (V,) [m²]."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.
    return np.bincount(faces.ravel(), np.repeat(third, 3), len(vertices))


def sees(vertices, faces, targets):
    """Return whether the way from each vertex to its target is inside the mesh, shape (V,)."""
    way = targets - vertices
    length = np.linalg.norm(way, axis=1)
    inwards = np.einsum('vi,vi->v', way, normals(vertices, faces)) < 0.
    corners = vertices[faces]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max()
    # A triangle that meets the way has its centre near the way's middle.
    near = cKDTree(centres).query_ball_point(vertices + .5 * way, .5 * length + reach)
    vertex = np.repeat(np.arange(len(vertices)), [len(found) for found in near])
    face = np.concatenate([np.asarray(found, dtype=int) for found in near])
    own = (faces[face] == vertex[:, None]).any(axis=1)
    vertex, face = vertex[~own], face[~own]
    blocked = crosses(vertices[vertex], targets[vertex], corners[face])
    clear = np.ones(len(vertices), dtype=bool)
    clear[vertex[blocked]] = False
    return inwards & clear


def crosses(start, end, corners):
    """Return whether segments cross triangles, pair by pair: Möller and Trumbore (1997).

    Parameters
    ----------
    start, end : ndarray, shape (n, 3)
        [m]
    corners : ndarray, shape (n, 3, 3)
        [m]
    """
    way = end - start
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(way, v)
    scale = np.einsum('ni,ni->n', u, across)
    flat = np.abs(scale) < 1e-18
    scale = np.where(flat, 1., scale)
    off = start - corners[:, 0]
    s = np.einsum('ni,ni->n', off, across) / scale
    turned = np.cross(off, u)
    t = np.einsum('ni,ni->n', way, turned) / scale
    at = np.einsum('ni,ni->n', v, turned) / scale
    return ~flat & (s >= 0.) & (t >= 0.) & (s + t <= 1.) & (at > 0.) & (at < 1.)
