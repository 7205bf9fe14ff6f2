"""What every evaluation is given, and how it spreads its work."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

from ..parallel import parallel_map
from ..progress import CLEAR_LINE, Progress


@dataclass(frozen=True)
class Options:
    """Choices of the command line.

    Parameters
    ----------
    captures : tuple of Capture
        For the evaluations that judge captures.
    seed : int
        Of everything that is drawn.
    jobs : int
        Processes to work in.
    output : Path, optional
        Folder for CSV, pictures and whatever else an evaluation leaves behind.
    quiet : bool
        Whether to keep progress to oneself.
    left_out : list of str
        What could not be judged, and why; it grows.
    """

    captures: tuple = ()
    seed: int = 1
    jobs: int = 1
    output: Path | None = None
    quiet: bool = False
    left_out: list = field(default_factory=list)

    def say(self, line):
        """Print a line of progress."""
        if not self.quiet:
            _print(line)

    def leave_out(self, what):
        """Say what is left out and why, and remember it."""
        _print(f'left out: {what}')
        self.left_out.append(what)

    def each(self, what, function, tasks):
        """Yield `function(task)` of every task, in their order whatever the number of jobs.

        Parameters
        ----------
        what : str
            Name of the pieces of work, in the plural, for the progress.
        function : callable
            At the top level of a module, so that another process finds it.
        tasks : sequence
            Of picklable arguments. What is drawn must depend on seed and task only.

        Yields
        ------
        object
        """
        tasks = list(tasks)
        if self.jobs > 1 and len(tasks) > 1:
            results = parallel_map(function, tasks, self.jobs)
        else:
            results = map(function, tasks)
        yield from self._shown(what, results, len(tasks))

    def _shown(self, what, results, count):
        return results if self.quiet else Progress(count, what).over(results)


def _print(line):
    # On a terminal there may be a bar.
    print(f'{CLEAR_LINE}{line}' if sys.stderr.isatty() else line, file=sys.stderr, flush=True)
