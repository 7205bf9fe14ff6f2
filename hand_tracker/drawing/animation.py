"""Pictures of a tracked hand: an animated GIF and a contact sheet, seen from two sides."""

from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..core.model.hand import DIGITS
from ..core.model.skeleton import DIGIT_CHAINS, PALM_BONES, SKELETON_BONES, bone_radii
from .images import drawn, save_gif
from .palette import DIGIT_COLOURS, INK, VERMILLION, rgb
from .render import view_axes

PALM_COLOUR = '#B9C0C7'
SEEN_COLOUR, HIDDEN_COLOUR = '#111111', VERMILLION
# What each view shows [m]: left, right, bottom, top, with the wrist at the origin.
VIEWS = {'from above': (-.105, .105, -.03, .205), 'from the thumb': (-.205, .03, -.125, .045)}
GIF_RATE = 10.       # [Hz]
GIF_COLOURS = 256
INCH = .055          # [m] of hand on an inch of picture
HEADER = .45         # [inches]
SHEET_COLUMNS, SHEET_ROWS = 6, 2


class Track(NamedTuple):
    """A tracked hand over time, in the wrist's frame.

    Attributes
    ----------
    times : ndarray, shape (n,)
        [s]
    points : ndarray, shape (n, 31, 3)
        `skeleton_points` [m].
    markers : ndarray, shape (n, 8, 3)
        Where seen the measured place, else the place on the tracked hand [m].
    seen : ndarray of bool, shape (n, 8)
    """

    times: np.ndarray
    points: np.ndarray
    markers: np.ndarray
    seen: np.ndarray


class View:
    """The hand in one pair of axes.

    Parameters
    ----------
    figure : Figure
    corner : tuple of float
        Lower left corner of the axes [inches].
    view : str
        One of `VIEWS`.
    hand : Hand
    scale : float
        1 is `INCH` metres of hand on an inch.
    """

    def __init__(self, figure, corner, view, hand, scale=1.):
        self.axes = view_axes(view, hand.side)
        left, right, bottom, top = VIEWS[view]
        if view == 'from the thumb' and hand.side == 'left':
            left, right = -right, -left
        width, height = figure.get_size_inches()
        axes = figure.add_axes((
            corner[0] / width, corner[1] / height, scale * (right - left) / INCH / width,
            scale * (top - bottom) / INCH / height))
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_axis_off()
        self.widths = 2. * bone_radii(hand) * 72. * scale / INCH
        digits = [digit for digit, chain in enumerate(DIGIT_CHAINS) for _ in chain[1:]]
        self.colours = np.array([rgb(PALM_COLOUR)] * len(PALM_BONES)
                                + [rgb(DIGIT_COLOURS[digit]) for digit in digits])
        self.bones = LineCollection([], capstyle='round')
        axes.add_collection(self.bones)
        self.bones.set_clip_on(False)
        self.marks = axes.scatter([], [], s=.3 * self.widths.min() ** 2, linewidths=.7,
                                  edgecolors='white', zorder=3, clip_on=False)

    def draw(self, points, markers, seen):
        """Draw one pose, far bones first."""
        ends = (points @ self.axes.T)[np.array(SKELETON_BONES)]  # (bones, 2, 3)
        depth = ends[:, :, 2].mean(axis=1)
        # The palm is one: which of its bones is nearer would change from pose to pose.
        near = np.append([depth[:len(PALM_BONES)].mean()] * len(PALM_BONES),
                         depth[len(PALM_BONES):])
        # Every bone twice: a white rim sets it off from those behind it.
        order = np.repeat(np.argsort(near, kind='stable'), 2)
        rim = np.arange(len(order)) % 2 == 0
        fade = .55 * np.clip((.05 - depth) / .15, 0., 1.)[:, None]
        colours = self.colours * (1. - fade) + fade
        self.bones.set_segments(ends[order, :, :2])
        self.bones.set_linewidths(self.widths[order] + np.where(rim, 1.6, 0.))
        self.bones.set_colors(np.where(rim[:, None], 1., colours[order]))
        self.marks.set_offsets((markers @ self.axes.T)[:, :2])
        self.marks.set_facecolors([SEEN_COLOUR if s else HIDDEN_COLOUR for s in seen])


