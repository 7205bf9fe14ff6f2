"""Software renderer of meshes: perspective, smooth shading, soft shadows; no display needed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.numerics.jit import jit
from ..core.numerics.vectors import unit_vectors
from .mesh import vertex_normals

# Directions to the eye and up, for a right hand in the wrist frame.
VIEW_DIRECTIONS = {
    'from above': ((0., 0., 1.), (1., 0., 0.)), 'the palm': ((0., 0., -1.), (1., 0., 0.)),
    'from the thumb': ((0., 1., 0.), (0., 0., 1.)),
    'from the front': ((1., .3, .5), (0., 0., 1.)),
    'aslant': ((.35, .5, .75), (1., 0., 0.))}
EYE_DISTANCE = .9                      # [m]
FRAMING_MARGIN = .006                  # [m]
LIGHT_DIRECTION = np.array((-.15, .40, .90))  # towards the light, in the camera's axes
AMBIENT_SHARE, DIFFUSE_SHARE, SPECULAR_SHARE, RIM_SHARE = .40, .66, .10, .16
SPECULAR_EXPONENT = 24.
SHADOW_MAP_SIZE = 900                  # [px] across
SHADOW_BLUR = 2.5                      # [px of the shadow map] standard deviation
SHADOW_SAMPLES = range(-4, 5, 2)       # [px of the shadow map]
SHADOW_BIAS = .0022                    # [m] within which nothing casts a shadow
CIRCLE_SEGMENTS = 24


class Mesh(NamedTuple):
    """Triangle mesh with colours.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        [m]
    faces : ndarray of int, shape (f, 3)
        Anticlockwise seen from outside.
    colours : array_like, shape (n, 3) or (3,)
        Red, green and blue of each vertex, or of all, 0 to 1.
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: ArrayLike


