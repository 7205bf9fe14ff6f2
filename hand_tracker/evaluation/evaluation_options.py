"""Options of all evaluations, and their distribution over processes."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import HandTrackerError
from ..parallel import Result, Task, parallel_map
from ..progress import CLEAR_LINE, Progress
from .rows import Row

if TYPE_CHECKING:
    from ..calibration.takes import MarkerTake
    from .captures import Capture


@dataclass(frozen=True)
class Options:
    """Options of evaluations, from the command line.

    Parameters
    ----------
    captures : tuple of Capture
        Input of the evaluations that judge captures.
    seed : int
        Of all random draws.
    jobs : int
        Number of processes.
    output : Path, optional
        Folder for CSV files and pictures.
    quiet : bool
        Whether to print no progress.
    left_out : list of str
        Captures that could not be judged, and why; appended to by `leave_out`.
    takes, fit_takes : tuple of MarkerTake
        Takes of real markers to judge, and to fit hands to.
    layout_takes, fit_layout_takes : tuple of MarkerTake
        The same, their markers named by the layout presets that have them.
    """

    captures: tuple['Capture', ...] = ()
    seed: int = 1
    jobs: int = 1
    output: Path | None = None
    quiet: bool = False
    left_out: list[str] = field(default_factory=list)
    takes: tuple['MarkerTake', ...] = ()
    fit_takes: tuple['MarkerTake', ...] = ()
    layout_takes: tuple['MarkerTake', ...] = ()
    fit_layout_takes: tuple['MarkerTake', ...] = ()

    def say(self, line: str) -> None:
        """Print a line of progress."""
        if not self.quiet:
            _print(line)

    def leave_out(self, what: str) -> None:
        """Print and record an omission and its reason."""
        _print(f'left out: {what}')
        self.left_out.append(what)

    def each(self, what: str, function: Callable[[Task], Result],
             tasks: Iterable[Task]) -> Iterator[Result]:
        """Yield `function(task)` of every task, in order, computed by `jobs` processes.

        Parameters
        ----------
        what : str
            Plural noun for the tasks, for the progress bar.
        function : callable
            At the top level of a module. Its random draws depend on seed and task only.
        tasks : iterable
            Picklable arguments.

        Yields
        ------
        object
        """
        pending = list(tasks)
        if self.jobs > 1 and len(pending) > 1:
            results = parallel_map(function, pending, self.jobs)
        else:
            results = map(function, pending)
        yield from self._shown(what, results, len(pending))

    def judge_each(self, what: str, judge: Callable[[Task], list[Row]], tasks: Sequence[Task],
                   name: Callable[[Task], str], none: HandTrackerError) -> Iterator[Row]:
        """Yield the rows of every task; report and leave out those that cannot be judged.

        Parameters
        ----------
        what, judge, tasks
            As for `each`; `judge` may raise `HandTrackerError`.
        name : callable
            Returns what a task is called in the report.
        none : HandTrackerError
            Raised if no task can be judged.

        Yields
        ------
        dict
        """
        judged = False
        for task, found in zip(tasks, self.each(what, partial(_rows_or_fault, judge), tasks)):
            if isinstance(found, str):
                self.leave_out(f'{name(task)}: {found}')
            else:
                judged = True
                yield from found
        if not judged:
            raise none

    def _shown(self, what: str, results: Iterator[Result], count: int) -> Iterator[Result]:
        return results if self.quiet else Progress(count, what).over(results)


def _rows_or_fault(judge: Callable[[Task], list[Row]], task: Task) -> list[Row] | str:
    # The fault is returned as text: raised, it would end the evaluation of the others.
    try:
        return judge(task)
    except HandTrackerError as fault:
        return str(fault)


def _print(line: str) -> None:
    # A terminal may show a progress bar.
    print(f'{CLEAR_LINE}{line}' if sys.stderr.isatty() else line, file=sys.stderr, flush=True)
