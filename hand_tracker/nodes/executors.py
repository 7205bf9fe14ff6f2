"""The fastest executor of rclpy that is installed, and how to wake one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

try:
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # before Jazzy
    EventsExecutor = None

AT_ONCE = 1e-9  # [s]


def steady_clock() -> Clock:
    """Return a clock for one timer: those of ROS time would stand still without /clock.

    Each timer has its own, as EventsExecutor prints a warning where one has many.
    """
    return Clock(clock_type=ClockType.STEADY_TIME)


def wake_timer(node: Node, callback: Callable[[], object]) -> Timer:
    """Return a timer of a node for waking its executor: due as soon as it is reset.

    Resetting a timer is what wakes an executor from another thread.

    Parameters
    ----------
    node : rclpy.node.Node
    callback : callable
        Called in the executor's thread, over and over until the timer is cancelled.

    Returns
    -------
    rclpy.timer.Timer
    """
    return node.create_timer(AT_ONCE, callback, clock=steady_clock())


class SubscriptionHidingNode(Node):
    """Node that hides the subscriptions of its fast path from executors.

    Executors have no other way to leave a subscription out: rclpy would set a callback of its own
    in place of the fast path's.
    """

    def hidden_subscriptions(self) -> Collection[Subscription]:
        """Return the subscriptions that the fast path serves now."""
        return ()

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions for executors to serve."""
        hidden = self.hidden_subscriptions()
        return (one for one in super().subscriptions if one not in hidden)


@contextmanager
def fastest_executor(*nodes: Node) -> Iterator[Any]:
    """Yield the fastest executor for nodes, with the nodes added.

    Parameters
    ----------
    *nodes : rclpy.node.Node
        The context manager `served_by_events` of each that has one is entered beside an
        EventsExecutor.
    """
    executor = SingleThreadedExecutor() if EventsExecutor is None else EventsExecutor()
    try:
        with ExitStack() as stack:
            for node in nodes:
                if EventsExecutor is not None and hasattr(node, 'served_by_events'):
                    stack.enter_context(node.served_by_events())
                executor.add_node(node)
            yield executor
    finally:
        executor.shutdown()
