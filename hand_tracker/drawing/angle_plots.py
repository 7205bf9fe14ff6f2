"""Plots of a tracked recording: a page for each digit, with what was seen beside its angles.

Command: ``hand_tracker plot RECORDING -o OUT.pdf``; `save_pages` draws the same from arrays.
"""

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ..core.errors import HandTrackerError
from ..core.model.hand import DIGITS, JOINTS, UNOBSERVED_JOINTS
from ..core.model.marker_layout import MARKERS, PALM_MARKERS
from ..core.model.states import MarkerState
from .palette import ANGLE, GRID, INK, MARKER_COLOURS, MUTED, PAPER, VERMILLION

PDF, PNG = '.pdf', '.png'
FARTHER = 3.     # usual steps of time after which frames are missing
WIDTH = 10.      # [inches]
PANEL, STRIP = 1.15, .72
HEADER, FOOTER = .75, .5
LEFT, RIGHT = .95, .25
BETWEEN = .14
DPI = 120
DASHED = (0, (4, 3))
MARGIN = .07     # shown beyond a limit, of the range within
LEAST_MM = 1.    # of the scale of residuals


class PlotError(HandTrackerError, ValueError):
    """Nothing can be plotted, or not there."""


class History(NamedTuple):
    """What a tracker said of n frames, as far as it is plotted.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Not decreasing [s].
    angles : ndarray, shape (n, 25)
        [rad]
    marker_states : ndarray of int, shape (n, 8)
        Of `MarkerState`.
    residuals : ndarray, shape (n, 8)
        Of markers seen, else NaN [m].
    """

    times: np.ndarray
    angles: np.ndarray
    marker_states: np.ndarray
    residuals: np.ndarray


def history(frames):
    """Return the history of tracked frames.

    Parameters
    ----------
    frames : iterable of (float, HandState)
        Time [s], and what `HandTracker.update` returned.

    Returns
    -------
    History

    Raises
    ------
    PlotError
        If there is no frame, or time runs backwards.
    """
    # Copied, as a state is part of a larger record.
    rows = [(time, state.angles.copy(), state.marker_states.copy(), state.residuals.copy())
            for time, state in frames]
    if not rows:
        raise PlotError('no frames; expected at least one')
    found = History(*map(np.array, zip(*rows)))
    back = np.flatnonzero(np.diff(found.times) < 0.)
    if back.size:
        raise PlotError(f'times: frame {back[0] + 1} is before frame {back[0]}; '
                        'expected times that never decrease')
    return found


def save_pages(path, tracked, hand, title=''):
    """Write a page for each digit: its angles, their limits, its markers' states and residual.

    Parameters
    ----------
    path : path-like
        A `.pdf` of five pages; a `.png`, to whose name each digit's is added; or a folder for
        `index.png` to `thumb.png`, made if it is not there.
    tracked : History
    hand : Hand
        Whose limits are drawn.
    title : str, optional
        Beside the name of the digit.

    Returns
    -------
    list of Path
        What was written, replaced if it was there.

    Raises
    ------
    PlotError
        If the path has another extension, or cannot be written to.
    """
    path = require_output(path)
    if path.suffix not in (PDF, PNG):
        path.mkdir(parents=True, exist_ok=True)
    names = [path] if path.suffix == PDF else [
        path.with_name(f'{path.stem}_{digit}{PNG}') if path.suffix else path / f'{digit}{PNG}'
        for digit in DIGITS]
    pages = (page(tracked, hand, digit, title) for digit in DIGITS)
    with TemporaryDirectory(dir=names[0].parent) as scratch:
        unfinished = [Path(scratch, name.name) for name in names]
        if path.suffix == PDF:
            with PdfPages(unfinished[0], metadata={'Title': title}) as pdf:
                for figure in pages:
                    pdf.savefig(figure)
        else:
            for name, figure in zip(unfinished, pages):
                figure.savefig(name)
        for name, final in zip(unfinished, names):
            os.replace(name, final)
    return names


