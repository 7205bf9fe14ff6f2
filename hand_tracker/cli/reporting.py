"""Faults of a command: a line on the standard error and an exit code, not a traceback."""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import wraps
from itertools import takewhile
from typing import Any, NoReturn

from ..core.errors import HandTrackerError
from ..interruption import INTERRUPTED_EXIT_CODE
from ..parallel import raise_on_interruption

FAULT_EXIT_CODE = 1
WRONG_COMMAND_LINE = 2     # exit code


class CommandParser(argparse.ArgumentParser):
    """Parser of a command line that takes whole names of options, and says a fault in one line."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(allow_abbrev=False, **kwargs)

    def parse_known_args(self, args: Sequence[str] | None = None,    # type: ignore[override]
                         namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse a command line; an unknown option is a fault here, so that a subcommand names it.

        Parameters and result as of `argparse.ArgumentParser`.
        """
        if self._subparsers is None:
            # Before an option is missed for which it may stand.
            self._refuse_unknown(one for one in (sys.argv[1:] if args is None else args)
                                 if one.startswith('--'))
        found, others = super().parse_known_args(args, namespace)
        self._refuse_unknown(one for one in takewhile(lambda one: one != '--', others)
                             if one.startswith('-'))
        return found, others

    def _refuse_unknown(self, given: Iterable[str]) -> None:
        """End with a fault that names the first option that is not known, and those near it."""
        for text in takewhile(lambda one: one != '--', given):
            name = text.partition('=')[0]
            if name not in self._option_string_actions:
                near = get_close_matches(name, self._option_string_actions, cutoff=.75)
                self.error(f'unknown option {name}' + (
                    f'; is {" or ".join(near)} meant?' if near else ''))

    def error(self, message: str) -> NoReturn:
        """Print a fault of the command line, and exit."""
        self.exit(WRONG_COMMAND_LINE, f'{self.prog}: {message} ({self.prog} --help)\n')


def reporting(main: Callable[[list[str] | None], int]) -> Callable[..., int]:
    """Return the `main` of a command's module with its faults, Ctrl-C and SIGTERM reported.

    A broken pipe, as of `| head`, is left to the caller: only its standard output may be closed.
    """
    name = f'hand_tracker {main.__module__.rpartition(".")[2]}'

    @wraps(main)
    def reported(arguments: list[str] | None = None) -> int:
        raise_on_interruption()
        try:
            return main(arguments)
        except BrokenPipeError:
            raise
        except (HandTrackerError, OSError) as error:
            print(f'{name}: {error}', file=sys.stderr)
            return FAULT_EXIT_CODE
        except KeyboardInterrupt:
            print(f'{name}: interrupted; no unfinished file is left', file=sys.stderr)
            return INTERRUPTED_EXIT_CODE
    return reported
