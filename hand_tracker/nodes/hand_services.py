"""Services of the tracker that give it another hand: `~/calibrate` and `~/load_hand`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MarkerLayout
from ..tracking.live_calibration import LiveCalibration
from .tracker_parameters import AUTO, another_hand, require_no_size

if TYPE_CHECKING:
    from .tracker_node import TrackerNode


class HandServices:
    """Serve `~/calibrate` and `~/load_hand`.

    Parameters
    ----------
    node : TrackerNode
    start : mapping of str to object
        Value of each of `START` when the node started.
    side : {'right', 'left'}
    layout : MarkerLayout
        Of the markers that are worn.
    """

    def __init__(self, node: TrackerNode, start: Mapping[str, Any], side: str,
                 layout: MarkerLayout) -> None:
        self._node, self._start, self._side, self._layout = node, start, side, layout
        self._calibration = LiveCalibration()
        self._output = Path(start['calibration_file']).expanduser().absolute()
        node.create_service(Trigger, '~/calibrate', self._on_calibrate)
        node.create_service(Trigger, '~/load_hand', self._on_load_hand)

    def _on_calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        limits = self._start['limits.preset']
        try:
            require_no_size(self._start, str(self._output))
            self._calibration.start(
                self._layout, self._side, 'paper' if limits == AUTO else limits, self._output)
        except HandTrackerError as error:
            response.message = str(error)
            return response
        self._node.collect(self._calibration.take)
        response.success = True
        response.message = (f'the hand will be written to {self._output}; /diagnostics tells what '
                            'to do')
        self._node.get_logger().info(f'calibration: {response.message}')
        return response

    def _on_load_hand(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message = self._load(self._node.get_parameter('hand_file').value)
            response.success = True
        except HandTrackerError as error:
            response.message = str(error)
        return response

    def _load(self, path: str) -> str:
        """Have the hand of a file tracked; return what to say of it."""
        hand, self._layout = another_hand(self._start, path, self._side)
        self._node.replace_hand(hand, self._layout)
        said = f'the hand of {path} is tracked from the next frame on'
        self._node.get_logger().info(said)
        return said

    def update(self) -> bool:
        """Go on with a calibration, a few times a second; return whether it has changed."""
        is_collecting, before = self._calibration.take is not None, self.progress()
        written = self._calibration.update()
        if is_collecting and self._calibration.take is None:
            self._node.collect(None)
        if written is not None:
            self._node.set_parameters([Parameter('hand_file', value=str(written))])
            try:
                self._load(str(written))
            except HandTrackerError as error:
                self._node.get_logger().error(f'calibration: {error}')
        return self.progress() != before

    def news(self) -> list[tuple[bool, str]]:
        """Return the lines to log, see `LiveCalibration.news`."""
        return self._calibration.news()

    def progress(self) -> dict[str, str]:
        """Return the calibration's values for /diagnostics, see `LiveCalibration.values`."""
        return self._calibration.values()

    def stop(self) -> None:
        """End what runs."""
        self._calibration.stop()
