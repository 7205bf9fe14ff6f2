"""Process pool: map a function over tasks in spawned processes, with clean interruption."""

import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import active_children, get_context
from typing import Any, NamedTuple, TypeVar

from .core.errors import HandTrackerError

Task = TypeVar('Task')
Result = TypeVar('Result')



class WorkerKilled(HandTrackerError):
    """A worker process was killed before it finished its task."""


class TaskResult(NamedTuple):
    """Result of a task of `run_tasks`.

    Attributes
    ----------
    is_done : bool
        False if the task raised an error.
    lines : list of str
        Messages of the task; the last one is its return value or its error.
    """

    is_done: bool
    lines: list[str]


class MessageCollector:
    """Stand-in for `Progress` in a worker process, which has no terminal: collects messages.

    Attributes
    ----------
    lines : list of str
    """

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, total: int, what: str) -> 'MessageCollector':
        """Return itself, in place of `Progress(total, what)`."""
        return self

    def over(self, items: Iterable[Task]) -> Iterable[Task]:
        """Return the items; no progress is shown."""
        return items

    def say(self, text: str) -> None:
        """Collect a message."""
        self.lines.append(text)


class Interruptions(list[type[BaseException]]):
    """Errors of the signals that came, as of `raise_on_interruption`."""

    def __init__(self) -> None:
        super().__init__()
        self._only_noted = False

    @contextmanager
    def only_noted(self) -> Iterator[None]:
        """Raise nothing from a signal within; what runs has to look for it, and is so never cut."""
        self._only_noted = True
        try:
            yield
        finally:
            self._only_noted = False
        if self:
            raise self[0]

    def note(self, error: type[BaseException]) -> None:
        """Take the error of a signal, and raise it unless it is only noted."""
        self.append(error)
        if not self._only_noted:
            raise error


def raise_on_interruption(
        error: type[BaseException] = KeyboardInterrupt) -> Interruptions:
    """Install signal handlers that raise an error on SIGINT and SIGTERM.

    Parameters
    ----------
    error : type of BaseException

    Returns
    -------
    Interruptions
        Gets the error appended on each signal, as extension code may swallow one raised in it.
    """
    interruptions = Interruptions()

    def interrupt(number: int, frame: object) -> None:
        interruptions.note(error)

    # SIGTERM too: a closed terminal or killed script leaves no unfinished file either.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    return interruptions


def parallel_map(function: Callable[[Task], Result], tasks: Sequence[Task], jobs: int,
                 initializer: Callable[[], None] | None = None) -> Iterator[Result]:
    """Yield `function(task)` for each task, in order, computed in up to `jobs` processes.

    Parameters
    ----------
    function : callable
        Picklable: at the top level of a module.
    tasks : sequence
        Picklable.
    jobs : int
    initializer : callable, optional
        Called at the start of each process.

    Yields
    ------
    object

    Raises
    ------
    WorkerKilled
        If a process was killed.
    """
    # Spawned, as forked processes would inherit locks of libraries' threads.
    with ProcessPoolExecutor(
            min(jobs, len(tasks)), get_context('spawn'), initializer) as pool:
        try:
            yield from pool.map(function, tasks)
        except BrokenProcessPool as error:
            raise WorkerKilled('a process was killed, perhaps for lack of memory; '
                               'expected is a smaller number of jobs') from error
        except BaseException:
            # On interruption end running tasks at once; they clean up on SIGTERM.
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():
                process.terminate()
            raise


_interruptions = Interruptions()  # of a worker process


def run_tasks(work: Callable[[Any, Interruptions, MessageCollector], str], tasks: Sequence[Any],
              jobs: int) -> Iterator[TaskResult]:
    """Run tasks in up to `jobs` processes; an error ends its task only.

    Parameters
    ----------
    work : callable
        At the top level of a module; takes a task, the list from `raise_on_interruption` and a
        `MessageCollector`; returns a message, and may raise `HandTrackerError` or `OSError`.
    tasks : sequence
        Picklable.
    jobs : int

    Yields
    ------
    TaskResult
        Of each task, in order.

    Raises
    ------
    WorkerKilled
        If a process was killed.
    """
    return parallel_map(partial(_run_task, work), tasks, jobs, _start_worker)


def _start_worker() -> None:
    global _interruptions
    # SystemExit, unlike KeyboardInterrupt, ends a process without a traceback.
    _interruptions = raise_on_interruption(SystemExit)


def _run_task(work: Callable[[Any, Interruptions, MessageCollector], str], task: Any) -> TaskResult:
    messages = MessageCollector()
    try:
        messages.say(work(task, _interruptions, messages))
    except (HandTrackerError, OSError) as error:
        messages.say(str(error))
        return TaskResult(False, messages.lines)
    return TaskResult(True, messages.lines)
