"""Table 2b: tracking at 240 to 30 Hz, compared with 480 Hz.

Lower rates take every second, fourth, ... of the same frames. Poses are compared at the instants
of the lower rate, and, with its poses interpolated linearly, at all instants of 480 Hz, which
counts motion missed between frames too.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..simulation.motion_names import PAPER_RATE
from .evaluation_options import Options
from .rows import Row
from .simulated import distances, mean_max, paper_losses, tasks, trial
from .tables import Losses, Picture, Table, figure_with, plot_motions, save_figure

FRAME_RATES_DURATION = 10.    # [s]
FRAME_STRIDES = {240: 2, 120: 4, 60: 8, 30: 16}
# Published Dist² [rad²], mean (maximum), by rate [Hz].
TABLE_2B = {240: '0.006 (0.008)', 120: '0.007 (0.011)', 60: '0.009 (0.012)', 30: '0.010 (0.015)'}
COMPARED_INSTANTS = {'common': 'same instants', 'between': 'all instants'}


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each motion and rate.

    Keys with the prefix `common` compare at the instants of the lower rate, `between` at all of
    480 Hz, and `true` with the ground truth.
    """
    for rows in options.each('motions', judge, tasks(options)):
        yield from rows


def judge(task: tuple[str, int]) -> list[Row]:
    """Return the rows of one (motion, seed)."""
    motion, seed = task
    one = trial(motion, seed, PAPER_RATE, FRAME_RATES_DURATION)
    markers = one.measured()
    best = one.track(markers).angles
    rows: list[Row] = []
    instants = np.arange(len(best))
    for rate, every in FRAME_STRIDES.items():
        tracked = one.track(markers[::every], rate=float(rate))
        angles = tracked.angles
        # No extrapolation past the last frame of the lower rate.
        within = instants[instants <= instants[::every][-1]]
        joined = np.column_stack([
            np.interp(within, instants[::every], column) for column in angles.T])
        rows.append({
            'evaluation': 'rates', 'recording': motion, 'method': 'hand_tracker', 'seed': seed,
            'rate_hz': rate, **one.errors(tracked, every),
            **distances('common', angles, best[::every]),
            **distances('between', joined, best[within]),
            **distances('true', angles, one.angles[::every]), 'frames': len(angles)})
    return rows


def tables(rows: list[Row]) -> list[Table]:
    """Return Table 2b beside the published one, and a table of each motion."""
    lines, each = [], []
    for rate in FRAME_STRIDES:
        mine = [row for row in rows if row['rate_hz'] == rate]
        lines.append((str(rate), TABLE_2B[rate], *(
            mean_max(mine, f'{reading}_{name}', digits)
            for reading in COMPARED_INSTANTS
            for name, digits in (('squared', 4), ('dist', 3), ('deg', 2))),
            mean_max(mine, 'true_deg', 2)))
    for motion in dict.fromkeys(row['recording'] for row in rows):
        of_motion = {row['rate_hz']: row for row in rows if row['recording'] == motion}
        each.append((motion, *(f'{of_motion[rate][f"{reading}_squared"]:.4f}'
                               for reading in COMPARED_INSTANTS for rate in FRAME_STRIDES)))
    return [
        Table('Distance from tracking at 480 Hz (Eq. 11): at the same instants, and at all of '
              '480 Hz; mean (maximum)',
              ('Hz', 'paper', *(f'{name}, {what}' for what in COMPARED_INSTANTS.values()
                                for name in ('Dist² [rad²]', 'Dist [rad]', 'degrees a joint')),
               'degrees from truth'), lines),
        Table('Each motion: Dist² from 480 Hz',
              ('motion', *(f'{rate} Hz, {what}' for what in COMPARED_INSTANTS.values()
                           for rate in FRAME_STRIDES)),
              each)]


FRAME_RATES_LOSSES = (
    'The motions are not the paper\'s, which it does not describe in numbers. At the same '
    'instants only what the tracker remembers differs: mostly predictions of lost markers, and '
    'for moments which of two bends that fit a marker alike it is in.')


def losses(rows: list[Row]) -> Losses:
    """Return the rates with a distance at the same instants above the published one."""
    return Losses(paper_losses(rows, 'rate_hz', 'common_squared', TABLE_2B, 'Hz'),
                  FRAME_RATES_LOSSES)


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the pose distance by rate, from 480 Hz at the same instants and from the truth."""
    figure, axes = figure_with(2, width=5.)
    for ax, value, what in zip(axes, ('common_squared', 'true_deg'), (
            'Dist² from 480 Hz, same instants [rad²]', 'from the truth [degrees a joint]')):
        plot_motions(ax, rows, 'rate_hz', value)
        ax.set_xlabel('rate [Hz]', fontsize=8)
        ax.set_ylabel(what, fontsize=8)
    # Logarithmic: one fast motion exceeds the others by far.
    axes[0].set_yscale('log')
    axes[1].set_ylim(0.)
    save_figure(figure, folder / 'rates.png', axes[0])
    return [Picture('rates.png', 'Distance of poses by rate, each motion')]
