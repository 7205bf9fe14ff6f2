"""Count the instructions that a frame costs the core, where times are too noisy.

    python -m benchmarks.instructions [--frames 10000] [--json OUT]

The frames of `benchmarks.core`, markers hidden in half of each second, under valgrind's
cachegrind, compiled for a processor that it knows: what a longer run takes more than a shorter
one, by frame. Starts differ by tens of millions: about a hundredth of what so many frames take.
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
from benchmarks.core import HIDDEN, SEEN_FIRST, frames, measure_all
from hand_tracker.core.model.hand import Hand

COUNTER = 'valgrind', '--tool=cachegrind', '--cache-sim=no', '--trace-children=yes'
# Without the instructions that valgrind has not learned.
PROCESSOR = {'NUMBA_CPU_NAME': 'haswell', 'NUMBA_CPU_FEATURES': '+avx2,+fma,+bmi,+bmi2'}


def track(number, count):
    """Track so many frames after the first ones."""
    hand = Hand.scaled()
    measure_all(frames(SEEN_FIRST + count, HIDDEN[number], hand)[0], hand)


def counted(number, count, cache):
    """Return the instructions of a process that tracks, its kernels kept in `cache`."""
    command = [sys.executable, '-m', 'benchmarks.instructions', '--here', str(number), str(count)]
    # All processes start alike.
    variables = environ(**PROCESSOR, NUMBA_CACHE_DIR=str(cache), PYTHONHASHSEED='0')
    subprocess.run(command, check=True, env=variables)
    output = subprocess.run(
        [*COUNTER, f'--cachegrind-out-file={cache}/%p.out', *command], check=True,
        stderr=subprocess.PIPE, text=True, env=variables).stderr
    counts = re.findall(r'I\s+refs:\s+([\d,]+)', output)
    return max(int(found.replace(',', '')) for found in counts)


def main():
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=10_000)
    add_json_option(parser)
    parser.add_argument('--here', type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        track(*options.here)
        return 0
    if shutil.which(COUNTER[0]) is None:
        raise SystemExit(
            'valgrind is not installed. On Debian and Ubuntu: sudo apt install valgrind')

    print(environment())
    rows = []
    with TemporaryDirectory() as cache:
        none = counted(0, 0, cache)
        for number in HIDDEN:
            more = counted(number, options.frames, cache) - none
            rows.append({'stage': 'all', 'markers_hidden': number,
                         'instructions': round(more / options.frames)})
            print('{markers_hidden} hidden: {instructions} a frame'.format(**rows[-1]))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
