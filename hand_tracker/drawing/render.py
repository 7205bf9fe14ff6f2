"""Meshes as pictures, drawn in software: smooth shading, soft shadows, no display needed."""

from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit
from .mesh import normals

# Directions to the eye and up, of a right hand in the wrist's frame.
EYES = {'from above': ((0., 0., 1.), (1., 0., 0.)), 'the palm': ((0., 0., -1.), (1., 0., 0.)),
        'from the thumb': ((0., 1., 0.), (0., 0., 1.)),
        'from the front': ((1., .3, .5), (0., 0., 1.)),
        'aslant': ((.35, .5, .75), (1., 0., 0.))}
DISTANCE, AIR = .9, .006               # [m] of the eye, and around what fits a picture
KEY = np.array((-.15, .40, .90))       # where the light comes from: left, above, the eye's side
AMBIENT, DIRECT, SHEEN, RIM = .40, .66, .10, .16  # shares of light
SHINE = 24.                            # exponent of the sheen
SHADOW_PIXELS = 900                    # of the map of what the light sees, across
SHADOW_BLUR = 2.5                      # [pixels of it]
SHADOW_SAMPLES = range(-4, 5, 2)       # [pixels of it]
SHADOW_BIAS = .0022                    # [m] nearer than which nothing throws a shadow
ROUND = 24                             # corners of a circle


class Mesh(NamedTuple):
    """Triangles to draw.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        [m]
    faces : ndarray of int, shape (f, 3)
        Anticlockwise seen from outside.
    colours : array_like, shape (n, 3) or (3,)
        Of the vertices, or one for all: red, green, blue, 0 to 1.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray


class Camera(NamedTuple):
    """Where a picture is taken from.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Rows: the directions that run right, up and to the eye.
    centre : ndarray, shape (3,)
        In the middle of the picture [m].
    height : float
        Of what is seen at the centre [m].
    distance : float
        Of the eye from the centre [m].
    """

    axes: np.ndarray
    centre: np.ndarray
    height: float
    distance: float = DISTANCE

    def project(self, points, size):
        """Return where points are in a picture.

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            [m]
        size : tuple of int
            Width and height of the picture.

        Returns
        -------
        ndarray, shape (..., 3)
            Right and down [picture elements], and towards the eye [m].
        """
        seen = (points - self.centre) @ self.axes.T
        scale = size[1] / self.height / (1. - seen[..., 2] / self.distance)
        return np.stack((.5 * size[0] + scale * seen[..., 0],
                         .5 * size[1] - scale * seen[..., 1], seen[..., 2]), axis=-1)


def facing(towards_eye, up):
    """Return the axes of a camera: directions that run right, up and to the eye.

    Parameters
    ----------
    towards_eye, up : array_like, shape (3,)
        Of any length.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows.
    """
    eye = _unit(np.asarray(towards_eye, dtype=float))
    right = _unit(np.cross(up, eye))
    return np.array((right, np.cross(eye, right), eye))


def view_axes(view, side):
    """Return the axes of a camera that sees a hand in one of the usual ways.

    Parameters
    ----------
    view : str
        One of `EYES`.
    side : {'right', 'left'}

    Returns
    -------
    ndarray, shape (3, 3)
        As from `facing`, in the wrist's frame.
    """
    mirror = (1., 1. if side == 'right' else -1., 1.)
    return facing(*np.multiply(EYES[view], mirror))


def fitted(axes, points):
    """Return a camera whose square pictures have all of some points in them, and air around.

    Parameters
    ----------
    axes
        See `Camera`.
    points : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    Camera
    """
    seen = points @ axes.T
    middle = .5 * (seen.min(axis=0) + seen.max(axis=0))
    across, depth = np.abs(seen - middle)[:, :2].max(axis=1), (seen - middle)[:, 2]
    height = 2. * (across / (1. - depth / DISTANCE)).max()
    return Camera(axes, middle @ axes, height + 2. * AIR)


def render(meshes, camera, size, finer=3, shadows=True):
    """Return a picture of meshes on nothing.

    Parameters
    ----------
    meshes : sequence of Mesh
    camera : Camera
    size : tuple of int
        Width and height [picture elements].
    finer : int
        Picture elements drawn for one that is shown, across.
    shadows : bool
        Whether meshes throw them.

    Returns
    -------
    ndarray of uint8, shape (height, width, 4)
        Red, green, blue and opacity.
    """
    mesh = joined(meshes)
    fine = finer * size[0], finer * size[1]
    attributes = np.hstack((mesh.vertices, normals(mesh.vertices, mesh.faces), mesh.colours))
    shown = rasterized(camera.project(mesh.vertices, fine), mesh.faces, attributes, fine)
    there = np.isfinite(shown[..., 0])
    place, normal, colour = np.split(shown[there], 3, axis=1)
    image = np.zeros((*there.shape, 4))
    image[there, :3] = _lit(mesh, camera, place, _unit(normal), colour, shadows)
    image[there, 3] = 1.
    image = image.reshape(size[1], finer, size[0], finer, 4).mean(axis=(1, 3))
    # Colour that is mixed with nothing keeps its own.
    image[..., :3] /= np.maximum(image[..., 3:], 1e-9)
    return np.round(255. * np.clip(image, 0., 1.)).astype(np.uint8)


def _lit(mesh, camera, place, normal, colour, shadows):
    """Return the colours that a camera sees at places, shape (n, 3)."""
    light = _unit(KEY @ camera.axes)
    eye = camera.axes[2]
    facing = normal @ light
    # Flesh lets light through: it darkens late, and not at once.
    direct = np.clip((facing + .25) / 1.25, 0., 1.)
    if shadows:
        direct *= _lightness(mesh, light, place, normal)
    half = np.clip(normal @ _unit(light + eye), 0., 1.)
    sky = .5 + .5 * normal @ camera.axes[1]
    edge = (1. - np.clip(normal @ eye, 0., 1.)) ** 3
    shade = AMBIENT * (.6 + .4 * sky) + DIRECT * direct
    gloss = SHEEN * half ** SHINE * np.clip(direct, 0., 1.) + RIM * edge * sky
    return colour * shade[:, None] + gloss[:, None]


def _lightness(mesh, light, place, normal):
    """Return how much of a light reaches places: 0 in the shadow to 1, soft at its edge."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    across = 1.05 * np.linalg.norm(high - low)
    sun = Camera(facing(light, (.3, .5, .8)), .5 * (low + high), across, np.inf)
    size = SHADOW_PIXELS, SHADOW_PIXELS
    seen = sun.project(mesh.vertices, size)
    depth = rasterized(seen, mesh.faces, seen[:, 2:], size)[..., 0]
    depth = np.where(np.isfinite(depth), depth, -np.inf)
    x, y, own = sun.project(place + SHADOW_BIAS * normal, size).T
    column, row = np.round(x - .5).astype(int), np.round(y - .5).astype(int)
    found, weights = np.zeros(len(place)), 0.
    for right in SHADOW_SAMPLES:
        for down in SHADOW_SAMPLES:
            weight = np.exp(-.5 * (right ** 2 + down ** 2) / SHADOW_BLUR ** 2)
            nearest = depth[np.clip(row + down, 0, size[1] - 1),
                            np.clip(column + right, 0, size[0] - 1)]
            found += weight * (nearest <= own + SHADOW_BIAS)
            weights += weight
    return found / weights


