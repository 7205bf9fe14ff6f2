"""Measure how fast motion capture files are read, and with how much memory.

    python -m benchmarks.files [--minutes 60] [--rate 120] [--hands 2] [--json OUT]

Writes the packaged recording over and over as two hands in every format, and reads each file in a
process of its own. `times_real_time` is the length of the recording over the time of reading it,
`peak_mb` all memory of the process, Python and libraries included.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.common import add_json_option, environ, environment, write_rows
from benchmarks.repository import REPOSITORY
from hand_tracker.calibration.hand_axes import with_recognised_axes
from hand_tracker.core.model.hand import SIDES, Hand
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.files.recordings import VICON_CSV, read_recording, write_recording
from hand_tracker.simulation.packaged_recordings import demo_recording

POINT_NAMES = ('Wrist', 'IndexMCP', 'LittleMCP', 'IndexDIP', 'MiddleDIP', 'RingDIP', 'LittleDIP',
               'ThumbTip')
FILES = {'C3D': 'take.c3d', 'TRC': 'take.trc', 'Qualisys TSV': 'take.tsv',
         'OptiTrack CSV': 'take.csv', 'Vicon CSV': 'vicon.csv', 'npz': 'take.npz'}


def long_recording(minutes, rate, hands):
    """Return the packaged recordings of both sides, over and over, as one recording."""
    frames = round(60. * minutes * rate)
    points = np.empty((frames, len(POINT_NAMES) * hands, 3), dtype=np.float32)
    labels = []
    for i, side in enumerate(SIDES[:hands]):
        markers = demo_recording(Hand.scaled(side=side)).markers
        columns = points[:, i * len(POINT_NAMES):(i + 1) * len(POINT_NAMES)]
        for first in range(0, frames, len(markers)):
            columns[first:first + len(markers)] = markers[:frames - first]
        labels += [f'{side[0].upper()}_{name}' for name in POINT_NAMES]
    return PointRecording('long', 'test', tuple(labels), points, rate, None, Axes('m', 'z'))


def read(path):
    """Read a file, and print the row of its figures without its name."""
    start, used = time.monotonic(), time.process_time()
    recording = with_recognised_axes(read_recording(path))
    took, cpu = time.monotonic() - start, time.process_time() - used
    seconds = len(recording.points) / recording.rate
    print(json.dumps({
        'frames': len(recording.points), 'points': len(recording.labels),
        'file_mb': round(path.stat().st_size / 1e6), 'seconds': round(took, 2),
        'cpu_s': round(cpu, 2), 'times_real_time': round(seconds / took),
        'peak_mb': round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.)}))
    return 0


def main():
    """Measure and print."""
    if sys.argv[1:2] == ['--read']:
        return read(Path(sys.argv[2]))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=60., help='length of the recording')
    parser.add_argument('--rate', type=float, default=120., help='frames per second')
    parser.add_argument('--hands', type=int, choices=(1, 2), default=2)
    add_json_option(parser)
    options = parser.parse_args()
    print(environment())
    rows = []
    recording = long_recording(options.minutes, options.rate, options.hands)
    with TemporaryDirectory() as folder:
        for name, file in FILES.items():
            path = Path(folder, file)
            write_recording(path, recording, VICON_CSV if file.startswith('vicon') else None)
            done = subprocess.run(
                [sys.executable, '-m', 'benchmarks.files', '--read', path], cwd=REPOSITORY,
                env=environ(), capture_output=True, text=True, check=True)
            path.unlink()
            rows.append({'format': name, **json.loads(done.stdout)})
            print('{format}: {frames} frames of {points} points ({file_mb} MB) in {seconds} s '
                  '({cpu_s} s of a core), {times_real_time} times real time, at most {peak_mb} MB'
                  .format(**rows[-1]), flush=True)
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
