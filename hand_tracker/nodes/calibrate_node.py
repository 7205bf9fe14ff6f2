"""Calibrate node: prompt a person how to move the hand, then fit a hand file to its markers.

It hears the markers as the tracker does, with the same parameters, shows how much of each movement
it has seen, and ends by itself. Its exit code is 0 with a hand file, 1 where the take is refused or
it is interrupted.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from ..calibration.calibrate_takes import calibrate_takes
from ..calibration.live_take import CALIBRATION_KEY, MAX_DURATION, Coverage, LiveTake
from ..calibration.prompts import PROMPTS
from ..calibration.takes import InvalidTake
from ..core.model.hand import Hand
from ..messages.builders import diagnostics
from ..messages.stamps import seconds
from ..output_files import YAML_SUFFIXES, OutputError, require_writable
from ..progress import Block, bar
from ..tracking.diagnostics import Level, Status
from ..tracking.input_monitor import InputMonitor
from ..tracking.side_check import SideCheck
from ..tracking.stream import FrameTime, read_or_warn
from .executors import steady_clock
from .parameters import Parameter
from .runner import POLL, declare, log_line, qos_of, run, spinning
from .serialization import Serialization
from .topic_publishers import who_publishes
from .tracker_parameters import (
    START,
    calibration_limits,
    live_settings,
    live_table,
    starting_hand,
    with_defaults,
)

SHOW_PERIOD = .25   # [s]
SHOWN_BAR = 24      # [characters]
STATUS_DEPTH = 10

# Those that the tracker has too and that say which markers are where on which hand.
MARKER_PARAMETERS = ('hand_file', 'side', 'limits.preset', 'mocap_frame',
                     'qos.markers.reliability', 'qos.markers.depth')
READING_PARAMETERS = ('labels.', 'unit_scale', 'zero_is_missing')
CALIBRATE_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    *(row for row in START if row.name in MARKER_PARAMETERS),
    *(row for row in live_table(Hand.scaled()) if row.name.startswith(READING_PARAMETERS)),
    Parameter('output', 'my_hand.yaml', 'Hand file to write; the picture goes beside it'),
    Parameter('max_duration', MAX_DURATION, 'After which a hand is fitted to what was shown, by '
              'the stamps, or once no marker comes any more [s]', range=(5., 3600.)),
))


class CalibrateNode(Node):
    """Node that collects a take and fits a hand to it."""

    def __init__(self) -> None:
        super().__init__('calibrate')
        values = declare(self, CALIBRATE_PARAMETERS)
        hand, layout = starting_hand(with_defaults(values))
        settings = live_settings(
            hand, {**{row.name: row.default for row in live_table(hand)}, **values})
        self._limits = calibration_limits(values)
        self._output = Path(values['output']).expanduser().absolute()
        require_writable(self._output, YAML_SUFFIXES)
        self._side = hand.side
        self._take = LiveTake(layout, hand.side, values['max_duration'])
        serialization = Serialization()
        self._reader = serialization.markers(settings, values['mocap_frame'])
        self._time = FrameTime()
        self._side_check: SideCheck | None = SideCheck(hand.side, layout.principal)
        self._topic = self.resolve_topic_name('markers')
        self._reliability = values['qos.markers.reliability']
        self._monitor = InputMonitor(time.monotonic(), self._topic, settings.labels)
        self._block = Block(sys.stdout) if sys.stdout.isatty() else None
        self._said = ''
        self._has_ended = Event()
        self._coverage = self._take.coverage()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', STATUS_DEPTH)
        self._subscription = self.create_subscription(
            MarkerArray, 'markers', self._on_markers, qos_of(values, 'markers'),
            raw=serialization.raw)
        self.create_timer(SHOW_PERIOD, self._show, clock=steady_clock())
        self.get_logger().info(f'{hand.side} hand: listening for markers on {self._topic}')

    def calibrate(self) -> None:
        """Collect the take, fit the hand and write it.

        Raises
        ------
        InvalidTake
            If the take is refused, or the node is interrupted.
        OutputError
            If the files cannot be written.
        """
        try:
            self._calibrate()
        except (KeyboardInterrupt, ExternalShutdownException):
            raise InvalidTake(f'interrupted: {self._output} is as it was, or without its '
                              'picture') from None

    def _calibrate(self) -> None:
        with spinning(self):
            while not self._has_ended.wait(POLL):
                if not rclpy.ok():
                    raise ExternalShutdownException
        for is_warning, line in self._take.end_lines(self._coverage):
            log_line(self, is_warning, line)
        self._publish(line, {})
        try:
            done = calibrate_takes([self._take.take()], self._output, self._limits)
        except OSError as error:
            raise OutputError(f'{self._output}: {error.strerror}') from None
        self._publish(done, {})
        self.get_logger().info(done)

    def _on_markers(self, message: Any) -> None:
        if self._has_ended.is_set():
            return
        received = time.monotonic()
        frame = read_or_warn(self._reader, message, self._monitor.received_unreadable)
        if frame is None:
            return
        self._monitor.received(received, frame)
        if frame.stamp is not None:
            at = self._time.of(frame.stamp, seconds(self._now()))
            self._take.add(frame.positions, at, received)
            self._check_side(frame.positions, at)

    def _check_side(self, positions: np.ndarray, at: float | None) -> None:
        """Tell of a hand of the other side, until it is seen to be of this one."""
        if self._side_check is not None and self._monitor.note_side(
                self._side, self._side_check.add_markers(positions, at)):
            self._side_check = None

    def _now(self) -> Any:
        return self.get_clock().now().to_msg()

    def _show(self) -> None:
        """Show how much is there; end where all is, or the time is over."""
        for is_warning, line in self._monitor.report(time.monotonic(), self._who_publishes):
            log_line(self, is_warning, line)
        if self._has_ended.is_set():
            return
        self._coverage = coverage = self._take.coverage()
        self._publish(self._monitor.side_fault() or coverage.text, coverage.values())
        if self._block is not None:
            self._block.draw(_coverage_block(coverage, self._take.seconds))
        elif coverage.text != self._said:
            self._said = coverage.text
            self.get_logger().info(coverage.text)
        if self._take.has_ended(coverage, time.monotonic()):
            self._has_ended.set()

    def _publish(self, text: str, shares: dict[str, str]) -> None:
        self._diagnostics.publish(diagnostics(
            self._now(), f'{self.get_name()}: {self._side} hand', self._topic,
            Status(Level.OK, text, {CALIBRATION_KEY: text, **shares})))

    def _who_publishes(self) -> str | None:
        return who_publishes(self.get_publishers_info_by_topic(self._topic), self._reliability)


def _coverage_block(coverage: Coverage, seconds: float) -> list[str]:
    """Return lines with a bar for each movement, and what to do next.

    Parameters
    ----------
    coverage : Coverage
    seconds : float
        Since the first frame [s].
    """
    width = max(len(prompt.name) for prompt in PROMPTS)
    lines = [f'{prompt.name:{width}s} {bar(share, SHOWN_BAR)}'
             for prompt, share in zip(PROMPTS, coverage.shares)]
    return [*lines, f'{seconds:4.0f} s  {coverage.text}']


def main(args: list[str] | None = None) -> int:
    """Run the calibrate node until the hand is written; return its exit code."""
    return run(CalibrateNode, CalibrateNode.calibrate, args, 'calibrate')


if __name__ == '__main__':
    sys.exit(main())
