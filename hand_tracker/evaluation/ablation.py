"""Fig. 13: the tracker without each of its constraints in turn, and with each alternative.

A line of `WITHOUT_ONE` switches one constraint off, by an option of the tracker or a change of the
hand model: no limits, or distal joints that stay straight (no intradigital correlation). A line of
`ALTERNATIVES` is another choice of method. Simulated hands have a saddle joint as the thumb's CMC
and a coupling of distal joints of 0.4, both with calibration errors: the paper's thumb and coupling
show the cost of a wrong hand model.

Occluded hands are seen by four cameras, two markers a second drop out, and one digit's marker is
hidden for 4 s. Wrong labels are swaps, reflections and frozen markers, each once a second. Measured
distal flexion has a constant error of 3 degrees (standard deviation).

Besides the distance from the truth, the tables have what constraints are for: frames in which
digits overlap by more than 1 mm, frames beyond the paper's limits, the largest step of an angle
between frames (mean over motions), jumps (frames with a step of more than 10 degrees, which the
truth never has), and jitter: the median step of the PIPs relative to the truth while no true joint
moves faster than 5 degrees a second.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..core.constraints import (
    ABDUCTION_MASK,
    CONSTRAINTS,
    FLEXION_MASK,
    Change,
    without_limits,
)
from ..core.model.hand import FLEXION_JOINTS, JOINTS, Hand, preset_coupling, preset_limits
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MARKERS, PALM_MARKERS, MarkerLayout, marker_positions
from ..core.model.skeleton import skeleton_points
from ..core.options import TrackerOptions
from ..drawing.animation import HIDDEN_COLOUR, SEEN_COLOUR, VIEW_EXTENTS, HandView, view_size
from ..drawing.palette import ORANGE, PAPER_WHITE, SKY_BLUE
from ..simulation.faults import Event, Faults, fault_events, with_faults
from ..simulation.visibility import skin_layout
from .capture_tracking import Tracked
from .evaluation_options import Options
from .metrics import limit_violations
from .overlap import deepest_overlaps
from .rows import Row
from .simulated import Trial, distances, mean_max, tasks, trial
from .tables import INK, Losses, Picture, Table, figure_with, fixed, save_figure, words

ABLATION_RATE = 120.            # [Hz]
ABLATION_DURATION = 12.         # [s]
ABLATION_MOTIONS = ('demo', 'spelling', 'power_grasp', 'typing', 'shaking')
OCCLUDED_CAMERAS = (0, 2, 4, 6)
DROPOUT_RATE = 2.               # [1/s]
LONG_OCCLUSION = 4.             # [s] for one digit's marker: until its prediction is stale
FAULT_RATES = Faults(swaps=1., ghosts=1., frozen=1.)  # [1/s]
FLEXION_ERROR = np.radians(3.)  # [rad] of measured flexion, standard deviation; ours, unsourced

LIMIT_TOLERANCE = np.radians(.01)  # [rad]
COUNTED_OVERLAP = 1e-3 + 1e-6      # [m] that soft tissue yields, and rounding
JUMP_ANGLE = np.radians(10.)       # [rad] between frames
REST_SPEED = np.radians(5.)        # [rad/s] of the fastest joint of a hand at rest
PIP_ROWS = [JOINTS.index(joint) for joint in JOINTS if 'pip' in joint]

CONDITIONS = {'all seen': 'all markers seen', 'occluded': 'occluded',
              'wrong': 'some labels and places wrong'}
DRAWN_DIFFERENCE = 10.   # [degrees] least difference to be drawn, summed over all joints
DRAWN_INTERVAL = 1.      # [s] least time between drawn frames of a motion
FULL_COLOUR = 6.         # [degrees] difference at the ends of the colour scale
LOSS_AND_GAIN = LinearSegmentedColormap.from_list('', (SKY_BLUE, PAPER_WHITE, ORANGE))
DRAWN_HANDS = 6          # greatest number of variants
DRAWN_SCALE = .5         # of the drawn hands [1]
DRAWN_MARGIN = .1        # [inches]

ALL_CONSTRAINTS = 'all constraints'
MEASURED_FLEXION = 'measured distal flexion'
WITHOUT_ONE = {
    'no flexion limits': without_limits(FLEXION_MASK),
    'no abduction limits': without_limits(ABDUCTION_MASK),
    'no limits': CONSTRAINTS['Joint limits'].off,
    'no DIP and IP coupling': CONSTRAINTS['DIP coupling'].off,
    'no smoothing': CONSTRAINTS['Smoothing'].off,
    'no inertia': CONSTRAINTS['Inertia'].off,
    'no transdigital correlation': CONSTRAINTS['Transdigital correlation'].off,
    'no links before learning': Change({
        'link_index_middle': 0., 'link_middle_ring': 0., 'link_ring_little': 0.}),
    'no candidate space': CONSTRAINTS['Candidate space'].off,
    'no rigidity': CONSTRAINTS['Rigidity'].off,
    'palm without fingers': CONSTRAINTS['Palm from fingers'].off,
    'no easing': Change({'reentry_rate': 1000.}),
    'no outlier gate': Change({'outlier_gate': 0.}),
    'no exchange of labels': Change({'swap_margin': 0.}),
    'no patience': Change({'patience': 0.}),
    'frozen believed': Change({'frozen_frames': 0}),
}
ALTERNATIVES = {
    'friction': Change({'friction': .5}),
    'stale: hold': Change({'stale': 'hold'}),
    MEASURED_FLEXION: Change(),
    'thumb: index_mcp': Change(hand=lambda hand: hand.with_paper_thumb()),
    'coupling: paper': Change(hand=lambda hand: hand.replace(coupling=preset_coupling('paper'))),
}
ABLATION_VARIANTS = {ALL_CONSTRAINTS: Change(), **WITHOUT_ONE, **ALTERNATIVES}


def without_any() -> Change:
    """Return the change that switches all constraints off."""
    def bare(hand: Hand) -> Hand:
        for change in WITHOUT_ONE.values():
            hand = change.hand(hand)
        return hand

    return Change({name: value for change in WITHOUT_ONE.values()
                   for name, value in change.options.items()}, bare)


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each motion, condition and variant."""
    for rows in options.each('motions', judge, tasks(options, ABLATION_MOTIONS)):
        yield from rows


