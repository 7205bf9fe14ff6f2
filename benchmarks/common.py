"""Parts shared by the benchmarks: environment, output of rows, stamps of serialized messages."""

import argparse
import json
import os
import subprocess

from benchmarks.repository import REPOSITORY
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.evaluation.results import hardware, versions

MARK = 0x1a5a5a5a    # placeholder for seconds and nanoseconds of a stamp; below 1e9
RATE = 120.          # [Hz] of the frames
END_TIME = 20.       # [s] in which a node ends


def environment(**more):
    """Return versions, hardware and load as lines of text.

    Parameters
    ----------
    **more : str
        Versions of other measured packages, by name.
    """
    made = ', '.join(f'{name} {number}' for name, number in {**versions(), **more}.items())
    return (f"{made}; kernels {'compiled' if COMPILED else 'in plain Python'}\n"
            f'{hardware()}, load {os.getloadavg()[0]:.2f}')


def environ(**more):
    """Return the environment variables of a process that imports this package."""
    paths = str(REPOSITORY), *filter(None, [os.environ.get('PYTHONPATH')])
    # Empty is unset: byte code is kept, as by default; compiling it anew would count as work.
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(paths), 'PYTHONDONTWRITEBYTECODE': '',
            **more}


def end(process):
    """End a process; kill it where it has missed the signal, as a node of rclpy may."""
    process.terminate()
    try:
        process.wait(END_TIME)
    except subprocess.TimeoutExpired:
        process.kill()


def add_json_option(parser):
    """Add the option --json, a file for the rows, to a command line."""
    parser.add_argument('--json', metavar='OUT', help='write the rows here')


def add_timing_options(parser, rates):
    """Add --rates, with their defaults, and --seconds of each measurement to a command line."""
    parser.add_argument('--rates', type=float, nargs='+', default=rates, help='frames per second')
    parser.add_argument('--seconds', type=float, default=5., help='of each measurement')


def write_rows(path, rows):
    """Write rows as a JSON list; nothing if the path is None.

    Parameters
    ----------
    path : str or None
    rows : list of dict
    """
    if path:
        with open(path, 'w', encoding='utf-8') as file:
            json.dump(rows, file, indent=1)
            file.write('\n')


def print_measured(doc, measure, line):
    """Measure as many frames as the command line says, print and write the rows; return 0.

    Parameters
    ----------
    doc : str
        Docstring of the benchmark.
    measure : callable
        Takes the count of frames, returns a list of rows.
    line : str
        Format of a row that is printed.
    """
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument('--frames', type=int, default=3000)
    add_json_option(parser)
    options = parser.parse_args()
    print(environment())
    rows = measure(options.frames)
    for row in rows:
        print(line.format(**row))
    write_rows(options.json, rows)
    return 0


def stamp_places(data):
    """Return the byte offsets of stamps of value `MARK` in a serialized message."""
    places, mark = [], 2 * MARK.to_bytes(4, 'little')
    at = data.find(mark)
    while at >= 0:
        places.append(at)
        at = data.find(mark, at + len(mark))
    return places


def put_stamps(data, places, time):
    """Write a time [ns] at the stamps of a serialized message; return the stamp's bytes."""
    seconds, nanoseconds = divmod(time, 10**9)
    stamp = seconds.to_bytes(4, 'little') + nanoseconds.to_bytes(4, 'little')
    for at in places:
        data[at:at + len(stamp)] = stamp
    return stamp
