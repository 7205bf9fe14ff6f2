"""Count the instructions that a frame costs the core, where times are too noisy.

    python -m benchmarks.instructions [--frames 10000] [--layouts NAME ...] [--json OUT]

The frames of `benchmarks.core`, markers hidden in half of each second, or with --layouts those of
`benchmarks.layouts`, all markers seen, under valgrind's cachegrind, compiled for a processor that
it knows: what a run that tracks all frames takes more than one that tracks the first of them, by
frame. Starts differ by tens of millions, several hundredths of what so many frames take: of each
run the least of three counts.
"""

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import add_json_option, environ, environment, write_rows
from benchmarks.core import HIDDEN, SEEN_FIRST, frames
from benchmarks.layouts import layout_frames
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.layout_presets import LAYOUT_PRESETS, preset_layout
from hand_tracker.core.tracker import HandTracker

RUNS = 3
COUNTER = 'valgrind', '--tool=cachegrind', '--cache-sim=no', '--trace-children=yes'
# Without the instructions that valgrind has not learned.
PROCESSOR = {'NUMBA_CPU_NAME': 'haswell', 'NUMBA_CPU_FEATURES': '+avx2,+fma,+bmi,+bmi2'}


def track(what, count, made):
    """Track so many of the frames made, of a layout or with so many markers hidden."""
    hand = Hand.scaled()
    if what in LAYOUT_PRESETS:
        tracker = HandTracker(hand, preset_layout(what))
        markers = layout_frames(what, made, hand)
    else:
        tracker = HandTracker(hand)
        markers, _ = frames(made, HIDDEN[int(what)], hand)
    for frame in markers[:count]:
        tracker.update(frame)


def counted(what, count, made, cache):
    """Return the least instructions of a process that tracks, its kernels kept in `cache`."""
    command = [sys.executable, '-m', 'benchmarks.instructions', '--here',
               *map(str, (what, count, made))]
    # All processes start alike.
    variables = environ(**PROCESSOR, NUMBA_CACHE_DIR=str(cache), PYTHONHASHSEED='0')
    subprocess.run(command, check=True, env=variables)
    totals = []
    for _ in range(RUNS):
        output = subprocess.run(
            [*COUNTER, f'--cachegrind-out-file={cache}/%p.out', *command], check=True,
            stderr=subprocess.PIPE, text=True, env=variables).stderr
        counts = re.findall(r'I\s+refs:\s+([\d,]+)', output)
        totals.append(max(int(found.replace(',', '')) for found in counts))
    return min(totals)


def main():
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=10_000)
    add_json_option(parser)
    parser.add_argument('--layouts', nargs='+', choices=tuple(LAYOUT_PRESETS), default=(),
                        metavar='NAME', help='in place of the markers hidden')
    parser.add_argument('--here', nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        track(options.here[0], *map(int, options.here[1:]))
        return 0
    if shutil.which(COUNTER[0]) is None:
        raise SystemExit(
            'valgrind is not installed. On Debian and Ubuntu: sudo apt install valgrind')

    print(environment())
    rows = []
    with TemporaryDirectory() as cache:
        for what in options.layouts or HIDDEN:
            # Both make all frames: what that takes is not counted.
            made = SEEN_FIRST + options.frames
            more = counted(what, made, made, cache) - counted(what, SEEN_FIRST, made, cache)
            rows.append({'stage': 'all', 'layout' if options.layouts else 'markers_hidden': what,
                         'instructions': round(more / options.frames)})
            print(f'{what}' + ('' if options.layouts else ' hidden')
                  + f': {rows[-1]["instructions"]} a frame', flush=True)
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
