"""The fastest executor of rclpy that is installed, and how to wake one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
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
def fastest_executor(node: Node) -> Iterator[Any]:
    """Yield the fastest executor for a node, with the node added.

    Parameters
    ----------
    node : rclpy.node.Node
        Its context manager `served_by_events`, if it has one, is entered beside an EventsExecutor.
    """
    if EventsExecutor is None:
        executor, serving = SingleThreadedExecutor(), nullcontext
    else:
        executor = EventsExecutor()
        serving = getattr(node, 'served_by_events', nullcontext)
    try:
        with serving():
            executor.add_node(node)
            yield executor
    finally:
        executor.shutdown()
