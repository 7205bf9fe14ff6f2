"""Measure the speed and the memory of `hand_tracker track`.

    python -m benchmarks.offline [--minutes 60] [--rate 120] [--many 8] [--jobs 2] [--json OUT]

Tracks ten seconds and then the long recording, each in a process of its own, to a table and to
a recording: equal peaks mean that memory does not grow. Then tracks the same minutes as many
recordings in parallel. `frames_per_s` is per second of wall time, `frames_per_s_core` per second
of processor time, which depends less on other load; both include start-up.
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

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import (
    MARK,
    add_json_option,
    environ,
    environment,
    put_stamps,
    stamp_places,
    write_rows,
)

SHORT = 10.  # [s]
OUTPUT_SUFFIXES = 'csv', 'mcap'


def record(path, rate, seconds):
    """Write a recording of the repeated demo motion; return the number of frames."""
    # Imported here: else the tracking process would load them too.
    from hand_tracker.core.model.marker_layout import MARKERS
    from hand_tracker.files.bags import bag_message, marker_array_message, write_bag
    from hand_tracker.simulation.packaged_recordings import RECORDING_START_NS, demo_recording
    mark = MARK * 10**9 + MARK
    frames = round(rate * seconds)
    lap = [bytearray(bag_message('/markers', 0, marker_array_message(
        mark, 'mocap', MARKERS, markers)).data)
        for markers in demo_recording(rate=rate).markers[:frames]]
    places = list(map(stamp_places, lap))
    first = bag_message('/markers', 0, marker_array_message(0, '', (), []))

    def messages():
        for i in range(frames):
            stamp, at = RECORDING_START_NS + round(i * 1e9 / rate), i % len(lap)
            put_stamps(lap[at], places[at], stamp)
            yield first._replace(time=stamp, data=bytes(lap[at]))

    write_bag(path, messages())
    return frames


def track(arguments):
    """Track in this process; print peak memory [MB] and time [s] as JSON."""
    start = time.monotonic()
    from hand_tracker.__main__ import main
    code = main(['track', *arguments])
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    # Linux counts in kB, macOS in bytes.
    unit = 1e6 if sys.platform == 'darwin' else 1e3
    print(json.dumps({
        'peak_mb': round(max(part.ru_maxrss for part in used) / unit, 1),
        'seconds': round(time.monotonic() - start, 2)}))
    return code


def _cpu_seconds():
    """Return the processor time of all ended child processes [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(recordings, frames, output, jobs=1):
    """Return the row of a process that tracks recordings of `frames` frames in total."""
    before = _cpu_seconds()
    done = subprocess.run(
        [sys.executable, __file__, '--track', *map(str, recordings), '-o', str(output),
         '--jobs', str(jobs)], env=environ(), stdout=subprocess.PIPE, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    found['cpu_seconds'] = round(_cpu_seconds() - before, 2)
    return {'recordings': len(recordings), 'jobs': jobs, 'output': output.suffix[1:] or 'csv',
            'frames': frames,
            'recording_mb': round(sum(path.stat().st_size for path in recordings) / 1e6, 1),
            **found,
            'frames_per_s': round(frames / found['seconds']),
            'frames_per_s_core': round(frames / found['cpu_seconds'])}


def measure_one(rate, seconds, folder, outputs=OUTPUT_SUFFIXES):
    """Yield the rows of one recording, for each kind of output."""
    recording = Path(folder, 'markers.mcap')
    frames = record(recording, rate, seconds)
    for kind in outputs:
        yield measure([recording], frames, Path(folder, f'angles.{kind}'))


def measure_many(rate, seconds, count, jobs, folder):
    """Return the row of `count` recordings of `seconds` [s] in total, tracked in parallel."""
    recordings = [Path(folder, f'part_{i}.mcap') for i in range(count)]
    frames = record(recordings[0], rate, seconds / count)
    for recording in recordings[1:]:
        recording.write_bytes(recordings[0].read_bytes())
    return measure(recordings, count * frames, Path(folder, 'angles'), jobs)


def say(row):
    """Print a row."""
    print('{frames} frames in {recordings} recordings ({recording_mb} MB) to {output}, processes: '
          '{jobs}: {frames_per_s} a second, {frames_per_s_core} a second of a core, at most '
          '{peak_mb} MB of memory'.format(**row), flush=True)


def main():
    """Measure and print."""
    if sys.argv[1:2] == ['--track']:
        return track(sys.argv[2:])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=60., help='length of the recording')
    parser.add_argument('--rate', type=float, default=120., help='frames per second')
    parser.add_argument('--many', type=int, default=8, help='recordings side by side, at least 2')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='processes for them')
    add_json_option(parser)
    options = parser.parse_args()
    print(environment())
    rows = []
    seconds = 60. * options.minutes
    with TemporaryDirectory() as folder:
        for length in (min(SHORT, seconds), seconds):
            for row in measure_one(options.rate, length, folder):
                rows.append(row)
                say(row)
        rows.append(measure_many(
            options.rate, seconds, max(options.many, 2), options.jobs, folder))
        say(rows[-1])
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
