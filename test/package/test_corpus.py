"""Bytes from outside that once broke an entry, or lead far into it, break none of them.

Those whose names are hashes were found by `benchmarks.fuzz_inputs`, see docs/security.md.
"""

from pathlib import Path

import pytest

from benchmarks.input_entries import ENTRIES, give

NEEDS = 'qtm_rt', 'trimesh', 'viser', 'websockets'

CORPUS = Path(__file__).resolve().parents[1] / 'corpus'
INPUTS = sorted(path.relative_to(CORPUS) for path in CORPUS.rglob('*') if path.is_file())
MOST_BYTES = 300_000       # of the corpus


def test_every_entry_has_inputs_and_the_corpus_stays_small():
    assert {path.parts[0] for path in INPUTS} == set(ENTRIES)
    assert sum((CORPUS / path).stat().st_size for path in INPUTS) <= MOST_BYTES


# Each takes milliseconds, or ends never, which the time that any test has finds out.
@pytest.mark.parametrize('entry', ENTRIES)
def test_inputs_are_read_or_refused(entry):
    for path in INPUTS:
        if path.parts[0] == entry:
            try:
                give(entry, (CORPUS / path).read_bytes())
            except Exception as error:
                raise AssertionError(f'{path}: {error!r}') from error
