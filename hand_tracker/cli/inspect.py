"""`hand_tracker inspect`: print a recording's contents, and the command to run next."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from .recording_options import (
    add_reading_options,
    add_topic_option,
    add_zeros_option,
    reading_options,
    require_inputs,
)
from .reporting import CommandParser, reporting


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Print a recording's labels, rate, units, gaps and likely layouts."""
    parser = CommandParser(prog='hand_tracker inspect', description=main.__doc__)
    parser.add_argument('recording', type=Path, metavar='FILE')
    parser.add_argument('--json', action='store_true', help='print it as JSON')
    parser.add_argument('--markers', action='append', default=[], metavar='MARKER=LABEL,...',
                        help='which point is which marker, for the command that is printed')
    add_topic_option(parser)
    add_zeros_option(parser)
    add_reading_options(parser)
    options = parser.parse_args(arguments)
    require_inputs(options)
    # Here, so that a wrong option is reported at once.
    from ..calibration.known_layouts import likely_layouts
    from ..calibration.recorded_points import recorded_points
    from ..files.recordings import RecordingError, recordings_at
    from .inspect_recording import summary, summary_lines
    from .next_command import next_command

    inside, _ = recordings_at(options.recording)
    if len(inside) > 1:
        raise RecordingError(f'{options.recording}: a folder with recordings, {len(inside)} in '
                             f'number; expected one of them, as {inside[0]}')
    options.recording, = inside
    recording = recorded_points(options.recording, reading_options(options))
    layouts = likely_layouts(recording)
    found = summary(recording, layouts)
    command = next_command(options.recording, recording, layouts, options)
    if options.json:
        print(json.dumps({**found, 'next': command}, allow_nan=False))
    else:
        print('\n'.join(summary_lines(options.recording, found, command)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
