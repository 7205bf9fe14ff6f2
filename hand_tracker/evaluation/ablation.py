"""Fig. 13: the tracker without each of its constraints in turn, and with each alternative.

A line of `OFF` is a constraint that is off: options of the tracker, or a hand that lacks it.
Limits are taken off by a hand that has none, the intradigital correlation by a hand whose last
joints stay straight. A line of `ALTERNATIVES` is another choice of method. Simulated hands have
a saddle for a thumb and bend their last joints by 0.4 (as calibrated, a little wrong): the
paper's thumb and coupling show what it costs to wear what a hand is not.

Occluded hands are seen by four cameras, labels drop out twice a second, and one digit's marker
stays lost for 4 s. Wrong are exchanged labels, reflections and frozen markers, each once a
second. A measured last joint is off by 3 degrees (standard deviation), for good.

Besides the distance from the truth, what constraints are for: frames in which digits overlap by
more than 1 mm, frames beyond the paper's limits, the largest step of an angle from frame to
frame (a mean over motions), jumps (frames with a step of more than 10 degrees, which the truth
never makes), and jitter: the median step of the PIPs that is not the truth's own, while no joint
truly moves faster than 5 degrees a second.
"""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..core.constraints import (
    ABDUCTION_MASK,
    FLEXION_MASK,
    UNBOUNDED_DIFFERENCES,
    UNCOUPLED,
    Change,
    without_limits,
)
from ..core.model.hand import FLEXION_JOINTS, JOINTS, preset_coupling, preset_limits
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MARKERS, PALM_MARKERS, marker_positions
from ..core.model.skeleton import skeleton_points
from ..core.options import TrackerOptions
from ..drawing.animation import HIDDEN_COLOUR, SEEN_COLOUR, VIEW_EXTENTS, HandView, view_size
from ..drawing.palette import ORANGE, PAPER_WHITE, SKY_BLUE
from ..simulation.faults import Event, Faults, fault_events, with_faults
from ..simulation.visibility import skin_layout
from .metrics import limit_violations
from .overlap import deepest_overlaps
from .simulated import distances, mean_max, trial
from .tables import INK, Picture, Table, figure_with, number, save, words

TITLE = 'Without each constraint (Fig. 13)'
RATE = 120.                    # [Hz]
DURATION = 12.                 # [s]
MOTIONS = ('demo', 'spelling', 'power_grasp', 'typing', 'shaking')
OCCLUDED_CAMERAS = (0, 2, 4, 6)
DROPOUTS = 2.                  # [1/s]
LONG = 4.                      # [s] for which one digit's marker is lost: until it is stale
WRONG = Faults(swaps=1., ghosts=1., frozen=1.)  # [1/s]
FLEXION_ERROR = np.radians(3.)  # of a measured last joint, standard deviation; ours, unsourced

TOLERANCE = np.radians(.01)    # beyond a limit
OVERLAP = 1e-3 + 1e-6          # [m] that flesh gives way, and rounding
JUMP = np.radians(10.)        # from frame to frame
STILL = np.radians(5.)         # [rad/s] below which a hand is at rest
PIP = [JOINTS.index(joint) for joint in JOINTS if 'pip' in joint]

CONDITIONS = {'all seen': 'all markers seen', 'occluded': 'occluded',
              'wrong': 'some labels and places wrong'}
SHOWN = 10.                    # [degrees] over all joints, from which a difference is drawn
APART = 1.                     # [s] of drawn frames of a motion
FULL = 6.                    # [degrees] more or less that have the full colour
LOSS_AND_GAIN = LinearSegmentedColormap.from_list('', (SKY_BLUE, PAPER_WHITE, ORANGE))
LINES = 6                      # of drawn hands
SCALE = .5                     # of the drawn hands
MARGIN = .1                    # [inches] around them
WHY = ('The digits of the simulated motions overlap themselves (said above each table), so that '
       'rigidity moves the pose away from its truth: it is to be judged by the overlaps that it '
       'takes away. Easing trades a little error for fewer jumps. A limit or a coupling that is '
       'only nearly right keeps a joint from where the markers, a little off themselves, would '
       'put it.')

