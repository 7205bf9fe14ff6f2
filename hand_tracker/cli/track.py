"""`hand_tracker track`: track recordings without ROS; write a table or a recording of angles."""

from __future__ import annotations

import argparse
import sys

from ..files.remote_files import located
from ..files.written_kinds import EULER_ORDERS, NAMINGS, TRACKED_KINDS
from ..parallel import Interruptions
from .recording_options import add_recording_options, run_command


def _track(options: argparse.Namespace, interrupted: Interruptions) -> str:
    # Here, so that a wrong option is reported at once.
    from .track_recordings import track_recordings

    return track_recordings(options, interrupted)


def _jobs(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number from 1 on")
    return int(text)


def add_motion_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command line that writes skeletons in motion."""
    parser.add_argument('--names', choices=NAMINGS, default=NAMINGS[0],
                        help='of the joints of .bvh and .glb; default: %(default)s')
    parser.add_argument('--order', choices=EULER_ORDERS, default=EULER_ORDERS[0],
                        help='of the Euler angles of .bvh; default: %(default)s')


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='hand_tracker track', description=main.__doc__)
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
                        help='leave out recordings whose file in the folder is there')
    parser.add_argument('--wrist', action='store_true', help="write the wrist's pose too: as "
                        'columns of the table, or as /tf')
    add_motion_options(parser)
    return parser.parse_args(args)


def main(args: list[str] | None = None) -> int:
    """Track recordings without ROS, and write the angles of every frame."""
    options = _parse(args)
    return run_command('hand_tracker track', _track, options)


if __name__ == '__main__':
    sys.exit(main())