class Camera(NamedTuple):
    """Perspective camera.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Rows: unit directions right, up and towards the eye.
    centre : ndarray, shape (3,)
        Point in the middle of the picture [m].
    height : float
        Visible height at the centre [m].
    distance : float
        From the centre to the eye [m].
    """

    axes: np.ndarray
    centre: np.ndarray
    height: float
    distance: float = EYE_DISTANCE

    def project(self, points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Project points into a picture.

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            [m]
        size : tuple of int
            Width and height of the picture [px].

        Returns
        -------
        ndarray, shape (..., 3)
            Right and down from the upper left corner [px], and towards the eye [m].
        """
        local = (points - self.centre) @ self.axes.T
        scale = size[1] / self.height / (1. - local[..., 2] / self.distance)
        return np.stack((.5 * size[0] + scale * local[..., 0],
                         .5 * size[1] - scale * local[..., 1], local[..., 2]), axis=-1)


def camera_axes(towards_eye: ArrayLike, up: ArrayLike) -> np.ndarray:
    """Return the axes of a camera from its viewing direction.

    Parameters
    ----------
    towards_eye, up : array_like, shape (3,)
        Of any length.

    Returns
    -------
    ndarray, shape (3, 3)
        Rows: unit directions right, up and towards the eye.
    """
    eye = unit_vectors(np.asarray(towards_eye, dtype=float))
    right = unit_vectors(np.cross(np.asarray(up), eye))
    return np.array((right, np.cross(eye, right), eye))


def view_axes(view: str, side: str) -> np.ndarray:
    """Return the axes of a camera for a named view of a hand.

    Parameters
    ----------
    view : str
        One of `VIEW_DIRECTIONS`.
    side : {'right', 'left'}

    Returns
    -------
    ndarray, shape (3, 3)
        As from `camera_axes`, in the wrist frame.
    """
    mirror = (1., 1. if side == 'right' else -1., 1.)
    return camera_axes(*np.multiply(VIEW_DIRECTIONS[view], mirror))


def fitting_camera(axes: np.ndarray, points: np.ndarray) -> Camera:
    """Return a camera whose square picture holds all of some points, with a margin.

    Parameters
    ----------
    axes : ndarray, shape (3, 3)
        See `Camera`.
    points : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    Camera
    """
    local = points @ axes.T
    middle = .5 * (local.min(axis=0) + local.max(axis=0))
    across, depth = np.abs(local - middle)[:, :2].max(axis=1), (local - middle)[:, 2]
    height = 2. * (across / (1. - depth / EYE_DISTANCE)).max()
    return Camera(axes, middle @ axes, height + 2. * FRAMING_MARGIN)


def render(meshes: Sequence[Mesh], camera: Camera, size: tuple[int, int],
           supersampling: int = 3, shadows: bool = True) -> np.ndarray:
    """Render meshes on a transparent background.

    Parameters
    ----------
    meshes : sequence of Mesh
    camera : Camera
    size : tuple of int
        Width and height [px].
    supersampling : int
        Rows and columns that are averaged to one.
    shadows : bool
        Cast shadows.

    Returns
    -------
    ndarray of uint8, shape (height, width, 4)
        Red, green, blue and opacity.
    """
    mesh = merge_meshes(meshes)
    fine_size = supersampling * size[0], supersampling * size[1]
    attributes = np.hstack(
        (mesh.vertices, vertex_normals(mesh.vertices, mesh.faces), mesh.colours))
    pixels = _rasterize(camera.project(mesh.vertices, fine_size), mesh.faces, attributes, fine_size)
    covered = np.isfinite(pixels[..., 0])
    position, normal, colour = np.split(pixels[covered], 3, axis=1)
    image = np.zeros((*covered.shape, 4))
    image[covered, :3] = _shade(mesh, camera, position, unit_vectors(normal), colour, shadows)
    image[covered, 3] = 1.
    image = image.reshape(size[1], supersampling, size[0], supersampling, 4).mean(axis=(1, 3))
    # Undo the averaging with empty pixels: opacity carries it.
    image[..., :3] /= np.maximum(image[..., 3:], 1e-9)
    return np.round(255. * np.clip(image, 0., 1.)).astype(np.uint8)


def _shade(mesh: Mesh, camera: Camera, position: np.ndarray, normal: np.ndarray,
           colour: np.ndarray, shadows: bool) -> np.ndarray:
    """Return the shaded colours of n points of a surface, shape (n, 3)."""
    light = unit_vectors(LIGHT_DIRECTION @ camera.axes)
    eye = camera.axes[2]
    cosine = normal @ light
    # Wrapped diffuse light: skin scatters light past the terminator.
    diffuse = np.clip((cosine + .25) / 1.25, 0., 1.)
    if shadows:
        diffuse *= _light_visibility(mesh, light, position, normal)
    half = np.clip(normal @ unit_vectors(light + eye), 0., 1.)
    sky = .5 + .5 * normal @ camera.axes[1]
    rim = (1. - np.clip(normal @ eye, 0., 1.)) ** 3
    shade = AMBIENT_SHARE * (.6 + .4 * sky) + DIFFUSE_SHARE * diffuse
    gloss = (SPECULAR_SHARE * half ** SPECULAR_EXPONENT * np.clip(diffuse, 0., 1.)
             + RIM_SHARE * rim * sky)
    return colour * shade[:, None] + gloss[:, None]


def _light_visibility(mesh: Mesh, light: np.ndarray, position: np.ndarray,
                      normal: np.ndarray) -> np.ndarray:
    """Return the unshadowed share of a light at n points, by a blurred shadow map, shape (n,)."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    across = 1.05 * float(np.linalg.norm(high - low))
    sun = Camera(camera_axes(light, (.3, .5, .8)), .5 * (low + high), across, np.inf)
    size = SHADOW_MAP_SIZE, SHADOW_MAP_SIZE
    projected = sun.project(mesh.vertices, size)
    depth = _rasterize(projected, mesh.faces, projected[:, 2:], size)[..., 0]
    depth = np.where(np.isfinite(depth), depth, -np.inf)
    x, y, point_depth = sun.project(position + SHADOW_BIAS * normal, size).T
    column, row = np.round(x - .5).astype(int), np.round(y - .5).astype(int)
    lit, weights = np.zeros(len(position)), 0.
    for right in SHADOW_SAMPLES:
        for down in SHADOW_SAMPLES:
            weight = np.exp(-.5 * (right ** 2 + down ** 2) / SHADOW_BLUR ** 2)
            nearest = depth[np.clip(row + down, 0, size[1] - 1),
                            np.clip(column + right, 0, size[0] - 1)]
            lit += weight * (nearest <= point_depth + SHADOW_BIAS)
            weights += weight
    return lit / weights


def _rasterize(points: np.ndarray, faces: np.ndarray, attributes: np.ndarray,
               size: tuple[int, int]) -> np.ndarray:
    """Interpolate vertex attributes at each pixel, on the triangle nearest to the eye.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices: right and down [px], and towards the eye.
    faces : ndarray of int, shape (f, 3)
    attributes : ndarray, shape (n, k)
        Of the vertices; linear within a triangle.
    size : tuple of int
        Width and height [px].

    Returns
    -------
    ndarray, shape (height, width, k)
        NaN where there is no triangle.
    """
    pixels = np.full((size[1], size[0], attributes.shape[1]), np.nan)
    _fill(np.ascontiguousarray(points), np.ascontiguousarray(faces),
          np.ascontiguousarray(attributes), np.full((size[1], size[0]), -np.inf), pixels)
    return pixels


@jit
def _fill(points: np.ndarray, faces: np.ndarray, attributes: np.ndarray, depth: np.ndarray,
          pixels: np.ndarray) -> None:
    """Fill pixels (height, width, k) with attributes, and their depth buffer (height, width)."""
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
                        pixels[row, column, k] = (u * attributes[a, k] + v * attributes[b, k]
                                                  + w * attributes[c, k])


def merge_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one, with a colour for each vertex."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(np.vstack([mesh.vertices for mesh in meshes]),
                np.vstack([mesh.faces + start for mesh, start in zip(meshes, starts)]),
                np.vstack([np.broadcast_to(mesh.colours, mesh.vertices.shape)
                           for mesh in meshes]))


