"""Table 2a: tracking with 6, 4 and 2 of the eight cameras, compared with all eight.

The subsets see the same noise as the same cameras among the eight.

The simulated cameras lose few markers: the last column, 1.2 % with four. The distances that the
paper reports with four cameras mean that far more were hidden from it, so its figures and these
are of data that are not equally hard.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .evaluation_options import Options
from .rows import Row
from .simulated import distances, mean_max, paper_losses, tasks, trial
from .tables import Losses, Picture, Table, figure_with, plot_motions, save_figure

CAMERA_COUNT_RATE = 120.       # [Hz]
CAMERA_COUNT_DURATION = 20.    # [s]
# Cameras of the ring by number of cameras: as evenly spaced as possible; two at a right angle.
CAMERA_SUBSETS = {6: (0, 1, 2, 4, 5, 6), 4: (0, 2, 4, 6), 2: (0, 2)}
# Published Dist² [rad²], mean (maximum), by number of cameras.
TABLE_2A = {6: '0.07 (0.36)', 4: '0.49 (1.12)', 2: '0.58 (1.27)'}


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each motion and number of cameras.

    Keys with the prefix `against_8` compare with tracking by all cameras, those with `true` with
    the ground truth.
    """
    for rows in options.each('motions', judge, tasks(options)):
        yield from rows


def judge(task: tuple[str, int]) -> list[Row]:
    """Return the rows of one (motion, seed)."""
    motion, seed = task
    one = trial(motion, seed, CAMERA_COUNT_RATE, CAMERA_COUNT_DURATION)
    rows: list[Row] = []
    best = None
    for count, cameras in ((8, None), *CAMERA_SUBSETS.items()):
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


def tables(rows: list[Row]) -> list[Table]:
    """Return Table 2a beside the published one, and a table of each motion."""
    lines, each = [], []
    for count in (8, *CAMERA_SUBSETS):
        mine = [row for row in rows if row['cameras'] == count]
        lost = sum(row['lost_pct'] for row in mine) / len(mine)
        against = [mean_max(mine, f'against_8_{name}', digits) if count != 8 else '–'
                   for name, digits in (('squared', 3), ('dist', 2), ('deg', 1))]
        lines.append((str(count), TABLE_2A.get(count, '–'), *against,
                      mean_max(mine, 'true_squared', 3), mean_max(mine, 'true_deg', 1),
                      f'{lost:.1f}'))
    for motion in dict.fromkeys(row['recording'] for row in rows):
        of_motion = {row['cameras']: row for row in rows if row['recording'] == motion}
        each.append((motion,
                     *(f'{of_motion[count]["against_8_squared"]:.3f}' for count in CAMERA_SUBSETS),
                     *(f'{of_motion[count]["true_deg"]:.1f}' for count in of_motion),
                     *(f'{of_motion[count]["lost_pct"]:.1f}' for count in of_motion)))
    return [
        Table('Distance from tracking with 8 cameras (Eq. 11), and from the truth; mean (maximum)',
              ('cameras', 'paper', 'Dist² [rad²]', 'Dist [rad]', 'degrees a joint',
               'Dist² from truth', 'degrees from truth', 'markers lost [%]'), lines),
        Table('Each motion: Dist² from 8 cameras, degrees a joint from the truth, '
              'markers lost [%]',
              ('motion', *(f'Dist² {count}' for count in CAMERA_SUBSETS),
               *(f'deg {count}' for count in (8, *CAMERA_SUBSETS)),
               *(f'lost {count}' for count in (8, *CAMERA_SUBSETS))), each)]


CAMERA_COUNT_LOSSES = (
    'The motions are not the paper\'s, which it does not describe in numbers. A maximum is one '
    'instant of one motion: that of a marker lost for long in a quick movement, or of a bend '
    'that fits the markers as well as the true one.')


def losses(rows: list[Row]) -> Losses:
    """Return the numbers of cameras with a distance above the published one."""
    return Losses(paper_losses(rows, 'cameras', 'against_8_squared', TABLE_2A, 'cameras'),
                  CAMERA_COUNT_LOSSES)


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the pose distance by number of cameras, from eight cameras and from the truth."""
    figure, axes = figure_with(2, width=5.)
    for ax, shown, value, title in (
            (axes[0], [row for row in rows if row['cameras'] in CAMERA_SUBSETS],
             'against_8_squared', 'Dist² from 8 cameras [rad²]'),
            (axes[1], rows, 'true_deg', 'from the truth [degrees a joint]')):
        plot_motions(ax, shown, 'cameras', value)
        ax.set_xlabel('cameras', fontsize=8)
        ax.set_ylabel(title, fontsize=8)
    # Logarithmic: one motion with long occlusions exceeds the others by far.
    axes[0].set_yscale('log')
    axes[1].set_ylim(0.)
    save_figure(figure, folder / 'cameras.png', axes[0])
    return [Picture('cameras.png', 'Distance of poses by number of cameras, each motion')]
