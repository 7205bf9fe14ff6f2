"""`hand_tracker urdf`: print or write the URDF of a hand."""

import sys
from pathlib import Path

from ..core.model.hand import LIMIT_PRESETS, SIDES
from ..output_files import write_whole_text
from .recording_options import one_side, require_inputs
from .reporting import CommandParser, reporting


@reporting
def main(args: list[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    args : list of str, optional
        Those of the command line when left out.

    Returns
    -------
    int
        Exit code: 0, or 1 if the hand or the file is invalid.
    """
    parser = CommandParser(prog='hand_tracker urdf', description='Write the URDF of a hand.')
    parser.add_argument('--hand', metavar='FILE', help='hand file; the mean hand when left out')
    parser.add_argument('--side', type=one_side, choices=SIDES, help="instead of the hand file's")
    parser.add_argument('--limits', choices=LIMIT_PRESETS, help="instead of the hand file's")
    parser.add_argument('--prefix', default='', help='put before every joint and link')
    parser.add_argument('-o', '--output', metavar='FILE', help='standard output when left out')
    options = parser.parse_args(args)
    require_inputs(options)
    # Here, so that a wrong option is reported at once.
    from ..files.hand_file import choose_hand
    from ..files.urdf_file import urdf

    hand, _ = choose_hand(options.hand, options.side, options.limits)
    text = urdf(hand, options.prefix)
    if options.output:
        write_whole_text(Path(options.output), text)
    else:
        sys.stdout.write(text)
    return 0


if __name__ == '__main__':
    sys.exit(main())
