"""Map a function over tasks: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import inspect
import re
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import active_children
from traceback import walk_tb
from typing import Any, NamedTuple, TypeVar

from .core.errors import HandTrackerError

Task = TypeVar('Task')
Result = TypeVar('Result')

CLUSTER_ADDRESS = re.compile(r'[a-z]+://[^/]+:\d+/?')
CLUSTER_TIMEOUT = 10.      # [s] within which a cluster answers


class WorkerKilled(HandTrackerError):
    """A worker process was killed before it finished its task."""


class ClusterUnavailable(HandTrackerError):
    """A cluster that does not answer, or whose library is not installed."""


class TaskResult(NamedTuple):
    """Result of a task of `run_tasks`.

    Attributes
    ----------
    value : object
        The task's result, None if it raised an error.
    lines : list of str
        Messages of the task; the last one is its value or its error.
    """

    value: Any
    lines: list[str]


class MessageCollector:
    """Stand-in for `Progress` in a worker process, which has no terminal: collects messages.

    Attributes
    ----------
    lines : list of str
    """

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, total: int, what: str) -> MessageCollector:
        """Return itself, in place of `Progress(total, what)`."""
        return self

    def over(self, items: Iterable[Task]) -> Iterable[Task]:
        """Return the items; no progress is shown."""
        return items

    def say(self, text: str) -> None:
        """Collect a message."""
        self.lines.append(text)


class Interruptions(list[type[BaseException]]):
    """Errors of received signals, recorded by the handlers of `raise_on_interruption`.

    Parameters
    ----------
    only_noted : bool, optional
        Whether signals are only recorded, for running code to poll.
    """

    def __init__(self, only_noted: bool = False) -> None:
        super().__init__()
        self._only_noted = only_noted
        self._on_note: Callable[[], None] | None = None

    @contextmanager
    def only_noted(self, on_note: Callable[[], None] | None = None) -> Iterator[None]:
        """Defer signals to the end of this context: code in it polls for them, uninterrupted.

        Parameters
        ----------
        on_note : callable, optional
            Called on each signal.
        """
        before = self._only_noted, self._on_note
        self._only_noted, self._on_note = True, on_note
        try:
            yield
        finally:
            self._only_noted, self._on_note = before
        if self:
            raise self[0]

    def note(self, error: type[BaseException]) -> None:
        """Record the error of a signal; raise it at once unless signals are deferred."""
        self.append(error)
        if self._on_note is not None:
            self._on_note()
        if not self._only_noted:
            raise error


def raise_on_interruption(error: type[BaseException] = KeyboardInterrupt,
                          only_noted: bool = False) -> Interruptions:
    """Install signal handlers that raise an error on SIGINT and SIGTERM.

    Parameters
    ----------
    error : type of BaseException
    only_noted : bool, optional
        See `Interruptions`.

    Returns
    -------
    Interruptions
        Gets the error appended on each signal, as extension code may swallow one raised in it.
    """
    interruptions = Interruptions(only_noted)

    def interrupt(number: int, frame: object) -> None:
        interruptions.note(error)

    # SIGTERM too: a closed terminal or killed script leaves no unfinished file either.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    return interruptions


def parallel_map(function: Callable[[Task], Result], tasks: Sequence[Task],
                 jobs: int) -> Iterator[Result]:
    """Yield `function(task)` for each task, in order, computed in up to `jobs` processes.

    Parameters
    ----------
    function : callable
        Picklable: at the top level of a module.
    tasks : sequence
        Picklable.
    jobs : int

    Yields
    ------
    object

    Raises
    ------
    WorkerKilled
        If a process was killed.
    """
    # Here, as only commands with several processes need it.
    from joblib import Parallel, delayed

    # Before joblib 1.3 results come all together.
    options = {'return_as': 'generator'} if 'return_as' in inspect.signature(
        Parallel).parameters else {}
    results = Parallel(min(jobs, max(len(tasks), 1)), batch_size=1, pre_dispatch='all', **options)(
        delayed(function)(task) for task in tasks)
    try:
        with _without_lost_tasks():
            yield from results
    except BrokenProcessPool as error:
        raise WorkerKilled('a process was killed, perhaps for lack of memory; '
                           'expected is a smaller number of jobs') from error


@contextmanager
def _without_lost_tasks() -> Iterator[None]:
    """Keep quiet a thread of joblib's that misses the tasks which an interruption took from it."""
    before = threading.excepthook

    def report(fault: threading.ExceptHookArgs) -> None:
        is_joblibs = any('joblib' in frame.f_code.co_filename
                         for frame, _ in walk_tb(fault.exc_traceback))
        if not (is_joblibs and fault.exc_type is KeyError):
            before(fault)

    threading.excepthook = report
    try:
        yield
    finally:
        threading.excepthook = before


