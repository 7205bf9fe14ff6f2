"""Measure the memory and the speed of `hand_tracker track` on a long recording.

    python -m benchmarks.long_recording [--minutes 60] [--rate 120] [--json OUT]

Tracks ten seconds and then the long recording, each in a process of its own, to a table and
to a recording: memory is flat where both peak alike.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from hand_tracker.core.layout import MARKERS
from hand_tracker.files.bags import bag_message, marker_array_message, write_bag
from hand_tracker.simulation.recording import START_NS, demo_recording

SHORT = 10.  # [s]
OUTPUTS = 'csv', 'mcap'


def record(path, rate, seconds):
    """Write the demo motion, again and again, and return the number of frames."""
    lap = demo_recording(rate=rate).markers
    frames = round(rate * seconds)
    write_bag(path, (bag_message('/markers', stamp, marker_array_message(
        stamp, 'mocap', MARKERS, lap[i % len(lap)]))
        for i, stamp in ((i, START_NS + round(i * 1e9 / rate)) for i in range(frames))))
    return frames


def track(recording, output):
    """Track in this process, and print the peak of its memory [MB] and the time [s]."""
    from hand_tracker.__main__ import main
    start = time.monotonic()
    code = main(['track', str(recording), '-o', str(output)])
    # Linux counts in kB, macOS in bytes.
    unit = 1e6 if sys.platform == 'darwin' else 1e3
    print(json.dumps({'peak_mb': round(resource.getrusage(
        resource.RUSAGE_SELF).ru_maxrss / unit, 1), 'seconds': time.monotonic() - start}))
    return code


def measure(rate, seconds, folder):
    """Return a row for each kind of output."""
    recording = Path(folder, 'markers.mcap')
    recording.unlink(missing_ok=True)
    frames = record(recording, rate, seconds)
    rows = []
    for kind in OUTPUTS:
        output = Path(folder, f'angles.{kind}')
        output.unlink(missing_ok=True)
        done = subprocess.run(
            [sys.executable, '-m', 'benchmarks.long_recording', '--track', recording, output],
            stdout=subprocess.PIPE, text=True, check=True)
        found = json.loads(done.stdout.splitlines()[-1])
        rows.append({'frames': frames, 'rate_hz': rate, 'output': kind,
                     'recording_mb': round(recording.stat().st_size / 1e6, 1),
                     'peak_mb': found['peak_mb'],
                     'frames_per_s': round(frames / found['seconds'])})
    return rows


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=60., help='length of the recording')
    parser.add_argument('--rate', type=float, default=120., help='frames per second')
    parser.add_argument('--json', type=Path, metavar='OUT', help='write the rows here')
    parser.add_argument('--track', nargs=2, type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.track:
        return track(*options.track)
    # Not above: the tracking process would pay for it.
    from hand_tracker.evaluation.results import hardware, versions
    print(*(f'{name} {number}' for name, number in versions().items()), sep=', ')
    print(f'{hardware()}, load {os.getloadavg()[0]:.2f}')
    rows = []
    with TemporaryDirectory() as folder:
        for seconds in (SHORT, 60. * options.minutes):
            rows += measure(options.rate, seconds, folder)
    for row in rows:
        print('{frames} frames ({recording_mb} MB) to {output}: at most {peak_mb} MB of memory, '
              '{frames_per_s} frames a second'.format(**row))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
