"""The solvers against each other: palm rigid or by spheres, fingers in closed form or by FABRIK.

The packaged demo motion at 120 Hz with 0.3 mm of noise, every marker seen; the tracked hand
errs as a calibrated one, and wears the limits `wide`.
"""

import time
from dataclasses import replace
from functools import partial

import numpy as np

from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from .capture_tracking import track, tracked_joints
from .demo_frames import RATE, demo_frames, tracked_hand
from .metrics import JOINT_CLASSES, joint_errors
from .rows import spread
from .simulated import moving_distance
from .tables import COLOURS, INK, Picture, Table, figure_with, mean_and_p95, number, save, words

TITLE = 'Solvers'

PALMS = ('rigid', 'spheres')
FINGERS = ('closed_form', 'fabrik')
CLASSES = tuple(JOINT_CLASSES)
DEFAULT = 'rigid + closed_form'
NOISE = .0003     # [m]
WARM_UP = 50      # [frames] before the clock counts: kernels are compiled at the first


def evaluate(options):
    """Yield a row for each pair of solvers and class of joint.

    `frame_us` is the mean time of `HandTracker.update`, which the clock measured;
    `iterations` those of FABRIK, of all digits in a frame.
    """
    # One after the other: neighbours would disturb the clock.
    alone = replace(options, jobs=1)
    for rows in alone.each('pairs of solvers', partial(judge, seed=options.seed),
                           [(palm, finger) for palm in PALMS for finger in FINGERS]):
        yield from rows


def judge(solvers, seed):
    """Return the rows of one pair of solvers."""
    palm, finger = solvers
    method = f'{palm} + {finger}'
    demo = demo_frames()
    hand, layout = tracked_hand(demo.hand, seed)
    noise = np.random.RandomState(seed + 1).normal(0., NOISE, demo.markers.shape)
    markers = demo.markers + noise
    tracker = HandTracker(
        hand, layout, TrackerOptions(palm_method=palm, finger_ik=finger))
    track(tracker, markers[:WARM_UP], RATE)
    tracker.reset()
    start = time.perf_counter()
    tracked = track(tracker, markers, RATE)
    frame = (time.perf_counter() - start) / len(markers)
    errors = joint_errors(tracked_joints(hand, tracked), demo.joints)
    return [{'evaluation': 'solvers', 'recording': 'demo', 'method': method, 'joint_class': name,
             **spread(errors[name]), 'frames': len(markers),
             'degrees': round(float(moving_distance(
                 tracked.angles, demo.angles).degrees.mean()), 4),
             'iterations': round(float(tracked.iterations.mean()), 3),
             'iterations_p95': round(float(np.percentile(tracked.iterations, 95.)), 3),
             'frame_us': round(1e6 * frame, 1)} for name in CLASSES]


def _methods(rows):
    return list(dict.fromkeys(row['method'] for row in rows))


def tables(rows):
    """Return the table of the solvers."""
    lines = []
    for method in _methods(rows):
        own = {row['joint_class']: row for row in rows if row['method'] == method}
        lines.append((method, *(mean_and_p95(own[name]) for name in CLASSES),
                      number(own['all']['degrees']), number(own['all']['iterations'], 1),
                      number(own['all']['iterations_p95'], 0), number(own['all']['frame_us'], 0)))
    return [Table('Distance of joints, mm, mean (p95), of angles, iterations and time a frame',
                  ('palm + fingers', *CLASSES, 'angles, deg', 'iterations', 'p95', 'us a frame'),
                  lines)]


WHY = ('The default keeps the palm rigid, whose three markers then err together, and takes the '
       'exact bend; the other pairs spread the same error differently, and may by chance meet '
       'the truth better in one class of joint.')


def losses(rows):
    """Return in which classes of joint another pair is nearer than the default."""
    lines = []
    for name in CLASSES:
        means = {row['method']: row['mean_mm'] for row in rows if row['joint_class'] == name}
        best = min(means, key=means.get)
        # Not by what the last digit of the table does not show.
        if means[DEFAULT] > means[best] + .005:
            lines.append(f'{name}: {means[DEFAULT]:.2f} mm with {DEFAULT}, '
                         f'{means[best]:.2f} with {best}')
    return lines


def pictures(rows, folder):
    """Draw the errors of the solvers."""
    figure, (ax,) = figure_with(1, width=6.5)
    for i, method in enumerate(_methods(rows)):
        found = {row['joint_class']: row['mean_mm'] for row in rows if row['method'] == method}
        ax.bar(np.arange(len(CLASSES)) + .2 * (i - 1.5), [found[name] for name in CLASSES],
               width=.19, color=COLOURS[i], label=words(method))
    ax.set_xticks(range(len(CLASSES)), map(words, CLASSES))
    ax.set_ylabel('mean error [mm]', fontsize=8, color=INK)
    save(figure, folder / 'solvers.png', ax)
    return [Picture('solvers.png', 'Mean error of each class of joint by the solvers')]