def judge(task: tuple[str, int]) -> list[Row]:
    """Return the rows of one (motion, seed).

    Besides errors, `overlap_pct` is the share of frames in which digits overlap by more than
    1 mm, `step_deg` the largest step of an angle between frames, `jumps_per_min` the rate of
    steps of more than 10 degrees, `jitter_deg` the median step of the PIPs at rest, null if the
    hand never rests. The prefix `true` marks the same of the ground truth.
    """
    motion, seed = task
    one = trial(motion, seed, ABLATION_RATE, ABLATION_DURATION)
    rows: list[Row] = []
    for condition in CONDITIONS:
        markers = markers_of(one, condition, seed)
        whole = None
        for variant in ABLATION_VARIANTS:
            hand, tracked = _variant_tracked(one, variant, markers)
            worse = _angle_error(tracked.angles, one.angles)
            whole = worse if whole is None else whole
            # Drawn frame: this variant wrong, the tracker with all constraints right.
            shown = int(np.argmax(worse - 2. * whole))
            broken, _ = limit_violations(tracked.angles, preset_limits('paper'), LIMIT_TOLERANCE)
            rows.append({
                'evaluation': 'ablation', 'recording': motion, 'method': variant, 'seed': seed,
                'condition': condition, **distances('true', tracked.angles, one.angles),
                **one.errors(tracked, hand=hand),
                'beyond_limits_pct': round(100. * float(broken), 3),
                **_plausibility('', hand, tracked.angles),
                **_plausibility('true_', one.hand, one.angles),
                'jitter_deg': _jitter(tracked.angles, one.angles),
                'lost_pct': round(100. * float(np.isnan(markers[..., 0]).mean()), 3),
                'shown_frame': shown,
                'shown_deg': round(float(np.degrees(worse[shown] - whole[shown])), 3),
                'frames': len(markers)})
    return rows


