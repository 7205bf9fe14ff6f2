"""Pictures and animations of a human and a robot hand in the same poses, from two sides."""

from collections.abc import Sequence
from os import PathLike
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from .images import AnimatedFigure, save_gif, write_figure
from .legends import add_legend_below
from .palette import DIGIT_COLOURS, GREY, GRID, INK, MUTED

ROBOT_PANEL = 2.4  # [inches] width of a pose
ROBOT_GIF_SIZE, ROBOT_GIF_COLOURS = (6.4, 5.6), 32   # [inches], entries of the palette
COLOUR_OF = dict(zip(('index', 'middle', 'ring', 'little', 'thumb'), DIGIT_COLOURS))
PALM_MARGIN = 6.   # [mm] around what is drawn
LEAST_PANEL = 1.2  # [inches] height, of the names of its axes
ROBOT_MARGINS = 1.8  # [inches] for titles, names of axes and the legend
SHOWN_AXES = 'distal', 'across', 'dorsal'  # the palm's x, y and z
SPHERE_ALPHA = .3  # [1]


class PalmView(NamedTuple):
    """View along an axis of the palm's frame.

    Attributes
    ----------
    name : str
    across, up : int
        Axes that point to the right, or the left, and upwards.
    to_left : bool
        Whether the axis across points to the left.
    """

    name: str
    across: int
    up: int
    to_left: bool = False

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Return points (n, 3) [m] in the view, shape (n, 2) [mm]."""
        return 1e3 * points[:, (self.across, self.up)]


# From the back, as the animation of the hand.
ROBOT_VIEWS = PalmView('from the back', 1, 0, True), PalmView('from the side', 0, 2)


class RobotPose(NamedTuple):
    """One pose of both hands, each in its palm's frame.

    Attributes
    ----------
    title : str
    human, robot : dict of str to ndarray, shape (k, 3)
        Points of each digit from its root to its tip, by role [m].
    spheres : sequence of tuple
        Centre (3,) and radius of each sphere with which the robot touches [m].
    """

    title: str
    human: dict[str, np.ndarray]
    robot: dict[str, np.ndarray]
    spheres: Sequence[tuple[np.ndarray, float]] = ()


class DigitLines:
    """A hand's digits as lines on axes.

    Parameters
    ----------
    ax : Axes
    roles : sequence of str
        The digits.
    view : PalmView

    Attributes
    ----------
    artists : list of Line2D
        The lines, from back to front.
    """

    def __init__(self, ax: Axes, roles: Sequence[str], view: PalmView) -> None:
        self._view = view
        self._palm = {role: ax.plot([], [], color=GREY, linewidth=1.)[0] for role in roles}
        self._digits = {role: ax.plot([], [], color=COLOUR_OF[role], linewidth=3., marker='o',
                                      markersize=3.5, solid_capstyle='round')[0]
                        for role in roles}
        self.artists = [*self._palm.values(), *self._digits.values()]
        ax.set_aspect('equal', adjustable='box')
        ax.tick_params(labelsize=6, colors=MUTED)
        for side in ('top', 'right'):
            ax.spines[side].set_visible(False)

    def draw(self, digits: dict[str, np.ndarray]) -> None:
        """Draw one pose: points (k, 3) of each digit, by role [m]."""
        roots = np.array([points[0] for points in digits.values()])
        centre = np.zeros((1, 3)) if len(roots) > 2 else roots.mean(axis=0)[None]
        for role, points in digits.items():
            self._digits[role].set_data(*self._view.flat(points).T)
            self._palm[role].set_data(*self._view.flat(
                np.concatenate((centre, points[:1]))).T)


def save_robot_picture(path: str | PathLike[str], name: str, poses: Sequence[RobotPose]) -> None:
    """Draw both hands in some poses.

    Parameters
    ----------
    path : path-like
        PNG.
    name : str
        Of the robot.
    poses : sequence of RobotPose
    """
    rows = [(view, hand) for view in ROBOT_VIEWS for hand in ('human', 'robot')]
    # To one scale: a robot is as much larger than the person as it looks.
    limits = {view: _limits(poses, ('human', 'robot'), view) for view in ROBOT_VIEWS}
    heights = [max(ROBOT_PANEL * np.ptp(limits[view][1]) / np.ptp(limits[view][0]), LEAST_PANEL)
               for view, _ in rows]
    figure = Figure(figsize=(ROBOT_PANEL * len(poses), sum(heights) + ROBOT_MARGINS), dpi=100,
                    layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(rows), len(poses), squeeze=False, sharex='row', sharey='row',
                           gridspec_kw={'height_ratios': heights})
    for row, (view, hand) in enumerate(rows):
        for column, (ax, pose) in enumerate(zip(axes[row], poses)):
            digits = getattr(pose, hand)
            DigitLines(ax, list(digits), view).draw(digits)
            ax.set(xlim=limits[view][0], ylim=limits[view][1])
            ax.grid(color=GRID, linewidth=.6)
            if not row:
                ax.set_title(pose.title, fontsize=10, color=INK)
            if not column:
                ax.set_ylabel(f'{_whose(hand, name)}\n{view.name}\n{SHOWN_AXES[view.up]} [mm]',
                              fontsize=7, color=MUTED)
            if hand == 'robot':
                for centre, radius in pose.spheres:
                    ax.add_patch(Circle(view.flat(centre[None])[0], 1e3 * radius, color=MUTED,
                                        alpha=SPHERE_ALPHA, linewidth=0.))
                ax.set_xlabel(f'{SHOWN_AXES[view.across]} [mm]', fontsize=7, color=MUTED)
    _draw_legend(figure, poses[0], bool(poses[0].spheres))
    write_figure(path, figure)


def _draw_legend(figure: Figure, pose: RobotPose, has_spheres: bool) -> None:
    """Draw the colours of the digits, and of spheres where they are drawn, below the axes."""
    roles = [role for role in COLOUR_OF if role in pose.human or role in pose.robot]
    handles = [Line2D([], [], linewidth=3., marker='o', markersize=3.5, color=COLOUR_OF[role],
                      label=role) for role in roles]
    handles.append(Line2D([], [], linewidth=1., color=GREY, label='palm, to the roots'))
    if has_spheres:
        handles.append(Line2D([], [], linestyle='', marker='o', markersize=9., color=MUTED,
                              markeredgewidth=0., alpha=SPHERE_ALPHA,
                              label='sphere with which a tip touches'))
    add_legend_below(figure, handles, labelcolor=INK)


def save_robot_animation(path: str | PathLike[str], name: str, poses: Sequence[RobotPose],
                         rate: float) -> None:
    """Write an animated GIF of both hands side by side, to one scale.

    Parameters
    ----------
    path : path-like
    name : str
        Of the robot.
    poses : sequence of RobotPose
        One each frame; their titles are shown.
    rate : float
        [Hz]
    """
    hands = 'human', 'robot'
    limits = [_limits(poses, hands, view) for view in ROBOT_VIEWS]
    figure = Figure(figsize=ROBOT_GIF_SIZE, dpi=80, layout='constrained')
    axes = figure.subplots(len(ROBOT_VIEWS), len(hands), squeeze=False,
                           gridspec_kw={'height_ratios': [np.ptp(up) for _, up in limits]})
    lines = []
    for row, view in enumerate(ROBOT_VIEWS):
        for column, hand in enumerate(hands):
            ax = axes[row][column]
            ax.set(xlim=limits[row][0], ylim=limits[row][1])
            if not row:
                ax.set_title(_whose(hand, name), fontsize=10, color=INK)
            if not column:
                ax.set_ylabel(f'{view.name} [mm]', fontsize=8, color=MUTED)
            lines.append((hand, DigitLines(ax, list(getattr(poses[0], hand)), view)))
    _draw_legend(figure, poses[0], False)
    clock = figure.text(.99, .985, '', ha='right', va='top', color=INK, fontsize=9)
    animated = AnimatedFigure(
        figure, [*(line for _, drawn in lines for line in drawn.artists), clock])
    images = []
    for pose in poses:
        for hand, drawn in lines:
            drawn.draw(getattr(pose, hand))
        clock.set_text(pose.title)
        images.append(animated.image().convert('RGB'))
    save_gif(path, images, rate, ROBOT_GIF_COLOURS, (*DIGIT_COLOURS, GREY, INK, MUTED))


def _whose(hand: str, name: str) -> str:
    return name if hand == 'robot' else 'person'


def _limits(poses: Sequence[RobotPose], hands: Sequence[str],
            view: PalmView) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the limits across and up within which hands are in all poses [mm]."""
    points = np.concatenate([np.zeros((1, 3)), *(
        digit for pose in poses for hand in hands for digit in getattr(pose, hand).values()), *(
        centre + ((-radius,), (radius,)) for pose in poses for centre, radius in pose.spheres)])
    flat = view.flat(points)
    lower, upper = flat.min(axis=0) - PALM_MARGIN, flat.max(axis=0) + PALM_MARGIN
    across = (upper[0], lower[0]) if view.to_left else (lower[0], upper[0])
    return across, (lower[1], upper[1])
