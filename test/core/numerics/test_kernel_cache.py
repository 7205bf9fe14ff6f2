"""Kernels on disk, where the folder is full or cannot be written to, and where files are cut."""

import os

import pytest
from helpers.kernel_programs import run_with_kernels

from hand_tracker.core.numerics.jit import COMPILED

pytestmark = pytest.mark.skipif(not COMPILED, reason='nothing is kept without numba')

KERNELS = """
from hand_tracker.core.numerics.jit import c_callback, jit

@jit
def half(number):
    return number / 2

@jit
def quarter(number):
    return half(half(number))

def callback():
    @c_callback('float64(float64)')
    def eighth(number):
        return half(quarter(number))

    return eighth
"""
# Prints results, how many kernels it compiled, and whether they count as a set on disk.
CALLS = """
import sys
from hand_tracker.core.numerics import jit
from small_kernels import half, quarter

if len(sys.argv) > 1:
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
results = quarter(8.), quarter(12), half(3.5), half(5)
compiled = sum(sum(kernel.stats.cache_misses.values()) for kernel in (half, quarter))
try:
    jit.mark_ready('small')
except jit.KernelsUnavailable:
    pass
print(*results, compiled, jit.is_ready('small'))
"""
RESULTS = '2.0 3.0 1.75 2.5'


@pytest.fixture
def run(tmp_path):
    """Return what runs the program with a cache folder: its output, and the lines that it says."""
    (tmp_path / 'small_kernels.py').write_text(KERNELS)

    def run_program(cache, *arguments, program=CALLS):
        # Python, too, would cut what it writes at the limit.
        done = run_with_kernels(program, *arguments, modules=tmp_path,
                                NUMBA_CACHE_DIR=str(cache), PYTHONDONTWRITEBYTECODE='1')
        assert not list((tmp_path / '__pycache__').glob('*.nb*'))  # as numba does without a folder
        return done.stdout.strip(), done.stderr.splitlines()

    return run_program


@pytest.mark.parametrize('room', [0, 4096], ids=['nothing', 'the index alone'])
def test_where_there_is_no_room_a_process_compiles_its_own(run, tmp_path, room):
    pytest.importorskip('resource', reason='there is no limit of file sizes here')
    cache = tmp_path / 'cache'
    output, (line,) = run(cache, str(room))
    assert output == f'{RESULTS} 4 False'
    for word in (str(cache), 'File too large', 'free space', 'NUMBA_CACHE_DIR'):
        assert word in line
    assert {path.suffix for path in cache.rglob('*.*')} <= {'.nbi'}
    # Once there is room, kernels are kept and loaded.
    assert run(cache) == (f'{RESULTS} 4 True', [])
    assert run(cache) == (f'{RESULTS} 0 True', [])


def test_a_folder_that_cannot_be_there_is_named(run, tmp_path):
    (tmp_path / 'file').touch()
    output, (line,) = run(tmp_path / 'file' / 'cache')
    assert output == f'{RESULTS} 4 False'
    assert str(tmp_path / 'file' / 'cache') in line and 'Not a directory' in line


@pytest.mark.skipif(os.name != 'posix' or os.geteuid() == 0, reason='may write to any folder')
def test_kernels_in_a_read_only_folder_are_loaded(run, tmp_path):
    cache = tmp_path / 'cache'
    assert run(cache) == (f'{RESULTS} 4 True', [])
    folders = [cache, *(path for path in cache.rglob('*') if path.is_dir())]
    for folder in folders:
        folder.chmod(0o500)
    assert run(cache) == (f'{RESULTS} 0 True', [])
    for folder in folders:
        folder.chmod(0o700)


def test_a_kernel_of_other_types_than_the_index_says_is_not_used(run, tmp_path):
    cache = tmp_path / 'cache'
    run(cache)
    first, second = sorted(cache.rglob('small_kernels.half*.nbc'))
    kept = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(kept)
    assert run(cache) == (f'{RESULTS} 2 True', [])
    assert run(cache) == (f'{RESULTS} 0 True', [])


def test_a_kernel_is_compiled_with_those_on_disk_that_it_calls(run, tmp_path):
    assert run(tmp_path)[0] == f'{RESULTS} 4 True'
    for path in tmp_path.rglob('*.quarter-*'):
        path.unlink()
    assert run(tmp_path) == (f'{RESULTS} 2 True', [])


def test_a_callback_is_loaded_from_the_disk(run, tmp_path):
    program = """
import ctypes
from small_kernels import callback
found = callback()
function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(found.address)
print(function(8.), found.cache_hits)
"""
    assert run(tmp_path, program=program) == ('1.0 0', [])
    assert run(tmp_path, program=program) == ('1.0 1', [])


def test_files_that_were_cut_are_made_anew(run, tmp_path):
    cache = tmp_path / 'cache'
    run(cache)
    for path, size in zip([*cache.rglob('*.half*.nbc'), next(cache.rglob('*.quarter*.nbi'))],
                          (1000, 0, 100)):
        path.write_bytes(path.read_bytes()[:size])
    assert run(cache) == (f'{RESULTS} 4 True', [])
    assert run(cache) == (f'{RESULTS} 0 True', [])
