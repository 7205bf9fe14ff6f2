"""Table 2a: a hand tracked with 6, 4 and 2 of the eight cameras, against all eight.

The fewer cameras are some of the eight, with the very noise they had among them.
"""

import numpy as np

from .simulated import distances, mean_max, paper_losses, tasks, trial
from .tables import Picture, Table, figure_with, plot_motions, save

TITLE = 'Fewer cameras (Table 2a)'
RATE = 120.       # [Hz]
DURATION = 20.    # [s]
# Of the ring's eight, in its order: evenly spaced as far as that goes; two at a right angle.
SUBSETS = {6: (0, 1, 2, 4, 5, 6), 4: (0, 2, 4, 6), 2: (0, 2)}
PAPER = {6: '0.07 (0.36)', 4: '0.49 (1.12)', 2: '0.58 (1.27)'}
WHY = ('The motions are not the paper\'s, which it does not describe in numbers. A maximum is one '
       'instant of one motion: that of a marker lost for long in a quick movement, or of a bend '
       'that fits the markers as well as the true one.')


def evaluate(options):
    """Yield a row for each motion and number of cameras.

    Keys that begin with `against_8` compare with tracking by all cameras, those that begin
    with `true` with the truth.
    """
    for rows in options.each('motions', judge, tasks(options)):
        yield from rows


def judge(task):
    """Return the rows of one motion."""
    motion, seed = task
    one = trial(motion, seed, RATE, DURATION)
    rows, best = [], None
    for count, cameras in {8: None, **SUBSETS}.items():
        markers = one.measured(cameras)
        tracked = one.track(markers)
        angles = tracked.angles
        best = angles if best is None else best
        rows.append({
            'evaluation': 'cameras', 'recording': motion, 'method': 'hand_tracker', 'seed': seed,
            'cameras': count, **one.errors(tracked), **distances('against_8', angles, best),
            **distances('true', angles, one.angles),
            'lost_pct': round(100. * float(np.isnan(markers[..., 0]).mean()), 3),
            'frames': len(angles)})
    return rows


def tables(rows):
    """Return Table 2a beside the paper's, and the numbers of each motion."""
    lines, each = [], []
    for count in (8, *SUBSETS):
        mine = [row for row in rows if row['cameras'] == count]
        lost = sum(row['lost_pct'] for row in mine) / len(mine)
        against = [mean_max(mine, f'against_8_{name}', digits) if count != 8 else '–'
                   for name, digits in (('squared', 3), ('dist', 2), ('deg', 1))]
        lines.append((str(count), PAPER.get(count, '–'), *against,
                      mean_max(mine, 'true_squared', 3), mean_max(mine, 'true_deg', 1),
                      f'{lost:.1f}'))
    for motion in dict.fromkeys(row['recording'] for row in rows):
        mine = {row['cameras']: row for row in rows if row['recording'] == motion}
        each.append((motion, *(f'{mine[count]["against_8_squared"]:.3f}' for count in SUBSETS),
                     *(f'{mine[count]["true_deg"]:.1f}' for count in mine),
                     *(f'{mine[count]["lost_pct"]:.1f}' for count in mine)))
    return [
        Table('Distance from tracking with 8 cameras (Eq. 11), and from the truth; mean (maximum)',
              ('cameras', 'paper', 'Dist² [rad²]', 'Dist [rad]', 'degrees a joint',
               'Dist² from truth', 'degrees from truth', 'markers lost [%]'), lines),
        Table('Each motion: Dist² from 8 cameras, degrees a joint from the truth, '
              'markers lost [%]',
              ('motion', *(f'Dist² {count}' for count in SUBSETS),
               *(f'deg {count}' for count in (8, *SUBSETS)),
               *(f'lost {count}' for count in (8, *SUBSETS))), each)]


def losses(rows):
    """Return with how many cameras the distance is above the paper's."""
    return paper_losses(rows, 'cameras', 'against_8_squared', PAPER, 'cameras')


def pictures(rows, folder):
    """Draw the distance of each number of cameras from eight, and from the truth."""
    figure, axes = figure_with(2, width=5.)
    for ax, shown, value, title in (
            (axes[0], [row for row in rows if row['cameras'] in SUBSETS], 'against_8_squared',
             'Dist² from 8 cameras [rad²]'),
            (axes[1], rows, 'true_deg', 'from the truth [degrees a joint]')):
        plot_motions(ax, shown, 'cameras', value)
        ax.set_xlabel('cameras', fontsize=8)
        ax.set_ylabel(title, fontsize=8)
    # A motion that is hard to see would flatten the others.
    axes[0].set_yscale('log')
    axes[1].set_ylim(0.)
    save(figure, folder / 'cameras.png', axes[0])
    return [Picture('cameras.png', 'Distance of poses by number of cameras, each motion')]
