"""`hand_tracker plot`: track a recording and plot the angles of each digit over time."""

import argparse
import sys
from pathlib import Path

from ..parallel import Interruptions
from .recording_options import add_recording_options, run_command
from .reporting import CommandParser, reporting


def _plot_file(options: argparse.Namespace, interrupted: Interruptions) -> str:
    """Track and plot the recording; return a closing message."""
    # Here, so that a wrong option is reported at once.
    from ..drawing.angle_plots import PDF, require_output, save_pages, tracked_angles
    from .tracking_job import tracking_job

    output = require_output(options.output or Path(options.recording.stem + PDF))
    with tracking_job(options, interrupted) as job:
        (side, hand), = job.hands().items()
        tracked = tracked_angles((1e-9 * frames[side].time, frames[side].state)
                                 for frames in job.frames())
    title = f'{options.recording.name}, {side} hand'
    names = save_pages(output, tracked, hand, title, job.layout)
    pictures = '' if len(names) == 1 else f'{len(names)} pictures, one of each digit: '
    return (f'{pictures}{", ".join(map(str, names))}: '
            f'{job.tracked} of {job.read} frames tracked')


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = CommandParser(prog='hand_tracker plot', description=main.__doc__)
    add_recording_options(parser)
    parser.add_argument('-o', '--output', type=Path, metavar='OUT',
                        help='.pdf with a page for each digit, .png for a picture of each '
                        "(OUT_index.png, ...) or a folder for them; default: the recording's "
                        'name with .pdf')
    return parser.parse_args(args)


@reporting
def main(args: list[str] | None = None) -> int:
    """Track a recording without ROS, and plot the angles of each digit over time."""
    return run_command(_plot_file, _parse(args))


if __name__ == '__main__':
    sys.exit(main())
