"""A tracked hand's skeleton and markers as an animated GIF and a contact sheet, in two views."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..core.model.hand import DIGITS, Hand
from ..core.model.skeleton import DIGIT_CHAINS, PALM_BONES, SKELETON_BONES, bone_radii
from ..output_files import write_whole
from .images import AnimatedFigure, save_gif, spread_rows
from .palette import DIGIT_COLOURS, INK, VERMILLION, rgb
from .render import view_axes

PALM_COLOUR = '#B9C0C7'
SEEN_COLOUR, HIDDEN_COLOUR = '#111111', VERMILLION
# Left, right, bottom and top of each view [m], with the wrist at the origin.
VIEW_EXTENTS = {
    'from above': (-.105, .105, -.03, .205), 'from the thumb': (-.205, .03, -.125, .045)}
ANIMATION_RATE = 10.     # [Hz]
ANIMATION_COLOURS = 256
METRES_PER_INCH = .055   # of hand on paper
TITLE_BAR_HEIGHT = .45   # [inches]
SHEET_COLUMNS, SHEET_ROWS = 6, 2


class HandMotion(NamedTuple):
    """A tracked hand in n frames, in the wrist frame.

    Attributes
    ----------
    times : ndarray, shape (n,)
        [s]
    points : ndarray, shape (n, 31, 3)
        `skeleton_points` [m].
    markers : ndarray, shape (n, 8, 3)
        Measured where seen, else as placed on the tracked hand [m].
    seen : ndarray of bool, shape (n, 8)
    """

    times: np.ndarray
    points: np.ndarray
    markers: np.ndarray
    seen: np.ndarray


class HandView:
    """Matplotlib axes with one view of the hand.

    Parameters
    ----------
    figure : Figure
    corner : tuple of float
        Lower left corner of the axes [inches].
    view : str
        One of `VIEW_EXTENTS`.
    hand : Hand
    scale : float
        Relative to `METRES_PER_INCH` [1].
    """

    def __init__(self, figure: Figure, corner: tuple[float, float], view: str, hand: Hand,
                 scale: float = 1.) -> None:
        self.camera_axes = view_axes(view, hand.side)
        left, right, bottom, top = VIEW_EXTENTS[view]
        if view == 'from the thumb' and hand.side == 'left':
            left, right = -right, -left
        width, height = figure.get_size_inches()
        axes = figure.add_axes((
            corner[0] / width, corner[1] / height,
            scale * (right - left) / METRES_PER_INCH / width,
            scale * (top - bottom) / METRES_PER_INCH / height))
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_axis_off()
        self.bone_widths = 2. * bone_radii(hand) * 72. * scale / METRES_PER_INCH
        digits = [digit for digit, chain in enumerate(DIGIT_CHAINS) for _ in chain[1:]]
        self.bone_colours = np.array([rgb(PALM_COLOUR)] * len(PALM_BONES)
                                + [rgb(DIGIT_COLOURS[digit]) for digit in digits])
        self.bones = LineCollection([], capstyle='round')
        axes.add_collection(self.bones)
        self.bones.set_clip_on(False)
        self.marks = axes.scatter([], [], s=.3 * self.bone_widths.min() ** 2, linewidths=.7,
                                  edgecolors='white', zorder=3, clip_on=False)

    def draw(self, points: np.ndarray, markers: np.ndarray, seen: np.ndarray) -> None:
        """Draw one frame, bones from far to near.

        Parameters
        ----------
        points : ndarray, shape (31, 3)
            `skeleton_points` [m].
        markers : ndarray, shape (8, 3)
            [m]
        seen : ndarray of bool, shape (8,)
        """
        ends = (points @ self.camera_axes.T)[np.array(SKELETON_BONES)]  # (bones, 2, 3)
        depth = ends[:, :, 2].mean(axis=1)
        # One depth for the whole palm, as the order of its bones would change between poses.
        near = np.append([depth[:len(PALM_BONES)].mean()] * len(PALM_BONES),
                         depth[len(PALM_BONES):])
        # Each bone twice: a white outline separates it from those behind.
        order = np.repeat(np.argsort(near, kind='stable'), 2)
        rim = np.arange(len(order)) % 2 == 0
        fade = .55 * np.clip((.05 - depth) / .15, 0., 1.)[:, None]
        colours = self.bone_colours * (1. - fade) + fade
        self.bones.set_segments(ends[order, :, :2])
        self.bones.set_linewidth(self.bone_widths[order] + np.where(rim, 1.6, 0.))
        self.bones.set_color(np.where(rim[:, None], 1., colours[order]).tolist())
        self.marks.set_offsets((markers @ self.camera_axes.T)[:, :2])
        self.marks.set_facecolor([SEEN_COLOUR if is_seen else HIDDEN_COLOUR for is_seen in seen])


def view_size(view: str, scale: float = 1.) -> tuple[float, float]:
    """Return width and height of a view [inches]."""
    left, right, bottom, top = VIEW_EXTENTS[view]
    return scale * (right - left) / METRES_PER_INCH, scale * (top - bottom) / METRES_PER_INCH


def save_animation(path: str | PathLike[str], motion: HandMotion, hand: Hand, title: str = '',
                   others: Sequence[tuple[HandMotion, Hand]] = ()) -> None:
    """Write an animated GIF of tracked hands, both views of each in each frame.

    Parameters
    ----------
    path : path-like
    motion : HandMotion
        Of the times shown.
    hand : Hand
    title : str
    others : sequence of (HandMotion, Hand)
        Further hands, each in a row below.
    """
    (width, height), (second_width, second_height) = (view_size(view) for view in VIEW_EXTENTS)
    rows = [(motion, hand), *others]
    figure = Figure(figsize=(width + second_width, len(rows) * height + TITLE_BAR_HEIGHT), dpi=80)
    views = []
    for row, (_, shown) in enumerate(reversed(rows)):
        corners = ((0., row * height), (width, row * height + .5 * (height - second_height)))
        views.append([HandView(figure, corner, view, shown)
                      for corner, view in zip(corners, VIEW_EXTENTS)])
        if others:
            figure.text(.01, (row + .5) * height / figure.get_size_inches()[1],
                        f'{shown.side} hand', rotation=90, va='center', color=INK, fontsize=10,
                        weight='bold')
    views.reverse()
    for share, name in zip((.25, .75), VIEW_EXTENTS):
        figure.text(share, .02, name, ha='center', color=INK, fontsize=9)
    _draw_title_bar(figure, title)
    clock = figure.text(.985, .02, '', ha='right', color=INK, fontsize=9)
    animated = AnimatedFigure(figure, [
        *(artist for of_hand in views for view in of_hand for artist in (view.bones, view.marks)),
        clock])
    images = []
    for now in np.arange(motion.times[0], motion.times[-1], 1. / ANIMATION_RATE):
        for of_hand, (shown_motion, _) in zip(views, rows):
            frame = _frame_at(shown_motion.times, now)
            for view in of_hand:
                view.draw(shown_motion.points[frame], shown_motion.markers[frame],
                          shown_motion.seen[frame])
        frame = _frame_at(motion.times, now)
        clock.set_text(f'{motion.times[frame] - motion.times[0]:.1f} s')
        images.append(animated.image().convert('RGB'))
    save_gif(path, images, ANIMATION_RATE, ANIMATION_COLOURS,
             (*DIGIT_COLOURS, PALM_COLOUR, SEEN_COLOUR, HIDDEN_COLOUR))


def save_sheet(path: str | PathLike[str], motion: HandMotion, hand: Hand,
               title: str = '') -> None:
    """Write a contact sheet (PNG) of a tracked hand: poses in time, each in both views.

    Parameters
    ----------
    path : path-like
    motion : HandMotion
    hand : Hand
    title : str
    """
    scale = .42
    sizes = [view_size(view, scale) for view in VIEW_EXTENTS]
    width = max(size[0] for size in sizes)
    height = sum(size[1] for size in sizes) + .15
    figure = Figure(
        figsize=(width * SHEET_COLUMNS, height * SHEET_ROWS + TITLE_BAR_HEIGHT), dpi=120)
    sheet_width, sheet_height = figure.get_size_inches()
    # Among the frames, not in time: where many are missing, an instant would be there twice.
    frames = spread_rows(len(motion.times), SHEET_ROWS * SHEET_COLUMNS)
    for pose, frame in enumerate(frames):
        row, column = divmod(pose, SHEET_COLUMNS)
        bottom = height * (SHEET_ROWS - 1 - row)
        for view, size, below in zip(VIEW_EXTENTS, sizes, (sizes[1][1], 0.)):
            corner = column * width + .5 * (width - size[0]), bottom + below
            HandView(figure, corner, view, hand, scale).draw(
                motion.points[frame], motion.markers[frame], motion.seen[frame])
        figure.text((column * width + .1) / sheet_width, (bottom + height - .15) / sheet_height,
                    f'{motion.times[frame] - motion.times[0]:.1f} s', color=INK, fontsize=8,
                    va='top')
    _draw_title_bar(figure, title)
    write_whole(Path(path), figure.savefig)


def _draw_title_bar(figure: Figure, title: str) -> None:
    """Write the title and the legend."""
    middle = 1. - .5 * TITLE_BAR_HEIGHT / figure.get_size_inches()[1]
    figure.text(.012, middle, title, color=INK, fontsize=11, weight='bold', va='center')
    handles = [Line2D([], [], marker='o', linestyle='', markersize=5, color=colour, label=label)
               for colour, label in ((SEEN_COLOUR, 'marker seen'), (HIDDEN_COLOUR, 'hidden'))]
    handles += [Line2D([], [], linewidth=4, solid_capstyle='round', color=colour, label=digit)
                for colour, digit in zip(DIGIT_COLOURS, DIGITS)]
    figure.legend(handles=handles, loc='center right', bbox_to_anchor=(.995, middle),
                  ncol=len(handles), frameon=False, fontsize=7, labelcolor=INK,
                  columnspacing=.8, handletextpad=.4, handlelength=1.)


def _frame_at(times: np.ndarray, wanted: float) -> int:
    """Return the index of the first frame at or after a wanted time."""
    return min(int(np.searchsorted(times, wanted)), len(times) - 1)
