"""Record a simulated hand: a natural motion, seen by a ring of cameras, with the truth beside.

The hand's markers sit on its skin. --calibration writes the hand file a tracker would be
given: the same hand as a calibration finds it, a little wrong.
"""

import argparse
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..core.errors import HandTrackerError
from ..core.hand import SIDES, Hand
from ..core.layout import MARKERS, MarkerLayout
from ..files.bags import write_bag
from ..files.hand_file import load_hand, save_hand
from .cameras import CAMERAS_RANGE, PAPER_CAMERAS, CameraRig
from .faults import Faults, fault_events, with_faults
from .motions import DURATION, MOTIONS, RATE_RANGE, motion_named
from .recording import DECIMALS, START_NS, Recording, recording_messages
from .sight import look, skin_layout

RATE = 480.             # [Hz] that of the paper's cameras
BLOCK = .5              # [s] simulated at once
LENGTH_ERROR = .02      # [1] standard deviation of a calibrated length
OFFSET_ERROR = .001     # [m] standard deviation of a calibrated marker's place, per axis


class InvalidRate(HandTrackerError, ValueError):
    """The rate is not allowed."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """A hand, how it moves and what sees it.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    hand : Hand
    layout : MarkerLayout
        Where the markers truly are.
    rig : CameraRig
    rate : float
        [Hz]
    seed : int
    duration : float
        At least [s].
    faults : Faults
    """

    motion: str
    hand: Hand = field(default_factory=Hand.scaled)
    layout: MarkerLayout = None
    rig: CameraRig = field(default_factory=CameraRig.ring)
    rate: float = RATE
    seed: int = 1
    duration: float = DURATION
    faults: Faults = Faults()

    def __post_init__(self):
        if not RATE_RANGE[0] <= self.rate <= RATE_RANGE[1]:
            raise InvalidRate(f'rate: {self.rate:g} Hz; allowed is '
                              f'{RATE_RANGE[0]:g} to {RATE_RANGE[1]:g} Hz')
        if self.layout is None:
            object.__setattr__(self, 'layout', skin_layout(self.hand))

    def blocks(self):
        """Yield the recording in parts of half a second.

        Yields
        ------
        Recording
            Of consecutive frames.
        """
        motion = motion_named(self.motion, self.hand, self.seed, self.duration)
        random = np.random.RandomState((self.seed, 1))
        events = fault_events(self.faults, motion.duration, len(MARKERS),
                              np.random.RandomState((self.seed, 2)))
        frames = np.arange(int(np.floor(motion.duration * self.rate)) + 1)
        step = max(1, round(BLOCK * self.rate))
        for first in range(0, len(frames), step):
            part = frames[first:first + step]
            times = part / self.rate
            angles, rotation, position = motion.sample(times)
            noise = random.standard_normal((len(part), len(MARKERS), len(self.rig.positions), 2))
            sight = look(self.rig, self.hand, self.layout, angles, rotation, position, noise)
            markers = with_faults(sight.positions, sight.truth, times, events)
            stamps = START_NS + np.round(part * (1e9 / self.rate)).astype(np.int64)
            yield Recording(stamps, np.round(markers, DECIMALS), np.round(angles, DECIMALS) + 0.)

    def recording(self):
        """Return the whole recording.

        Returns
        -------
        Recording
        """
        return Recording(*map(np.concatenate, zip(*self.blocks())))


def calibrated(hand, layout, seed, length_error=LENGTH_ERROR, offset_error=OFFSET_ERROR):
    """Return hand and layout as a calibration finds them: a little wrong.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    seed : int
    length_error : float
        Standard deviation of each bone and of each coordinate of the palm's joints [1].
    offset_error : float
        Standard deviation of each marker's place on its link, per axis [m].

    Returns
    -------
    hand : Hand
    layout : MarkerLayout
    """
    random = np.random.RandomState((seed, 3))
    fields = {name: getattr(hand, name) * (
        1. + length_error * random.standard_normal(getattr(hand, name).shape))
        for name in ('finger_cmc', 'finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones')}
    offsets = layout.offsets + offset_error * random.standard_normal(layout.offsets.shape)
    return hand.replace(**fields), MarkerLayout(layout.places, offsets)


def worn(path=None, side=None):
    """Return a hand and where its markers are.

    Parameters
    ----------
    path : path-like, optional
        Hand file; the mean hand when left out. Markers without any offset are put on the skin.
    side : {'right', 'left'}, optional

    Returns
    -------
    hand : Hand
    layout : MarkerLayout
    """
    hand, layout = load_hand(path) if path else (Hand.scaled(), MarkerLayout())
    hand = hand.replace(side=side or hand.side)
    if not layout.offsets.any():
        layout = MarkerLayout(layout.places, skin_layout(hand).offsets)
    return hand, layout


def _messages(simulation, count):
    """Yield the messages of a simulation; count frames and lost markers in `count`."""
    for block in simulation.blocks():
        count['frames'] += len(block.stamps)
        count['lost'] += int(np.isnan(block.markers[..., 0]).sum())
        yield from recording_messages(block, simulation.hand.side)
        if sys.stderr.isatty():
            seconds = 1e-9 * (block.stamps[-1] - START_NS)
            print(f'\r{seconds:6.1f} s simulated', end='', file=sys.stderr, flush=True)


def _parse(arguments):
    parser = argparse.ArgumentParser(
        prog='hand_tracker simulate', description=__doc__.split('\n')[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument('motion', choices=tuple(MOTIONS), metavar='MOTION',
                        help=', '.join(MOTIONS))
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='OUT',
                        help='recording to write, .mcap or .db3')
    parser.add_argument('--cameras', type=int, default=PAPER_CAMERAS,
                        help='in the ring, {} to {}'.format(*CAMERAS_RANGE))
    parser.add_argument('--rate', type=float, default=RATE, help='frames per second [Hz]')
    parser.add_argument('--duration', type=float, default=DURATION,
                        help='at least so long [s]; the demo has its own')
    parser.add_argument('--seed', type=int, default=1, help='of all that is drawn')
    parser.add_argument('--hand', type=Path, help='hand file (YAML) of the simulated hand')
    parser.add_argument('--side', choices=SIDES, help='of the hand')
    for kind, what in (('swaps', 'labels of neighbours exchanged'),
                       ('ghosts', 'reflections taken for markers'),
                       ('dropouts', 'labels lost')):
        parser.add_argument(f'--{kind}', type=float, default=0., help=f'{what} [1/s]')
    parser.add_argument('--calibration', type=Path, metavar='HAND.yaml',
                        help='also write the hand as a calibration would find it')
    chosen = parser.parse_args(arguments)
    if chosen.seed < 0:
        parser.error(f'--seed: {chosen.seed} is below 0')
    return parser, chosen


def main(arguments=None):
    """Run the command; return its exit code."""
    parser, chosen = _parse(arguments)
    count = {'frames': 0, 'lost': 0}
    try:
        hand, layout = worn(chosen.hand, chosen.side)
        simulation = Simulation(
            chosen.motion, hand, layout, CameraRig.ring(chosen.cameras), chosen.rate, chosen.seed,
            chosen.duration, Faults(chosen.swaps, chosen.ghosts, chosen.dropouts))
        write_bag(chosen.output, _messages(simulation, count))
        if chosen.calibration:
            save_hand(chosen.calibration, *calibrated(hand, layout, chosen.seed))
    except (HandTrackerError, OSError) as error:
        print(f'{parser.prog}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    if sys.stderr.isatty():
        print(file=sys.stderr)
    share = 100. * count['lost'] / (count['frames'] * len(MARKERS))
    print(f'{chosen.output}: {count["frames"]} frames at {chosen.rate:g} Hz, '
          f'{share:.1f} % of the markers lost')
    return 0


if __name__ == '__main__':
    sys.exit(main())
