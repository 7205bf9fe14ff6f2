"""`hand_tracker calibrate`: fit a person's hand to takes of the markers on it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from ..calibration.calibrate_takes import calibrate_takes
from ..calibration.take_files import load_take
from ..calibration.takes import InvalidTake, MarkerTake
from ..core.model.hand import LIMIT_PRESETS, SIDES
from ..core.model.marker_layout import MARKERS, PAPER_PLACES
from ..files.bags import open_bag
from ..messages.cdr import MarkerReader
from ..messages.stamps import seconds
from ..parallel import Interruptions
from ..tracking.recording import marker_topic
from .recording_options import add_marker_options, label_map, run_command

TAKE_SUFFIX = '.npz'


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
    return calibrate_takes(takes, options.output, options.limits, options.picture)


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