ALL = 'all constraints'
MEASURED = 'measured distal flexion'
OFF = {
    'no flexion limits': without_limits(FLEXION_MASK),
    'no abduction limits': without_limits(ABDUCTION_MASK),
    'no limits': without_limits(FLEXION_MASK | ABDUCTION_MASK),
    'no DIP and IP coupling': UNCOUPLED,
    'no smoothing': Change({'smoothing': False}),
    'no inertia': Change({'inertia': 0.}),
    'no transdigital correlation': Change({'transdigital_memory': 0.}),
    'no links before learning': Change({
        'link_index_middle': 0., 'link_middle_ring': 0., 'link_ring_little': 0.}),
    'no candidate space': UNBOUNDED_DIFFERENCES,
    'no rigidity': Change({'rigidity': False}),
    'palm without fingers': Change({'palm_from_fingers': False}),
    'no easing': Change({'reentry_rate': 1000.}),
    'no outlier gate': Change({'outlier_gate': 0.}),
    'no exchange of labels': Change({'swap_margin': 0.}),
    'no patience': Change({'patience': 0.}),
    'frozen believed': Change({'frozen_frames': 0}),
}
ALTERNATIVES = {
    'friction': Change({'friction': .5}),
    'stale: hold': Change({'stale': 'hold'}),
    MEASURED: Change(),
    'thumb: index_mcp': Change(hand=lambda hand: hand.with_paper_thumb()),
    'coupling: paper': Change(hand=lambda hand: hand.replace(coupling=preset_coupling('paper'))),
}
VARIANTS = {ALL: Change(), **OFF, **ALTERNATIVES}


def without_any():
    """Return the change that takes every constraint off at once."""
    def bare(hand):
        for change in OFF.values():
            hand = change.hand(hand)
        return hand

    return Change({name: value for change in OFF.values()
                   for name, value in change.options.items()}, bare)


def evaluate(options):
    """Yield a row for each motion, condition and variant."""
    tasks = [(motion, options.seed + i) for i, motion in enumerate(MOTIONS)]
    for rows in options.each('motions', judge, tasks):
        yield from rows


def judge(task):
    """Return the rows of one motion.

    Besides errors, `overlap_pct` is the share of frames in which digits overlap by more than
    1 mm, `step_deg` the largest step of an angle from frame to frame, `jumps_per_min` how often
    one is more than 10 degrees, `jitter_deg` the median step of the PIPs at rest, null where the
    hand never rests; `true_...` is the truth's own.
    """
    motion, seed = task
    one = trial(motion, seed, RATE, DURATION)
    rows = []
    for condition in CONDITIONS:
        markers = markers_of(one, condition, seed)
        whole = None
        for variant in VARIANTS:
            hand, tracked = variant_tracked(one, variant, markers)
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
                **_nature('', hand, tracked.angles), **_nature('true_', one.hand, one.angles),
                'jitter_deg': _jitter(tracked.angles, one.angles),
                'lost_pct': round(100. * float(np.isnan(markers[..., 0]).mean()), 3),
                'shown_frame': shown,
                'shown_deg': round(float(np.degrees(worse[shown] - whole[shown])), 3),
                'frames': len(markers)})
    return rows


def _nature(prefix, hand, angles):
    """Return how natural a motion is by itself: overlaps and steps."""
    overlaps, steps = deepest_overlaps(hand, angles), _steps(angles).max(axis=1)
    return {f'{prefix}overlap_pct': round(100. * float((overlaps > OVERLAP).mean()), 3),
            f'{prefix}overlap_max_mm': round(1e3 * float(overlaps.max()), 3),
            f'{prefix}step_deg': round(float(np.degrees(steps.max())), 3),
            f'{prefix}jumps_per_min': round(60. * RATE * float((steps > JUMP).mean()), 2)}


def _jitter(angles, true):
    """Return the median step of the PIPs that is not the truth's, at rest [degrees]."""
    still = _steps(true).max(axis=1) < STILL / RATE
    steps = _steps(angles - true)[np.ix_(still, PIP)]
    return round(float(np.degrees(np.median(steps))), 5) if still.any() else np.nan


def _steps(angles):
    return np.abs(np.diff(angles, axis=0))