def run_tasks(work: Callable[[Task, Interruptions, MessageCollector], Any],
              tasks: Sequence[Task], jobs: int, interrupted: Interruptions,
              cluster: str = '') -> Iterator[TaskResult]:
    """Run tasks in up to `jobs` processes, or on a cluster; an error ends its task only.

    Parameters
    ----------
    work : callable
        At the top level of a module; takes a task, the list from `raise_on_interruption` and a
        `MessageCollector`; returns a value with a `str`, and may raise errors.
    tasks : sequence
        Picklable.
    jobs : int
        With 1, this process.
    interrupted : Interruptions
        Of this process.
    cluster : str, optional
        Address of a Dask scheduler, as tcp://10.0.0.5:8786; its workers replace the processes.
        The task of a worker that died is done again by another one.

    Yields
    ------
    TaskResult
        Of each task, in order.

    Raises
    ------
    WorkerKilled
        If a process was killed.
    ClusterUnavailable
    """
    if cluster:
        return _cluster_map(partial(_run_task, work, Interruptions()), tasks, cluster)
    if jobs == 1:
        return map(partial(_run_task, work, interrupted), tasks)
    return _process_map(partial(_run_in_worker, work), tasks, jobs, interrupted)


def _process_map(function: Callable[[Task], TaskResult], tasks: Sequence[Task], jobs: int,
                 interrupted: Interruptions) -> Iterator[TaskResult]:
    """Map in processes; on a signal running tasks clean up, and no other one begins."""
    with interrupted.only_noted(_terminate_children):
        try:
            yield from parallel_map(function, tasks, jobs)
        except WorkerKilled:
            if not interrupted:
                raise


def _terminate_children() -> None:
    for process in active_children():
        process.terminate()


def _cluster_map(function: Callable[[Task], TaskResult], tasks: Sequence[Task],
                 cluster: str) -> Iterator[TaskResult]:
    expected = 'expected an address such as tcp://10.0.0.5:8786'
    if not CLUSTER_ADDRESS.fullmatch(cluster):
        raise ClusterUnavailable(f'--cluster {cluster}: no address of a scheduler; {expected}')
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise ClusterUnavailable('--cluster needs Dask: pip install distributed') from None
    try:
        client = Client(cluster, timeout=CLUSTER_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterUnavailable(
            f'--cluster {cluster}: no scheduler answers ({error}); {expected}') from None
    with client:
        # Tasks write files: the results of an earlier command are not theirs.
        futures = client.map(function, tasks, pure=False)
        for future in futures:
            try:
                yield future.result()
            except KilledWorker:
                yield TaskResult(None, ['each worker that began it died, perhaps for lack of '
                                        'memory'])


_of_worker: list[Interruptions] = []     # of a worker process, installed by its first task


def _run_in_worker(work: Callable[[Any, Interruptions, MessageCollector], Any],
                   task: Any) -> TaskResult:
    """Run a task in a worker process; a signal ends the task, not the process.

    A pool would end its other processes with one that ended, in the middle of a file.
    """
    if not _of_worker:
        _of_worker.append(raise_on_interruption(SystemExit, only_noted=True))
    interruptions, = _of_worker
    if not interruptions:
        try:
            return _run_task(work, interruptions, task)
        except SystemExit:
            pass
    return TaskResult(None, ['interrupted'])


def _run_task(work: Callable[[Any, Interruptions, MessageCollector], Any],
              interrupted: Interruptions, task: Any) -> TaskResult:
    messages = MessageCollector()
    try:
        value = work(task, interrupted, messages)
    except (HandTrackerError, OSError) as error:
        messages.say(str(error))
        return TaskResult(None, messages.lines)
    except Exception as error:
        # A fault of this package, too, ends this task alone.
        messages.say(f'{type(error).__name__}: {error}')
        return TaskResult(None, messages.lines)
    messages.say(str(value))
    return TaskResult(value, messages.lines)