def bone_mesh(start: np.ndarray, end: np.ndarray, radius: float, end_radius: float,
              colour: ArrayLike) -> Mesh:
    """Return a tapered capsule; a sphere if both ends coincide.

    Parameters
    ----------
    start, end : ndarray, shape (3,)
        Centres of its ends [m].
    radius, end_radius : float
        [m]
    colour : array_like, shape (3,)
        Red, green and blue, 0 to 1.

    Returns
    -------
    Mesh
    """
    offset = end - start
    length = np.linalg.norm(offset)
    along = offset / length if length else np.array((0., 0., 1.))
    aside = unit_vectors(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    frame = np.array((aside, np.cross(along, aside), along))
    segments = CIRCLE_SEGMENTS
    polar = np.linspace(-.5 * np.pi, .5 * np.pi, segments)
    first = polar < 0.
    rings = np.column_stack((np.where(first, radius, end_radius) * np.cos(polar),
                             np.where(first, radius, end_radius) * np.sin(polar)
                             + np.where(first, 0., length)))
    turn = 2. * np.pi * np.arange(segments) / segments
    local = np.stack(np.broadcast_arrays(
        rings[:, :1] * np.cos(turn), rings[:, :1] * np.sin(turn), rings[:, 1:]), axis=-1)
    ring, corner = np.meshgrid(np.arange(segments - 1), np.arange(segments), indexing='ij')
    here, beside = segments * ring + corner, segments * ring + (corner + 1) % segments
    faces = np.concatenate((np.stack((here, beside, here + segments), axis=-1).reshape(-1, 3),
                            np.stack((beside, beside + segments, here + segments),
                                     axis=-1).reshape(-1, 3)))
    vertices = start + local.reshape(-1, 3) @ frame
    return Mesh(vertices, faces, colour)


def ball_mesh(centre: np.ndarray, radius: float, colour: ArrayLike) -> Mesh:
    """Return a sphere of a radius [m]; see `bone_mesh`."""
    return bone_mesh(centre, centre, radius, radius, colour)