def require_output(path):
    """Return a path that `save_pages` can write to.

    Raises
    ------
    PlotError
        If it has another extension, is no folder where one is needed, or one where not.
    """
    path = Path(path)
    if path.suffix not in (PDF, PNG, ''):
        raise PlotError(f'{path}: unknown extension {path.suffix!r}; '
                        f'expected {PDF}, {PNG} or a folder')
    if path.suffix and path.is_dir():
        raise PlotError(f'{path}: is a folder; expected another name for the output')
    if path.suffix and not path.parent.is_dir():
        raise PlotError(f'{path}: no folder {path.parent}; expected one to write into')
    if not path.suffix and path.exists() and not path.is_dir():
        raise PlotError(f'{path}: is no folder; expected one, or a name with {PDF} or {PNG}')
    return path


def page(tracked, hand, digit, title='', truth=None):
    """Return the page of a digit.

    Parameters
    ----------
    tracked : History
    hand : Hand
    digit : str
        One of `DIGITS`.
    title : str, optional
    truth : ndarray, shape (n, 25), optional
        Angles to draw beside those tracked [rad].

    Returns
    -------
    matplotlib.figure.Figure
    """
    # A joint that is still, or whose limits are one, has no angle to plot.
    joints = [i for i, joint in enumerate(JOINTS) if joint.startswith(digit)
              and joint not in UNOBSERVED_JOINTS and np.ptp(hand.limits[i]) > 0.]
    markers = [MARKERS.index(marker) for marker in (digit, *PALM_MARKERS)]
    heights = [STRIP] + [PANEL] * (len(joints) + 1)
    height = HEADER + sum(heights) + BETWEEN * len(joints + [0]) + FOOTER
    figure = Figure(figsize=(WIDTH, height), dpi=DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    axes, top = [], height - HEADER
    for tall in heights:
        axes.append(figure.add_axes((LEFT / WIDTH, (top - tall) / height,
                                     (WIDTH - LEFT - RIGHT) / WIDTH, tall / height)))
        top -= tall + BETWEEN
    first = tracked.times[0]
    times = tracked.times - first
    steps = np.diff(times)
    step = np.median(steps[steps > 0.]) if (steps > 0.).any() else 1.
    for ax in axes:
        _plain(ax, ax is axes[-1])
        ax.set_xlim(times[0], times[-1] + step)
    spans = [_spans(times, step, tracked.marker_states[:, marker]) for marker in markers]
    _draw_markers(axes[0], markers, spans)
    missing = np.flatnonzero(steps > FARTHER * step) + 1
    own = MARKERS.index(digit)
    for ax, joint in zip(axes[1:], joints):
        _shade(ax, spans[0])
        if truth is not None:
            ax.plot(_with_gaps(times, missing), _with_gaps(
                np.degrees(truth[:, joint]), missing), color=VERMILLION, linewidth=1.1)
        _draw_angle(ax, _with_gaps(times, missing),
                    _with_gaps(np.degrees(tracked.angles[:, joint]), missing),
                    np.degrees(hand.limits[joint]))
        ax.set_ylabel(joint_title(JOINTS[joint]) + ' [°]')
    _shade(axes[-1], spans[0])
    _draw_residual(axes[-1], _with_gaps(times, missing),
                   _with_gaps(1e3 * tracked.residuals[:, own], missing))
    axes[-1].set_xlabel('time [s]')
    figure.align_ylabels(axes)
    lines = [('angle', ANGLE, '-')] + [('truth', VERMILLION, '-')] * (truth is not None) + [
        ('limit', INK, DASHED)]
    _head(figure, height, digit, title, tracked.marker_states[:, markers], lines)
    return figure


def joint_title(joint):
    """Return the title of a joint, as 'MCP abduction'."""
    name, direction = joint.split('_')[1:]
    return f'{name.upper()}\n{direction}'


def _plain(ax, last):
    ax.set_facecolor(PAPER)
    for spine in ('top', 'right'):
        ax.spines[spine].set_visible(False)
    for spine in ('left', 'bottom'):
        ax.spines[spine].set_color(MUTED)
    ax.tick_params(colors=INK, labelsize=8, color=MUTED, labelbottom=last)
    ax.xaxis.label.set(color=INK, size=9)
    ax.yaxis.label.set(color=INK, size=8)
    ax.grid(axis='x', color=GRID, linewidth=.7)
    ax.set_axisbelow(True)


def _spans(times, step, states):
    """Return start and length of all times in which a marker has each state [s]."""
    # A frame counts until the next one, unless frames are missing.
    ends = np.append(np.minimum(times[1:], times[:-1] + FARTHER * step), times[-1] + step)
    begins = np.flatnonzero(np.append(
        True, (states[1:] != states[:-1]) | (times[1:] > ends[:-1])))
    lasts = np.append(begins[1:], len(times)) - 1
    lengths = ends[lasts] - times[begins]
    return {state: np.column_stack((times[begins], lengths))[states[begins] == state]
            for state in MarkerState}


def _with_gaps(values, missing):
    """Return values with NaN where frames are missing, so that no line leads across."""
    return np.insert(values, missing, np.nan)


def _draw_markers(ax, markers, spans):
    for row, by_state in enumerate(spans):
        for state, where in by_state.items():
            ax.broken_barh(where, (row - .36, .72), color=MARKER_COLOURS[state], linewidth=0)
    ax.set_ylim(len(markers) - .4, -.6)
    ax.set_yticks(range(len(markers)), [MARKERS[marker].replace('_mcp', ' MCP')
                                        for marker in markers])
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.tick_params(length=0)


def _shade(ax, by_state):
    for state, where in by_state.items():
        if state != MarkerState.SEEN:
            ax.broken_barh(where, (0., 1.), transform=ax.get_xaxis_transform(), linewidth=0,
                           color=MARKER_COLOURS[state], alpha=.25, zorder=.5)


def _draw_angle(ax, times, angles, limits):
    shown = limits + MARGIN * np.ptp(limits) * np.array((-1., 1.))
    ax.set_ylim(shown)
    for limit, end in zip(limits, shown):
        ax.axhspan(limit, end, color=GRID, linewidth=0, zorder=.4)
        ax.axhline(limit, color=INK, linewidth=.9, linestyle=DASHED)
    ax.plot(times, angles, color=ANGLE, linewidth=1.3)
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 1.5, 3, 6, 10]))


