"""Plots of tracked angles over time: a page for each digit, with its markers' states.

Command: ``hand_tracker plot RECORDING -o OUT.pdf``; `save_pages` draws the same from arrays.
"""

import os
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ..core.errors import HandTrackerError
from ..core.model.hand import DIGITS, JOINTS, RESTING_JOINTS, Hand
from ..core.model.marker_layout import PALM_LANDMARKS, PALM_MARKERS, MarkerLayout
from ..core.model.states import MarkerState
from ..core.tracker import HandState
from ..output_files import folder_beside, require_folder, require_suffix
from .palette import BLUE, GRID, INK, MARKER_COLOURS, MUTED, PAPER_WHITE, VERMILLION

PDF, PNG = '.pdf', '.png'
MAX_STEP_RATIO = 3.  # median periods, above which frames are missing between two
PAGE_WIDTH = 10.     # [inches]
ANGLE_HEIGHT, MARKERS_HEIGHT = 1.15, .72  # [inches] of a panel
PAGE_HEADER, PAGE_FOOTER = .75, .5        # [inches]
LEFT_MARGIN, RIGHT_MARGIN = .95, .25      # [inches]
PANEL_GAP = .14                           # [inches]
PAGE_DPI = 120
DASHED = (0, (4, 3))
BEYOND_LIMITS = .07  # shown on both sides, as a share of the range of motion
MIN_RESIDUAL_SCALE = 1.  # [mm]


class PlotError(HandTrackerError, ValueError):
    """There are no frames to plot, or the output cannot be written."""


class TrackedAngles(NamedTuple):
    """The plotted part of n tracked frames.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Not decreasing [s].
    angles : ndarray, shape (n, 25)
        [rad]
    marker_states : ndarray of int, shape (n, markers)
        Values of `MarkerState`.
    residuals : ndarray, shape (n, markers)
        Distance of each seen marker from its place on the hand, else NaN [m].
    """

    times: np.ndarray
    angles: np.ndarray
    marker_states: np.ndarray
    residuals: np.ndarray


def tracked_angles(frames: Iterable[tuple[float, HandState]]) -> TrackedAngles:
    """Collect the plotted part of tracked frames.

    Parameters
    ----------
    frames : iterable of (float, HandState)
        Time [s], and the result of `HandTracker.update`.

    Returns
    -------
    TrackedAngles

    Raises
    ------
    PlotError
        If there is no frame, or times decrease.
    """
    # Copied, to release the rest of the state.
    rows = [(time, state.angles.copy(), state.marker_states.copy(), state.residuals.copy())
            for time, state in frames]
    if not rows:
        raise PlotError('no frames; expected at least one')
    tracked = TrackedAngles(*map(np.array, zip(*rows)))
    back = np.flatnonzero(np.diff(tracked.times) < 0.)
    if back.size:
        raise PlotError(f'times: frame {back[0] + 1} is before frame {back[0]}; '
                        'expected times that never decrease')
    return tracked


def save_pages(path: str | PathLike[str], tracked: TrackedAngles, hand: Hand,
               title: str = '', layout: MarkerLayout | None = None) -> list[Path]:
    """Plot a page for each digit: angles, limits, marker states and residual.

    Parameters
    ----------
    path : path-like
        A `.pdf` of five pages; a `.png`, to whose name each digit's is added; or a folder for
        `index.png` to `thumb.png`, created if missing.
    tracked : TrackedAngles
    hand : Hand
        Its limits are drawn.
    title : str, optional
        In the header of each page.
    layout : MarkerLayout, optional
        The paper's eight markers when left out.

    Returns
    -------
    list of Path
        The files written; existing ones are replaced.

    Raises
    ------
    PlotError
        If the path has another extension, or cannot be written to.
    """
    path = require_output(path)
    is_pdf = path.suffix.lower() == PDF
    if not path.suffix:
        path.mkdir(parents=True, exist_ok=True)
    names = [path] if is_pdf else [
        path.with_name(f'{path.stem}_{digit}{PNG}') if path.suffix else path / f'{digit}{PNG}'
        for digit in DIGITS]
    pages = (digit_page(tracked, hand, digit, title, layout=layout) for digit in DIGITS)
    with folder_beside(names[0], PlotError) as scratch:
        unfinished = [scratch / name.name for name in names]
        if is_pdf:
            with PdfPages(unfinished[0], metadata={'Title': title}) as pdf:
                for figure in pages:
                    pdf.savefig(figure)
        else:
            for name, figure in zip(unfinished, pages):
                figure.savefig(name)
        for name, final in zip(unfinished, names):
            os.replace(name, final)
    return names


