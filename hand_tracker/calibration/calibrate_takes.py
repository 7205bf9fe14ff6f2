"""Calibrate a hand by takes: fit it, print the report, write hand file and picture."""

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from ..core.model.hand import FINGERS, FLEXION_JOINTS, WEARER_LIMITS, Hand
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..drawing.fit_picture import FittedPose, save_fit_picture
from ..files.hand_file import hand_text
from ..output_files import (
    PICTURE_SUFFIXES,
    YAML_SUFFIXES,
    require_writable,
    write_keeping_replaced,
)
from ..progress import Progress, bar
from .angle_uncertainty import angle_uncertainty, uncertainty_lines, uncertainty_range
from .coverage import Covered, coverage, missing_movements
from .fit import fit_hand
from .fit_report import FitReport, average_rate, report_fit
from .fitted_hand import place_mounted
from .full_layout import fitted_layout
from .joint_centres import are_joint_centres, landmark_frames
from .label_repair import with_labels_put_right, worn_order
from .layout_names import names_in_layout
from .marker_fit import FIT_STEPS, MarkerFit, fit_gathered
from .ruler import UNMEASURED, Ruler
from .ruler_check import ruler_doubts
from .take_checks import check_takes
from .takes import Gathered, InvalidTake, MarkerTake, gather

COVERAGE_BAR = 20          # [characters]
MOST_BEND = 113.          # [degrees] of a PIP in a take, with the margin of its range; ours
PICTURED_FLEXION = (0., .5, 1.)  # order of the poses in the picture among all, by flexion [1]


def calibrate_takes(takes: Sequence[MarkerTake], output: Path, limits: str = WEARER_LIMITS,
                    picture: Path | None = None, layout: MarkerLayout | None = None,
                    ruler: Ruler = UNMEASURED,
                    prepare: Callable[[], object] = lambda: None) -> str:
    """Fit a hand to takes, print the report, and write hand file and picture.

    Parameters
    ----------
    takes : sequence of MarkerTake
        Of one hand with its markers left in place.
    output : Path
        Hand file to write.
    limits : str, optional
        Preset of the joint limits; by default Table 1, widened to what the takes show.
    picture : Path, optional
        Beside the hand file when left out.
    layout : MarkerLayout, optional
        Whose markers the takes have, and the hand file gets; when left out it gets the paper's
        eight.
    ruler : Ruler, optional
        What was measured of the hand and its markers.
    prepare : callable, optional
        Called before the takes are tracked, to load or compile kernels.

    Returns
    -------
    str
        The files written, in words.

    Raises
    ------
    InvalidTake
        If the takes are refused, with the reason.
    OutputError
        If a file cannot be written.
    """
    picture = picture or output.with_suffix('.png')
    require_writable(output, YAML_SUFFIXES)
    require_writable(picture, PICTURE_SUFFIXES)
    weaknesses = check_takes(takes)
    gathered = gather(_repaired(takes, prepare), ruler)
    if are_joint_centres(gathered, not any(take.is_optical for take in takes)):
        if ruler != UNMEASURED:
            print('note: what a ruler says is not used, as joints tell all lengths',
                  file=sys.stderr)
        joints = landmark_frames(gathered) * takes[0].mirror
        kept = _written(output, hand_text(
            fit_hand(joints, takes[0].side, limits), layout or MarkerLayout()))
        return (f'{output}: a hand with markers at its joints, as these are no markers on '
                f'the skin: joints of a skeleton{_kept(kept)}')
    doubts = ruler_doubts(gathered, takes[0].side)
    for doubt in (*weaknesses, *doubts):
        print(f'note: {doubt}', file=sys.stderr)
    rate = average_rate([take.rate for take in takes])
    fit, report = _fit_with_progress(gathered, takes[0].side, limits, rate)
    try:
        report.require_fitted(', '.join(take.name for take in takes))
    except InvalidTake as fault:
        print('\n'.join(report.lines()), file=sys.stderr)
        if doubts:
            raise InvalidTake(f'{fault} Or is a length by the ruler wrong?') from None
        raise
    covered = coverage(fit.postures)
    if layout is None or layout.names == MARKERS:
        worn, names = fit.layout, fit.worn
    else:
        worn, (names, _) = fitted_layout(fit, layout), names_in_layout(layout)
    prepare()
    deviations = angle_uncertainty(fit.hand.as_right(), worn, gathered.columns(names), rate)
    missing = missing_movements(covered)
    verdict = f'{report.verdict()}; {uncertainty_range(deviations)}' + (
        f'; movements to add: {"; ".join(missing)}' if missing else '')
    lines = [verdict, '', *report.lines(), '',
             *_unusual_bends(fit.hand), *uncertainty_lines(deviations), '',
             *_coverage_lines(covered)]
    kept = _written(output, hand_text(fit.hand, worn) + ''.join(
        f'# {line}'.rstrip() + '\n' for line in (
            '', f'Fitted to {", ".join(take.name for take in takes)}:', *lines, '',
            *report.table())))
    print('\n'.join(lines))
    kept_picture = write_keeping_replaced(picture, lambda unfinished: save_fit_picture(
        unfinished, fit.hand, _pictured(fit, gathered)))
    return (f'{output}: {takes[0].side} hand of {1e3 * fit.length:.0f} mm (standard deviation '
            f'{1e3 * fit.length_deviation:.0f} mm), and at its end each fitted parameter '
            f'with its standard deviation; its markers are drawn in {picture}'
            f'{_kept(kept, kept_picture)}')


