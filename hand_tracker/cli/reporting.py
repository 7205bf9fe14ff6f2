"""Faults of a command: a line on the standard error and an exit code, not a traceback."""

import sys
from collections.abc import Callable
from functools import wraps

from ..core.errors import HandTrackerError
from ..interruption import INTERRUPTED_EXIT_CODE

FAULT_EXIT_CODE = 1


def reporting(main: Callable[[list[str] | None], int]) -> Callable[..., int]:
    """Return the `main` of a command's module with its faults and Ctrl-C reported.

    A broken pipe, as of `| head`, is left to the caller: only its standard output may be closed.
    """
    name = f'hand_tracker {main.__module__.rpartition(".")[2]}'

    @wraps(main)
    def reported(arguments: list[str] | None = None) -> int:
        try:
            return main(arguments)
        except BrokenPipeError:
            raise
        except (HandTrackerError, OSError) as error:
            print(f'{name}: {error}', file=sys.stderr)
            return FAULT_EXIT_CODE
        except KeyboardInterrupt:
            return INTERRUPTED_EXIT_CODE
    return reported