def view_size(view, scale=1.):
    """Return width and height of a view [inches]."""
    left, right, bottom, top = VIEWS[view]
    return scale * (right - left) / INCH, scale * (top - bottom) / INCH


def save_animation(path, track, hand, title=''):
    """Write an animated GIF of a track, both views side by side.

    Parameters
    ----------
    path : path-like
    track : Track
    hand : Hand
    title : str
    """
    (width, height), (second_width, second_height) = (view_size(view) for view in VIEWS)
    figure = Figure(figsize=(width + second_width, height + HEADER), dpi=80)
    corners = ((0., 0.), (width, .5 * (height - second_height)))
    views = [View(figure, corner, view, hand) for corner, view in zip(corners, VIEWS)]
    for share, view in zip((.25, .75), VIEWS):
        figure.text(share, .02, view, ha='center', color=INK, fontsize=9)
    _header(figure, title)
    clock = figure.text(.985, .02, '', ha='right', color=INK, fontsize=9)
    images = []
    for frame in _frames_at(track.times, np.arange(
            track.times[0], track.times[-1], 1. / GIF_RATE)):
        for view in views:
            view.draw(track.points[frame], track.markers[frame], track.seen[frame])
        clock.set_text(f'{track.times[frame] - track.times[0]:.1f} s')
        images.append(drawn(figure).convert('RGB'))
    save_gif(path, images, GIF_RATE, GIF_COLOURS,
             (*DIGIT_COLOURS, PALM_COLOUR, SEEN_COLOUR, HIDDEN_COLOUR))


def save_sheet(path, track, hand, title=''):
    """Write a contact sheet (PNG) of a track: poses in time, each from both views.

    Parameters
    ----------
    path : path-like
    track : Track
    hand : Hand
    title : str
    """
    scale = .42
    sizes = [view_size(view, scale) for view in VIEWS]
    width = max(size[0] for size in sizes)
    height = sum(size[1] for size in sizes) + .15
    figure = Figure(figsize=(width * SHEET_COLUMNS, height * SHEET_ROWS + HEADER), dpi=120)
    poses = SHEET_ROWS * SHEET_COLUMNS
    # The middle of equal parts: neither end, where the hand only rests.
    wanted = track.times[0] + (track.times[-1] - track.times[0]) * (np.arange(poses) + .5) / poses
    for pose, frame in enumerate(_frames_at(track.times, wanted)):
        row, column = divmod(pose, SHEET_COLUMNS)
        bottom = height * (SHEET_ROWS - 1 - row)
        for view, size, below in zip(VIEWS, sizes, (sizes[1][1], 0.)):
            View(figure, (column * width + .5 * (width - size[0]), bottom + below), view, hand,
                  scale).draw(track.points[frame], track.markers[frame], track.seen[frame])
        figure.text((column * width + .1) / figure.get_size_inches()[0],
                    (bottom + height - .15) / figure.get_size_inches()[1],
                    f'{track.times[frame] - track.times[0]:.1f} s', color=INK, fontsize=8,
                    va='top')
    _header(figure, title)
    figure.savefig(path)


def _header(figure, title):
    """Write the title and the legend."""
    middle = 1. - .5 * HEADER / figure.get_size_inches()[1]
    figure.text(.012, middle, title, color=INK, fontsize=11, weight='bold', va='center')
    handles = [Line2D([], [], marker='o', linestyle='', markersize=5, color=colour, label=label)
               for colour, label in ((SEEN_COLOUR, 'marker seen'), (HIDDEN_COLOUR, 'hidden'))]
    handles += [Line2D([], [], linewidth=4, solid_capstyle='round', color=colour, label=digit)
                for colour, digit in zip(DIGIT_COLOURS, DIGITS)]
    figure.legend(handles=handles, loc='center right', bbox_to_anchor=(.995, middle),
                  ncols=len(handles), frameon=False, fontsize=7, labelcolor=INK,
                  columnspacing=.8, handletextpad=.4, handlelength=1.)


def _frames_at(times, wanted):
    """Return the index of the frame at or next after each wanted time."""
    return np.minimum(np.searchsorted(times, wanted), len(times) - 1)