def rasterized(points, faces, attributes, size):
    """Return the attributes of what is nearest at each picture element, NaN where nothing is.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Right, down [picture elements] and towards the eye.
    faces : ndarray of int, shape (f, 3)
    attributes : ndarray, shape (n, k)
        Of the vertices; linear within a triangle.
    size : tuple of int
        Width and height.

    Returns
    -------
    ndarray, shape (height, width, k)
    """
    shown = np.full((size[1], size[0], attributes.shape[1]), np.nan)
    _fill(np.ascontiguousarray(points), np.ascontiguousarray(faces),
          np.ascontiguousarray(attributes), np.full((size[1], size[0]), -np.inf), shown)
    return shown


@jit
def _fill(points, faces, attributes, depth, shown):
    height, width = depth.shape
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.:
            continue
        for row in range(max(0, int(min(ay, by, cy) - .5)),
                         min(height, int(max(ay, by, cy) + .5) + 1)):
            y = row + .5
            for column in range(max(0, int(min(ax, bx, cx) - .5)),
                                min(width, int(max(ax, bx, cx) + .5) + 1)):
                x = column + .5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1. - u - v
                if u < 0. or v < 0. or w < 0.:
                    continue
                near = u * points[a, 2] + v * points[b, 2] + w * points[c, 2]
                if near > depth[row, column]:
                    depth[row, column] = near
                    for k in range(attributes.shape[1]):
                        shown[row, column, k] = (u * attributes[a, k] + v * attributes[b, k]
                                                 + w * attributes[c, k])


def joined(meshes):
    """Return several meshes as one."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(np.vstack([mesh.vertices for mesh in meshes]),
                np.vstack([mesh.faces + start for mesh, start in zip(meshes, starts)]),
                np.vstack([np.broadcast_to(mesh.colours, mesh.vertices.shape)
                           for mesh in meshes]))


def bone(start, end, radius, end_radius, colour):
    """Return a round bone: a cone between two balls, which are one if both ends are.

    Parameters
    ----------
    start, end : ndarray, shape (3,)
        [m]
    radius, end_radius : float
        [m]
    colour : array_like, shape (3,)

    Returns
    -------
    Mesh
    """
    way = end - start
    length = np.linalg.norm(way)
    along = way / length if length else np.array((0., 0., 1.))
    aside = _unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    frame = np.array((aside, np.cross(along, aside), along))
    polar = np.linspace(-.5 * np.pi, .5 * np.pi, ROUND)
    first = polar < 0.
    rings = np.column_stack((np.where(first, radius, end_radius) * np.cos(polar),
                             np.where(first, radius, end_radius) * np.sin(polar)
                             + np.where(first, 0., length)))
    turn = 2. * np.pi * np.arange(ROUND) / ROUND
    local = np.stack(np.broadcast_arrays(
        rings[:, :1] * np.cos(turn), rings[:, :1] * np.sin(turn), rings[:, 1:]), axis=-1)
    ring, corner = np.meshgrid(np.arange(ROUND - 1), np.arange(ROUND), indexing='ij')
    here, beside = ROUND * ring + corner, ROUND * ring + (corner + 1) % ROUND
    faces = np.concatenate((np.stack((here, beside, here + ROUND), axis=-1).reshape(-1, 3),
                            np.stack((beside, beside + ROUND, here + ROUND),
                                     axis=-1).reshape(-1, 3)))
    vertices = start + local.reshape(-1, 3) @ frame
    return Mesh(vertices, faces, colour)


def ball(centre, radius, colour):
    """Return a ball; see `bone`."""
    return bone(centre, centre, radius, radius, colour)


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
