"""Services of the tracker for another hand: `~/calibrate`, `~/load_hand` and `~/reset`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MarkerLayout
from ..files.hand_file import file_notes
from ..tracking.live_calibration import LiveCalibration
from .tracker_parameters import (
    InvalidParameter,
    another_hand,
    calibration_limits,
    require_no_size,
)

if TYPE_CHECKING:
    from .tracked_hand import TrackedHand


class HandServices:
    """Serve `~/calibrate`, `~/load_hand`, `~/reset`; of both hands `~/right/calibrate` and so on.

    Parameters
    ----------
    node : rclpy.node.Node
    hand : TrackedHand
    start : mapping of str to object
        Value of each of `START` when the node started, for this hand.
    layout : MarkerLayout
        Of the markers that are worn.
    scope, topics : str
        Before the name of its parameter and of its services: both empty, or 'right.' and
        'right/'.
    """

    def __init__(self, node: Node, hand: TrackedHand, start: Mapping[str, Any],
                 layout: MarkerLayout, scope: str, topics: str) -> None:
        self._node, self._hand, self._start, self._layout = node, hand, start, layout
        self._side, self._file_parameter = hand.hand.side, f'{scope}hand_file'
        self._calibration = LiveCalibration()
        self._output = Path(start['calibration_file']).expanduser().absolute()
        node.create_service(Trigger, f'~/{topics}calibrate', self._on_calibrate)
        node.create_service(Trigger, f'~/{topics}load_hand', self._on_load_hand)
        node.create_service(Trigger, f'~/{topics}reset', self._on_reset)

    def _on_calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            require_no_size(self._start, str(self._output))
            self._calibration.start(
                self._layout, self._side, calibration_limits(self._start), self._output)
        except HandTrackerError as error:
            response.message = str(error)
            return response
        self._hand.collect(self._calibration.take)
        response.success = True
        response.message = (f'the hand will be written to {self._output}; /diagnostics tells what '
                            'to do')
        self._node.get_logger().info(f'calibration: {response.message}')
        return response

    def _on_load_hand(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message = self._load(self._hand_file)
            response.success = True
        except HandTrackerError as error:
            response.message = str(error)
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        was_calibrating = self._calibration.is_running
        self._hand.reset()
        response.success = True
        response.message = f'the {self._side} hand is tracked as if no frame had come yet' + (
            ', of the size that is given' if self._hand.stream.size == 'given' else '') + (
            '; the calibration is cancelled' if was_calibrating else '')
        self._node.get_logger().info(response.message)
        return response

    def _load(self, path: str) -> str:
        """Switch the tracker to the hand of a file; return the message for user and log."""
        if not path:
            raise InvalidParameter(
                f"{self._file_parameter}: ''; expected a hand file to load, as by ros2 param set "
                f'{self._node.get_fully_qualified_name()} {self._file_parameter} '
                '/path/my_hand.yaml')
        hand, layout = another_hand(self._start, path, self._side)
        if layout.names != self._layout.names:
            raise InvalidParameter(f'hand_file: {path}: {len(layout.names)} markers; expected the '
                                   f'{len(self._layout.names)} that labels.* name')
        self._layout = layout
        self._hand.replace_hand(hand, layout)
        said = f'the {hand.side} hand of {path} is tracked from the next frame on'
        said = '; '.join((said, *file_notes(
            Path(path).expanduser(), hand.side, self._start['layout'])))
        self._node.get_logger().info(said)
        return said

    def reload(self) -> None:
        """Track the hand of the hand file as it is now, where there is one.

        Raises
        ------
        HandTrackerError
        """
        if self._hand_file:
            self._load(self._hand_file)

    @property
    def _hand_file(self) -> str:
        """The hand file as it is set now: this hand's own, else that of both hands."""
        return str(self._node.get_parameter(self._file_parameter).value
                   or self._node.get_parameter('hand_file').value)

    def update(self) -> bool:
        """Go on with a calibration, a few times a second; return whether its progress changed."""
        is_collecting, before = self._calibration.take is not None, self.progress()
        written = self._calibration.update(time.monotonic())
        if is_collecting and self._calibration.take is None:
            self._hand.collect(None)
        if written is not None:
            self._node.set_parameters([Parameter(self._file_parameter, value=str(written))])
            try:
                self._load(str(written))
            except HandTrackerError as error:
                self._node.get_logger().error(f'calibration: {error}')
        return self.progress() != before

    def pop_log_lines(self) -> list[tuple[bool, str]]:
        """Return the lines to log, see `LiveCalibration.pop_log_lines`."""
        return self._calibration.pop_log_lines()

    def progress(self) -> dict[str, str]:
        """Return the calibration's values for /diagnostics, see `LiveCalibration.values`."""
        return self._calibration.values()

    def stop(self) -> None:
        """Cancel the calibration that runs."""
        self._calibration.stop()
        self._hand.collect(None)
