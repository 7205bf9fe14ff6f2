"""Several nodes in one process, between which messages do not leave it.

Names before --ros-args choose them: `all tracker source retarget`; without any they are tracker and
replay. A parameter reaches every node that has it, `-p NODE:PARAMETER:=VALUE` the one with this ROS
name (`hand_tracker` is the tracker's). Of replay, simulate and viewer, which have loops of their
own, one at most. See docs/ros.md.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from typing import Any

from rclpy.utilities import remove_ros_args

from .runner import run_together, spin, spinning

# Class of each node, by its program.
NODE_CLASSES = {
    'tracker': 'TrackerNode', 'replay': 'ReplayNode', 'simulate': 'SimulateNode',
    'source': 'SourceNode', 'landmarks': 'LandmarksNode', 'skin': 'SkinNode',
    'retarget': 'RetargetNode', 'mount': 'MountNode', 'viewer': 'ViewerNode'}
USUAL_NODES = 'tracker', 'replay'


def serve(*nodes: Any) -> None:
    """Serve nodes until interrupted, or until the loop of one, its method `play`, has ended."""
    for node in nodes:
        if hasattr(node, 'hand_over'):
            node.hand_over(one for other in nodes for one in getattr(other, 'inputs', ()))
    try:
        for node in nodes:
            if hasattr(node, 'play'):
                with spinning(*(other for other in nodes if other is not node)):
                    node.play()
                return
        spin(*nodes)
    finally:
        # What hands over has to end before that to which it does is destroyed.
        for node in nodes:
            if hasattr(node, 'end'):
                node.end()


def main(args: list[str] | None = None) -> int:
    """Run the nodes that are named until they are interrupted; return the exit code."""
    parser = argparse.ArgumentParser(
        prog='all', description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('nodes', nargs='*', metavar='NODE', help=', '.join(NODE_CLASSES))
    given = parser.parse_args(remove_ros_args(args)[1:] if args is None else args).nodes
    names = list(dict.fromkeys(given or USUAL_NODES))
    if unknown := [name for name in names if name not in NODE_CLASSES]:
        parser.error(f"'{unknown[0]}' is no node; expected {', '.join(NODE_CLASSES)}")
    classes = {name: getattr(import_module(f'.{name}_node', __package__), NODE_CLASSES[name])
               for name in names}
    leading = [name for name in names if hasattr(classes[name], 'play')]
    if len(leading) > 1:
        parser.error(f'{" and ".join(leading)}: each has a loop of its own; expected one at most')
    return run_together(classes, serve, args, ros_words_alone=False)


if __name__ == '__main__':
    sys.exit(main())
