"""The viewer's node as it is while somebody looks, without a browser: for `security.policies`."""

import sys
import time

import rclpy

from hand_tracker.nodes.live_tracker import LiveTracker
from hand_tracker.nodes.runner import spinning

VIEWER_POLL = .1  # [s]


def main():
    """Listen to all that the page can show, until killed."""
    rclpy.init()
    node = rclpy.create_node('viewer')
    with spinning(node):
        live = LiveTracker(node)
        live.prepare(print)
        for one in (live, live.beside):
            if one is not None:
                one.set_demand(looked_at=True, compared=True)
        while rclpy.ok():
            time.sleep(VIEWER_POLL)
    return 0


if __name__ == '__main__':
    sys.exit(main())
