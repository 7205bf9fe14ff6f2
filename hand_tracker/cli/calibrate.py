"""`hand_tracker calibrate`: fit a person's hand to takes of the markers on it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from ..core.model.hand import (
    FINGERS,
    HAND_BREADTH_RANGE,
    HAND_LENGTH_RANGE,
    LIMIT_PRESETS,
    SIDES,
    WEARER_LIMITS,
)
from ..parallel import Interruptions
from .recording_options import add_layout_option, add_marker_options, one_side, run_command
from .reporting import CommandParser, reporting

FINGER_LENGTH_RANGE, MARKER_HEIGHT_RANGE = (.04, .14), (0., .03)     # [m]


def _calibrate(options: argparse.Namespace, interrupted: Interruptions) -> str:
    # With all that fits, for which a wrong option need not wait.
    from .calibrate_recordings import calibrate

    return calibrate(options, interrupted)


def _length(allowed: tuple[float, float]) -> Callable[[str], float]:
    """Return the parser of a length in millimetres, which returns metres."""
    lower, upper = allowed

    def parse(text: str) -> float:
        try:
            length = float(text) / 1e3
        except ValueError:
            length = float('nan')
        if not lower <= length <= upper:
            raise argparse.ArgumentTypeError(
                f"'{text}'; allowed is {1e3 * lower:g} to {1e3 * upper:g} mm")
        return length

    return parse


def _finger_lengths(text: str) -> tuple[float, ...]:
    found = tuple(map(_length(FINGER_LENGTH_RANGE), text.split(',')))
    if len(found) != len(FINGERS):
        raise argparse.ArgumentTypeError(f"'{text}'; expected four lengths, {', '.join(FINGERS)}")
    return found


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = CommandParser(prog='hand_tracker calibrate', description=main.__doc__)
    parser.add_argument('takes', nargs='+', type=Path, metavar='TAKE',
                        help='recordings of the eight markers (rosbag2 folder, .mcap, .db3), or '
                        'points with names, more than eight if there are: .npz with markers '
                        '(T, M, 3) [m] and marker_names, C3D, TRC, TSV, CSV, BVH; or a folder of '
                        'such takes')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='HAND.yaml',
                        help='hand file to write')
    parser.add_argument('--picture', type=Path, metavar='FILE.png',
                        help='of the fitted hand; default: beside the hand file')
    parser.add_argument('--side', type=one_side, choices=SIDES,
                        help="default: the take's, else right")
    parser.add_argument('--fingers', choices=('dip', 'tip'),
                        help='joint at which the fingers wear their markers, of MarkerArrays; '
                        'default: dip')
    parser.add_argument('--limits', choices=LIMIT_PRESETS, default=WEARER_LIMITS,
                        help='joint limits: Table 1 of the paper, wider ranges, or Table 1 widened '
                        'to what the take shows; default: %(default)s')
    add_layout_option(parser, "those whose labels name a place on the hand; of a recording the "
                      "paper's eight. The hand file gets all of them")
    add_marker_options(parser)
    lengths = parser.add_argument_group('what a ruler says', 'where it was measured, in mm')
    lengths.add_argument('--hand-length', type=_length(HAND_LENGTH_RANGE), metavar='MM',
                         help="from the wrist's crease to the tip of the middle finger")
    lengths.add_argument('--hand-breadth', type=_length(HAND_BREADTH_RANGE), metavar='MM',
                         help='across the knuckles of index to little finger')
    lengths.add_argument('--finger-lengths', type=_finger_lengths, metavar='MM,MM,MM,MM',
                         help='index to little finger, bent: from the knuckle over the back to the '
                         'tip')
    lengths.add_argument('--marker-height', type=_length(MARKER_HEIGHT_RANGE), metavar='MM',
                         help="of the markers' centres above the skin; default: as of balls of "
                         '8 mm')
    return parser.parse_args(arguments)


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Fit a person's hand, and where the markers are on it, to takes of a moving hand.

    Best are takes with more markers than will be worn: of every joint and tip. With the eight
    worn ones alone much is taken from other hands; the report says what.
    """
    options = _parse(arguments)
    return run_command(_calibrate, options)


if __name__ == '__main__':
    sys.exit(main())