def _plausibility(prefix: str, hand: Hand, angles: np.ndarray) -> Row:
    """Return overlaps and steps of a motion, measures that need no ground truth."""
    overlaps, steps = deepest_overlaps(hand, angles), _steps(angles).max(axis=1)
    return {f'{prefix}overlap_pct': round(100. * float((overlaps > COUNTED_OVERLAP).mean()), 3),
            f'{prefix}overlap_max_mm': round(1e3 * float(overlaps.max()), 3),
            f'{prefix}step_deg': round(float(np.degrees(steps.max())), 3),
            f'{prefix}jumps_per_min': round(
                60. * ABLATION_RATE * float((steps > JUMP_ANGLE).mean()), 2)}


def _jitter(angles: np.ndarray, true: np.ndarray) -> float:
    """Return the median step of the PIPs relative to the truth, at rest [degrees]."""
    still = _steps(true).max(axis=1) < REST_SPEED / ABLATION_RATE
    steps = _steps(angles - true)[np.ix_(still, PIP_ROWS)]
    return round(float(np.degrees(np.median(steps))), 5) if still.any() else np.nan


def _steps(angles: np.ndarray) -> np.ndarray:
    return np.abs(np.diff(angles, axis=0))


def markers_of(one: Trial, condition: str, seed: int) -> np.ndarray:
    """Return the reported markers of a trial under one of `CONDITIONS`, shape (n, 8, 3) [m]."""
    if condition == 'all seen':
        return one.measured(hidden=False)
    times = np.arange(len(one.angles)) / one.rate
    random = np.random.RandomState((seed, 2))
    faults = FAULT_RATES if condition == 'wrong' else Faults(dropouts=DROPOUT_RATE)
    events = fault_events(faults, times[-1], len(MARKERS), random)
    if condition == 'wrong':
        measured = one.measured(hidden=False)
    else:
        measured = one.measured(OCCLUDED_CAMERAS)
        start = random.uniform(0., max(times[-1] - LONG_OCCLUSION, 0.))
        digit = random.randint(len(PALM_MARKERS), len(MARKERS))
        events.append(Event('dropout', int(digit), start, start + LONG_OCCLUSION))
    return with_faults(measured, one.observed.truth, times, events)


def tracked_with(one: Trial, change: Change, markers: np.ndarray,
                 flexion: np.ndarray | None = None) -> tuple[Hand, Tracked]:
    """Track markers of a trial with a change; return the changed hand model and the results."""
    hand = change.hand(one.calibrated_hand)
    options = TrackerOptions(**change.options)
    return hand, one.track(markers, hand=hand, options=options, flexion=flexion)


def _variant_tracked(one: Trial, variant: str, markers: np.ndarray) -> tuple[Hand, Tracked]:
    """Track the first markers of a trial with a variant; return its hand model and the results."""
    flexion = None
    if variant == MEASURED_FLEXION:
        last = FLEXION_JOINTS[:, 2]
        error = FLEXION_ERROR * np.random.RandomState(0).normal(size=len(last))
        flexion = one.angles[:len(markers), last] + error
    return tracked_with(one, ABLATION_VARIANTS[variant], markers, flexion)


