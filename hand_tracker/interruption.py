"""Ctrl-C and SIGTERM where an exception would break what goes on, or be lost.

It may be lost in a callback of Python's while modules are imported, and in one of LLVM's while
kernels are compiled.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import current_thread, main_thread

INTERRUPTED_EXIT_CODE = 130
STANDARD_ERROR = 2


@contextmanager
def ended_by_interrupt(saying: str = '', exit_code: int = INTERRUPTED_EXIT_CODE) -> Iterator[None]:
    """End the process at once at Ctrl-C or SIGTERM in this context.

    Parameters
    ----------
    saying : str, optional
        Line on the standard error; none when left out.
    exit_code : int, optional
    """
    def end(number: int, frame: object) -> None:
        if saying:
            # Below what is drawn there.
            with suppress(OSError):
                os.write(STANDARD_ERROR, f'\n{saying}\n'.encode())
        os._exit(exit_code)

    # Other threads get no signals, and may set no handlers.
    numbers = (signal.SIGINT, signal.SIGTERM) if current_thread() is main_thread() else ()
    before = [(number, signal.signal(number, end)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)
