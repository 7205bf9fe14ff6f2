"""`hand_tracker splice`: put tracked hands on the body that another system captured."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..files.point_recording import UNIT_SPELLINGS
from ..files.written_kinds import WRISTS
from ..parallel import Interruptions
from .recording_options import add_recording_options, run_command
from .reporting import CommandParser, reporting


def _splice(options: argparse.Namespace, interrupted: Interruptions) -> str:
    # Here, so that a wrong option is reported at once.
    from .splice_recordings import splice_recordings

    return splice_recordings(options, interrupted)


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Put tracked hands on the body that another system captured, whose joints stay as they are.

    The clocks are aligned by the path of the wrist. One recording is of the hand that its
    labels, --hand or --side say; of two the first is of the right hand.
    """
    parser = CommandParser(prog='hand_tracker splice', description=main.__doc__)
    parser.add_argument('body', type=Path, metavar='BODY', help='motion of the body: a '
                        'skeleton (.bvh), or markers (.c3d, .trc, ...)')
    add_recording_options(parser, several=True)
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='OUT',
                        help='body with fingers (.bvh; .glb: with bones, or markers, and the '
                        'skin of hands); of a body of markers also .c3d and .trc')
    parser.add_argument('--wrist', choices=WRISTS, default=WRISTS[0],
                        help="whose rotation the wrists keep: the body's (default), or that of "
                        'the tracked hands')
    parser.add_argument('--offset', type=float, metavar='SECONDS',
                        help="time of the body at which the hands' recordings begin; default: "
                        'as the paths of the wrist tell')
    parser.add_argument('--body-units', choices=tuple(UNIT_SPELLINGS),
                        help='of BODY; default: as the wrist moves, else by its size')
    return run_command(_splice, parser.parse_args(arguments))


if __name__ == '__main__':
    sys.exit(main())
