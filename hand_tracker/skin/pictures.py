"""Rendered pictures of a skin: poses, weights, linear and dual-quaternion blending compared."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import DIGITS, LINKS, Hand
from ..core.model.kinematics import forward, joint_table
from ..drawing.images import blank_figure, figure_image, place_image, write_text
from ..drawing.palette import DIGIT_COLOURS, INK, PAPER_WHITE, SKIN_TONE, VERMILLION, rgb
from ..drawing.render import Camera, Mesh, fitting_camera, render, view_axes
from ..output_files import write_whole
from ..simulation.poses import pose_angles
from .skinning import Skin, deform

PALM_GREY = (.80, .81, .83)
PICTURED_POSES = ('open', 'spread', 'pinch', 'rolled', 'fist')
PICTURED_WEIGHTS = ('index_metacarpal', 'index_proximal', 'index_middle', 'thumb_metacarpal')
CELL_SIZE, TITLE_HEIGHT = 286, 38   # [px] of a rendered mesh, and of titles
TITLE_FONT_SIZE = 15                # [px]
SUPERSAMPLING = 2                   # see `render`


class FistView(NamedTuple):
    """Close-up of a fist's knuckles, centred between joints of a digit.

    Attributes
    ----------
    digit : str
    bones : tuple of str
        Whose links' origins are averaged to the centre.
    height : float
        Of the picture [m].
    """

    digit: str
    bones: tuple[str, ...]
    height: float


FIST_VIEWS = {'from the thumb': FistView('index', ('proximal', 'middle', 'distal'), .096),
              'from above': FistView('middle', ('proximal',), .09),
              'from the front': FistView('middle', ('proximal', 'middle'), .1)}
SKIN_TONE_RGB = rgb(SKIN_TONE)
FULL_COLOUR_DIFFERENCE = .003  # [m] between both blendings, shown wholly vermillion


def _render_square(hand: Hand, vertices: np.ndarray, faces: np.ndarray, view: str,
                   colours: ArrayLike = SKIN_TONE_RGB) -> np.ndarray:
    """Render a mesh into a square picture that it fills.

    Parameters
    ----------
    hand : Hand
        Whose side decides the view.
    vertices : ndarray, shape (V, 3)
        In the wrist frame [m].
    faces : ndarray of int, shape (F, 3)
        Anticlockwise seen from outside.
    view : str
        One of `VIEW_DIRECTIONS`.
    colours : array_like, shape (V, 3) or (3,)
        Red, green and blue, 0 to 1.

    Returns
    -------
    ndarray of uint8, shape (CELL_SIZE, CELL_SIZE, 4)
        Red, green, blue and opacity.
    """
    camera = fitting_camera(view_axes(view, hand.side), vertices)
    return render(
        [Mesh(vertices, faces, colours)], camera, (CELL_SIZE, CELL_SIZE), SUPERSAMPLING)


def _save_grid(path: str | PathLike[str], rows: Sequence[Sequence[np.ndarray]],
               column_titles: Sequence[str], row_titles: Sequence[str] = ()) -> None:
    """Write a grid of square pictures as one PNG.

    Parameters
    ----------
    path : path-like
    rows : sequence of sequence of ndarray, shape (CELL_SIZE, CELL_SIZE, 4)
        From `_render_square`.
    column_titles, row_titles : sequence of str
    """
    margin = TITLE_HEIGHT if row_titles else 0
    figure = blank_figure(margin + CELL_SIZE * len(column_titles),
                          TITLE_HEIGHT + CELL_SIZE * len(rows), facecolor=PAPER_WHITE)
    place_image(figure, np.vstack([np.hstack(row) for row in rows]), margin, TITLE_HEIGHT)
    for column, title in enumerate(column_titles):
        write_text(figure, margin + (column + .5) * CELL_SIZE, .5 * TITLE_HEIGHT, title,
                   TITLE_FONT_SIZE, INK)
    for row, title in enumerate(row_titles):
        write_text(figure, .5 * margin, TITLE_HEIGHT + (row + .5) * CELL_SIZE, title,
                   TITLE_FONT_SIZE, INK, rotation=90.)
    image = figure_image(figure).convert('RGB')
    write_whole(Path(path), lambda unfinished: image.save(unfinished, optimize=True))


def save_poses(path: str | PathLike[str], hand: Hand, skin: Skin) -> None:
    """Write a PNG of the skin in several poses, each from two views."""
    table = joint_table(hand)
    posed = [deform(skin, forward(table, pose_angles(name, hand))) for name in PICTURED_POSES]
    _save_grid(path, [[_render_square(hand, vertices, skin.faces, view) for vertices in posed]
                      for view in ('aslant', 'the palm')], PICTURED_POSES)


def _link_colours(skin: Skin) -> np.ndarray:
    """Return a colour for each link of a skin, shape (B, 3): the digit's, or grey in the palm."""
    colours = []
    for link in skin.links:
        digit, bone = LINKS[link].split('_')
        colour = np.array(rgb(DIGIT_COLOURS[DIGITS.index(digit)]))
        pale = {'metacarpal': .45, 'proximal': 0., 'middle': .5, 'distal': 0.}[bone]
        palm = bone == 'metacarpal' and digit != 'thumb'
        colours.append(PALM_GREY if palm else (1. - pale) * colour + pale)
    return np.array(colours)


def save_weights(path: str | PathLike[str], hand: Hand, skin: Skin) -> None:
    """Write a PNG of the skinning weights: of all links by colour, and of some links alone."""
    from matplotlib import colormaps

    columns = [skin.links.index(LINKS.index(name)) for name in PICTURED_WEIGHTS]
    single_links = [colormaps['cividis'](skin.weights[:, column])[:, :3] for column in columns]
    colourings = (skin.weights @ _link_colours(skin), *single_links)
    _save_grid(path, [[_render_square(hand, skin.vertices, skin.faces, view, colours)
                       for colours in colourings] for view in ('from above', 'the palm')],
               ['all links', *(name.replace('_', ' ') for name in PICTURED_WEIGHTS)])


def save_blending(path: str | PathLike[str], hand: Hand, skin: Skin) -> None:
    """Write a PNG of a fist's knuckles with linear and dual-quaternion blending."""
    pose = forward(joint_table(hand), pose_angles('fist', hand))
    linear, dual = (deform(skin, pose, quaternions) for quaternions in (False, True))
    difference = np.linalg.norm(dual - linear, axis=1)
    share = np.clip(difference / FULL_COLOUR_DIFFERENCE, 0., 1.)[:, None]
    marked = (1. - share) * SKIN_TONE_RGB + share * rgb(VERMILLION)
    cameras = [Camera(view_axes(name, hand.side), pose.position[[
        LINKS.index(f'{view.digit}_{bone}') for bone in view.bones]].mean(axis=0), view.height)
        for name, view in FIST_VIEWS.items()]
    rows = ((linear, SKIN_TONE_RGB), (dual, SKIN_TONE_RGB), (dual, marked))
    _save_grid(path, [[render([Mesh(vertices, skin.faces, colours)], camera,
                              (CELL_SIZE, CELL_SIZE), SUPERSAMPLING) for camera in cameras]
                      for vertices, colours in rows],
               [f'fist, {name}' for name in FIST_VIEWS],
               ('linear', 'dual quaternions',
                f'orange: {1e3 * FULL_COLOUR_DIFFERENCE:.0f} mm apart'))
