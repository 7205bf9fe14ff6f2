"""`hand_tracker track`: track recordings without ROS; write a table or a recording of angles."""

from __future__ import annotations

import argparse
import sys
from pathlib import PurePath

from ..core.errors import HandTrackerError
from ..files.remote_files import located
from ..files.written_kinds import (
    EULER_ORDERS,
    NAMINGS,
    SKELETON_KIND,
    SKELETON_KINDS,
    TABLE,
    TRACKED_KINDS,
)
from ..parallel import Interruptions
from .recording_options import add_recording_options, run_command
from .reporting import CommandParser, reporting

# Options of skeletons: the outputs that they are for, and what they are where they are not given.
MOTION_OPTIONS = {'names': (SKELETON_KINDS, NAMINGS[0]),
                  'order': ((SKELETON_KIND,), EULER_ORDERS[0])}


def _track(options: argparse.Namespace, interrupted: Interruptions) -> str:
    kind = PurePath(options.output).suffix.lower()
    if options.format or kind not in TRACKED_KINDS:
        kind = f'.{options.format}' if options.format else TABLE
    settle_motion_options(options, kind)
    # Here, so that a wrong option is reported at once.
    from .track_recordings import track_recordings

    return track_recordings(options, interrupted)


def _jobs(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number from 1 on")
    return int(text)


def add_motion_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command line that writes skeletons in motion."""
    parser.add_argument('--names', choices=NAMINGS,
                        help=f'of the joints, for .bvh and .glb alone; default: {NAMINGS[0]}')
    parser.add_argument('--order', choices=EULER_ORDERS, help='of the Euler angles, for .bvh '
                        f'alone; default: {EULER_ORDERS[0]}')


def settle_motion_options(options: argparse.Namespace, kind: str) -> None:
    """Refuse options of skeletons for other outputs; set those that are not given.

    Parameters
    ----------
    options : argparse.Namespace
        With all that `add_motion_options` adds.
    kind : str
        Suffix of the output.

    Raises
    ------
    HandTrackerError
        Naming the output, the option and the outputs that it is for.
    """
    for name, (kinds, usual) in MOTION_OPTIONS.items():
        given = getattr(options, name)
        if given is not None and kind not in kinds:
            raise HandTrackerError(f'{options.output}: --{name}: {given}; expected for outputs '
                                   f'{", ".join(kinds)} only')
        setattr(options, name, given or usual)


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = CommandParser(prog='hand_tracker track', description=main.__doc__)
    add_recording_options(parser, several=True, both=True, located=located)
    parser.add_argument('-o', '--output', type=located, required=True, metavar='OUT',
                        help='table of angles (.csv), recording of /joint_states (.mcap, .db3), '
                        'skeleton in motion (.bvh; .glb: with skin), joint centres (.trc, .c3d), '
                        'of one hand or both (--side both); for several recordings the folder of '
                        'such; also a URL, as s3://...')
    parser.add_argument('--format', choices=[kind[1:] for kind in TRACKED_KINDS],
                        help='of the files in a folder OUT, for one recording too; default: csv')
    parser.add_argument('--jobs', type=_jobs, default=1, metavar='N',
                        help='processes for several recordings; default: 1')
    parser.add_argument('--cluster', default='', metavar='ADDRESS', help='Dask scheduler whose '
                        'workers track several recordings, as tcp://10.0.0.5:8786; they see '
                        'the same files')
    parser.add_argument('--resume', action='store_true',
                        help='leave out recordings whose file in the folder is there, '
                        'made with the same options')
    parser.add_argument('--wrist', action='store_true', help="write the wrist's pose too: as "
                        'columns of the table, or as /tf')
    parser.add_argument('--quality', action='store_true', help='write into the table, too, the '
                        'standard deviation of each angle, and how far each seen marker is off '
                        'the hand')
    add_motion_options(parser)
    return parser.parse_args(args)


@reporting
def main(args: list[str] | None = None) -> int:
    """Track recordings without ROS, and write the angles of every frame with a hand."""
    options = _parse(args)
    return run_command(_track, options)


if __name__ == '__main__':
    sys.exit(main())
