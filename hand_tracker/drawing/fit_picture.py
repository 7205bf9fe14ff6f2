"""Picture of a fitted hand: its skeleton in some poses, with measured and modelled markers."""

from os import PathLike
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..core.model.hand import DIGITS, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.skeleton import DIGIT_CHAINS, PALM_BONES, skeleton_points
from .legends import add_legend_below
from .palette import BLUE, DIGIT_COLOURS, GREY, INK, MUTED, VERMILLION

FIT_PANEL = 3.4  # [inches] width of a pose
# Name, axis to the left (of a left hand to the right) and axis up of each view.
FIT_VIEWS = (('from the back of the {} hand', 1, 0), ('from the thumb\'s side', 0, 2))
FIT_AXES = 'distal', 'across', 'dorsal'    # the wrist's x, y and z


class FittedPose(NamedTuple):
    """One pose of the picture, of a right hand in the wrist's frame.

    Attributes
    ----------
    title : str
    angles : ndarray, shape (25,)
        [rad]
    measured, modelled : ndarray, shape (k, 3)
        Markers, NaN where not seen [m].
    """

    title: str
    angles: np.ndarray
    measured: np.ndarray
    modelled: np.ndarray


def save_fit_picture(path: str | PathLike[str], hand: Hand, poses: list[FittedPose]) -> None:
    """Draw a fitted hand in some poses, each from two sides.

    Parameters
    ----------
    path : path-like
        PNG.
    hand : Hand
    poses : list of FittedPose
    """
    figure = Figure(figsize=(FIT_PANEL * len(poses), 2. * FIT_PANEL), dpi=110, layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(FIT_VIEWS), len(poses), squeeze=False, sharex='row', sharey='row')
    right = hand.as_right()
    tips = tip_offsets(right)
    for column, pose in enumerate(poses):
        points = 1e3 * skeleton_points(
            tips, forward(joint_table(right), pose.angles), np.zeros(3))
        misses = 1e3 * np.linalg.norm(pose.measured - pose.modelled, axis=1)
        for row, (view, across, up) in enumerate(FIT_VIEWS):
            ax = axes[row][column]
            _draw_view(ax, points, pose, (across, up))
            if not row:
                ax.set_title(f'{pose.title}: markers {np.nanmean(misses):.1f} mm off',
                             fontsize=9, color=INK)
            ax.set_xlabel(f'{view.format(hand.side)} [mm]', fontsize=8, color=MUTED)
            if not column:
                if hand.side == 'right':
                    ax.invert_xaxis()   # of the whole row
                ax.set_ylabel(f'{FIT_AXES[up]} [mm]', fontsize=8, color=MUTED)
    add_legend_below(figure, axes[0][0].get_legend_handles_labels()[0])
    figure.savefig(path, metadata={'Software': None})


def _draw_view(ax: Axes, points: np.ndarray, pose: FittedPose,
               view: tuple[int, int]) -> None:
    """Draw skeleton and markers from one side [mm]."""
    def flat(places: np.ndarray) -> np.ndarray:
        return places[:, view]

    skeleton = flat(points)
    for first, second in PALM_BONES:
        ax.plot(*skeleton[[first, second]].T, color=GREY, linewidth=1.)
    for digit, chain, colour in zip(DIGITS, DIGIT_CHAINS, DIGIT_COLOURS):
        ax.plot(*skeleton[list(chain)].T, color=colour, linewidth=2.5, marker='o', markersize=3,
                label=digit)
    measured, modelled = flat(1e3 * pose.measured), flat(1e3 * pose.modelled)
    for ends in zip(measured, modelled):
        ax.plot(*np.array(ends).T, color=VERMILLION, linewidth=1.)
    ax.plot(*measured.T, linestyle='', marker='o', markersize=6, markerfacecolor='none',
            markeredgecolor=VERMILLION, label='marker as measured')
    ax.plot(*modelled.T, linestyle='', marker='.', markersize=5, color=BLUE,
            label='on the fitted hand (modelled)')
    ax.set_aspect('equal')
    ax.tick_params(labelsize=7, colors=MUTED)
    for side in ('top', 'right'):
        ax.spines[side].set_visible(False)