def markers_of(one, condition, seed):
    """Return the markers of a trial, all seen, as occlusion leaves them, or with wrong ones."""
    if condition == 'all seen':
        return one.measured(hidden=False)
    times = np.arange(len(one.angles)) / one.rate
    random = np.random.RandomState((seed, 2))
    faults = WRONG if condition == 'wrong' else Faults(dropouts=DROPOUTS)
    events = fault_events(faults, times[-1], len(MARKERS), random)
    if condition == 'wrong':
        measured = one.measured(hidden=False)
    else:
        measured = one.measured(OCCLUDED_CAMERAS)
        start = random.uniform(0., max(times[-1] - LONG, 0.))
        digit = random.randint(len(PALM_MARKERS), len(MARKERS))
        events.append(Event('dropout', int(digit), start, start + LONG))
    return with_faults(measured, one.sight.truth, times, events)


def tracked_with(one, change, markers, flexion=None):
    """Return the changed hand, and what tracking with the change says of markers."""
    hand = change.hand(one.worn)
    options = TrackerOptions(**change.options)
    return hand, one.track(markers, hand=hand, options=options, flexion=flexion)


def variant_tracked(one, variant, markers):
    """Return the hand of a variant, and what tracking so says of the first markers of a trial."""
    flexion = None
    if variant == MEASURED:
        last = FLEXION_JOINTS[:, 2]
        error = FLEXION_ERROR * np.random.RandomState(0).normal(size=len(last))
        flexion = one.angles[:len(markers), last] + error
    return tracked_with(one, VARIANTS[variant], markers, flexion)


def _worse(angles, true):
    return np.abs(np.angle(np.exp(1j * (angles - true)))).sum(axis=1)


def tables(rows):
    """Return one table of each condition."""
    found = []
    for condition in CONDITIONS:
        there = [row for row in rows if row['condition'] == condition]
        lines = []
        for variant in VARIANTS:
            mine = [row for row in there if row['method'] == variant]
            lines.append((
                variant, mean_max(mine, 'true_squared', 3), mean_max(mine, 'true_deg', 1),
                *(number(_mean(mine, key), digits) for key, digits in (
                    ('mean_mm', 2), ('p95_mm', 1), ('beyond_limits_pct', 1))),
                *(number(_mean(mine, key), digits) for key, digits in (
                    ('overlap_pct', 1), ('step_deg', 1), ('jumps_per_min', 1),
                    ('jitter_deg', 3)))))
        found.append(Table(
            f'{condition.capitalize()} ({_mean(there, "lost_pct"):.1f} % of the markers lost): '
            'distance from the truth, mean (maximum). The truth itself overlaps by more than 1 mm '
            f'in {_mean(there, "true_overlap_pct"):.1f} % of the frames, by up to '
            f'{max(row["true_overlap_max_mm"] for row in there):.1f} mm, and steps by up to '
            f'{max(row["true_step_deg"] for row in there):.1f} degrees',
            ('tracked with', 'Dist² [rad²]', 'degrees a joint', 'joints, mean [mm]',
             'joints, p95 [mm]', 'frames beyond limits [%]', 'frames overlapping [%]',
             'largest step [degrees]', 'jumps a minute', 'PIP jitter at rest [degrees]'), lines))
    return found


def _mean(rows, key):
    """Return the mean over rows that have the key; None if none has."""
    known = [row[key] for row in rows if row[key] is not None and np.isfinite(row[key])]
    return sum(known) / len(known) if known else None


def losses(rows):
    """Return which constraints do harm in the mean of the motions."""
    lines = []
    for condition in CONDITIONS:
        means = {variant: _mean([row for row in rows if (row['condition'], row['method'])
                                 == (condition, variant)], 'mean_mm') for variant in VARIANTS}
        # Not by what the last digit of the table does not show.
        lines += [f'{condition}, {variant}: {mean:.2f} mm, {means[ALL]:.2f} with {ALL}'
                  for variant, mean in means.items()
                  if variant != MEASURED and mean < means[ALL] - .05]
    return lines


