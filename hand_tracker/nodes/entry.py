"""Entry points of the nodes: Ctrl-C ends a node quietly even while it is still importing.

Where no entry point is installed: `python -m hand_tracker.nodes.entry tracker --ros-args ...`.
"""

import os
import signal
import sys
from importlib import import_module

NODES = 'replay', 'simulate', 'tracker'


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


if __name__ == '__main__':
    if sys.argv[1:2] == [] or sys.argv[1] not in NODES:
        sys.exit(f"expected one of the nodes {', '.join(NODES)}")
    sys.exit(_run(sys.argv.pop(1)))
