"""The tracker as a managed node: it tracks only while it is active.

configure
    The hand files are loaded, again where the node was cleaned up before.
activate
    Markers are tracked and answered.
deactivate
    Markers are left out; the next activation goes on with the same hand.
cleanup
    The tracked state is dropped.

It activates itself at the start, unless the parameter `autostart` is false.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from ..core.errors import HandTrackerError
from .parameters import Parameter
from .runner import InvalidArguments, declare, run
from .tracker_node import TrackerNode

AUTOSTART = Parameter('autostart', True, 'Whether the node configures and activates itself at the '
                      'start', read_only=True)


class ManagedTracker(LifecycleNodeMixin, TrackerNode):
    """Tracker node with the states of design.ros2.org/articles/node_lifecycle.html."""

    def __init__(self) -> None:
        TrackerNode.__init__(self)
        # Its hands have just been made of their files.
        self._is_loaded, self._is_active = True, False
        autostart = declare(self, (AUTOSTART,))[AUTOSTART.name]
        self._set_active(False)
        LifecycleNodeMixin.__init__(self)
        # Else a transition that is not allowed in the present state ends the node (rclpy 7.1.6).
        service = self._service_change_state
        service.callback = partial(self._change_or_refuse, service.callback)
        if autostart and (self.trigger_configure() != TransitionCallbackReturn.SUCCESS
                          or self.trigger_activate() != TransitionCallbackReturn.SUCCESS):
            raise InvalidArguments('autostart: it could not be activated')

    def _change_or_refuse(self, change: Callable[[Any, Any], Any], request: Any,
                          response: Any) -> Any:
        try:
            return change(request, response)
        except RuntimeError:  # RCLError has no public name
            asked = request.transition.label or request.transition.id
            self.get_logger().warning(f'there is no transition {asked} from the present state')
            response.success = False
            return response

    def _set_active(self, is_active: bool) -> None:
        self._is_active = is_active
        for one in self.inputs:
            one.is_active = is_active
        self.disable_fast_path()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the hand files."""
        try:
            if not self._is_loaded:
                for hand in self.hands:
                    hand.services.reload()
        except HandTrackerError as error:
            self.get_logger().error(f'not configured: {error}')
            return TransitionCallbackReturn.FAILURE
        self._is_loaded = True
        self.get_logger().info('configured')
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track from the next message on."""
        for one in self.inputs:
            for hand in one.hands:
                # Nobody was to send anything meanwhile.
                hand.listen_to(one.topic)
        self._set_active(True)
        self.get_logger().info('active')
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track no more."""
        for one in self.inputs:
            one.drain()
        self._set_active(False)
        self.get_logger().info('inactive')
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Drop the tracked state."""
        for hand in self.hands:
            hand.reset()
        self._is_loaded = False
        self.get_logger().info('cleaned up')
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track no more, for good."""
        self._set_active(False)
        self.get_logger().info('shut down')
        return TransitionCallbackReturn.SUCCESS

    def _report(self) -> None:
        if self._is_active:
            super()._report()

    def _publish_status(self) -> None:
        if self._is_active:
            super()._publish_status()
            return
        for hand in self.hands:
            hand.publish_inactive()


def main(args: list[str] | None = None) -> int:
    """Run the managed tracker node until it is interrupted; return its exit code."""
    return run(ManagedTracker, args=args)


if __name__ == '__main__':
    sys.exit(main())
