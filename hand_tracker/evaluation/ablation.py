"""Fig. 13: the tracker without each of its constraints in turn, with and without occlusion.

Limits are taken off by a hand that has none, the intradigital correlation by a hand whose
last joints stay straight, the holding of hidden markers in the palm's frame by holding them
where they were in the room.
"""

from textwrap import fill

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..calibration import landmark_positions
from ..core.hand import JOINTS, preset_limits
from ..core.kinematics import forward, joint_table, tip_offsets
from ..core.layout import marker_positions
from ..core.metrics import joint_errors, limit_violations
from ..core.skeleton import skeleton_points
from ..picture import VIEWS, View, view_size
from ..simulation.faults import Faults, fault_events, with_faults
from ..simulation.sight import skin_layout
from .report import COLOURS, INK, Picture, Table, figure_with, save
from .rows import spread
from .simulated import distances, mean_max, trial
from .tracking import tracked_joints

TITLE = 'Without each constraint (Fig. 13)'
RATE = 120.                    # [Hz]
DURATION = 15.                 # [s]
MOTIONS = ('demo', 'spelling', 'power_grasp', 'typing', 'shaking')
OCCLUDED_CAMERAS = (0, 2, 4, 6)
DROPOUTS = 2.                  # [1/s]
FREE = np.radians(170.)        # a limit that is none
TOLERANCE = np.radians(.01)    # beyond a limit

ALL = 'all constraints'
VARIANTS = (ALL, 'no flexion limits', 'no abduction limits', 'no limits',
            'no DIP and IP coupling', 'no holding in the palm')
CONDITIONS = ('all seen', 'occluded')
FLEXION = np.array(['flexion' in joint and not (
    joint.endswith('cmc_flexion') and not joint.startswith('thumb')) for joint in JOINTS])
ABDUCTION = np.array(['abduction' in joint for joint in JOINTS])
SCALE = .36                    # of the drawn hands


def without(variant, hand):
    """Return a hand that lacks a constraint.

    Parameters
    ----------
    variant : str
        One of `VARIANTS`.
    hand : Hand

    Returns
    -------
    Hand
    """
    freed = {'no flexion limits': FLEXION, 'no abduction limits': ABDUCTION,
             'no limits': FLEXION | ABDUCTION}.get(variant)
    if freed is not None:
        return hand.replace(limits=np.where(freed[:, None], (-FREE, FREE), hand.limits))
    if variant == 'no DIP and IP coupling':
        return hand.replace(coupling=np.zeros_like(hand.coupling))
    return hand


def held_in_the_room(markers):
    """Return markers, each hidden one where it was last seen.

    Parameters
    ----------
    markers : ndarray, shape (n, 8, 3)
        NaN where not seen [m].

    Returns
    -------
    ndarray, shape (n, 8, 3)
        NaN before a marker was first seen [m].
    """
    seen = np.isfinite(markers).all(axis=2)
    last = np.maximum.accumulate(np.where(seen, np.arange(len(markers))[:, None], 0), axis=0)
    return np.take_along_axis(markers, last[..., None], axis=0)


def evaluate(options):
    """Yield a row for each motion, condition and variant."""
    tasks = [(motion, options.seed + i) for i, motion in enumerate(MOTIONS)]
    for rows in options.each('ablation', judge, tasks):
        yield from rows


def judge(task):
    """Return the rows of one motion."""
    motion, seed = task
    one = trial(motion, seed, RATE, DURATION)
    pose = forward(joint_table(one.hand), one.angles, one.rotation, one.position)
    true = landmark_positions(one.hand, pose, one.position)
    rows = []
    for condition in CONDITIONS:
        markers = markers_of(one, condition, seed)
        whole = None
        for variant in VARIANTS:
            hand, tracked = tracked_without(one, variant, markers)
            worse = _worse(tracked.angles, one.angles)
            whole = worse if whole is None else whole
            broken, _ = limit_violations(tracked.angles, preset_limits('paper'), TOLERANCE)
            rows.append({
                'evaluation': 'ablation', 'recording': motion, 'method': variant, 'seed': seed,
                'condition': condition, **distances('true', tracked.angles, one.angles),
                **spread(joint_errors(tracked_joints(hand, tracked), true)['all']),
                'beyond_limits_pct': round(100. * float(broken), 3),
                'lost_pct': round(100. * float(np.isnan(markers[..., 0]).mean()), 3),
                # Where this variant is worst beside all constraints: what the picture shows.
                'shown_frame': int(np.argmax(worse - whole)), 'frames': len(true)})
    return rows


def markers_of(one, condition, seed):
    """Return the markers of a trial, all seen, or as four cameras and drop-outs leave them."""
    if condition == 'all seen':
        return one.measured(hidden=False)
    times = np.arange(len(one.angles)) / one.rate
    events = fault_events(Faults(dropouts=DROPOUTS), times[-1], one.noise.shape[1],
                          np.random.RandomState((seed, 2)))
    return with_faults(one.measured(OCCLUDED_CAMERAS), one.sight.truth, times, events)


def tracked_without(one, variant, markers):
    """Return the hand that lacks a constraint, and what tracking with it says of markers."""
    hand = without(variant, one.worn)
    given = held_in_the_room(markers) if variant == 'no holding in the palm' else markers
    return hand, one.track(given, hand=hand)


