"""Ctrl-C and SIGTERM where no exception may be raised."""

import signal
import subprocess
import sys

import pytest

from benchmarks.repository import REPOSITORY

BOTH_SIGNALS = signal.SIGINT, signal.SIGTERM
ENDED = """
import signal, sys
from hand_tracker.interruption import ended_by_interrupt

try:
    with ended_by_interrupt('over', 3):
        signal.raise_signal(int(sys.argv[1]))
finally:
    print('goes on')
"""


@pytest.mark.parametrize('number', BOTH_SIGNALS)
def test_the_process_ends_at_once_with_one_line(number):
    done = subprocess.run([sys.executable, '-c', ENDED, str(int(number))], cwd=REPOSITORY,
                          capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (3, '', '\nover\n')
