"""Fig. 13: the tracker without each of its constraints in turn, with and without occlusion.

A line of `VARIANTS` is a constraint that is off: options of the tracker, or a hand that lacks
it. Limits are taken off by a hand that has none, the intradigital correlation by a hand whose
last joints stay straight.
"""

from textwrap import fill

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..constraints import ABDUCTION, FLEXION, UNBOUND, UNCOUPLED, Change, free
from ..core.hand import preset_limits
from ..core.kinematics import forward, joint_table, tip_offsets
from ..core.layout import marker_positions
from ..core.metrics import limit_violations
from ..core.skeleton import skeleton_points
from ..core.tracker import TrackerOptions
from ..picture import HIDDEN_COLOUR, SEEN_COLOUR, VIEWS, View, view_size
from ..simulation.faults import Faults, fault_events, with_faults
from ..simulation.sight import skin_layout
from .report import COLOURS, INK, Picture, Table, figure_with, save
from .simulated import distances, mean_max, trial

TITLE = 'Without each constraint (Fig. 13)'
RATE = 120.                    # [Hz]
DURATION = 15.                 # [s]
MOTIONS = ('demo', 'spelling', 'power_grasp', 'typing', 'shaking')
OCCLUDED_CAMERAS = (0, 2, 4, 6)
DROPOUTS = 2.                  # [1/s]
TOLERANCE = np.radians(.01)    # beyond a limit

WRONG = Faults(swaps=1., ghosts=1.)  # [1/s]

CONDITIONS = ('all seen', 'occluded', 'wrong')
SHOWN = 10.                    # [degrees] over all joints, from which a difference is drawn
LINES = 6                      # of drawn hands
SCALE = .5                     # of the drawn hands
MARGIN = .1                    # [inches] around them
WHY = ('A limit or a coupling that is only nearly right keeps a joint from where the markers, a '
       'little off themselves, would put it.')

ALL = 'all constraints'
VARIANTS = {
    ALL: Change(),
    'no flexion limits': free(FLEXION),
    'no abduction limits': free(ABDUCTION),
    'no limits': free(FLEXION | ABDUCTION),
    'no DIP and IP coupling': UNCOUPLED,
    'no smoothing': Change({'smoothing': False}),
    'no inertia': Change({'inertia': 0.}),
    'no transdigital correlation': Change({'transdigital_memory': 0.}),
    'no links before learning': Change({
        'link_index_middle': 0., 'link_middle_ring': 0., 'link_ring_little': 0.}),
    'no candidate space': UNBOUND,
    'friction': Change({'friction': .5}),
    'no rigidity': Change({'rigidity': False}),
    'palm without fingers': Change({'palm_from_fingers': False}),
    'no easing': Change({'reentry_rate': 1000.}),
    'no outlier gate': Change({'outlier_gate': 0.}),
    'no exchange of labels': Change({'swap_margin': 0.}),
}


def without_any():
    """Return the change that takes every constraint off at once."""
    off = [change for name, change in VARIANTS.items() if name != 'friction']

    def bare(hand):
        for change in off:
            hand = change.hand(hand)
        return hand

    return Change({name: value for change in off for name, value in change.options.items()}, bare)


def evaluate(options):
    """Yield a row for each motion, condition and variant."""
    tasks = [(motion, options.seed + i) for i, motion in enumerate(MOTIONS)]
    for rows in options.each('motions', judge, tasks):
        yield from rows


def judge(task):
    """Return the rows of one motion."""
    motion, seed = task
    one = trial(motion, seed, RATE, DURATION)
    rows = []
    for condition in CONDITIONS:
        markers = markers_of(one, condition, seed)
        whole = None
        for variant in VARIANTS:
            hand, tracked = tracked_with(one, VARIANTS[variant], markers)
            worse = _worse(tracked.angles, one.angles)
            whole = worse if whole is None else whole
            # What the picture shows: this variant wrong where all constraints are right.
            shown = int(np.argmax(worse - 2. * whole))
            broken, _ = limit_violations(tracked.angles, preset_limits('paper'), TOLERANCE)
            rows.append({
                'evaluation': 'ablation', 'recording': motion, 'method': variant, 'seed': seed,
                'condition': condition, **distances('true', tracked.angles, one.angles),
                **one.errors(tracked, hand=hand),
                'beyond_limits_pct': round(100. * float(broken), 3),
                'lost_pct': round(100. * float(np.isnan(markers[..., 0]).mean()), 3),
                'shown_frame': shown,
                'shown_deg': round(float(np.degrees(worse[shown] - whole[shown])), 3),
                'frames': len(markers)})
    return rows


def markers_of(one, condition, seed):
    """Return the markers of a trial, all seen, as occlusion leaves them, or with wrong ones."""
    if condition == 'all seen':
        return one.measured(hidden=False)
    times = np.arange(len(one.angles)) / one.rate
    faults = WRONG if condition == 'wrong' else Faults(dropouts=DROPOUTS)
    events = fault_events(faults, times[-1], one.noise.shape[1],
                          np.random.RandomState((seed, 2)))
    measured = one.measured(hidden=False) if condition == 'wrong' else one.measured(
        OCCLUDED_CAMERAS)
    return with_faults(measured, one.sight.truth, times, events)


def tracked_with(one, change, markers):
    """Return the changed hand, and what tracking with the change says of markers."""
    hand = change.hand(one.worn)
    return hand, one.track(markers, hand=hand, options=TrackerOptions(**change.options))


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


