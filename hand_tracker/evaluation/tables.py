"""Tables and pictures in which evaluations show their rows."""

import re
from typing import NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

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

# Ours first, then what it is beside.
COLOURS = (BLUE, ORANGE, BLUISH_GREEN, REDDISH_PURPLE, SKY_BLUE, VERMILLION, '#555555')
ABBREVIATIONS = 'cmc', 'mcp', 'pip', 'dip', 'ip', 'fabrik'


class Table(NamedTuple):
    """A table of strings.

    Attributes
    ----------
    caption : str
    header : sequence of str
    lines : sequence of sequence of str
        As long as the header.
    """

    caption: str
    header: tuple
    lines: list

    def text(self):
        """Return the table as Markdown, columns aligned."""
        widths = [max(len(cell) for cell in column) for column in zip(self.header, *self.lines)]

        def line(cells):
            return '| ' + ' | '.join(
                cell.rjust(width) if number else cell.ljust(width)
                for cell, width, number in zip(cells, widths, numbers)) + ' |'

        numbers = [all(cell[:1] in '-–0123456789' for cell in column)
                   for column in zip(*self.lines)] or [False] * len(widths)
        rule = '|' + '|'.join('-' * (width + 1) + ('-:'[number])
                              for width, number in zip(widths, numbers)) + '|'
        return '\n'.join((self.caption, '', line(self.header), rule, *map(line, self.lines)))


class Picture(NamedTuple):
    """A drawn file.

    Attributes
    ----------
    file : str
        Name within the folder it was drawn into.
    caption : str
    """

    file: str
    caption: str


def number(value, digits=2):
    """Return a number as a table shows it; a dash for none."""
    return '–' if value is None else f'{value:.{digits}f}'


def mean_and_p95(row, digits=2):
    """Return 'mean (p95)' of a row's `mean_mm` and `p95_mm`; a dash where there is none."""
    if row is None or row['mean_mm'] is None:
        return '–'
    return f'{number(row["mean_mm"], digits)} ({number(row["p95_mm"], max(digits - 1, 0))})'


def words(name):
    """Return a name of the program as people write it."""
    plain = ' '.join(name.replace('_', ' ').split())
    return re.sub(rf"\b({'|'.join(ABBREVIATIONS)})\b", lambda found: found[0].upper(), plain)


def figure_with(count, width=4., height=3.2, legend_height=.45, columns=None):
    """Return a figure and plain axes in it, with room for a legend above.

    Parameters
    ----------
    count : int
        Of pairs of axes.
    width, height, legend_height : float
        Of one pair of axes, and of the legend [inches].
    columns : int, optional
        All stand in a row when left out.

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : list of matplotlib.axes.Axes
    """
    columns = columns or count
    rows = -(-count // columns)
    whole = rows * height + legend_height
    figure = Figure(figsize=(columns * width, whole), dpi=120, layout='constrained')
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(rect=(0., 0., 1., rows * height / whole))
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


def plot_motions(ax, rows, key, value):
    """Plot a line for each motion: one value of its rows over another, which is named as it is."""
    for i, motion in enumerate(dict.fromkeys(row['recording'] for row in rows)):
        mine = [row for row in rows if row['recording'] == motion]
        ax.plot([str(row[key]) for row in mine], [row[value] for row in mine],
                marker='osD^v<>PX'[i], color=COLOURS[i % len(COLOURS)], markersize=4,
                linewidth=1.2, linestyle='-' if i < len(COLOURS) else '--', label=words(motion))


def share_top(axes):
    """Let axes begin at zero and end alike."""
    top = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(0., top)


def save(figure, path, legend_of=None):
    """Write a figure, with the legend of one of its axes above all."""
    if legend_of is not None:
        handles, labels = legend_of.get_legend_handles_labels()
        figure.legend(handles, labels, loc='upper center', ncols=len(labels), frameon=False,
                      fontsize=8, labelcolor=INK)
    # Without the software's version the same numbers give the same bytes.
    figure.savefig(path, metadata={'Software': None})
