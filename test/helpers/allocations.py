"""Scripts that count what kernels allocate, in a process of their own."""

import os
import subprocess
import sys

from benchmarks.repository import REPOSITORY


def counted_allocations(script):
    """Return the words that a script prints, run where numba counts allocations."""
    environment = {**os.environ, 'NUMBA_NRT_STATS': '1', 'PYTHONPATH': os.pathsep.join(
        [str(REPOSITORY), os.environ.get('PYTHONPATH', '')])}
    return subprocess.run([sys.executable, '-c', script], check=True, env=environment,
                          stdout=subprocess.PIPE, text=True).stdout.split()
