"""Published deviations of angles: the share of errors that lie within one and two of them.

Every simulated motion at 120 Hz, eight cameras, markers hidden for a time now and then; tracked
with two hands: drawn, with the usual errors of a calibration, and fitted, as `hand_tracker
calibrate` finds it from a simulated take of markers at all joints (truth is then the angle of the
true bones about its axes). Of normally distributed errors 68 and 95 % lie within one and two
deviations. Digits are straight up to 12 degrees of their second flexion, bent from 40 on, seen
while the marker and the palm's three are. The simulated last joints follow their coupling, those
of people leave it (by 14 to 19 degrees in captured hands): theirs are wide here.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from ..core.model.hand import ABDUCTION_JOINTS, DIGIT_OF_JOINT, FLEXION_JOINTS, Hand
from ..core.model.marker_layout import MARKERS, PALM_MARKERS, MarkerLayout
from ..core.tracker import HandTracker
from .calibrated_fit import calibrated_fit, true_angles
from .evaluation_options import Options
from .rows import Row, root_mean_square_deg
from .simulated import tasks, trial
from .steadiness import BENT, NEAR_STRAIGHT
from .tables import SERIES_COLOURS, Picture, Table, figure_with, save_figure, words

DEVIATIONS_RATE, DEVIATIONS_DURATION = 120., 8.  # [Hz, s]
DEVIATIONS_FROM = .5                             # [s] after the start that is not judged
HIDING_LENGTHS = (.05, .1, .25, .5, 1.)          # [s] that markers are hidden for
SEEN_LENGTHS = (.4, .8)                          # [s] between these
PALM_HIDDEN_SHARE = .12                          # [1] of these that hide a marker of the palm
SHORTLY, LONG = .1, .5                           # [s] of the conditions' names
JUDGED_CONDITIONS = ('straight', 'between', 'bent', 'hidden_0.1_s', 'hidden_0.5_s', 'hidden_longer',
              'palm_hidden')
JUDGED_CLASSES = {
    'mcp_flexion': FLEXION_JOINTS[:4, 0], 'pip': FLEXION_JOINTS[:4, 1],
    'dip': FLEXION_JOINTS[:4, 2], 'mcp_abduction': ABDUCTION_JOINTS[:4],
    'thumb_cmc_flexion': FLEXION_JOINTS[4:, 0], 'thumb_mcp': FLEXION_JOINTS[4:, 1],
    'thumb_ip': FLEXION_JOINTS[4:, 2], 'thumb_abduction': ABDUCTION_JOINTS[4:]}
EVERY_CLASS = 'all'
JUDGED_CLASSES[EVERY_CLASS] = np.concatenate(list(JUDGED_CLASSES.values()))


def evaluate(options: Options) -> Iterator[Row]:
    """Yield a row for each motion, hand, class of joints and condition.

    `within_1_pct` and `within_2_pct` are the shares of errors within one and two deviations,
    `error_deg` and `deviation_deg` root mean squares [degrees], `angles` how many were judged.
    """
    for rows in options.each('motions', partial(judge, seed=options.seed), tasks(options)):
        yield from rows


def judge(task: tuple[str, int], seed: int) -> list[Row]:
    """Return the rows of one motion and its seed; `seed` is that of the fitted hand."""
    motion, own_seed = task
    one = trial(motion, own_seed, DEVIATIONS_RATE, DEVIATIONS_DURATION)
    markers = _hide_at_times(one.measured(), np.random.RandomState((own_seed, 7)))
    fit = calibrated_fit(seed)
    return [row for name, hand, layout, true in (
        ('drawn', one.calibrated_hand, one.layout, one.angles),
        ('fitted', fit.hand, fit.layout, true_angles(one, fit)))
        for row in _judge_hand(motion, name, hand, layout, true, markers)]


def _hide_at_times(markers: np.ndarray, random: np.random.RandomState) -> np.ndarray:
    """Return markers (n, 8, 3) of which some are hidden at times, after a second."""
    hidden = markers.copy()
    palm = len(PALM_MARKERS)
    start = round(DEVIATIONS_RATE)
    while start < len(markers):
        end = start + round(random.choice(HIDING_LENGTHS) * DEVIATIONS_RATE)
        count = random.choice((1, 1, 2, 3))
        rows = (random.choice(palm, 1) if random.rand() < PALM_HIDDEN_SHARE
                else palm + random.choice(len(MARKERS) - palm, count, replace=False))
        hidden[start:end, rows] = np.nan
        start = end + round(random.choice(SEEN_LENGTHS) * DEVIATIONS_RATE)
    return hidden


def _judge_hand(motion: str, name: str, hand: Hand, layout: MarkerLayout, true: np.ndarray,
                markers: np.ndarray) -> Iterator[Row]:
    """Yield the rows of a motion tracked with one hand."""
    tracker = HandTracker(hand, layout)
    states = [tracker.update(frame, i / DEVIATIONS_RATE) for i, frame in enumerate(markers)]
    error = np.array([state.angles for state in states]) - true
    deviation = np.array([state.deviation for state in states])
    hidden_for = np.array([state.hidden_for for state in states])
    bend = np.degrees(true[:, FLEXION_JOINTS[:, 1]])
    first = round(DEVIATIONS_FROM * DEVIATIONS_RATE)
    for condition, holds in zip(JUDGED_CONDITIONS, _conditions(hidden_for, bend)):
        mask = holds[:, DIGIT_OF_JOINT] & np.isfinite(error)
        mask[:first] = False
        for joint_class, joints in JUDGED_CLASSES.items():
            judged = mask[:, joints]
            if not judged.any():
                continue
            off, spread = error[:, joints][judged], deviation[:, joints][judged]
            yield {
                'evaluation': 'deviations', 'recording': motion, 'method': name,
                'joint_class': joint_class, 'condition': condition,
                **{f'within_{count}_pct': round(100. * float(
                    (np.abs(off) <= count * spread).mean()), 2) for count in (1, 2)},
                'error_deg': root_mean_square_deg(off),
                'deviation_deg': root_mean_square_deg(spread),
                'mean_mm': np.nan, 'p95_mm': np.nan, 'angles': int(judged.sum()),
                'frames': len(markers) - first}


def _conditions(hidden_for: np.ndarray, bend: np.ndarray) -> Iterator[np.ndarray]:
    """Yield where each of `JUDGED_CONDITIONS` holds, (n, 5) bool.

    Parameters
    ----------
    hidden_for : ndarray, shape (n, 8)
        [s]
    bend : ndarray, shape (n, 5)
        True second flexion of the digits [degrees].
    """
    palm = (hidden_for[:, :len(PALM_MARKERS)] > 0.).any(axis=1, keepdims=True)
    hidden = np.where(palm, np.nan, hidden_for[:, len(PALM_MARKERS):])
    seen = hidden == 0.
    yield seen & (bend <= NEAR_STRAIGHT)
    yield seen & (bend > NEAR_STRAIGHT) & (bend < BENT)
    yield seen & (bend >= BENT)
    yield (hidden > 0.) & (hidden <= SHORTLY)
    yield (hidden > SHORTLY) & (hidden <= LONG)
    yield hidden > LONG
    yield np.repeat(palm, bend.shape[1], axis=1)


def pooled(rows: list[Row]) -> Row | None:
    """Return shares and root mean squares over all angles of rows; None where there are none."""
    if not rows:
        return None
    count = np.array([row['angles'] for row in rows])
    found: Row = {key: float(np.average([row[key] for row in rows], weights=count))
                  for key in ('within_1_pct', 'within_2_pct')}
    found.update({key: float(np.sqrt(np.average(
        [row[key] ** 2 for row in rows], weights=count))) for key in (
            'error_deg', 'deviation_deg')})
    return found


def _of(rows: list[Row], **values: str) -> Row | None:
    return pooled([row for row in rows if all(row[key] == value for key, value in values.items())])


def tables(rows: list[Row]) -> list[Table]:
    """Return a table of each hand, over all motions."""
    return [Table(
        f'{hand.capitalize()} hands: % of errors within one and two deviations, and the '
        'root mean square of errors ~ deviations, degrees',
        ('joints', *map(words, JUDGED_CONDITIONS)),
        [(words(name), *(_cell(_of(rows, method=hand, joint_class=name, condition=condition))
                         for condition in JUDGED_CONDITIONS)) for name in JUDGED_CLASSES])
        for hand in dict.fromkeys(row['method'] for row in rows)]


def _cell(found: Row | None) -> str:
    return '–' if found is None else (
        f'{found["within_1_pct"]:.0f} {found["within_2_pct"]:.0f} '
        f'({found["error_deg"]:.1f} ~ {found["deviation_deg"]:.1f})')


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Draw errors and deviations of the fingers' second flexion in each condition."""
    hands = list(dict.fromkeys(row['method'] for row in rows))
    figure, axes = figure_with(len(hands), width=5.)
    for ax, hand in zip(axes, hands):
        for i, key in enumerate(('deviation_deg', 'error_deg')):
            found = [_of(rows, method=hand, joint_class='pip', condition=condition)
                     for condition in JUDGED_CONDITIONS]
            ax.bar(np.arange(len(JUDGED_CONDITIONS)) + .38 * (i - .5),
                   [np.nan if one is None else one[key] for one in found], .38,
                   color=SERIES_COLOURS[i], label=('deviation', 'error')[i])
        ax.set_xticks(range(len(JUDGED_CONDITIONS)),
                      [words(name).replace(' ', '\n') for name in JUDGED_CONDITIONS], fontsize=7)
        ax.set_xlabel(f'{hand} hand', fontsize=8)
    axes[0].set_ylabel('PIP, root mean square [degrees]', fontsize=8)
    save_figure(figure, folder / 'deviations.png', axes[0])
    return [Picture('deviations.png', 'Published deviations and errors of the fingers\' PIP')]
