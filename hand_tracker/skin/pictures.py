"""Pictures of a skin, rendered: poses, weights, and linear beside dual-quaternion blending."""

import numpy as np

from ..core.model.hand import DIGITS, LINKS
from ..core.model.kinematics import forward, joint_table
from ..drawing.images import blank, drawn, place, write
from ..drawing.palette import DIGIT_COLOURS, FLESH, INK, PAPER, VERMILLION, rgb
from ..drawing.render import Camera, Mesh, fitted, render, view_axes
from ..simulation.poses import pose_angles
from .skinning import deform

PALM = (.80, .81, .83)
POSES = ('open', 'spread', 'pinch', 'rolled', 'fist')
WEIGHTS_SHOWN = ('index_metacarpal', 'index_proximal', 'index_middle', 'thumb_metacarpal')
SIDE, HEADER = 286, 38   # [picture elements] of a mesh, and of titles
LETTERS = 15             # [picture elements]
FINER = 2                # see `render`
# What is in the middle of a fist's pictures from each side, and how high they are [m].
KNUCKLES = {'from the thumb': ('index', ('proximal', 'middle', 'distal'), .096),
            'from above': ('middle', ('proximal',), .09),
            'from the front': ('middle', ('proximal', 'middle'), .1)}
SKIN_COLOUR = rgb(FLESH)
APART = .003             # [m] from which two ways of blending have the full colour


def seen(hand, vertices, faces, view, colours=SKIN_COLOUR):
    """Return a square picture of a mesh.

    Parameters
    ----------
    hand : Hand
    vertices : ndarray, shape (V, 3)
        In the wrist's frame [m].
    faces : ndarray of int, shape (F, 3)
    view : str
        One of `EYES`.
    colours : array_like, shape (V, 3) or (3,)
        Red, green and blue.

    Returns
    -------
    ndarray of uint8, shape (SIDE, SIDE, 4)
    """
    camera = fitted(view_axes(view, hand.side), vertices)
    return render([Mesh(vertices, faces, colours)], camera, (SIDE, SIDE), FINER)


def sheet(path, rows, titles, names=()):
    """Write a picture (PNG) of rows of square pictures.

    Parameters
    ----------
    path : path-like
    rows : sequence of sequence of ndarray
        From `seen`.
    titles, names : sequence of str
        Of the columns and of the rows.
    """
    margin = HEADER if names else 0
    figure = blank(margin + SIDE * len(titles), HEADER + SIDE * len(rows), facecolor=PAPER)
    place(figure, np.vstack([np.hstack(row) for row in rows]), margin, HEADER)
    for column, title in enumerate(titles):
        write(figure, margin + (column + .5) * SIDE, .5 * HEADER, title, LETTERS, INK)
    for row, name in enumerate(names):
        write(figure, .5 * margin, HEADER + (row + .5) * SIDE, name, LETTERS, INK,
              rotation=90.)
    drawn(figure).convert('RGB').save(path, optimize=True)


def save_poses(path, hand, skin):
    """Write the skin in poses, each from two sides."""
    table = joint_table(hand)
    posed = [deform(skin, forward(table, pose_angles(name, hand))) for name in POSES]
    sheet(path, [[seen(hand, vertices, skin.faces, view) for vertices in posed]
                 for view in ('aslant', 'the palm')], POSES)


def link_colours(skin):
    """Return a colour for each link of a skin: grey for the palm's, else its digit's."""
    colours = []
    for link in skin.links:
        digit, bone = LINKS[link].split('_')
        colour = np.array(rgb(DIGIT_COLOURS[DIGITS.index(digit)]))
        pale = {'metacarpal': .45, 'proximal': 0., 'middle': .5, 'distal': 0.}[bone]
        palm = bone == 'metacarpal' and digit != 'thumb'
        colours.append(PALM if palm else (1. - pale) * colour + pale)
    return np.array(colours)


def save_weights(path, hand, skin):
    """Write which link each place follows, and how far the weights of some links reach."""
    from matplotlib import colormaps

    each = [colormaps['cividis'](skin.weights[:, skin.links.index(LINKS.index(name))])[:, :3]
            for name in WEIGHTS_SHOWN]
    sheet(path, [[seen(hand, skin.vertices, skin.faces, view, colours)
                  for colours in (skin.weights @ link_colours(skin), *each)]
                 for view in ('from above', 'the palm')],
          ['all links', *(name.replace('_', ' ') for name in WEIGHTS_SHOWN)])


def save_blending(path, hand, skin):
    """Write linear and dual-quaternion blending of a fist's knuckles, and how they differ."""
    pose = forward(joint_table(hand), pose_angles('fist', hand))
    linear, dual = (deform(skin, pose, quaternions) for quaternions in (False, True))
    share = np.clip(np.linalg.norm(dual - linear, axis=1) / APART, 0., 1.)[:, None]
    marked = (1. - share) * rgb(FLESH) + share * rgb(VERMILLION)
    cameras = [Camera(view_axes(view, hand.side), pose.position[[
        LINKS.index(f'{finger}_{bone}') for bone in bones]].mean(axis=0), height)
        for view, (finger, bones, height) in KNUCKLES.items()]
    sheet(path, [[render([Mesh(vertices, skin.faces, colours)], camera, (SIDE, SIDE), FINER)
                  for camera in cameras] for vertices, colours in (
                      (linear, rgb(FLESH)), (dual, rgb(FLESH)), (dual, marked))],
          [f'fist, {view}' for view in KNUCKLES],
          ('linear', 'dual quaternions', f'orange: {1e3 * APART:.0f} mm apart'))
