"""Ctrl-C while modules are imported, where an exception may be lost in a callback of Python's."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED_EXIT_CODE = 130


@contextmanager
def ended_by_interrupt() -> Iterator[None]:
    """End the process at once and quietly at Ctrl-C in this context."""
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED_EXIT_CODE))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
