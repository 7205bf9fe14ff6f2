"""The fastest executor of rclpy that is installed, and how to wake one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.timer import Timer

try:
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # before Jazzy
    EventsExecutor = None

AT_ONCE = 1e-9  # [s]


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
    return node.create_timer(AT_ONCE, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


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
