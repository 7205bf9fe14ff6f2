"""What every evaluation is given, and how it spreads its work."""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path


@dataclass(frozen=True)
class Options:
    """Choices of the command line.

    Parameters
    ----------
    files : tuple of Path
        Captures, for the evaluations that judge captures.
    seed : int
        Of everything that is drawn.
    jobs : int
        Processes to work in.
    output : Path, optional
        Folder for CSV, pictures and whatever else an evaluation leaves behind.
    quiet : bool
        Whether to keep progress to oneself.
    """

    files: tuple = ()
    seed: int = 1
    jobs: int = 1
    output: Path | None = None
    quiet: bool = False

    def say(self, line):
        """Print a line of progress."""
        if not self.quiet:
            print(line, file=sys.stderr, flush=True)

    def each(self, what, function, tasks):
        """Yield `function(task)` of every task, in their order whatever the number of jobs.

        Parameters
        ----------
        what : str
            Name of the work, for the progress lines.
        function : callable
            At the top level of a module, so that another process finds it.
        tasks : sequence
            Of picklable arguments. What is drawn must depend on seed and task only.

        Yields
        ------
        object
        """
        start = time.monotonic()
        tasks = list(tasks)
        if self.jobs > 1 and len(tasks) > 1:
            # Spawned processes: forked ones would inherit locks of libraries' threads.
            with ProcessPoolExecutor(
                    min(self.jobs, len(tasks)), mp_context=get_context('spawn')) as pool:
                yield from self._counted(what, pool.map(function, tasks), len(tasks), start)
        else:
            yield from self._counted(what, map(function, tasks), len(tasks), start)

    def _counted(self, what, results, count, start):
        for done, result in enumerate(results, 1):
            self.say(f'{what}: {done} of {count}, {time.monotonic() - start:.0f} s')
            yield result
