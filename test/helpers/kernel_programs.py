"""Programs that run beside the tests with compiled kernels."""

import os
import subprocess
import sys

from benchmarks.repository import REPOSITORY


def run_with_kernels(program, *arguments, modules='', **environment):
    """Return the process of a program that has ended well, with modules of a folder of its own."""
    done = subprocess.run([sys.executable, '-c', program, *map(str, arguments)], env={
        **os.environ, 'HAND_TRACKER_JIT': '1', **environment, 'PYTHONPATH': os.pathsep.join(
            [str(REPOSITORY), str(modules), os.environ.get('PYTHONPATH', '')])},
        capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done