def losses(rows):
    """Return which constraints do harm in the mean of the motions."""
    lines = []
    for condition in CONDITIONS:
        means = {variant: _mean([row for row in rows if (row['condition'], row['method'])
                                 == (condition, variant)], 'mean_mm') for variant in VARIANTS}
        # Not by what the last digit of the table does not show.
        lines += [f'{condition}, {variant}: {mean:.2f} mm, {means[ALL]:.2f} with {ALL}'
                  for variant, mean in means.items() if mean < means[ALL] - .05]
    return lines


def pictures(rows, folder):
    """Draw the errors, and the hands where each variant is worst."""
    figure, axes = figure_with(
        len(CONDITIONS), width=max(5., .6 * len(VARIANTS)), height=2.4, stacked=True)
    for ax, condition in zip(axes, CONDITIONS):
        for i, motion in enumerate(MOTIONS):
            mine = {row['method']: row['true_deg'] for row in rows
                    if (row['condition'], row['recording']) == (condition, motion)}
            ax.bar(np.arange(len(VARIANTS)) + .16 * (i - 2), [mine[name] for name in VARIANTS],
                   width=.15, color=COLOURS[i], label=motion)
        ax.set_xlim(-.5, len(VARIANTS) - .5)
        ax.set_xticks(range(len(VARIANTS)), [fill(name, 10, break_long_words=False)
                                             for name in VARIANTS], fontsize=7)
        ax.set_ylabel(f'{condition}: from the\ntruth [degrees a joint]', fontsize=8)
    top = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(0., top)
    save(figure, folder / 'ablation.png', axes[0])
    _draw_hands(rows, folder / 'ablation_hands.png')
    return [Picture('ablation.png', 'Error without each constraint, each motion'),
            Picture('ablation_hands.png', 'The truth, the tracked hand with all constraints and '
                    'without one, occluded, at the frame where that one is missed most; only '
                    'constraints that are missed')]


def _draw_hands(rows, path):
    """Draw truth, all constraints and one less side by side, a line for each that is missed."""
    # Where a variant never differs there is nothing to see.
    shown = sorted((row for variant in list(VARIANTS)[1:]
                    if (row := _missed_most(rows, variant))),
                   key=lambda row: -row['shown_deg'])[:LINES]
    sizes = [view_size(view, SCALE) for view in VIEWS]
    width = sum(size[0] for size in sizes) + 3. * MARGIN
    height, legend = max(size[1] for size in sizes) + .35, .35
    figure = Figure(figsize=(3. * width + 1.1, len(shown) * height + legend), dpi=110)
    FigureCanvasAgg(figure)
    across, up = figure.get_size_inches()
    trials = {}
    for line, row in enumerate(shown):
        motion, frame = row['recording'], row['shown_frame']
        if motion not in trials:
            one = trial(motion, row['seed'], RATE, DURATION)
            trials[motion] = one, markers_of(one, 'occluded', row['seed'])
        one, markers = trials[motion]
        to_wrist = one.rotation[frame].T
        local = (markers[frame] - one.position[frame]) @ to_wrist.T
        seen = np.isfinite(local).all(axis=1)
        bottom = up - legend - (line + 1) * height
        for column, name in enumerate(('the truth', ALL, row['method'])):
            # Nothing of the frames to come.
            hand, layout, pose = _tracked(one, name, markers[:frame + 1]) if column else _true(
                one, frame)
            # All in the true wrist's frame, so that a turned palm is seen too.
            turned, moved = to_wrist @ pose[1], to_wrist @ (pose[2] - one.position[frame])
            links = forward(joint_table(hand), pose[0], turned, moved)
            places = marker_positions(layout.mounting(hand), links, turned, moved)
            left = 1.1 + column * width
            for view, size in zip(VIEWS, sizes):
                View(figure, (left, bottom), view, hand, SCALE).draw(
                    skeleton_points(tip_offsets(hand), links, moved),
                    np.where(seen[:, None], local, places), seen)
                left += size[0] + MARGIN
            figure.text((1.1 + (column + .5) * width) / across, (bottom + height - .1) / up,
                        name, ha='center', va='top', color=INK, fontsize=9,
                        weight='bold' if column == 2 else 'normal')
        figure.text(.1 / across, (bottom + .5 * height) / up,
                    f'{motion}\n{frame / RATE:.2f} s', color=INK, fontsize=8, va='center')
    figure.legend(handles=[
        Line2D([], [], marker='o', linestyle='', markersize=5, color=colour, label=label)
        for colour, label in ((SEEN_COLOUR, 'marker, measured'),
                              (HIDDEN_COLOUR, 'marker not seen: its place on the hand'))],
        loc='upper center', ncols=2, frameon=False, fontsize=8, labelcolor=INK)
    save(figure, path)


def _missed_most(rows, variant):
    """Return the occluded row of a variant with the frame it is missed most in; None if never."""
    row = max((row for row in rows
               if (row['condition'], row['method']) == ('occluded', variant)),
              key=lambda row: row['shown_deg'])
    return row if row['shown_deg'] > SHOWN else None


def _true(one, frame):
    return one.hand, skin_layout(one.hand), (
        one.angles[frame], one.rotation[frame], one.position[frame])


def _tracked(one, variant, markers):
    hand, tracked = tracked_with(one, VARIANTS[variant], markers)
    return hand, one.layout, (
        tracked.angles[-1], tracked.wrist_rotation[-1], tracked.wrist_position[-1])
