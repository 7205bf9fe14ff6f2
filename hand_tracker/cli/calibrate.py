"""`hand_tracker calibrate`: fit a person's hand to takes of the markers on it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from ..calibration.coverage import Covered, coverage
from ..calibration.fit import fit_hand
from ..calibration.fit_report import FitReport, average_rate, report_fit
from ..calibration.fitted_hand import place_mounted
from ..calibration.joint_centres import are_joint_centres, landmark_frames
from ..calibration.marker_fit import FIT_STEPS, MarkerFit, fit_gathered
from ..calibration.take_checks import check_takes
from ..calibration.take_files import load_take
from ..calibration.takes import Gathered, InvalidTake, MarkerTake, gather
from ..core.model.hand import FLEXION_JOINTS, LIMIT_PRESETS, SIDES, preset_limits
from ..core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from ..drawing.fit_picture import FittedPose, save_fit_picture
from ..files.bags import open_bag
from ..files.hand_file import save_hand
from ..messages.cdr import MarkerReader
from ..messages.stamps import seconds
from ..parallel import Interruptions
from ..progress import Progress
from ..tracking.recording import marker_topic
from .recording_options import add_marker_options, label_map, run_command

TAKE_SUFFIX = '.npz'
COVERAGE_BAR = 20          # [characters]
PICTURED_FLEXION = (0., .5, 1.)  # order of the poses in the picture among all, by flexion [1]


def recorded_take(path: Path, options: argparse.Namespace) -> MarkerTake:
    """Return a take of the eight worn markers from a rosbag2 recording.

    Parameters
    ----------
    path : Path
    options : argparse.Namespace
        Of the command line.

    Returns
    -------
    MarkerTake
    """
    reader = MarkerReader(label_map(options.label), options.frame, options.unit_scale,
                          not options.keep_zeros)
    frames, times = [], []
    with open_bag(path) as bag:
        for message in bag.messages([marker_topic(bag, options.topic)]):
            frame = reader.read(message.data)
            if frame.stamp is not None:
                frames.append(frame.positions.copy())
                stamped = seconds(frame.stamp)
                times.append(1e-9 * message.time if stamped is None else stamped)
    if len(frames) < 2:
        raise InvalidTake(f'{path}: {len(frames)} messages with markers of the hand; '
                          'expected a take of some 40 s')
    steps = np.diff(times)
    rate = 1. / max(float(np.median(steps[steps > 0.])) if (steps > 0.).any() else 1., 1e-4)
    points = np.array(frames, dtype=float)
    names = tuple(place.replace('dip', options.fingers) if marker in place else place
                  for marker, place in zip(MARKERS, PAPER_PLACES))
    seen = np.isfinite(points).all(axis=2).any(axis=0)
    return MarkerTake(path.stem, tuple(name for name, there in zip(names, seen) if there),
                      points[:, seen], options.side or 'right', rate,
                      np.zeros(len(points), dtype=int))


def calibrate(options: argparse.Namespace, _: Interruptions) -> str:
    """Do what the command line asks for; return what to say at the end."""
    takes = []
    for path in options.takes:
        take = (load_take(path, options.side) if path.suffix == TAKE_SUFFIX
                else recorded_take(path, options))
        scale = options.unit_scale if path.suffix == TAKE_SUFFIX else 1.
        takes.append(take._replace(points=scale * take.points))
    for weak in check_takes(takes):
        print(f'note: {weak}', file=sys.stderr)
    gathered = gather(takes)
    if are_joint_centres(gathered):
        joints = landmark_frames(gathered) * takes[0].mirror
        save_hand(options.output, fit_hand(joints, takes[0].side, preset_limits(options.limits)),
                  MarkerLayout())
        return (f'{options.output}: a hand with markers at its joints, as these are no markers on '
                'the skin: joints that keep their distances')
    rate = average_rate([take.rate for take in takes])
    fit, report = _fit_with_progress(gathered, takes[0].side, options.limits, rate)
    covered = coverage(fit.postures)
    lines = [*report.lines(), '', *_coverage_lines(covered)]
    print('\n'.join(lines))
    save_hand(options.output, fit.hand, fit.layout)
    with open(options.output, 'a', encoding='utf-8') as file:
        file.write(''.join(f'# {line}'.rstrip() + '\n' for line in
                           ('', f'Fitted to {", ".join(take.name for take in takes)}:', *lines)))
    picture = options.picture or options.output.with_suffix('.png')
    save_fit_picture(picture, fit.hand, _pictured(fit, gathered))
    return (f'{options.output}: hand of {1e3 * fit.length:.0f} mm; '
            f'its markers are drawn in {picture}')


def _fit_with_progress(gathered: Gathered, side: str, limits: str,
                       rate: float) -> tuple[MarkerFit, FitReport]:
    """Fit and report, with a progress line."""
    steps: SimpleQueue[bool] = SimpleQueue()

    def work(done: Callable[[], None]) -> tuple[MarkerFit, FitReport]:
        try:
            fit = fit_gathered(gathered, side, preset_limits(limits), done)
            return fit, report_fit(fit, gathered, rate, done)
        finally:
            steps.put(False)

    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(work, lambda: steps.put(True))
        for _ in Progress(2 * FIT_STEPS, 'fits of a digit').over(iter(steps.get, False)):
            pass
        return found.result()


def _coverage_lines(covered: list[Covered]) -> Iterator[str]:
    """Yield how far each joint moved, as bars, and what would show more."""
    yield 'motion in the take, of what a calibration asks for'
    names = {'turn': 'abduction', 'first': 'first joint', 'second': 'second joint'}
    for one in covered:
        full = int(one.share * COVERAGE_BAR)
        yield (f'{one.digit:7s}{names[one.joint]:13s}[{"#" * full}{"." * (COVERAGE_BAR - full)}] '
               f'{one.degrees:4.0f} degrees' + ('' if one.share == 1. else f'; {one.task}'))


def _pictured(fit: MarkerFit, gathered: Gathered) -> list[FittedPose]:
    """Return an open, a half closed and a closed hand of the take."""
    flexion = fit.postures[:, FLEXION_JOINTS[:, :2].ravel()].sum(axis=1)
    order = np.argsort(flexion)
    rows = [int(order[int(share * (len(order) - 1))]) for share in PICTURED_FLEXION]
    mounts = [fit.mounts[marker.name] for marker in gathered.markers]
    modelled = place_mounted(fit.hand.replace(side='right'), mounts, fit.postures[rows],
                             np.tile(np.eye(3), (len(rows), 1, 1)), np.zeros((len(rows), 3)))
    return [FittedPose(title, fit.postures[row], fit.local[row], points)
            for title, row, points in zip(('open', 'half closed', 'closed'), rows, modelled)]


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='hand_tracker calibrate', description=main.__doc__)
    parser.add_argument('takes', nargs='+', type=Path, metavar='TAKE',
                        help='recordings of the eight markers (folder, .mcap, .db3), or .npz with '
                        'markers (T, M, 3) [m] and marker_names, more than eight if there are')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='HAND.yaml',
                        help='hand file to write')
    parser.add_argument('--picture', type=Path, metavar='FILE.png',
                        help='of the fitted hand; default: beside the hand file')
    parser.add_argument('--side', choices=SIDES, help="default: the take's, else right")
    parser.add_argument('--fingers', choices=('dip', 'tip'), default='dip',
                        help='joint at which the fingers wear their markers, of recordings; '
                        'default: %(default)s')
    parser.add_argument('--limits', choices=tuple(LIMIT_PRESETS), default='paper',
                        help='joint limits, which the take widens; default: %(default)s')
    add_marker_options(parser)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Fit a person's hand, and where the markers are on it, to takes of a moving hand.

    Best are takes with more markers than will be worn: of every joint and tip. With the eight
    worn ones alone much is taken from other hands; the report says what.
    """
    options = _parse(arguments)
    return run_command('hand_tracker calibrate', calibrate, options)


if __name__ == '__main__':
    sys.exit(main())