def require_output(path: str | PathLike[str]) -> Path:
    """Return a path after checking that `save_pages` can write to it.

    Raises
    ------
    PlotError
        If its extension is unknown, its folder is missing, or it is a file instead of a folder or
        the reverse.
    """
    path = Path(path)
    require_suffix(path, (PDF, PNG, ''), f'{PDF}, {PNG} or a folder', PlotError)
    if path.suffix and path.is_dir():
        raise PlotError(f'{path}: is a folder; expected another name for the output')
    if path.suffix:
        require_folder(path, PlotError)
    if not path.suffix and path.exists() and not path.is_dir():
        raise PlotError(f'{path}: is no folder; expected one, or a name with {PDF} or {PNG}')
    return path


def _shown_markers(digit: str, layout: MarkerLayout) -> list[int]:
    """Return the rows of a digit's markers, its principal one first, and of the palm's three."""
    palm, rest = layout.principal[:len(PALM_MARKERS)], layout.principal[len(PALM_MARKERS):]
    first = rest[DIGITS.index(digit)]
    return [*(row for row in (first,) if row >= 0),
            *(row for row in layout.further if layout.places[row].startswith(f'{digit}_')
              and layout.places[row] not in PALM_LANDMARKS), *palm]


def digit_page(tracked: TrackedAngles, hand: Hand, digit: str, title: str = '',
               truth: np.ndarray | None = None, layout: MarkerLayout | None = None) -> Figure:
    """Plot the page of a digit.

    Parameters
    ----------
    tracked : TrackedAngles
    hand : Hand
        Its limits are drawn.
    digit : str
        One of `DIGITS`.
    title : str, optional
    truth : ndarray, shape (n, 25), optional
        True angles, drawn beneath those tracked [rad].
    layout : MarkerLayout, optional
        The paper's eight markers when left out.

    Returns
    -------
    matplotlib.figure.Figure
    """
    layout = layout or MarkerLayout()
    # Unobserved joints, and joints locked by their limits, are left out.
    joints = [i for i, joint in enumerate(JOINTS) if joint.startswith(digit)
              and joint not in RESTING_JOINTS and np.ptp(hand.limits[i]) > 0.]
    markers = _shown_markers(digit, layout)
    figure, axes = _stacked_panels([MARKERS_HEIGHT] + [ANGLE_HEIGHT] * (len(joints) + 1))
    times = tracked.times - tracked.times[0]
    steps = np.diff(times)
    step = np.median(steps[steps > 0.]) if (steps > 0.).any() else 1.
    for ax in axes:
        _style_panel(ax, ax is axes[-1])
        ax.set_xlim(times[0], times[-1] + step)
    spans = [_state_spans(times, step, tracked.marker_states[:, marker]) for marker in markers]
    _draw_marker_states(axes[0], [layout.names[marker] for marker in markers], spans)
    missing = np.flatnonzero(steps > MAX_STEP_RATIO * step) + 1
    for ax, joint in zip(axes[1:], joints):
        _shade_unseen(ax, spans[0])
        if truth is not None:
            ax.plot(_with_gaps(times, missing), _with_gaps(
                np.degrees(truth[:, joint]), missing), color=VERMILLION, linewidth=1.1)
        _draw_angle(ax, _with_gaps(times, missing),
                    _with_gaps(np.degrees(tracked.angles[:, joint]), missing),
                    np.degrees(hand.limits[joint]))
        ax.set_ylabel(_joint_title(JOINTS[joint]) + ' [°]')
    _shade_unseen(axes[-1], spans[0])
    _draw_residual(axes[-1], _with_gaps(times, missing),
                   _with_gaps(1e3 * tracked.residuals[:, markers[0]], missing))
    axes[-1].set_xlabel('time [s]')
    figure.align_ylabels(axes)
    lines = [('angle', BLUE, '-')] + [('truth', VERMILLION, '-')] * (truth is not None) + [
        ('limit', INK, DASHED)]
    _draw_header(figure, digit, title, tracked.marker_states[:, markers], lines)
    return figure


def _stacked_panels(heights: Sequence[float]) -> tuple[Figure, list[Axes]]:
    """Return a page with panels of these heights [inches], from top to bottom."""
    height = PAGE_HEADER + sum(heights) + PANEL_GAP * (len(heights) - 1) + PAGE_FOOTER
    figure = Figure(figsize=(PAGE_WIDTH, height), dpi=PAGE_DPI, facecolor=PAPER_WHITE)
    FigureCanvasAgg(figure)
    axes, top = [], height - PAGE_HEADER
    for panel_height in heights:
        axes.append(figure.add_axes((
            LEFT_MARGIN / PAGE_WIDTH, (top - panel_height) / height,
            (PAGE_WIDTH - LEFT_MARGIN - RIGHT_MARGIN) / PAGE_WIDTH, panel_height / height)))
        top -= panel_height + PANEL_GAP
    return figure, axes


def _joint_title(joint: str) -> str:
    """Return the title of a joint in two lines, like 'MCP' and 'abduction'."""
    name, direction = joint.split('_')[1:]
    return f'{name.upper()}\n{direction}'


