"""A robot's primitive shapes and a ball in its hand, drawn at several moments."""

from collections.abc import Sequence
from os import PathLike
from typing import NamedTuple

import numpy as np

from .images import blank_figure, place_image, write_figure, write_text
from .palette import INK, PAPER_WHITE
from .render import Mesh, ball_mesh, bone_mesh, camera_axes, fitting_camera, render

MOMENT_SIZE, CAPTION_HEIGHT = 240, 36   # [px]
SPHERE_SHARE = 1.03    # of its radius: a little more than the round end of a cylinder in it
TOWARDS_EYE, UPWARDS = (.75, -.55, .45), (0., 0., 1.)
# Corners of a box's six faces, anticlockwise from outside; three signs each.
BOX_CORNERS = np.array([[
    np.insert((u, v) if side > 0. else (v, u), axis, side)
    for u, v in ((-1., -1.), (1., -1.), (1., 1.), (-1., 1.))]
    for axis in (0, 2) for side in (-1., 1.)] + [[
        np.insert((v, u) if side > 0. else (u, v), 1, side)
        for u, v in ((-1., -1.), (1., -1.), (1., 1.), (-1., 1.))] for side in (-1., 1.)])


class PlacedShape(NamedTuple):
    """A primitive shape in the world.

    Attributes
    ----------
    kind : str
        'box', 'cylinder' along z, or 'sphere'.
    size : tuple of float
        Three sides; radius and length; or radius [m].
    rotation, position : ndarray, shape (3, 3) and (3,)
        [m]
    colour : tuple of float
        Red, green and blue, 0 to 1.
    """

    kind: str
    size: tuple[float, ...]
    rotation: np.ndarray
    position: np.ndarray
    colour: tuple[float, ...]


class GraspMoment(NamedTuple):
    """A moment of a grasp: title and shapes to draw.

    Attributes
    ----------
    title : str
    shapes : sequence of PlacedShape
        Up is along z.
    """

    title: str
    shapes: Sequence[PlacedShape]


def shape_mesh(shape: PlacedShape) -> Mesh:
    """Return the mesh of a shape; a cylinder has round ends."""
    if shape.kind == 'sphere':
        return ball_mesh(shape.position, SPHERE_SHARE * shape.size[0], shape.colour)
    if shape.kind == 'cylinder':
        radius, length = shape.size
        half = .5 * length * shape.rotation[:, 2]
        return bone_mesh(shape.position - half, shape.position + half, radius, radius,
                         shape.colour)
    # Each face has corners of its own, so that edges are sharp.
    corners = (.5 * BOX_CORNERS * shape.size).reshape(-1, 3) @ shape.rotation.T
    first = 4 * np.arange(len(BOX_CORNERS))[:, None]
    faces = np.concatenate((first + (0, 1, 2), first + (0, 2, 3)))
    return Mesh(corners + shape.position, faces, shape.colour)


def save_grasp_picture(path: str | PathLike[str], moments: Sequence[GraspMoment]) -> None:
    """Draw moments side by side, as one camera sees them.

    Parameters
    ----------
    path : path-like
        PNG.
    moments : sequence of GraspMoment
    """
    scenes = [[shape_mesh(shape) for shape in moment.shapes] for moment in moments]
    camera = fitting_camera(camera_axes(TOWARDS_EYE, UPWARDS), np.concatenate(
        [mesh.vertices for meshes in scenes for mesh in meshes]))
    figure = blank_figure(MOMENT_SIZE * len(moments), MOMENT_SIZE + CAPTION_HEIGHT,
                          facecolor=PAPER_WHITE)
    for column, (moment, meshes) in enumerate(zip(moments, scenes)):
        left = MOMENT_SIZE * column
        place_image(figure, render(meshes, camera, (MOMENT_SIZE, MOMENT_SIZE)), left,
                    CAPTION_HEIGHT)
        write_text(figure, left + .5 * MOMENT_SIZE, .5 * CAPTION_HEIGHT, moment.title, 14., INK)
    write_figure(path, figure)
