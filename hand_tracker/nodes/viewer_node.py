"""The viewer node: the hand that a running tracker publishes, in the browser.

Before --ros-args it takes --host ADDRESS and --port PORT; the parameter `tracker` names the
tracker's node, whose constraints it switches, and `player` that of the recording's player,
which it pauses and speeds up by rosbag2's services, where there is one.
"""

from __future__ import annotations

import argparse
import sys

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from ..viewer.serve import add_page_options, view
from .live_tracker import LiveTracker
from .runner import run, spinning


def main(args: list[str] | None = None) -> int:
    """Serve the page until interrupted; return the exit code."""
    parser = argparse.ArgumentParser(prog='viewer', description=__doc__.split('\n')[0])
    add_page_options(parser)
    options = parser.parse_args(remove_ros_args(args)[1:] if args is None else args)

    def make() -> Node:
        node = Node('viewer')
        node.declare_parameter('tracker', 'hand_tracker')
        node.declare_parameter('player', 'replay')
        return node

    def work(node: Node) -> None:
        with spinning(node):
            tracker, player = (
                node.get_parameter(name).value for name in ('tracker', 'player'))
            view(LiveTracker(node, tracker, player), options)

    return run(make, work, args)


if __name__ == '__main__':
    sys.exit(main())
