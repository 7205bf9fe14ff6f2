"""Entry points of the nodes: Ctrl-C ends a node quietly even while it is still importing."""

import os
import signal
from importlib import import_module


def _run(node):
    for interrupt in (signal.SIGINT, signal.SIGTERM):
        signal.signal(interrupt, lambda *_: os._exit(0))
    return import_module(f'.{node}', __package__).main()


def replay():
    """Run the replay node; return its exit code."""
    return _run('replay')


def simulate():
    """Run the node of the simulated driver; return its exit code."""
    return _run('simulate')


def tracker():
    """Run the tracker node; return its exit code."""
    return _run('tracker')