def pictures(rows, folder):
    """Draw what each variant changes, and the hands where each is worst."""
    figure, axes = figure_with(len(CONDITIONS), width=3.9, height=.24 * len(VARIANTS) + .6)
    for ax, (condition, what) in zip(axes, CONDITIONS.items()):
        means = {(row['recording'], row['method']): row['true_deg'] for row in rows
                 if row['condition'] == condition}
        found = np.array([[means[motion, variant] for motion in MOTIONS] for variant in VARIANTS])
        more = found - found[0]
        ax.imshow(more, LOSS_AND_GAIN, aspect='auto', vmin=-FULL, vmax=FULL)
        for (line, column), change in np.ndenumerate(more):
            text = f'{change:+.1f}' if line else f'{found[0, column]:.1f}'
            ax.text(column, line, '·' if text in ('+0.0', '-0.0') else text, fontsize=8,
                    color=INK, ha='center', va='center', weight='normal' if line else 'bold')
        ax.set_title(what, fontsize=9)
        ax.set_xticks(range(len(MOTIONS)), [words(motion).replace(' ', '\n')
                                            for motion in MOTIONS])
        ax.set_yticks(range(len(VARIANTS)), map(words, VARIANTS) if ax is axes[0] else [])
        ax.grid(False)
        ax.tick_params(length=0)
        ax.axhline(.5, color=INK, linewidth=.7)
        ax.spines[:].set_visible(False)
    figure.text(.5, .985, 'distance from the truth with all constraints [degrees a joint], and '
                'how much more or less without each, or with another choice', ha='center',
                va='top', fontsize=9, color=INK)
    save(figure, folder / 'ablation.png')
    _draw_hands(rows, folder / 'ablation_hands.png')
    return [Picture('ablation.png', 'Error with all constraints, and what each changes, in each '
                    'motion'),
            Picture('ablation_hands.png', 'The truth, the tracked hand with all constraints and '
                    'without one, occluded, at a frame where that one is missed most; only '
                    'constraints that are missed')]


def _draw_hands(rows, path):
    """Draw truth, all constraints and one less side by side, a line for each that is missed."""
    shown = _missed_most(rows)[:LINES]
    sizes = [view_size(view, SCALE) for view in VIEW_EXTENTS]
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
            for view, size in zip(VIEW_EXTENTS, sizes):
                HandView(figure, (left, bottom), view, hand, SCALE).draw(
                    skeleton_points(tip_offsets(hand), links, moved),
                    np.where(seen[:, None], local, places), seen)
                left += size[0] + MARGIN
            figure.text((1.1 + (column + .5) * width) / across, (bottom + height - .1) / up,
                        words(name), ha='center', va='top', color=INK, fontsize=9,
                        weight='bold' if column == 2 else 'normal')
        figure.text(.1 / across, (bottom + .5 * height) / up,
                    f'{words(motion)}\n{frame / RATE:.2f} s', color=INK, fontsize=8, va='center')
    figure.legend(handles=[
        Line2D([], [], marker='o', linestyle='', markersize=5, color=colour, label=label)
        for colour, label in ((SEEN_COLOUR, 'marker, measured'),
                              (HIDDEN_COLOUR, 'marker not seen: its place on the hand'))],
        loc='upper center', ncols=2, frameon=False, fontsize=8, labelcolor=INK)
    save(figure, path)


def _missed_most(rows):
    """Return an occluded row of each variant that is missed, the most missed first.

    None of a frame near one of another's, where there would be the same to see.
    """
    found = []
    for row in sorted(rows, key=lambda row: -row['shown_deg']):
        if (row['condition'] == 'occluded' and row['shown_deg'] > SHOWN and not any(
                row['method'] == other['method'] or row['recording'] == other['recording']
                and abs(row['shown_frame'] - other['shown_frame']) < APART * RATE
                for other in found)):
            found.append(row)
    return found


def _true(one, frame):
    return one.hand, skin_layout(one.hand), (
        one.angles[frame], one.rotation[frame], one.position[frame])


def _tracked(one, variant, markers):
    hand, tracked = variant_tracked(one, variant, markers)
    return hand, one.layout, (
        tracked.angles[-1], tracked.wrist_rotation[-1], tracked.wrist_position[-1])
