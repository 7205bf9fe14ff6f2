"""`hand_tracker simulate`: record a simulated hand, seen by a ring of cameras, with the truth."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.model.hand import JOINTS, SIDES
from ..files.written_kinds import TABLE
from ..output_files import require_writable
from ..progress import Progress
from ..simulation.cameras import CAMERAS_RANGE, PAPER_CAMERAS, CameraRig
from ..simulation.motion_names import MOTION_DURATION, MOTION_NAMES, PAPER_RATE
from .recording_options import add_layout_option, one_side, require_inputs
from .reporting import CommandParser, reporting

# What simulates is imported where it is used, so that a wrong option is reported at once.
if TYPE_CHECKING:
    from ..files.bags import BagMessage
    from ..simulation.simulator import Simulation


class _DefaultsHelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Help with the defaults of the options that have one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default is None else super()._get_help_string(action)


def _frames(simulation: Simulation, count: dict[str, int],
            truth: list[tuple[np.ndarray, np.ndarray]]) -> Iterator[tuple[BagMessage, ...]]:
    """Yield the messages of each frame; count frames and lost markers, and note stamps, angles."""
    from ..simulation.simulator import frame_messages

    for part in simulation.blocks():
        count['frames'] += len(part.stamps)
        truth.append((part.stamps, part.angles))
        count['lost'] += int(np.isnan(part.markers[..., 0]).sum())
        yield from frame_messages(
            part, simulation.hand.side, names=simulation.layout.names)


def _parse(arguments: list[str] | None) -> tuple[CommandParser, argparse.Namespace]:
    parser = CommandParser(
        prog='hand_tracker simulate',
        description='Record a simulated hand, seen by a ring of cameras, with the truth.',
        formatter_class=_DefaultsHelpFormatter)
    parser.add_argument('motion', choices=MOTION_NAMES, metavar='MOTION',
                        help=', '.join(MOTION_NAMES))
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='OUT',
                        default=argparse.SUPPRESS,
                        help='recording to write, .mcap or .db3')
    parser.add_argument('--cameras', type=int, default=PAPER_CAMERAS,
                        help='in the ring, {} to {}'.format(*CAMERAS_RANGE))
    parser.add_argument('--rate', type=float, default=PAPER_RATE, help='frames per second [Hz]')
    parser.add_argument('--duration', type=float, default=MOTION_DURATION,
                        help='at least so long, to the end of a movement [s]; the demo has its '
                        'own')
    parser.add_argument('--seed', type=int, default=1,
                        help='of what is drawn: noise, faults of labels, errors of --calibration, '
                        'and the motion, but of demo and of the fingers in range_of_motion, which '
                        'are always the same')
    parser.add_argument('--hand', type=Path, help='hand file (YAML) of the simulated hand')
    parser.add_argument('--side', type=one_side, choices=SIDES, help='of the hand')
    add_layout_option(parser)
    for kind, what in (('swaps', 'labels of neighbours exchanged'),
                       ('ghosts', 'reflections taken for markers'),
                       ('dropouts', 'labels lost'),
                       ('frozen', 'markers repeated where they were')):
        parser.add_argument(f'--{kind}', type=float, default=0., help=f'{what} [1/s]')
    parser.add_argument('--truth', type=Path, metavar='TABLE.csv',
                        help='also write the true angles, in the columns of hand_tracker track')
    parser.add_argument('--calibration', type=Path, metavar='HAND.yaml',
                        help='also write the hand as a calibration would find it, '
                        'with random errors, others for another --seed')
    chosen = parser.parse_args(arguments)
    if chosen.seed < 0:
        parser.error(f'--seed: {chosen.seed} is below 0')
    files = [Path(one).resolve() for one in (
        chosen.output, chosen.truth, chosen.calibration, chosen.hand) if one]
    if len(set(files)) < len(files):
        parser.error('-o, --truth, --calibration and --hand: expected a file each')
    return parser, chosen


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser, chosen = _parse(arguments)
    count = {'frames': 0, 'lost': 0}
    truth: list[tuple[np.ndarray, np.ndarray]] = []
    require_inputs(chosen)
    from ..files.angle_table import write_angle_table
    from ..files.bags import write_bag
    from ..files.hand_file import load_hand, save_hand
    from ..simulation.faults import Faults
    from ..simulation.simulator import Simulation, calibrated, simulated_hand

    hand, layout = simulated_hand(chosen.hand, chosen.side, chosen.layout)
    simulation = Simulation(
        chosen.motion, hand, layout, CameraRig.ring(chosen.cameras), chosen.rate, chosen.seed,
        chosen.duration, Faults(chosen.swaps, chosen.ghosts, chosen.dropouts, chosen.frozen))
    if chosen.truth:
        require_writable(chosen.truth, (TABLE,))
    frames = Progress(simulation.frames, 'frames').over(_frames(simulation, count, truth))
    write_bag(chosen.output, (message for frame in frames for message in frame))
    if chosen.truth:
        first = truth[0][0][0]
        write_angle_table(chosen.truth, [f'{hand.side}_{joint}' for joint in JOINTS], (
            (1e-9 * (stamp - first), angles, ())
            for stamps, block in truth for stamp, angles in zip(stamps, block)))
    if chosen.calibration:
        save_hand(chosen.calibration, *calibrated(hand, layout, chosen.seed))
    share = 100. * count['lost'] / (count['frames'] * len(layout.names))
    print(f'{chosen.output}: {count["frames"]} frames at {chosen.rate:g} Hz, '
          f'{share:.1f} % of the markers lost')
    worn_by = chosen.calibration
    if worn_by is None and chosen.hand:
        own, worn = load_hand(chosen.hand)
        # With all markers where the hand file has them.
        if own.side == hand.side and np.array_equal(worn.offsets, layout.offsets):
            worn_by = chosen.hand
    print('Its markers are on the skin: track it with --hand '
          + (shlex.quote(str(worn_by)) if worn_by
             else 'HAND.yaml, which --calibration HAND.yaml writes'))
    return 0


if __name__ == '__main__':
    sys.exit(main())
