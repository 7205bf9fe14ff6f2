"""Look for bytes from outside that break an entry, guided by the coverage of the code (atheris).

    python -m benchmarks.fuzz_inputs ENTRY [--seconds 600] [--corpus FOLDER] [--found FOLDER]
                                     [--keep] [--json OUT]

An entry is a key of `benchmarks.input_entries.ENTRIES`. What is mutated comes from `--corpus`,
test/corpus/ENTRY when left out. A fault is any exception, any warning, more than `--timeout` for an
input, or more than `--megabytes` of memory in all: it ends the run with exit code 1, and its input
is kept in the folder of `--found`. With `--keep` the smallest inputs that add coverage go into the
corpus, `KEPT_FILES` and `KEPT_BYTES` at most; faults are to be copied there by hand.
`test/package/test_corpus.py` replays it.

It needs requirements/fuzz.txt besides those of the tests. Kernels run as plain Python, where
coverage can see them.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from shutil import copy, copytree
from tempfile import TemporaryDirectory

CORPUS = Path(__file__).resolve().parent.parent / 'test' / 'corpus'
# Packages whose coverage guides.
COVERED = ['hand_tracker', 'rosbags', 'yaml', 'qtm_rt', 'websockets', 'trimesh.exchange']
# What changes what follows in a YAML or XML, or is no number to Python.
WORDS = (b'&a ', b'*a', b'<<: ', b'!!int ', b'!!float ', b'!!bool ', b'!!timestamp ', b'!!set ',
         b'? ', b'- ', b'2001-99-99', b'0x_', b'1e999', b'.nan', b'.inf', b'"\\0"',
         b'"\\UFFFFFFFF"', b'%YAML 9', b'---', b'[[[[[[[[', b'{{{{', b'~nobody/', b'<!DOCTYPE a [',
         b'<!ENTITY a "b">', b'&a;', b'<![CDATA[', b'encoding="x"', b'99999999999999999999',
         b'\xff\xff\xff\xff', b'\0\0\0\0')
KEPT_FILES = 12            # at most, that a run adds to an entry's corpus
KEPT_BYTES = 9000          # of an entry's corpus
FUZZING = '--fuzzing'      # the process that does it, which ends as libFuzzer wants


def fuzz(entry, arguments):
    """Fuzz an entry in this process, with arguments of libFuzzer; it ends the process."""
    import atheris
    with atheris.instrument_imports(include=COVERED, enable_loader_override=False):
        from benchmarks.input_entries import give
    command = [sys.executable, '-m', 'benchmarks.fuzz_inputs', FUZZING, entry]
    # When it merges, libFuzzer starts itself by this line.
    atheris.Setup([shlex.join(command), *arguments], lambda data: give(entry, data))
    atheris.Fuzz()


def run(entry, *arguments):
    """Run libFuzzer on an entry; return its exit code, and what it printed."""
    from benchmarks.common import environ
    process = subprocess.Popen(
        [sys.executable, '-m', 'benchmarks.fuzz_inputs', FUZZING, entry, *map(str, arguments)],
        env=environ(HAND_TRACKER_JIT='0'), stderr=subprocess.STDOUT,
        stdout=subprocess.PIPE, text=True, errors='replace')
    said = []
    for line in process.stdout:
        said.append(line)
        if not line.startswith('#') or 'pulse' in line:
            print(line, end='', flush=True)
    return process.wait(), ''.join(said)


def numbers(name, text):
    """Return the numbers after a name in what libFuzzer printed."""
    return [int(number) for number in re.findall(rf'{name}:? +(\d+)', text)]


def keep(entry, corpus, found):
    """Put the smallest inputs that add coverage into the corpus."""
    with TemporaryDirectory() as folder:
        merged = Path(copytree(corpus, Path(folder, 'merged')))
        run(entry, '-merge=1', '-set_cover_merge=1', merged, found)
        known = {path.name for path in corpus.iterdir()}
        total = sum(path.stat().st_size for path in corpus.iterdir())
        added = sorted((path.stat().st_size, path) for path in merged.iterdir()
                       if path.name not in known)
        for size, path in added[:KEPT_FILES]:
            total += size
            if total <= KEPT_BYTES:
                copy(path, corpus)


def main():
    """Fuzz an entry; return 1 where there is a fault."""
    if sys.argv[1:2] == [FUZZING]:
        fuzz(sys.argv[2], sys.argv[3:])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('entry')
    parser.add_argument('--seconds', type=int, default=600)
    parser.add_argument('--corpus', type=Path, help='folder of inputs; default: test/corpus/ENTRY')
    parser.add_argument('--found', type=Path, help='folder for inputs that are found')
    parser.add_argument('--keep', action='store_true', help='add to the corpus what adds coverage')
    parser.add_argument('--timeout', type=int, default=20, help='seconds that an input may take')
    parser.add_argument('--megabytes', type=int, default=1000, help='that the process may take')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--json', metavar='OUT', help='write the row here')
    options = parser.parse_args()
    os.environ['HAND_TRACKER_JIT'] = '0'
    from benchmarks.common import environment, write_rows
    from benchmarks.input_entries import ENTRIES
    if options.entry not in ENTRIES:
        parser.error(f"'{options.entry}'; expected one of {', '.join(ENTRIES)}")
    print(environment())
    corpus = options.corpus or CORPUS / options.entry
    corpus.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as scratch:
        found = options.found or Path(scratch)
        found.mkdir(parents=True, exist_ok=True)
        faults = found / 'faults'
        faults.mkdir(exist_ok=True)
        inputs = found / 'inputs'
        inputs.mkdir(exist_ok=True)
        words = Path(scratch, 'words')
        words.write_text(''.join(
            '"{}"\n'.format(''.join(f'\\x{octet:02x}' for octet in word)) for word in WORDS))
        code, said = run(
            options.entry, f'-dict={words}', f'-max_total_time={options.seconds}',
            f'-timeout={options.timeout}', f'-rss_limit_mb={options.megabytes}',
            f'-seed={options.seed}', '-print_final_stats=1', f'-artifact_prefix={faults}/',
            inputs, corpus)
        edges = numbers('cov', said)
        row = {'entry': options.entry, 'executions': (numbers(
            'stat::number_of_executed_units', said) or [0])[-1],
            'seconds': (re.findall(r'Done \d+ runs in (\d+) second', said) or [None])[-1],
            'edges_of_corpus': edges[0] if edges else 0, 'edges': edges[-1] if edges else 0,
            'peak_mb': (numbers('stat::peak_rss_mb', said) or [0])[-1], 'fault': code != 0}
        print(row)
        if options.keep:
            keep(options.entry, corpus, inputs)
    write_rows(options.json, [row])
    return int(code != 0)


if __name__ == '__main__':
    sys.exit(main())
