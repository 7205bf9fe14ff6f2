"""Entry points of the nodes: Ctrl-C ends a node quietly even while it is still importing.

Where no entry point is installed: `python -m hand_tracker.entry tracker --ros-args ...`.
"""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module

from .__main__ import main

HELP = """
usage: ros2 run hand_tracker {node} [--ros-args -p PARAMETER:=VALUE -r {topic}:=/topic ...]
`ros2 param list` and `ros2 param describe` show the parameters while it runs; {page} says
what they mean."""
ASKS = {'-h', '--help'}
# Of the nodes that have others than the tracker's
TOPIC_AND_PAGE = {'source': ('~/markers', 'docs/sources.md'),
                  'retarget': ('joint_states', 'docs/teleoperation.md')}
# Nodes whose kernels are small: compiling or loading them takes longer than they save.
PLAIN_NODES = {'landmarks', 'mount', 'replay', 'source'}


def _run(node: str) -> int:
    for interrupt in (signal.SIGINT, signal.SIGTERM):
        signal.signal(interrupt, lambda *_: os._exit(0))
    # Another thread of BLAS would spin from frame to frame, and take a core from the trackers.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    asks = ASKS & set(sys.argv[1:])
    if node in PLAIN_NODES or asks:
        os.environ.setdefault('HAND_TRACKER_JIT', '0')
    elif node in ('all', 'calibrate', 'tracker', 'managed_tracker'):
        # Where kernels are not on disk, plain Python does their work at once.
        os.environ.setdefault('HAND_TRACKER_JIT', 'background')
    module = import_module(f'.nodes.{node}_node', __package__)
    if asks:
        topic, page = TOPIC_AND_PAGE.get(node, ('markers', 'docs/ros.md'))
        print((module.__doc__ or '').strip(), HELP.format(node=node, topic=topic, page=page),
              sep='\n')
        return 0
    return module.main()


def _run_or_command(name: str) -> int:
    """Run a node, or the command of its name when the arguments are not those of a node."""
    arguments = sys.argv[1:]
    # Parameters without --ros-args are told of by the node.
    if arguments and arguments[0] not in ('--ros-args', *ASKS) and ':=' not in arguments[0]:
        return main([name, *arguments])
    if not ASKS & set(arguments):
        # Importing and preparing the hand take seconds.
        print(f'{name}: preparing the hand', flush=True)
    code = _run(name)
    if ASKS & set(arguments):
        print(f'Other arguments are those of the command: hand_tracker {name} --help')
    return code


def all_nodes() -> int:
    """Run several nodes in one process; return its exit code."""
    return _run('all')


def calibrate() -> int:
    """Run the node of the live calibration, or the command that fits; return the exit code."""
    return _run_or_command('calibrate')


def landmarks() -> int:
    """Run the node that publishes the hand as landmarks; return its exit code."""
    return _run('landmarks')


def managed_tracker() -> int:
    """Run the tracker as a managed node; return its exit code."""
    return _run('managed_tracker')


def mount() -> int:
    """Run the node that hangs the hand on a body; return its exit code."""
    return _run('mount')


def replay() -> int:
    """Run the replay node; return its exit code."""
    return _run('replay')


def retarget() -> int:
    """Run the node that drives a robot hand; return its exit code."""
    return _run('retarget')


def simulate() -> int:
    """Run the node of the simulated driver, or the command that records; return the exit code."""
    return _run_or_command('simulate')


def skin() -> int:
    """Run the node of the skin, or the command that draws it; return the exit code."""
    return _run_or_command('skin')


def source() -> int:
    """Run the node of a motion capture system; return its exit code."""
    return _run('source')


def teleoperate() -> int:
    """Run tracker and retarget node in one process; return its exit code."""
    return _run('teleoperate')


def tracker() -> int:
    """Run the tracker node; return its exit code."""
    return _run('tracker')


def viewer() -> int:
    """Run the viewer of a running tracker; return its exit code."""
    return _run('viewer')


NODES = {'all': all_nodes, 'calibrate': calibrate, 'landmarks': landmarks,
         'managed_tracker': managed_tracker, 'mount': mount, 'replay': replay,
         'retarget': retarget, 'simulate': simulate, 'skin': skin, 'source': source,
         'teleoperate': teleoperate, 'tracker': tracker, 'viewer': viewer}

if __name__ == '__main__':
    if sys.argv[1:2] == [] or sys.argv[1] not in NODES:
        sys.exit(f"expected one of the nodes {', '.join(NODES)}")
    sys.exit(NODES[sys.argv.pop(1)]())
