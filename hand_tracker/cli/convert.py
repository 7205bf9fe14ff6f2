"""`hand_tracker convert`: write a recording in another format."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..files.written_kinds import WRITTEN_FORMATS
from ..parallel import Interruptions
from .recording_options import add_recording_options, run_command
from .reporting import CommandParser, reporting
from .track import add_motion_options, settle_motion_options


def _convert(options: argparse.Namespace, interrupted: Interruptions) -> str:
    settle_motion_options(options, f'.{options.format}' if options.format
                          else options.output.suffix.lower())
    # Here, so that a wrong option is reported at once.
    from .convert_recording import convert_recording

    return convert_recording(options, interrupted)


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Write a recording in another format, known by the suffix of OUT.

    Points are written as .c3d, .trc, .tsv (Qualisys), .csv (OptiTrack), .npz, .mcap or .db3, with
    --labels none without their labels; a skeleton (.bvh) and one with skin (.glb) by tracking the
    hand.
    """
    parser = CommandParser(prog='hand_tracker convert', description=main.__doc__)
    add_recording_options(parser)
    parser.add_argument('output', type=Path, metavar='OUT')
    parser.add_argument('--format', choices=WRITTEN_FORMATS,
                        help='of OUT, where its suffix does not tell')
    add_motion_options(parser)
    options = parser.parse_args(arguments)
    return run_command(_convert, options)


if __name__ == '__main__':
    sys.exit(main())