def _style_panel(ax: Axes, is_lowest: bool) -> None:
    ax.set_facecolor(PAPER_WHITE)
    for spine in ('top', 'right'):
        ax.spines[spine].set_visible(False)
    for spine in ('left', 'bottom'):
        ax.spines[spine].set_color(MUTED)
    ax.tick_params(colors=INK, labelsize=8, color=MUTED, labelbottom=is_lowest)
    ax.xaxis.label.set(color=INK, size=9)
    ax.yaxis.label.set(color=INK, size=8)
    ax.grid(axis='x', color=GRID, linewidth=.7)
    ax.set_axisbelow(True)


def _state_spans(times: np.ndarray, step: float,
                 states: np.ndarray) -> dict[MarkerState, np.ndarray]:
    """Return start and length of each span of time in each state of a marker, shape (k, 2) [s]."""
    # A frame lasts until the next one, unless frames are missing.
    ends = np.append(np.minimum(times[1:], times[:-1] + MAX_STEP_RATIO * step), times[-1] + step)
    begins = np.flatnonzero(np.append(
        True, (states[1:] != states[:-1]) | (times[1:] > ends[:-1])))
    lasts = np.append(begins[1:], len(times)) - 1
    lengths = ends[lasts] - times[begins]
    return {state: np.column_stack((times[begins], lengths))[states[begins] == state]
            for state in MarkerState}


def _with_gaps(values: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Insert NaN where frames are missing, which interrupts a plotted line."""
    return np.insert(values, missing, np.nan)


def _draw_marker_states(ax: Axes, markers: Sequence[str],
                        spans: Sequence[dict[MarkerState, np.ndarray]]) -> None:
    for row, by_state in enumerate(spans):
        for state, where in by_state.items():
            ax.broken_barh(where.tolist(), (row - .36, .72), linewidth=0,
                           color=MARKER_COLOURS[state])
    ax.set_ylim(len(markers) - .4, -.6)
    ax.set_yticks(range(len(markers)), [marker.replace('_mcp', ' MCP') for marker in markers],
                  fontsize=None if len(markers) < 9 else 5)
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.tick_params(length=0)


def _shade_unseen(ax: Axes, by_state: dict[MarkerState, np.ndarray]) -> None:
    for state, where in by_state.items():
        if state != MarkerState.SEEN:
            ax.broken_barh(where.tolist(), (0., 1.), transform=ax.get_xaxis_transform(),
                           linewidth=0, color=MARKER_COLOURS[state], alpha=.25, zorder=.5)


def _draw_angle(ax: Axes, times: np.ndarray, angles: np.ndarray, limits: np.ndarray) -> None:
    shown = limits + BEYOND_LIMITS * np.ptp(limits) * np.array((-1., 1.))
    ax.set_ylim(shown)
    for limit, end in zip(limits, shown):
        ax.axhspan(limit, end, color=GRID, linewidth=0, zorder=.4)
        ax.axhline(limit, color=INK, linewidth=.9, linestyle=DASHED)
    ax.plot(times, angles, color=BLUE, linewidth=1.3)
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 1.5, 3, 6, 10]))


def _draw_residual(ax: Axes, times: np.ndarray, residuals: np.ndarray) -> None:
    ax.plot(times, residuals, color=INK, linewidth=.8)
    found = residuals[np.isfinite(residuals)]
    ax.set_ylim(0., max(MIN_RESIDUAL_SCALE, 1.05 * found.max(initial=0.)))
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.set_ylabel('residual\n[mm]')


def _draw_header(figure: Figure, digit: str, title: str, states: np.ndarray,
                 lines: Sequence[tuple]) -> None:
    """Write the digit, title, shares of its marker's states, and the legend."""
    height = figure.get_size_inches()[1]
    name = digit if digit == 'thumb' else f'{digit} finger'
    figure.text(.2 / PAGE_WIDTH, 1. - .16 / height, name.capitalize(), color=INK, fontsize=14,
                weight='bold', va='top')
    shares = ((state, (states[:, 0] == state).mean()) for state in MarkerState)
    percentages = ', '.join(f'{100. * share:.1f} % {state.name.lower()}'
                            for state, share in shares if share)
    figure.text(.2 / PAGE_WIDTH, 1. - .47 / height, ' · '.join(filter(None, (
        title, f'its marker: {percentages}'))), color=MUTED, fontsize=8.5, va='top')
    handles: list[Artist] = [
        Line2D([], [], color=colour, linewidth=1.3, linestyle=style, label=label)
        for label, colour, style in lines]
    handles += [Patch(color=MARKER_COLOURS[state], label=state.name.lower())
                for state in MarkerState if (states == state).any()]
    figure.legend(handles=handles, loc='upper right', ncol=len(handles), frameon=False,
                  bbox_to_anchor=(1. - (RIGHT_MARGIN - .1) / PAGE_WIDTH, 1. - .06 / height),
                  fontsize=8.5, labelcolor=INK, handlelength=1.3, columnspacing=1.1,
                  handletextpad=.5)
