"""Read mutated motion capture files: each must end in a clear message or in a sound recording.

    python -m benchmarks.fuzz_files [--count 10000] [--seed 1] [--jobs 2] [--formats c3d trc ...]
                                    [--files FOLDER] [--json OUT]

The files are those that this package writes of a moving hand, and the small ones of a folder. Of
each format as many are mutated: cut, with bytes changed, taken out, doubled and put elsewhere, and
with numbers and words of headers replaced by extreme ones; of npz files mostly the arrays in them.
A fault is any exception but those that the package raises for its input, any warning, a message
that does not name the file, a recording that is not sound, more than `--seconds` of processor time
for a file, or more than `--megabytes` of memory in all. `--case FORMAT NUMBER` makes one case
again, and keeps its file.
"""

import argparse
import os
import re
import resource
import sys
import time
import traceback
import warnings
from concurrent.futures import ProcessPoolExecutor
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import numpy as np

from benchmarks.common import add_json_option, environment, write_rows
from hand_tracker.calibration.hand_axes import with_recognised_axes
from hand_tracker.calibration.known_layouts import likely_layouts
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import Hand
from hand_tracker.files.bvh_file import write_bvh
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.files.recordings import (
    BAG_STARTS,
    FORMATS,
    VICON_CSV,
    ReadingOptions,
    read_recording,
    write_recording,
)
from hand_tracker.files.skeleton_motion import HandAngles, skeleton_motion
from hand_tracker.simulation.packaged_recordings import demo_recording

FUZZED_FRAMES = 24
LARGEST_SEED = 2**17      # [bytes] of files of a folder
FUZZED_NAMES = ('wrist', 'index_mcp', 'little_mcp', 'index_dip', 'middle_dip', 'ring_dip',
                'little_dip', 'thumb_tip')
EXTREMES = (b'0', b'-1', b'1', b'255', b'65535', b'65536', b'4294967295', b'99999999999', b'1e308',
            b'nan', b'inf', b'-', b'', b'\xff', b'\0', b'1_0', b'0x10', b'{', b'}', b'\n', b'\t',
            b',', b'"', b'\r\n\r\n')
KINDS = ('c3d', 'trc', 'tsv', 'optitrack', 'vicon', 'bvh', 'npz', 'mcap', 'db3')
BAG_START_OF = dict(zip(('mcap', 'db3'), BAG_STARTS))
SUFFIX_OF = {'optitrack': '.csv', 'vicon': '.csv'}
CASES_AT_ONCE = 250
REPACKED_SHARE = .8       # of npz files


def seeds(kind, folder, files):
    """Return the contents of whole files of a format.

    Parameters
    ----------
    kind : str
        Of `KINDS`.
    folder : Path
        To write into.
    files : Path or None
        Folder with more files.

    Returns
    -------
    list of bytes
    """
    recorded = demo_recording()
    labels = tuple(f'Anna:R_{name}' for name in FUZZED_NAMES)
    recording = PointRecording('hand', 'seed', labels, recorded.markers[:FUZZED_FRAMES].astype(
        np.float32), 120., None, Axes('m', 'z'))
    unnamed = recording._replace(labels=(*labels[:4], '', '', '', ''))
    path = folder / f'seed{SUFFIX_OF.get(kind, "." + kind)}'
    found = []
    if kind == 'bvh':
        for order in ('ZXY', 'XYZ'):
            write_bvh(path, skeleton_motion(HandAngles(
                Hand.scaled(), recorded.angles[:FUZZED_FRAMES], np.zeros((FUZZED_FRAMES, 3)),
                np.tile(np.eye(3), (FUZZED_FRAMES, 1, 1)), np.arange(FUZZED_FRAMES) / 120.)), order)
            found.append(path.read_bytes())
    else:
        for one in (recording, unnamed):
            write_recording(path, one, VICON_CSV if kind == 'vicon' else None)
            found.append(path.read_bytes())
    starts = BAG_START_OF.get(kind)
    is_like = (lambda head: head.startswith(starts)) if starts else next(
        one for one in FORMATS if one.name.lower().startswith(
            {'tsv': 'qualisys'}.get(kind, kind))).is_like
    for other in sorted(files.rglob('*')) if files else ():
        if other.is_file() and other.stat().st_size <= LARGEST_SEED:
            content = other.read_bytes()
            if is_like(content[:4096]):
                found.append(content)
    return found


