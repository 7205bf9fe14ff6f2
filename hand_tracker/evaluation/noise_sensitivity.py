"""Sensitivity of the tracked pose to marker noise and to a wrong size of the hand model.

The demo motion at 120 Hz with all markers visible; the hand model has calibration errors and the
limits `wide`, since with wrong lengths the solution exceeds the moving hand's limits. Raw jitter
is without smoothing. A single PIP, at rest and swinging, shows gain and lag of the smoothing, at
0.3 mm of noise and with an exact hand model.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from ..core.model.hand import JOINTS
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from ..simulation.packaged_recordings import RECORDING_RATE
from . import noise_pip
from .capture_tracking import track_markers, tracked_joints
from .demo_frames import demo_frames, tracked_hand
from .evaluation_options import Options
from .metrics import angle_distance, high_frequency_energy, jerk, joint_errors, palm_pose_error
from .noise_pip import USUAL_NOISE
from .rows import Row, error_statistics
from .simulated import moving_distance
from .tables import INK, SERIES_COLOURS, Picture, Table, figure_with, fixed, save_figure

NOISE_LEVELS = (0., .1, .3, .5, 1., 2.)  # [mm] standard deviation per axis
SIZE_ERRORS = (-10., -5., -2., 0., 2., 5., 10.)  # [%]
REST_LENGTH = .5                          # [s] of rest at the start of the demo motion
PIP_JOINTS = [i for i, joint in enumerate(JOINTS) if 'pip' in joint]


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each noise level and each size error, then the rows of `noise_pip`.

    `degrees` is the mean angular error of the joints that move, `pip_degrees` that of the
    fingers' PIP, `pip_rest_jitter_degrees` the root mean square of the PIP above 10 Hz at rest,
    `pip_rest_jitter_raw_degrees` that without smoothing, `palm_degrees` and `palm_mm` the mean
    errors of the palm.
    """
    tasks = [('noise', noise, 0.) for noise in NOISE_LEVELS]
    tasks += [('size', USUAL_NOISE, error) for error in SIZE_ERRORS]
    yield from options.each('settings', partial(judge, seed=options.seed), tasks)
    yield from options.each('motions of one PIP', partial(noise_pip.judge, seed=options.seed),
                            noise_pip.pip_tasks())


def judge(task: tuple[str, float, float], seed: int) -> Row:
    """Return the row of one (sweep, noise [mm], size error [%])."""
    sweep, noise, size_error = task
    demo = demo_frames()
    hand, layout = tracked_hand(demo.hand, seed, 1. + size_error / 100.)
    # Equal draws for all levels, differently scaled.
    draws = np.random.RandomState(seed + 1).normal(size=demo.markers.shape)
    markers = demo.markers + 1e-3 * noise * draws
    tracked = track_markers(HandTracker(hand, layout), markers, RECORDING_RATE)
    rest = slice(round(REST_LENGTH * RECORDING_RATE))
    unsmoothed = HandTracker(hand, layout, TrackerOptions(smoothing=False))
    raw = track_markers(unsmoothed, markers[rest], RECORDING_RATE)
    errors = joint_errors(tracked_joints(hand, tracked), demo.joints)['all']
    angle, distance = palm_pose_error(
        tracked.wrist_rotation, tracked.wrist_position, demo.wrist_rotation, demo.wrist_position)
    still = tracked.angles[rest]
    pip = angle_distance(tracked.angles[:, PIP_JOINTS], demo.angles[:, PIP_JOINTS])
    return {
        'evaluation': 'noise', 'recording': 'demo', 'method': 'hand_tracker',
        'joint_class': 'all', 'sweep': sweep, 'noise_mm': noise, 'size_error_pct': size_error,
        **error_statistics(errors), 'frames': len(demo.markers),
        'degrees': _mean(moving_distance(tracked.angles, demo.angles).degrees),
        'pip_degrees': _mean(pip.degrees),
        'pip_rest_jitter_degrees': _jitter(still),
        'pip_rest_jitter_raw_degrees': _jitter(raw.angles),
        'pip_rest_jerk': round(float(jerk(still[:, PIP_JOINTS], RECORDING_RATE).mean()), 2),
        'palm_degrees': _mean(np.degrees(angle)), 'palm_mm': _mean(1e3 * distance)}


def _jitter(angles: np.ndarray) -> float:
    return _mean(np.degrees(np.sqrt(high_frequency_energy(angles[:, PIP_JOINTS], RECORDING_RATE))))


def _mean(values: np.ndarray) -> float:
    return round(float(np.mean(values)), 4)


def _sweep(rows: list[Row], sweep: str) -> list[Row]:
    return [row for row in rows if row['sweep'] == sweep]


def tables(rows: list[Row]) -> list[Table]:
    """Return the tables of both sweeps, and those of a single PIP."""
    header = ('joints, mm mean', 'p95', 'angles, deg', 'PIP, deg', 'PIP jitter at rest, deg',
              'raw', 'palm, deg', 'palm, mm')

    def line(row: Row) -> tuple[str, ...]:
        return tuple(fixed(row[key]) for key in (
            'mean_mm', 'p95_mm', 'degrees', 'pip_degrees', 'pip_rest_jitter_degrees',
            'pip_rest_jitter_raw_degrees', 'palm_degrees', 'palm_mm'))

    return [
        Table('Errors over the noise of the markers (standard deviation per axis)',
              ('noise, mm', *header),
              [(f'{row["noise_mm"]:g}', *line(row)) for row in _sweep(rows, 'noise')]),
        Table(f'Errors over the error of the hand\'s size, at {USUAL_NOISE:g} mm of noise',
              ('size, %', *header),
              [(f'{row["size_error_pct"]:g}', *line(row)) for row in _sweep(rows, 'size')]),
        *noise_pip.tables(rows)]


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the errors over marker noise and over size error."""
    figure, axes = figure_with(2)
    for ax, (sweep, key, label) in zip(axes, (
            ('noise', 'noise_mm', 'noise of the markers [mm]'),
            ('size', 'size_error_pct', 'error of the hand\'s size [%]'))):
        found = _sweep(rows, sweep)
        x = [row[key] for row in found]
        for i, (what, name) in enumerate((
                ('mean_mm', 'joints [mm]'), ('degrees', 'angles [degrees]'),
                ('palm_mm', 'palm [mm]'))):
            ax.plot(x, [row[what] for row in found], marker='osD'[i], markersize=4,
                    color=SERIES_COLOURS[i], label=name)
        ax.set_xlabel(label, fontsize=8, color=INK)
        ax.set_ylim(bottom=0.)
    axes[0].set_ylabel('mean error', fontsize=8, color=INK)
    save_figure(figure, folder / 'noise.png', axes[0])
    return [Picture('noise.png', 'Mean errors over marker noise and hand size')]
