"""Tasks for tests of processes and clusters, importable by their workers."""

import os
import signal
from pathlib import Path

from hand_tracker.core.errors import HandTrackerError


def square(task, interrupted, progress):
    """Return the square of a number; 3 is refused, 4 a fault."""
    progress.say(f'at {task}')
    if task == 3:
        raise HandTrackerError('three is no number')
    if task == 4:
        raise ZeroDivisionError('four')
    return task * task


def killed_once(task, interrupted, progress):
    """Return the number of a (number, file) pair; whoever creates the file of 2 is killed."""
    number, file = task
    if number == 2 and not Path(file).exists():
        Path(file).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number
