"""Markdown tables and figures of evaluations."""

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..drawing.images import write_figure
from ..drawing.palette import (
    BLUE,
    BLUISH_GREEN,
    GRID,
    INK,
    ORANGE,
    REDDISH_PURPLE,
    SKY_BLUE,
    VERMILLION,
)
from .rows import Row

# Of plotted series, the tracker's first.
SERIES_COLOURS = (BLUE, ORANGE, BLUISH_GREEN, REDDISH_PURPLE, SKY_BLUE, VERMILLION, '#555555')
WIDEST_LEGEND = 8   # entries in a row
LEGEND_HEIGHT = .45  # [inches]
ABBREVIATIONS = 'cmc', 'mcp', 'pip', 'dip', 'ip', 'fabrik'


class Table(NamedTuple):
    """Table of strings.

    Attributes
    ----------
    caption : str
    header : sequence of str
    lines : sequence of sequence of str
        Cells of each line, as many as columns.
    """

    caption: str
    header: Sequence[str]
    lines: Sequence[Sequence[str]]

    def text(self) -> str:
        """Return the table as Markdown with aligned columns."""
        widths = [max(len(cell) for cell in column) for column in zip(self.header, *self.lines)]

        def line(cells: Iterable[str]) -> str:
            return '| ' + ' | '.join(
                cell.rjust(width) if number else cell.ljust(width)
                for cell, width, number in zip(cells, widths, numbers)) + ' |'

        numbers = [all(cell[:1] in '-–0123456789' for cell in column)
                   for column in zip(*self.lines)] or [False] * len(widths)
        rule = '|' + '|'.join('-' * (width + 1) + ('-:'[number])
                              for width, number in zip(widths, numbers)) + '|'
        return '\n'.join((self.caption, '', line(self.header), rule, *map(line, self.lines)))


class Picture(NamedTuple):
    """Image file of an evaluation.

    Attributes
    ----------
    file : str
        Name within its folder.
    caption : str
    """

    file: str
    caption: str


class Losses(NamedTuple):
    """Cases in which the tracker is worse than what it is compared with.

    Attributes
    ----------
    lines : list of str
        One for each case.
    reason : str
        Why it is.
    """

    lines: list[str]
    reason: str


def fixed(value: float | None, digits: int = 2) -> str:
    """Format a number with fixed decimals; a dash for None and NaN."""
    return '–' if value is None or math.isnan(value) else f'{value:.{digits}f}'


def mean_and_p95(row: Row | None) -> str:
    """Format `mean_mm` and `p95_mm` of a row as 'mean (p95)'; a dash where there is none."""
    if row is None or row['mean_mm'] is None:
        return '–'
    return f'{fixed(row["mean_mm"])} ({fixed(row["p95_mm"], 1)})'


def words(name: str) -> str:
    """Return an identifier as words: no underscores, anatomical abbreviations in capitals."""
    plain = ' '.join(name.replace('_', ' ').split())
    return re.sub(rf"\b({'|'.join(ABBREVIATIONS)})\b", lambda found: found[0].upper(), plain)


def figure_with(count: int, width: float = 4., height: float = 3.2,
                columns: int | None = None) -> tuple[Figure, list[Axes]]:
    """Return a figure with plots in a grid and space for a legend above them.

    Parameters
    ----------
    count : int
        Number of plots.
    width, height : float
        Of one plot [inches].
    columns : int, optional
        Default: all plots in one row.

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : list of matplotlib.axes.Axes
    """
    # Imported here: matplotlib 3.5 lacks it, and the tables do without.
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    columns = columns or count
    rows = -(-count // columns)
    whole = rows * height + LEGEND_HEIGHT
    layout = ConstrainedLayoutEngine(rect=(0., 0., 1., rows * height / whole))
    figure = Figure(figsize=(columns * width, whole), dpi=120, layout=layout)
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for ax in axes[count:]:
        ax.remove()
    for ax in axes[:count]:
        for spine in ('top', 'right'):
            ax.spines[spine].set_visible(False)
        ax.tick_params(colors=INK, labelsize=8)
        ax.grid(axis='y', color=GRID, linewidth=.7)
        ax.set_axisbelow(True)
    return figure, axes[:count]


def plot_motions(ax: Axes, rows: Sequence[Row], key: str, value: str) -> None:
    """Plot one value of rows over the categories of another, a line for each motion.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    rows : sequence of dict
    key, value : str
        Keys of the abscissa and of the ordinate.
    """
    for i, motion in enumerate(dict.fromkeys(row['recording'] for row in rows)):
        mine = [row for row in rows if row['recording'] == motion]
        ax.plot([str(row[key]) for row in mine], [row[value] for row in mine],
                marker='osD^v<>PXh*'[i], markersize=4,
                color=SERIES_COLOURS[i % len(SERIES_COLOURS)], linewidth=1.2,
                linestyle='-' if i < len(SERIES_COLOURS) else '--',
                label=words(motion))


def share_top(axes: Sequence[Axes]) -> None:
    """Set equal limits of the ordinate, from zero, in all plots."""
    top = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(0., top)


def save_figure(figure: Figure, path: Path, legend_of: Axes | None = None) -> None:
    """Write a figure as PNG, with the legend of one of its plots above all."""
    if legend_of is not None:
        handles, labels = legend_of.get_legend_handles_labels()
        rows = -(-len(labels) // WIDEST_LEGEND)
        figure.legend(handles, labels, loc='upper center', ncol=-(-len(labels) // rows),
                      frameon=False, fontsize=8, labelcolor=INK)
    write_figure(path, figure)