def _worse(angles, true):
    return np.abs(np.angle(np.exp(1j * (angles - true)))).sum(axis=1)


def tables(rows):
    """Return one table of each condition."""
    found = []
    for condition in CONDITIONS:
        lines = []
        for variant in VARIANTS:
            mine = [row for row in rows
                    if (row['condition'], row['method']) == (condition, variant)]
            lines.append((variant, mean_max(mine, 'true_squared', 3),
                          mean_max(mine, 'true_deg', 1), *(f'{_mean(mine, key):.1f}' for key in (
                              'mean_mm', 'p95_mm', 'beyond_limits_pct'))))
        lost = _mean([row for row in rows if row['condition'] == condition], 'lost_pct')
        found.append(Table(
            f'{condition.capitalize()} ({lost:.1f} % of the markers lost): distance from the '
            'truth, mean (maximum)',
            ('tracked with', 'Dist² [rad²]', 'degrees a joint', 'joints, mean [mm]',
             'joints, p95 [mm]', 'frames beyond limits [%]'), lines))
    return found


def _mean(rows, key):
    return sum(row[key] for row in rows) / len(rows)


def pictures(rows, folder):
    """Draw the errors, and the hands where each variant is worst."""
    figure, axes = figure_with(2, width=5.)
    for ax, condition in zip(axes, CONDITIONS):
        for i, motion in enumerate(MOTIONS):
            mine = {row['method']: row['true_deg'] for row in rows
                    if (row['condition'], row['recording']) == (condition, motion)}
            ax.bar(np.arange(len(VARIANTS)) + .16 * (i - 2), [mine[name] for name in VARIANTS],
                   width=.15, color=COLOURS[i], label=motion)
        ax.set_xticks(range(len(VARIANTS)), [fill(name, 11) for name in VARIANTS], fontsize=7)
        ax.set_ylabel(f'{condition}: from the truth [degrees a joint]', fontsize=8)
    top = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(0., top)
    save(figure, folder / 'ablation.png', axes[0])
    _draw_hands(rows, folder / 'ablation_hands.png')
    return [Picture('ablation.png', 'Error without each constraint, each motion'),
            Picture('ablation_hands.png', 'The truth, the tracked hand with all constraints and '
                    'without one, occluded, at the frame where that one is missed most')]


def _draw_hands(rows, path):
    """Draw truth, all constraints and one less side by side, a line for each variant."""
    columns = ('the truth', ALL, 'without')
    sizes = [view_size(view, SCALE) for view in VIEWS]
    width, height = sum(size[0] for size in sizes) + .2, max(size[1] for size in sizes) + .25
    variants = VARIANTS[1:]
    figure = Figure(figsize=(len(columns) * width + 1.1, len(variants) * height), dpi=110)
    FigureCanvasAgg(figure)
    across, up = figure.get_size_inches()
    trials = {}
    for line, variant in enumerate(variants):
        row = max((row for row in rows
                   if (row['condition'], row['method']) == ('occluded', variant)),
                  key=lambda row: row['true_deg'] - _with_all(rows, row)['true_deg'])
        motion, frame = row['recording'], row['shown_frame']
        if motion not in trials:
            one = trial(motion, row['seed'], RATE, DURATION)
            trials[motion] = one, markers_of(one, 'occluded', row['seed'])
        one, markers = trials[motion]
        to_wrist = one.rotation[frame].T
        local = (markers[frame] - one.position[frame]) @ to_wrist.T
        seen = np.isfinite(local).all(axis=1)
        bottom = up - (line + 1) * height
        for column, name in enumerate(columns):
            # Nothing of the frames to come.
            hand, layout, pose = _true(one, frame) if not column else _tracked(
                one, ALL if column == 1 else variant, markers[:frame + 1])
            # All in the true wrist's frame, so that a turned palm is seen too.
            turned, moved = to_wrist @ pose[1], to_wrist @ (pose[2] - one.position[frame])
            links = forward(joint_table(hand), pose[0], turned, moved)
            places = marker_positions(layout.mounting(hand), links, turned, moved)
            left = 1.1 + column * width
            for view, size in zip(VIEWS, sizes):
                View(figure, (left, bottom), view, hand, SCALE).draw(
                    skeleton_points(tip_offsets(hand), links, moved),
                    np.where(seen[:, None], local, places), seen)
                left += size[0]
            figure.text((1.1 + (column + .45) * width) / across, (bottom + height - .12) / up,
                        name if column < 2 else variant, ha='center', va='top', color=INK,
                        fontsize=8, weight='bold' if column == 2 else 'normal')
        figure.text(.1 / across, (bottom + .5 * height) / up,
                    f'{motion}\n{frame / RATE:.2f} s', color=INK, fontsize=8, va='center')
    save(figure, path)


def _true(one, frame):
    return one.hand, skin_layout(one.hand), (
        one.angles[frame], one.rotation[frame], one.position[frame])


def _tracked(one, variant, markers):
    hand, tracked = tracked_without(one, variant, markers)
    return hand, one.layout, (
        tracked.angles[-1], tracked.wrist_rotation[-1], tracked.wrist_position[-1])


def _with_all(rows, row):
    return next(other for other in rows if other['method'] == ALL and all(
        other[key] == row[key] for key in ('recording', 'condition')))