def mutated(content, others, random):
    """Return a mutated copy of a file's content.

    Parameters
    ----------
    content : bytes
    others : list of bytes
        Parts of these may be put into it.
    random : numpy.random.Generator

    Returns
    -------
    bytes
    """
    data = bytearray(content)
    for _ in range(random.integers(1, 5)):
        if not data:
            break
        # Headers are hit as often as all the rest.
        size = len(data) if random.random() < .5 else min(len(data), 1500)
        at = int(random.integers(size))
        length = int(min(2 ** random.integers(0, 11), len(data) - at))
        choice = int(random.integers(9))
        if choice == 0:
            del data[at:]
        elif choice == 1:
            data[at] = int(random.integers(256))
        elif choice == 2:
            data[at] ^= 1 << int(random.integers(8))
        elif choice == 3:
            del data[at:at + length]
        elif choice == 4:
            data[at:at] = data[at:at + length]
        elif choice == 5:
            data[at:at + length] = random.bytes(length)
        elif choice == 6:
            other = others[int(random.integers(len(others)))]
            start = int(random.integers(max(len(other), 1)))
            data[at:at + length] = other[start:start + length]
        elif choice == 7:
            words = list(re.finditer(rb'[-+.\w]+', bytes(data[:size])))
            if words:
                word = words[int(random.integers(len(words)))]
                data[word.start():word.end()] = EXTREMES[int(random.integers(len(EXTREMES)))]
        else:
            value = random.choice([0, 1, 0x7fff, 0x8000, 0xffff]).item()
            data[at:at + 2] = value.to_bytes(2, 'little')
    return bytes(data)


def repacked(content, random):
    """Return a copy of an npz file in which an array is mutated, with a right CRC.

    Parameters
    ----------
    content : bytes
    random : numpy.random.Generator

    Returns
    -------
    bytes
    """
    with ZipFile(BytesIO(content)) as archive:
        arrays = {name: archive.read(name) for name in archive.namelist()}
    hit = list(arrays)[int(random.integers(len(arrays)))]
    arrays[hit] = mutated(arrays[hit], list(arrays.values()), random)
    packed = BytesIO()
    with ZipFile(packed, 'w') as archive:
        for name, array in arrays.items():
            archive.writestr(name, array)
    return packed.getvalue()


def require_sound(recording):
    """Raise AssertionError where a recording is not what its docstring says."""
    frames, count, three = recording.points.shape
    assert frames > 0 and three == 3 and count == len(recording.labels), recording.points.shape
    named = [label for label in recording.labels if label]
    assert len(set(named)) == len(named), 'labels that are repeated'
    assert all(label.isprintable() for label in named), 'labels that cannot be printed'
    assert not np.isinf(recording.points).any(), 'infinite points'
    partly = np.isnan(recording.points).any(axis=2) & ~np.isnan(recording.points).all(axis=2)
    assert not partly.any(), 'points with a missing coordinate'
    assert np.isnan(recording.rate) or recording.rate > 0., recording.rate
    assert recording.stamps is None or len(recording.stamps) == frames


def case(kind, number, seed, contents):
    """Return the content of a case and how it is read."""
    random = np.random.default_rng((seed, KINDS.index(kind), number))
    content = contents[int(random.integers(len(contents)))]
    if kind == 'npz' and random.random() < REPACKED_SHARE:
        content = repacked(content, random)
    else:
        content = mutated(content, contents, random)
    return content, ReadingOptions(partial=bool(random.integers(2)))


