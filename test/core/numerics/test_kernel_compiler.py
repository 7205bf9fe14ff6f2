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


def test_arrays_of_a_call_are_counted_only_where_a_kernel_returns_one(run, tmp_path):
    (tmp_path / 'array_kernels.py').write_text("""
from typing import NamedTuple

import numpy as np
from hand_tracker.core.numerics.jit import jit

class Ends(NamedTuple):
    numbers: np.ndarray
    firsts: np.ndarray

@jit
def inner(numbers):
    return numbers[1:-1]

@jit
def ends_of(numbers):
    return Ends(numbers, numbers[:1])

@jit
def total(ends):
    own = np.ones(len(ends.numbers))
    within = inner(own)
    own = np.zeros(9)
    return inner(ends.numbers).sum() + ends.firsts[0] + within.sum() + ends_of(own).firsts[0]
""")
    assert run("""
import sys
import numpy as np
from array_kernels import Ends, ends_of, inner, total
from numba.core.runtime import _nrt_python, rtsys

def counts():
    return sys.getrefcount(ends.numbers), sys.getrefcount(ends.firsts)

_nrt_python.memsys_enable_stats()
ends = Ends(np.arange(5.), np.full(1, .5))
held, first, before = counts(), total(ends), rtsys.get_allocation_stats()
print({total(ends) for _ in range(100)} == {first}, first)
after = rtsys.get_allocation_stats()
print(after.alloc - before.alloc, after.free - before.free, counts() == held)
views = inner(np.arange(1e6)), ends_of(np.arange(1e6)).numbers
others = [np.full(10**6, 7.) for _ in range(4)]     # where freed memory would be used again
print(*views[0][:2], *views[1][:2])
""") == ['True', '9.5', '200', '200', 'True', '1.0', '2.0', '0.0', '1.0']


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