def _written(output: Path, text: str) -> Path | None:
    """Write a hand file; return where the one that it replaced is now, if there was one."""
    return write_keeping_replaced(
        output, lambda unfinished: unfinished.write_text(text, encoding='utf-8'))


def _kept(*replaced: Path | None) -> str:
    """Return the end of a message on where replaced files are, if there are any."""
    named = ' and '.join(str(path) for path in replaced if path)
    return f'; what was there before is now {named}' if named else ''


def _repaired(takes: Sequence[MarkerTake], prepare: Callable[[], object]) -> list[MarkerTake]:
    """Return takes whose exchanged labels are put right, and say so."""
    repaired = []
    for take in takes:
        if (order := worn_order(take)) is not None:
            prepare()
            take, changed = with_labels_put_right(take, order)
            if changed:
                print(f'note: {take.name}: labels are exchanged in {changed} of '
                      f'{len(take.points)} frames, and were put right', file=sys.stderr)
        repaired.append(take)
    return repaired


def _fit_with_progress(gathered: Gathered, side: str, limits: str,
                       rate: float) -> tuple[MarkerFit, FitReport]:
    """Fit and report, with a progress line."""
    steps: SimpleQueue[bool] = SimpleQueue()

    def work(done: Callable[[], None]) -> tuple[MarkerFit, FitReport]:
        try:
            fit = fit_gathered(gathered, side, limits, done)
            return fit, report_fit(fit, gathered, rate, done)
        finally:
            steps.put(False)

    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(work, lambda: steps.put(True))
        for _ in Progress(2 * FIT_STEPS, 'fits of a digit').over(iter(steps.get, False)):
            pass
        return found.result()


def _unusual_bends(hand: Hand) -> list[str]:
    """Return a line on fingers whose PIP is fitted as bent farther than it can be, if any."""
    bends = np.degrees(hand.range_of_motion[FLEXION_JOINTS[:len(FINGERS), 1], 1])
    named = [f'{finger} {bend:.0f}' for finger, bend in zip(FINGERS, bends) if bend > MOST_BEND]
    return [f'bent farther than a PIP bends, degrees: {", ".join(named)}; are the markers on the '
            'back of the joints, not at them, and their labels right?', ''] if named else []


def _coverage_lines(covered: list[Covered]) -> Iterator[str]:
    """Yield the coverage of each joint as a bar, with the movement to add."""
    yield 'motion in the take, degrees of those that a calibration asks for'
    names = {'turn': 'abduction', 'first': 'first joint', 'second': 'second joint'}
    for one in covered:
        yield (f'{one.digit:7s}{names[one.joint]:13s}{bar(one.share, COVERAGE_BAR)} '
               f'{one.degrees:4.0f} of {one.wanted:2.0f}'
               + ('' if one.share == 1. else f'; {one.task}'))


def _pictured(fit: MarkerFit, gathered: Gathered) -> list[FittedPose]:
    """Return an open, the median and a closed hand of the take, by flexion."""
    flexion = fit.postures[:, FLEXION_JOINTS[:, :2].ravel()].sum(axis=1)
    order = np.argsort(flexion)
    rows = [int(order[int(share * (len(order) - 1))]) for share in PICTURED_FLEXION]
    mounts = [fit.mounts[marker.name] for marker in gathered.markers]
    modelled = place_mounted(fit.hand.as_right(), mounts, fit.postures[rows],
                             np.tile(np.eye(3), (len(rows), 1, 1)), np.zeros((len(rows), 3)))
    return [FittedPose(title, fit.postures[row], fit.local[row], points)
            for title, row, points in zip(('open', 'median', 'closed'), rows, modelled)]
