"""Pictures of a skin, shaded: poses, weights, and linear beside dual-quaternion blending."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from ..core.hand import DIGITS, JOINTS, LINKS
from ..core.kinematics import forward, joint_table
from ..palette import DIGIT_COLOURS, INK, PAPER
from ..simulation.poses import pose_angles
from .blend import deform
from .surface import normals

FLESH = (.93, .76, .65)
PALM = (.80, .81, .83)
LIGHT = np.array((-.42, .48, .77))     # right, up, to the eye
POSES = ('open', 'spread', 'pinch', 'rolled', 'fist')
# Directions to the eye and up, of a right hand in the wrist's frame.
EYES = {'from above': ((0., 0., 1.), (1., 0., 0.)), 'the palm': ((0., 0., -1.), (1., 0., 0.)),
        'from the thumb': ((-.15, .95, .25), (0., 0., 1.)),
        'aslant': ((.55, .55, .62), (0., 0., 1.))}
WEIGHTS_SHOWN = ('index_metacarpal', 'index_proximal', 'index_middle', 'thumb_metacarpal')
SIDE, PAD = 2.6, .006     # [inches] of a picture, [m] of air around it
HEADER = .35             # [inches]
DPI = 110


def draw(axes, hand, vertices, faces, eye, colours):
    """Draw a mesh into axes.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    hand : Hand
    vertices : ndarray, shape (V, 3)
        In the wrist's frame [m].
    faces : ndarray of int, shape (F, 3)
    eye : str
        One of `EYES`.
    colours : ndarray, shape (V, 3) or (3,)
        Red, green and blue.
    """
    mirror = (1., 1. if hand.side == 'right' else -1., 1.)
    to_eye, up = (np.array(direction) * mirror for direction in EYES[eye])
    to_eye = to_eye / np.linalg.norm(to_eye)
    right = np.cross(up, to_eye)
    right = right / np.linalg.norm(right)
    view = np.array((right, np.cross(to_eye, right), to_eye))
    seen, normal = vertices @ view.T, normals(vertices, faces) @ view.T
    lit = np.clip(normal @ LIGHT, 0., 1.)
    gloss = np.clip(normal @ (np.array((-.22, .25, .94))), 0., 1.)[:, None] ** 24
    shade = (.42 + .58 * lit)[:, None] * np.broadcast_to(colours, vertices.shape) + .10 * gloss
    corners = seen[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    front = flat > 0.
    order = np.argsort(corners[front][:, :, 2].mean(axis=1))
    paint = np.clip(shade[faces].mean(axis=1), 0., 1.)[front][order]
    axes.add_collection(PolyCollection(corners[front][order][:, :, :2], facecolors=paint,
                                       edgecolors=paint, linewidths=.35))
    low, high = seen[:, :2].min(axis=0) - PAD, seen[:, :2].max(axis=0) + PAD
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect='equal')
    axes.set_axis_off()


def sheet(path, rows, titles, names=('', '')):
    """Write a picture (PNG) of rows of drawings.

    Parameters
    ----------
    path : path-like
    rows : sequence of sequence of callable
        Each draws into the axes that it is given.
    titles, names : sequence of str
        Of the columns and of the rows.
    """
    columns = len(titles)
    margin = HEADER if any(names) else 0.
    size = np.array((SIDE * columns + margin, SIDE * len(rows) + HEADER))
    figure = Figure(figsize=size, dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    wide, (left, header) = SIDE / size[0], (margin, HEADER) / size
    top = 1. - header
    for i, (row, name) in enumerate(zip(rows, names)):
        bottom = top * (len(rows) - 1 - i) / len(rows)
        figure.text(.5 * left, bottom + .5 * top / len(rows), name, rotation=90., ha='center',
                    va='center', fontsize=10, color=INK)
        for j, drawing in enumerate(row):
            drawing(figure.add_axes((left + j * wide, bottom, wide, top / len(rows))))
    for j, title in enumerate(titles):
        figure.text(left + (j + .5) * wide, .5 + .5 * top, title, ha='center', va='center',
                    fontsize=10, color=INK)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy())
    image.quantize(256, kmeans=1, dither=Image.Dither.NONE).save(path, optimize=True)


def _pose(hand, name):
    angles = np.zeros(len(JOINTS)) if name == 'zero' else pose_angles(name, hand)
    return forward(joint_table(hand), angles)


def save_poses(path, hand, skin):
    """Write the skin in poses, each from two sides."""
    def drawing(name, eye):
        return lambda axes: draw(
            axes, hand, deform(skin, _pose(hand, name)), skin.faces, eye, FLESH)

    sheet(path, [[drawing(name, eye) for name in POSES] for eye in ('aslant', 'the palm')],
          POSES)


def link_colours(skin):
    """Return a colour for each link of a skin: the palm grey, phalanges in those of their digit."""
    colours = []
    for link in skin.links:
        digit, bone = LINKS[link].split('_')
        colour = np.array(to_rgb(DIGIT_COLOURS[DIGITS.index(digit)]))
        pale = {'metacarpal': .45, 'proximal': 0., 'middle': .5, 'distal': 0.}[bone]
        palm = bone == 'metacarpal' and digit != 'thumb'
        colours.append(PALM if palm else (1. - pale) * colour + pale)
    return np.array(colours)


def save_weights(path, hand, skin):
    """Write which link each place follows, and how far the weights of some links reach."""
    from matplotlib import colormaps

    rows = []
    for eye in ('from above', 'the palm'):
        everything = skin.weights @ link_colours(skin)
        each = [colormaps['cividis'](skin.weights[:, skin.links.index(LINKS.index(name))])[:, :3]
                for name in WEIGHTS_SHOWN]
        rows.append([lambda axes, eye=eye, colours=colours: draw(
            axes, hand, skin.vertices, skin.faces, eye, colours)
            for colours in (everything, *each)])
    sheet(path, rows, ['all links', *(name.replace('_', ' ') for name in WEIGHTS_SHOWN)])


def save_blending(path, hand, skin):
    """Write linear and dual-quaternion blending of bent fingers, one above the other."""
    views = (('rolled', 'from the thumb'), ('rolled', 'aslant'), ('fist', 'from the thumb'),
             ('fist', 'aslant'))

    def drawing(name, eye, dual_quaternions):
        return lambda axes: draw(axes, hand, deform(skin, _pose(hand, name), dual_quaternions),
                                 skin.faces, eye, FLESH)

    sheet(path, [[drawing(*view, dual) for view in views] for dual in (False, True)],
          [f'{name}, {eye}' for name, eye in views], ('linear', 'dual quaternions'))
