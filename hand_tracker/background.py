"""Background work: child processes at low priority, and calls in a thread."""

import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import IO, Generic, TypeVar

NICENESS = 10      # of child processes: tracking comes first

Argument = TypeVar('Argument')
Outcome = TypeVar('Outcome')


def start_low_priority(arguments: Sequence[str | Path], environment: Mapping[str, str],
                       output: int | IO[bytes],
                       errors: IO[bytes] | IO[str]) -> subprocess.Popen[bytes]:
    """Start this Python with this package in a child process at low priority.

    Parameters
    ----------
    arguments : sequence of str or Path
        Of Python, as ``-m hand_tracker``.
    environment : mapping of str to str
        In addition to that of this process.
    output, errors : file or int
        As of `subprocess.Popen`.

    Returns
    -------
    subprocess.Popen
    """
    # Links stay as they are: numba keeps kernels by the path that a package is imported from.
    parent = Path(__file__).parent.parent
    child = subprocess.Popen(
        [sys.executable, *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=errors,
        env={**os.environ, **environment, 'PYTHONPATH': os.pathsep.join(
            filter(None, (str(parent), os.environ.get('PYTHONPATH'))))},
        # A session of its own: Ctrl-C is not for it.
        start_new_session=True,
        # `python -m` looks there first, and would follow links: no package is there.
        cwd=parent.anchor)
    with suppress(OSError):  # it has ended, or the system has no priorities
        os.setpriority(os.PRIO_PROCESS, child.pid, NICENESS)
    return child


class NewestCall(Generic[Argument, Outcome]):
    """Call a function in a background thread, one call at a time, for the newest argument.

    Parameters
    ----------
    function : callable
        Takes an argument and returns its outcome.
    """

    def __init__(self, function: Callable[[Argument], Outcome]) -> None:
        self._function = function
        self._asked: deque[Argument] = deque(maxlen=1)
        self._running: Future[tuple[Argument, Outcome]] | None = None

    def ask(self, argument: Argument) -> None:
        """Ask for a call, in place of one that was asked for and has not begun."""
        self._asked.append(argument)

    def poll(self) -> tuple[Argument, Outcome] | None:
        """Return an argument and its outcome, once; begin the next call.

        Returns
        -------
        argument : object
        outcome : object

        None while there is nothing new. Errors of the function are raised here.
        """
        done = None
        if self._running is not None and self._running.done():
            done, self._running = self._running, None
        if self._running is None and self._asked:
            self._running = Future()
            # A daemon, so that nobody waits for it at the end.
            Thread(target=self._call, args=(self._running, self._asked.pop()), daemon=True).start()
        return None if done is None else done.result()

    def _call(self, future: 'Future[tuple[Argument, Outcome]]', argument: Argument) -> None:
        try:
            future.set_result((argument, self._function(argument)))
        except Exception as error:
            future.set_exception(error)
