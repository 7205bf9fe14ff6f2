"""Table 2b: a hand tracked at 240 to 30 Hz against 480 Hz.

Every lower rate is given every second, fourth, ... of the same frames. Poses are compared
where both have one, and, at all 480 instants of a second, with those of the lower rate
joined by straight lines: what is missed between frames then counts too.
"""

import numpy as np

from .simulated import distances, mean_max, paper_losses, tasks, trial
from .tables import Picture, Table, figure_with, plot_motions, save

TITLE = 'Lower rates (Table 2b)'
RATE = 480.                      # [Hz]
DURATION = 10.                   # [s]
EVERY = {240: 2, 120: 4, 60: 8, 30: 16}
PAPER = {240: '0.006 (0.008)', 120: '0.007 (0.011)', 60: '0.009 (0.012)', 30: '0.010 (0.015)'}
WHY = ('The motions are not the paper\'s, which it does not describe in numbers. At the same '
       'instants only what the tracker remembers differs: mostly predictions of lost markers, and '
       'for moments which of two bends that fit a marker alike it is in.')
READINGS = {'common': 'same instants', 'between': 'all instants'}


def evaluate(options):
    """Yield a row for each motion and rate.

    Keys that begin with `common` compare at the instants of both rates, with `between` at
    all of 480 Hz, with `true` with the truth.
    """
    for rows in options.each('motions', judge, tasks(options)):
        yield from rows


def judge(task):
    """Return the rows of one motion."""
    motion, seed = task
    one = trial(motion, seed, RATE, DURATION)
    markers = one.measured()
    best = one.track(markers).angles
    rows, instants = [], np.arange(len(best))
    for rate, every in EVERY.items():
        tracked = one.track(markers[::every], rate=float(rate))
        angles = tracked.angles
        # Past its last frame the lower rate has nothing to join.
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


def tables(rows):
    """Return Table 2b beside the paper's, and the numbers of each motion."""
    lines, each = [], []
    for rate in EVERY:
        mine = [row for row in rows if row['rate_hz'] == rate]
        lines.append((str(rate), PAPER[rate], *(
            mean_max(mine, f'{reading}_{name}', digits)
            for reading in READINGS for name, digits in (('squared', 4), ('dist', 3), ('deg', 2))),
            mean_max(mine, 'true_deg', 2)))
    for motion in dict.fromkeys(row['recording'] for row in rows):
        mine = {row['rate_hz']: row for row in rows if row['recording'] == motion}
        each.append((motion, *(f'{mine[rate][f"{reading}_squared"]:.4f}'
                               for reading in READINGS for rate in EVERY)))
    return [
        Table('Distance from tracking at 480 Hz (Eq. 11): at the same instants, and at all of '
              '480 Hz; mean (maximum)',
              ('Hz', 'paper', *(f'{name}, {what}' for what in READINGS.values()
                                for name in ('Dist² [rad²]', 'Dist [rad]', 'degrees a joint')),
               'degrees from truth'), lines),
        Table('Each motion: Dist² from 480 Hz',
              ('motion', *(f'{rate} Hz, {what}' for what in READINGS.values() for rate in EVERY)),
              each)]


def losses(rows):
    """Return at which rates the distance at the same instants is above the paper's."""
    return paper_losses(rows, 'rate_hz', 'common_squared', PAPER, 'Hz')


def pictures(rows, folder):
    """Draw the distance of each rate from 480 Hz, at the same instants, and from the truth."""
    figure, axes = figure_with(2, width=5.)
    for ax, value, what in zip(axes, ('common_squared', 'true_deg'), (
            'Dist² from 480 Hz, same instants [rad²]', 'from the truth [degrees a joint]')):
        plot_motions(ax, rows, 'rate_hz', value)
        ax.set_xlabel('rate [Hz]', fontsize=8)
        ax.set_ylabel(what, fontsize=8)
    # A motion that is hard to follow would flatten the others.
    axes[0].set_yscale('log')
    axes[1].set_ylim(0.)
    save(figure, folder / 'rates.png', axes[0])
    return [Picture('rates.png', 'Distance of poses by rate, each motion')]