def _draw_residual(ax, times, residuals):
    ax.plot(times, residuals, color=INK, linewidth=.8)
    found = residuals[np.isfinite(residuals)]
    ax.set_ylim(0., max(LEAST_MM, 1.05 * found.max(initial=0.)))
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.set_ylabel('residual\n[mm]')


def _head(figure, height, digit, title, states, lines):
    """Write digit, title, how long its marker had which state, and the legend."""
    name = digit if digit == 'thumb' else f'{digit} finger'
    figure.text(.2 / WIDTH, 1. - .16 / height, name.capitalize(), color=INK, fontsize=14,
                weight='bold', va='top')
    shares = ((state, (states[:, 0] == state).mean()) for state in MarkerState)
    said = ', '.join(f'{100. * share:.1f} % {state.name.lower()}'
                     for state, share in shares if share)
    figure.text(.2 / WIDTH, 1. - .47 / height, ' · '.join(filter(None, (
        title, f'its marker: {said}'))), color=MUTED, fontsize=8.5, va='top')
    handles = [Line2D([], [], color=colour, linewidth=1.3, linestyle=style, label=label)
               for label, colour, style in lines]
    handles += [Patch(color=MARKER_COLOURS[state], label=f'{state.name.lower()}')
                for state in MarkerState if (states == state).any()]
    figure.legend(handles=handles, loc='upper right', ncols=len(handles), frameon=False,
                  bbox_to_anchor=(1. - (RIGHT - .1) / WIDTH, 1. - .06 / height),
                  fontsize=8.5, labelcolor=INK, handlelength=1.3, columnspacing=1.1,
                  handletextpad=.5)
