"""What noise of the markers and a wrong size of the hand do to the tracked pose.

The packaged demo motion at 120 Hz, every marker seen; the tracked hand errs as a calibrated
one besides, and wears the limits `wide`, as errors of size lead past those of the moving one.
Raw jitter is without smoothing. One PIP, at rest and swinging, tells what smoothing is worth and
where it ends: at 0.3 mm of noise on a hand of exactly known size.
"""

from functools import partial

import numpy as np

from ..core.model.hand import JOINTS
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from . import noise_pip
from .capture_tracking import track, tracked_joints
from .demo_frames import RATE, demo_frames, tracked_hand
from .metrics import angle_distance, high_frequency_energy, jerk, joint_errors, palm_pose_error
from .rows import spread
from .simulated import moving_distance
from .tables import COLOURS, INK, Picture, Table, figure_with, number, save

TITLE = 'Marker noise and size of the hand'

NOISES = (0., .1, .3, .5, 1., 2.)        # [mm] standard deviation per axis
SIZE_ERRORS = (-10., -5., -2., 0., 2., 5., 10.)  # [%]
USUAL_NOISE = .3                          # [mm] in the sweep of sizes
REST = .5                                 # [s] at the beginning, in which the demo's hand rests
PIP = [i for i, joint in enumerate(JOINTS) if 'pip' in joint]


def evaluate(options):
    """Yield a row for each noise and each size, of all joints.

    `degrees` is the mean angle between tracked and true joints that move, `pip_degrees` that of
    the fingers' PIP, `pip_rest_jitter_degrees` the root of the PIP's mean square above 10 Hz at
    rest, `pip_rest_jitter_raw_degrees` that without smoothing, `palm_degrees` and `palm_mm` the
    palm's mean errors. The rows of one PIP are those of `noise_pip`.
    """
    tasks = [('noise', noise, 0.) for noise in NOISES]
    tasks += [('size', USUAL_NOISE, error) for error in SIZE_ERRORS]
    yield from options.each('settings', partial(judge, seed=options.seed), tasks)
    yield from options.each('motions of one PIP', partial(noise_pip.judge, seed=options.seed),
                            noise_pip.tasks())


def judge(task, seed):
    """Return the row of one setting."""
    sweep, noise, size_error = task
    demo = demo_frames()
    hand, layout = tracked_hand(demo.hand, seed, 1. + size_error / 100.)
    # The same draws for each noise: only their size differs.
    draws = np.random.RandomState(seed + 1).normal(size=demo.markers.shape)
    markers = demo.markers + 1e-3 * noise * draws
    tracked = track(HandTracker(hand, layout), markers, RATE)
    rest = slice(round(REST * RATE))
    raw = track(HandTracker(hand, layout, TrackerOptions(smoothing=False)), markers[rest], RATE)
    errors = joint_errors(tracked_joints(hand, tracked), demo.joints)['all']
    angle, distance = palm_pose_error(
        tracked.wrist_rotation, tracked.wrist_position, demo.wrist_rotation, demo.wrist_position)
    still = tracked.angles[rest]
    pip = angle_distance(tracked.angles[:, PIP], demo.angles[:, PIP])
    return {
        'evaluation': 'noise', 'recording': 'demo', 'method': 'hand_tracker',
        'joint_class': 'all', 'sweep': sweep, 'noise_mm': noise, 'size_error_pct': size_error,
        **spread(errors), 'frames': len(demo.markers),
        'degrees': _mean(moving_distance(tracked.angles, demo.angles).degrees),
        'pip_degrees': _mean(pip.degrees),
        'pip_rest_jitter_degrees': _jitter(still),
        'pip_rest_jitter_raw_degrees': _jitter(raw.angles),
        'pip_rest_jerk': round(float(jerk(still[:, PIP], RATE).mean()), 2),
        'palm_degrees': _mean(np.degrees(angle)), 'palm_mm': _mean(1e3 * distance)}


def _jitter(angles):
    return _mean(np.degrees(np.sqrt(high_frequency_energy(angles[:, PIP], RATE))))


def _mean(values):
    return round(float(np.mean(values)), 4)


def _sweep(rows, sweep):
    return [row for row in rows if row['sweep'] == sweep]


def tables(rows):
    """Return the table of each sweep, and those of one PIP."""
    header = ('joints, mm mean', 'p95', 'angles, deg', 'PIP, deg', 'PIP jitter at rest, deg',
              'raw', 'palm, deg', 'palm, mm')

    def line(row):
        return tuple(number(row[key]) for key in (
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


def pictures(rows, folder):
    """Draw the errors over noise and over size."""
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
                    color=COLOURS[i], label=name)
        ax.set_xlabel(label, fontsize=8, color=INK)
        ax.set_ylim(bottom=0.)
    axes[0].set_ylabel('mean error', fontsize=8, color=INK)
    save(figure, folder / 'noise.png', axes[0])
    return [Picture('noise.png', 'Mean errors over marker noise and hand size')]