def _angle_error(angles: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the sum of absolute angular errors over joints in each frame [rad]."""
    return np.abs(np.angle(np.exp(1j * (angles - true)))).sum(axis=1)


def tables(rows: list[Row]) -> list[Table]:
    """Return a table for each condition."""
    found = []
    for condition in CONDITIONS:
        there = [row for row in rows if row['condition'] == condition]
        lines: list[tuple[str, ...]] = []
        for variant in ABLATION_VARIANTS:
            mine = [row for row in there if row['method'] == variant]
            lines.append((
                variant, mean_max(mine, 'true_squared', 3), mean_max(mine, 'true_deg', 1),
                *(fixed(_mean(mine, key), digits) for key, digits in (
                    ('mean_mm', 2), ('p95_mm', 1), ('beyond_limits_pct', 1))),
                *(fixed(_mean(mine, key), digits) for key, digits in (
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


def _mean(rows: list[Row], key: str) -> float:
    """Return the mean of a key over the rows that have it; NaN if none has."""
    known = [row[key] for row in rows if row[key] is not None and np.isfinite(row[key])]
    return sum(known) / len(known) if known else np.nan


ABLATION_LOSSES = (
    'The digits of the simulated motions overlap themselves (said above each table), so that '
    'rigidity moves the pose away from its truth: it is to be judged by the overlaps that it '
    'takes away. Easing trades a little error for fewer jumps. A limit or a coupling that is '
    'only nearly right keeps a joint from where the markers, a little off themselves, would '
    'put it.')


def losses(rows: list[Row]) -> Losses:
    """Return the constraints without which the mean error over motions is smaller."""
    lines = []
    for condition in CONDITIONS:
        there = [row for row in rows if row['condition'] == condition]
        means = {variant: _mean([row for row in there if row['method'] == variant], 'mean_mm')
                 for variant in ABLATION_VARIANTS}
        whole = means[ALL_CONSTRAINTS]
        # By at least what the table shows.
        lines += [f'{condition}, {variant}: {mean:.2f} mm, {whole:.2f} with {ALL_CONSTRAINTS}'
                  for variant, mean in means.items()
                  if variant != MEASURED_FLEXION and mean < whole - .05]
    return Losses(lines, ABLATION_LOSSES)


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw the change of error of each variant, and hands where it is greatest."""
    figure, axes = figure_with(len(CONDITIONS), width=3.9, height=.24 * len(ABLATION_VARIANTS) + .6)
    for ax, (condition, what) in zip(axes, CONDITIONS.items()):
        means = {(row['recording'], row['method']): row['true_deg'] for row in rows
                 if row['condition'] == condition}
        found = np.array([[means[motion, variant] for motion in ABLATION_MOTIONS]
                          for variant in ABLATION_VARIANTS])
        more = found - found[0]
        ax.imshow(more, LOSS_AND_GAIN, aspect='auto', vmin=-FULL_COLOUR, vmax=FULL_COLOUR)
        for (line, column), change in np.ndenumerate(more):
            text = f'{change:+.1f}' if line else f'{found[0, column]:.1f}'
            ax.text(column, line, '·' if text in ('+0.0', '-0.0') else text, fontsize=8,
                    color=INK, ha='center', va='center', weight='normal' if line else 'bold')
        ax.set_title(what, fontsize=9)
        ax.set_xticks(range(len(ABLATION_MOTIONS)), [words(motion).replace(' ', '\n')
                                                     for motion in ABLATION_MOTIONS])
        ax.set_yticks(range(len(ABLATION_VARIANTS)),
                      map(words, ABLATION_VARIANTS) if ax is axes[0] else [])
        ax.grid(False)
        ax.tick_params(length=0)
        ax.axhline(.5, color=INK, linewidth=.7)
        ax.spines[:].set_visible(False)
    figure.text(.5, .985, 'distance from the truth with all constraints [degrees a joint], and '
                'how much more or less without each, or with another choice', ha='center',
                va='top', fontsize=9, color=INK)
    save_figure(figure, folder / 'ablation.png')
    _draw_hands(rows, folder / 'ablation_hands.png')
    return [Picture('ablation.png', 'Error with all constraints, and what each changes, in each '
                    'motion'),
            Picture('ablation_hands.png', 'The truth, the tracked hand with all constraints and '
                    'without one, occluded, at a frame where that one is missed most; only '
                    'constraints that are missed')]


# Hand, marker layout, and the pose: joint angles, wrist rotation and position.
DrawnHand = tuple[Hand, MarkerLayout, tuple[np.ndarray, np.ndarray, np.ndarray]]


def _draw_hands(rows: list[Row], path: Path) -> None:
    """Draw truth, all constraints and a variant side by side, a line for each worst variant."""
    shown = _worst_variants(rows)[:DRAWN_HANDS]
    sizes = [view_size(view, DRAWN_SCALE) for view in VIEW_EXTENTS]
    width = sum(size[0] for size in sizes) + 3. * DRAWN_MARGIN
    height, legend = max(size[1] for size in sizes) + .35, .35
    figure = Figure(figsize=(3. * width + 1.1, len(shown) * height + legend), dpi=110)
    FigureCanvasAgg(figure)
    across, up = figure.get_size_inches()
    trials: dict[str, tuple[Trial, np.ndarray]] = {}
    for line, row in enumerate(shown):
        motion, frame = row['recording'], row['shown_frame']
        if motion not in trials:
            one = trial(motion, row['seed'], ABLATION_RATE, ABLATION_DURATION)
            trials[motion] = one, markers_of(one, 'occluded', row['seed'])
        one, markers = trials[motion]
        to_wrist = one.rotation[frame].T
        local = (markers[frame] - one.position[frame]) @ to_wrist.T
        seen = np.isfinite(local).all(axis=1)
        bottom = up - legend - (line + 1) * height
        for column, name in enumerate(('the truth', ALL_CONSTRAINTS, row['method'])):
            # Frames up to the drawn one only.
            hand, layout, pose = _tracked(one, name, markers[:frame + 1]) if column else _true(
                one, frame)
            # In the true wrist's frame, which shows errors of the palm too.
            turned, moved = to_wrist @ pose[1], to_wrist @ (pose[2] - one.position[frame])
            links = forward(joint_table(hand), pose[0], turned, moved)
            places = marker_positions(layout.mounting(hand), links, turned, moved)
            left = 1.1 + column * width
            for view, size in zip(VIEW_EXTENTS, sizes):
                HandView(figure, (left, bottom), view, hand, DRAWN_SCALE).draw(
                    skeleton_points(tip_offsets(hand), links, moved),
                    np.where(seen[:, None], local, places), seen)
                left += size[0] + DRAWN_MARGIN
            figure.text((1.1 + (column + .5) * width) / across, (bottom + height - .1) / up,
                        words(name), ha='center', va='top', color=INK, fontsize=9,
                        weight='bold' if column == 2 else 'normal')
        figure.text(.1 / across, (bottom + .5 * height) / up,
                    f'{words(motion)}\n{frame / ABLATION_RATE:.2f} s', color=INK, fontsize=8,
                    va='center')
    figure.legend(handles=[
        Line2D([], [], marker='o', linestyle='', markersize=5, color=colour, label=label)
        for colour, label in ((SEEN_COLOUR, 'marker, measured'),
                              (HIDDEN_COLOUR, 'marker not seen: its place on the hand'))],
        loc='upper center', ncol=2, frameon=False, fontsize=8, labelcolor=INK)
    save_figure(figure, path)


def _worst_variants(rows: list[Row]) -> list[Row]:
    """Return an occluded row of each variant with a large error, the largest first.

    Rows with a frame close to one of a row before are left out.
    """
    found: list[Row] = []
    for row in sorted(rows, key=lambda row: -row['shown_deg']):
        if (row['condition'] == 'occluded' and row['shown_deg'] > DRAWN_DIFFERENCE and not any(
                row['method'] == other['method'] or row['recording'] == other['recording']
                and abs(row['shown_frame'] - other['shown_frame']) < DRAWN_INTERVAL * ABLATION_RATE
                for other in found)):
            found.append(row)
    return found


def _true(one: Trial, frame: int) -> DrawnHand:
    return one.hand, skin_layout(one.hand), (
        one.angles[frame], one.rotation[frame], one.position[frame])


def _tracked(one: Trial, variant: str, markers: np.ndarray) -> DrawnHand:
    hand, tracked = _variant_tracked(one, variant, markers)
    return hand, one.layout, (
        tracked.angles[-1], tracked.wrist_rotation[-1], tracked.wrist_position[-1])
