"""`hand_tracker calibrate`: fit a person's hand to takes of the markers on it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..core.model.hand import LIMIT_PRESETS, SIDES, WEARER_LIMITS
from ..parallel import Interruptions
from .recording_options import add_layout_option, add_marker_options, run_command
from .reporting import CommandParser, reporting


def _calibrate(options: argparse.Namespace, interrupted: Interruptions) -> str:
    # With all that fits, for which a wrong option need not wait.
    from .calibrate_recordings import calibrate

    return calibrate(options, interrupted)


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = CommandParser(prog='hand_tracker calibrate', description=main.__doc__)
    parser.add_argument('takes', nargs='+', type=Path, metavar='TAKE',
                        help='recordings of the eight markers (folder, .mcap, .db3), or points '
                        'with names, more than eight if there are: .npz with markers (T, M, 3) [m] '
                        'and marker_names, C3D, TRC, TSV, CSV, BVH')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='HAND.yaml',
                        help='hand file to write')
    parser.add_argument('--picture', type=Path, metavar='FILE.png',
                        help='of the fitted hand; default: beside the hand file')
    parser.add_argument('--side', choices=SIDES, help="default: the take's, else right")
    parser.add_argument('--fingers', choices=('dip', 'tip'), default='dip',
                        help='joint at which the fingers wear their markers, of recordings; '
                        'default: %(default)s')
    parser.add_argument('--limits', choices=LIMIT_PRESETS, default=WEARER_LIMITS,
                        help='joint limits: Table 1 of the paper, wider ranges, or Table 1 widened '
                        'to what the take shows; default: %(default)s')
    add_layout_option(parser, "those whose labels name a place on the hand; of a recording the "
                      "paper's eight. The hand file gets all of them")
    add_marker_options(parser)
    return parser.parse_args(arguments)


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Fit a person's hand, and where the markers are on it, to takes of a moving hand.

    Best are takes with more markers than will be worn: of every joint and tip. With the eight
    worn ones alone much is taken from other hands; the report says what.
    """
    options = _parse(arguments)
    return run_command('hand_tracker calibrate', _calibrate, options)


if __name__ == '__main__':
    sys.exit(main())
