"""Options of all evaluations, and their distribution over processes."""

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..parallel import Result, Task, parallel_map
from ..progress import CLEAR_LINE, Progress

if TYPE_CHECKING:
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
    """

    captures: tuple['Capture', ...] = ()
    seed: int = 1
    jobs: int = 1
    output: Path | None = None
    quiet: bool = False
    left_out: list[str] = field(default_factory=list)

    def say(self, line: str) -> None:
        """Print a line of progress."""
        if not self.quiet:
            _print(line)

    def leave_out(self, what: str) -> None:
        """Print and record what is left out and why."""
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

    def _shown(self, what: str, results: Iterator[Result], count: int) -> Iterator[Result]:
        return results if self.quiet else Progress(count, what).over(results)


def _print(line: str) -> None:
    # A terminal may show a progress bar.
    print(f'{CLEAR_LINE}{line}' if sys.stderr.isatty() else line, file=sys.stderr, flush=True)
