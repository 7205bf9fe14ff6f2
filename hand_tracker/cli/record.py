"""`hand_tracker record`: simulate a packaged recording again."""

import sys
from pathlib import Path

from ..core.model.hand import BOTH
from ..package_data import PACKAGED_RECORDINGS
from .reporting import CommandParser, reporting


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Make a packaged recording again."""
    parser = CommandParser(prog='hand_tracker record', description=main.__doc__,
                           epilog='Topics are recorded by `ros2 bag record`.')
    parser.add_argument('--side', choices=tuple(PACKAGED_RECORDINGS), default='right',
                        help='of the hand, or both hands (default: %(default)s)')
    parser.add_argument('-o', '--output', type=Path, metavar='OUT',
                        help='file to write, .mcap or .db3 (default: the packaged one of the '
                        'side, below the current folder)')
    chosen = parser.parse_args(arguments)
    # Here, so that a wrong option is reported at once.
    import numpy as np

    from ..files.bags import write_bag
    from ..simulation.packaged_recordings import (
        RECORDING_RATE,
        both_hands_messages,
        packaged_recordings,
        recording_messages,
    )

    output = chosen.output or Path(PACKAGED_RECORDINGS[chosen.side])
    recordings = packaged_recordings(chosen.side)
    messages = (both_hands_messages(recordings) if chosen.side == BOTH
                else recording_messages(recordings[chosen.side], chosen.side))
    output.parent.mkdir(parents=True, exist_ok=True)
    write_bag(output, messages)
    markers = np.stack([recording.markers for recording in recordings.values()])
    lost = np.isnan(markers).any(axis=3).mean()
    print(f'{output}: {markers.shape[1]} frames at {RECORDING_RATE:g} Hz, '
          f'{100 * lost:.1f} % of the markers lost')
    return 0


if __name__ == '__main__':
    sys.exit(main())
