"""Kernels that others call: parts of these, until Python calls them."""

import pytest
from helpers.kernel_programs import run_with_kernels

from benchmarks.repository import REPOSITORY
from hand_tracker.core.numerics.jit import COMPILED

pytestmark = pytest.mark.skipif(not COMPILED, reason='needs numba')

KERNELS = """
from hand_tracker.core.numerics.jit import jit

@jit
def third(number):
    return number / 3

@jit
def ninth(number):
    return third(third(number))

@jit
def either(number):
    return ninth(number) if number > 9 else third(number)
"""


@pytest.fixture
def run(tmp_path):
    """Return what runs a program with these kernels and a cache of its own: its output."""
    (tmp_path / 'few_kernels.py').write_text(KERNELS)

    def run_program(program):
        return run_with_kernels(program, modules=tmp_path,
                                NUMBA_CACHE_DIR=str(tmp_path / 'cache')).stdout.split()

    return run_program


def test_what_a_kernel_calls_is_its_part_until_python_calls_it(run, tmp_path):
    assert run("""
from few_kernels import either, ninth, third
from hand_tracker.core.numerics.kernel_compiler import is_part

def parts():
    return ''.join(str(+is_part(kernel.overloads[kernel.signatures[0]]))
                   for kernel in (either, ninth, third))

print(either(18.), either(6.), parts(), ninth(27.), parts(), third(6.), parts(), either(18.))
""") == ['2.0', '2.0', '011', '3.0', '001', '2.0', '000', '2.0']
    # Parts are in that of their callers on disk.
    assert run("""
from few_kernels import either, ninth, third
print(either(18.), either.stats.cache_hits.total(), len(ninth.overloads), ninth(27.), third(6.),
      ninth.stats.cache_hits.total(), third.stats.cache_misses.total())
""") == ['2.0', '1', '0', '3.0', '2.0', '1', '0']


def test_threads_that_call_a_kernel_and_its_part_at_once_get_both(run):
    assert run("""
from threading import Barrier, Thread
from few_kernels import either, ninth, third

begin, found = Barrier(3), {}

def call(kernel):
    begin.wait()
    found[kernel] = kernel(27.)

threads = [Thread(target=call, args=(kernel,)) for kernel in (either, ninth, third)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(*(found[kernel] for kernel in (either, ninth, third)))
""") == ['3.0', '3.0', '9.0']


def test_a_process_with_its_kernels_on_disk_compiles_none_to_find_hands_among_points(tmp_path):
    program = """
import sys
from hand_tracker.__main__ import main
from hand_tracker.core.numerics.kernel_compiler import KernelCompiler
from hand_tracker.tracking.compile_kernels import prepare_kernels

prepare_kernels(print, labels_points=True)
before = KernelCompiler.finished
assert main(sys.argv[1:]) == 0
print(KernelCompiler.finished - before)
"""
    done = run_with_kernels(
        program, 'track', REPOSITORY / 'recordings/demo_both.mcap',
        '-o', tmp_path / 'angles.csv', '--side', 'both', '--labels', 'none')
    assert done.stdout.split()[-1] == '0'
