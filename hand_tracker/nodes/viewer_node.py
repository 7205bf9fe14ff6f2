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

from ..viewer.page_options import add_page_options
from ..viewer.serve import view
from .live_tracker import LiveTracker
from .runner import run, spinning


class ViewerNode(Node):
    """Node that shows what a tracker publishes.

    Parameters
    ----------
    options : argparse.Namespace, optional
        Of the page; their defaults when left out.
    """

    def __init__(self, options: argparse.Namespace | None = None) -> None:
        super().__init__('viewer')
        self._options = page_options([]) if options is None else options
        self._names = [self.declare_parameter(name, default).value for name, default in (
            ('tracker', 'hand_tracker'), ('player', 'replay'))]

    def play(self) -> None:
        """Serve the page until interrupted."""
        with spinning(self):
            view(LiveTracker(self, *self._names), self._options)


def page_options(arguments: list[str]) -> argparse.Namespace:
    """Return the options of the page that a command line gives."""
    parser = argparse.ArgumentParser(prog='viewer', description=(__doc__ or '').split('\n')[0])
    add_page_options(parser)
    return parser.parse_args(arguments)


def main(args: list[str] | None = None) -> int:
    """Serve the page until interrupted; return the exit code."""
    options = page_options(remove_ros_args(args)[1:] if args is None else args)
    return run(lambda: ViewerNode(options), ViewerNode.play, args, 'viewer', ros_words_alone=False)


if __name__ == '__main__':
    sys.exit(main())
