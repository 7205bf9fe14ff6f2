"""The same work on many files, side by side in processes, and its interruption."""

import signal
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import repeat
from multiprocessing import active_children, get_context

from .core.errors import HandTrackerError


class ProcessLost(HandTrackerError):
    """A process ended before its work did."""


class Notes(list):
    """The lines of a process that has no terminal of its own: stands in for `Progress`."""

    def __call__(self, total, what):
        """Return itself, as its progress through anything."""
        return self

    def over(self, items):
        """Pass the items on."""
        return items

    say = list.append


def listen_for_interruption(error=KeyboardInterrupt):
    """Have the signals of an interruption raise an error.

    Parameters
    ----------
    error : type of BaseException

    Returns
    -------
    list of type
        Empty until a signal came, then of the error: extension code may swallow one raised in it.
    """
    interrupted = []

    def interrupt(number, frame):
        interrupted.append(error)
        raise error

    # A closing terminal or a killed script leaves no half file either.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    return interrupted


def side_by_side(work, tasks, jobs):
    """Work on several tasks, each in one of so many processes.

    Parameters
    ----------
    work : callable
        At the top level of a module; takes a task, a list as of `listen_for_interruption` and
        one of `Notes`; returns a line to be said, and may raise a `HandTrackerError`.
    tasks : sequence
        That can be pickled.
    jobs : int

    Yields
    ------
    is_done : bool
        Whether the work raised no error, for each task in turn.
    lines : list of str
        To be said of it; the last is the error's.

    Raises
    ------
    ProcessLost
        If one was killed.
    """
    # Spawned processes: forked ones would inherit locks of libraries' threads.
    with ProcessPoolExecutor(min(jobs, len(tasks)), get_context('spawn'), _begin) as pool:
        try:
            yield from pool.map(_attempt, repeat(work), tasks)
        except BrokenProcessPool as error:
            raise ProcessLost('a process was killed, perhaps for lack of memory; '
                              'expected is a smaller number of jobs') from error
        except BaseException:
            # Interrupted: what runs ends without leaving anything behind.
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise


def _begin():
    global _interrupted
    # Unlike KeyboardInterrupt it ends a process quietly.
    _interrupted = listen_for_interruption(SystemExit)


def _attempt(work, task):
    notes = Notes()
    try:
        notes.say(work(task, _interrupted, notes))
    except (HandTrackerError, OSError) as error:
        notes.say(str(error))
        return False, notes
    return True, notes
