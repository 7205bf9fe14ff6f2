"""`hand_tracker demo`: replay and tracker as processes, listened to over ROS topics.

Both nodes run as they do for a user; this program only listens, and leaves what it received
as an animated GIF, a contact sheet and a table of the angles.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..interruption import ended_by_interrupt
from ..viewer.page_options import add_page_options
from .recording_options import (
    add_hand_options,
    add_labels_option,
    add_layout_option,
    add_reading_options,
    require_inputs,
)
from .reporting import CommandParser, reporting


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = CommandParser(prog='hand_tracker demo', description=__doc__.split('\n')[0])
    parser.add_argument('--recording', type=Path,
                        help='recording to play: rosbag2 with markers of ids from 0 on /markers, '
                        'those of both hands in namespaces right and left; or with '
                        'names: rosbag2 of mocap4r2 or landmarks, C3D, TRC, TSV, CSV, BVH, npz '
                        '(default: the packaged one of the side)')
    add_hand_options(parser, both=True)
    add_layout_option(parser)
    add_labels_option(parser)
    parser.add_argument('--markers', action='append', default=[], metavar='MARKER=LABEL,...',
                        help='which point of a file is which marker')
    add_reading_options(parser)
    parser.add_argument('--rate', type=float, default=1., help='speed of the replay (default: 1)')
    parser.add_argument('-o', '--output', type=Path, default=Path('demo_output'),
                        help='folder for the pictures and the table (default: demo_output)')
    parser.add_argument('--grasp', action='store_true',
                        help='instead of a recording, a hand that grasps a ball: the plain robot '
                        'hand follows it in MuJoCo (pip install mujoco)')
    parser.add_argument('--anonymous', action='store_true',
                        help='take the labels off the markers, which then come back under other '
                        'ids: the tracker finds the hand, or both, among the points')
    parser.add_argument('--view', action='store_true',
                        help='instead of all that, show the hand in the browser')
    add_page_options(parser)
    return parser.parse_args(args)


@reporting
def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit code."""
    options = _parse(args)
    require_inputs(options)
    # With all that reads and tracks, for which a wrong option need not wait.
    with ended_by_interrupt():
        from .demo_hands import demonstrate
    demonstrate(options)
    return 0


if __name__ == '__main__':
    sys.exit(main())