def run_cases(job):
    """Run some cases; return how they ended, by word, the faults, and the slowest [s].

    Parameters
    ----------
    job : tuple
        Format, first number, count, seed, contents, limit of a case [s].
    """
    kind, first, count, seed, contents, limit = job
    warnings.simplefilter('error')
    ends, faults, slowest = {'refused': 0, 'read': 0}, [], 0.
    with TemporaryDirectory(dir='/dev/shm' if os.path.isdir('/dev/shm') else None) as folder:
        path = Path(folder, f'case{SUFFIX_OF.get(kind, "." + kind)}')
        for number in range(first, first + count):
            content, options = case(kind, number, seed, contents)
            path.write_bytes(content)
            start = time.process_time()   # beside other work a case may wait for long
            try:
                recording = with_recognised_axes(read_recording(path, options))
                likely_layouts(recording)
                require_sound(recording)
                ends['read'] += 1
            except HandTrackerError as error:
                ends['refused'] += 1
                if path.name not in str(error) or len(str(error)) > 2000:
                    faults.append((kind, number, f'message: {str(error)[:200]}'))
            except BaseException:
                faults.append((kind, number, traceback.format_exc(limit=-3)))
            took = time.process_time() - start
            slowest = max(slowest, took)
            if took > limit:
                faults.append((kind, number, f'{took:.1f} s'))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.
    return kind, ends, faults, slowest, peak


def main():
    """Run the cases, print how they ended; return 1 where there is a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--count', type=int, default=10000, help='cases of each format')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--jobs', type=int, default=2, help='processes')
    parser.add_argument('--formats', nargs='+', choices=KINDS, default=KINDS)
    parser.add_argument('--files', type=Path, help='folder with more files to mutate')
    parser.add_argument('--seconds', type=float, default=5., help='of processor time for a case')
    parser.add_argument('--megabytes', type=float, default=600., help='that a process may take')
    parser.add_argument('--case', nargs=2, metavar=('FORMAT', 'NUMBER'), help='only this one')
    add_json_option(parser)
    options = parser.parse_args()
    print(environment())
    with TemporaryDirectory() as folder:
        contents = {kind: seeds(kind, Path(folder), options.files) for kind in options.formats}
    if options.case:
        kind, number = options.case[0], int(options.case[1])
        content, reading = case(kind, number, options.seed, contents[kind])
        path = Path(f'case{SUFFIX_OF.get(kind, "." + kind)}')
        path.write_bytes(content)
        print(path, reading)
        print(with_recognised_axes(read_recording(path, reading)))
        return 0
    jobs = [(kind, first, min(CASES_AT_ONCE, options.count - first), options.seed,
             contents[kind], options.seconds)
            for kind in options.formats for first in range(0, options.count, CASES_AT_ONCE)]
    rows = {kind: {'format': kind, 'seeds': len(contents[kind]), 'cases': 0, 'refused': 0,
                   'read': 0, 'faults': 0, 'slowest_s': 0., 'peak_mb': 0.}
            for kind in options.formats}
    shown = 0
    with ProcessPoolExecutor(options.jobs) as pool:
        for kind, ends, faults, slowest, peak in pool.map(run_cases, jobs):
            row = rows[kind]
            if peak > options.megabytes:
                faults.append((kind, -1, f'{peak:.0f} MB of memory'))
            row['cases'] += sum(ends.values())
            row['refused'] += ends['refused']
            row['read'] += ends['read']
            row['faults'] += len(faults)
            row['slowest_s'] = round(max(row['slowest_s'], slowest), 3)
            row['peak_mb'] = round(max(row['peak_mb'], peak))
            for fault in faults:
                shown += 1
                if shown <= 20:
                    print('FAULT {}, case {}: {}'.format(*fault), flush=True)
    for row in rows.values():
        print('{format}: {cases} cases of {seeds} files: {refused} refused, {read} read, {faults} '
              'faults; the slowest {slowest_s} s, at most {peak_mb} MB'.format(**row))
    write_rows(options.json, list(rows.values()))
    return int(any(row['faults'] for row in rows.values()))


if __name__ == '__main__':
    sys.exit(main())
