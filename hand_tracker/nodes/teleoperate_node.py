"""Tracker and retarget node in one process: markers in, commands for a robot hand out.

Frames go from one to the other without a change of thread. See docs/teleoperation.md.
"""

from __future__ import annotations

import sys

from .retarget_node import RetargetNode
from .runner import run_together
from .tracker_node import TrackerNode


def main(args: list[str] | None = None) -> int:
    """Run both nodes until they are interrupted; return the exit code."""
    return run_together({'tracker': TrackerNode, 'retarget': RetargetNode}, args=args)


if __name__ == '__main__':
    sys.exit(main())
