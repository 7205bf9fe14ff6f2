"""`hand_tracker demo`: replay and tracker as processes, listened to over ROS topics.

Both nodes run as they do for a user; this program only listens, and leaves what it received
as an animated GIF, a contact sheet and a table of the angles.
"""

from __future__ import annotations

import argparse
import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..core.errors import HandTrackerError
from ..core.inverse_kinematics.palm import place_palm
from ..core.model.hand import Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import PALM_MARKERS, MarkerLayout, marker_positions
from ..core.model.skeleton import skeleton_points
from ..core.numerics.jit import DEFERRED
from ..drawing.animation import HandMotion, save_animation, save_sheet
from ..files.angle_table import write_angle_table
from ..files.bags import open_bag
from ..files.hand_file import choose_hand
from ..messages.labels import DEFAULT_LABELS, LabelMap
from ..messages.marker_array import markers_from_message
from ..messages.stamps import nanoseconds
from ..package_data import packaged_recording
from ..tracking.recording import USUAL_TOPIC, marker_topic
from ..viewer.recording_source import ViewerRecording
from ..viewer.serve import add_page_options, view
from .recording_options import add_hand_options

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

LINE_EVERY = .5  # [s] between live lines
LAG = .5         # [s] for the last messages to arrive
PALM_MARKER_COUNT = len(PALM_MARKERS)


class ReceivedFrames(NamedTuple):
    """Frames of which both the markers and the joint state arrived.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        [ns]
    angles : ndarray, shape (n, 25)
        [rad]
    markers : ndarray, shape (n, 8, 3)
        In the wrist's frame [m].
    places : ndarray, shape (n, 8, 3)
        Of the markers on the tracked hand, in the wrist's frame [m].
    """

    stamps: np.ndarray
    angles: np.ndarray
    markers: np.ndarray
    places: np.ndarray


class Listener:
    """Collect the messages of the nodes."""

    def __init__(self, node: Node) -> None:
        self.joints: Sequence[str] = ()
        self.transforms = 0
        self.latencies: list[float] = []  # [s]
        self._markers: dict[int, np.ndarray] = {}  # by stamp [ns]
        self._angles: dict[int, Sequence[float]] = {}
        self._labels = LabelMap(DEFAULT_LABELS)
        quick = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        node.create_subscription(MarkerArray, 'markers', self._on_markers, quick)
        node.create_subscription(JointState, 'joint_states', self._on_angles, 100)
        if TFMessage is not None:
            # Only counted: as bytes they cost this listener nothing.
            node.create_subscription(TFMessage, '/tf', self._on_transforms, 100, raw=True)

    def _on_markers(self, message: MarkerArray) -> None:
        frame = markers_from_message(message, self._labels)
        if frame.stamp is not None:
            self._markers[nanoseconds(frame.stamp)] = frame.positions

    def _on_angles(self, message: JointState) -> None:
        stamp = nanoseconds(message.header.stamp)
        # The replay stamps a frame with the time at which it is due.
        self.latencies.append(1e-9 * (time.time_ns() - stamp))
        self.joints = message.name
        self._angles[stamp] = message.position

    def _on_transforms(self, _: object) -> None:
        self.transforms += 1

    @property
    def counts(self) -> tuple[int, int]:
        """Return the numbers of received frames of markers and of joint states."""
        return len(self._markers), len(self._angles)

    def received_frames(self, hand: Hand, layout: MarkerLayout,
                        recent: int | None = None) -> ReceivedFrames:
        """Return the last so many whole frames, or all, with the palm fitted to its markers."""
        stamps = [stamp for stamp in self._angles if stamp in self._markers]
        stamps = stamps if recent is None else stamps[-recent:]
        angles = np.array([self._angles[stamp] for stamp in stamps]).reshape(-1, 25)
        mounting = layout.mounting(hand)
        template = mounting.position[:PALM_MARKER_COUNT]
        # Nothing is known of the palm before its markers were all seen.
        rotation, position, roots = np.eye(3), np.full(3, np.nan), np.zeros((5, 3))
        markers = np.empty((len(stamps), len(template) + 5, 3))
        for stamp, local in zip(stamps, markers):
            frame = self._markers[stamp]
            if np.isfinite(frame[:PALM_MARKER_COUNT]).all():
                place_palm(frame[:PALM_MARKER_COUNT], template, False, rotation, position, roots)
            local[:] = (frame - position) @ rotation
        places = marker_positions(mounting, forward(joint_table(hand), angles))
        return ReceivedFrames(np.array(stamps, dtype=np.int64), angles, markers, places)

    def line(self, hand: Hand, layout: MarkerLayout, rate: float) -> str:
        """Return a line on the last second at a rate [Hz]."""
        received = self.received_frames(hand, layout, max(2, round(rate)))
        if len(received.stamps) < 2:
            return 'waiting for the first frames'
        seen = np.isfinite(received.markers[-1]).all(axis=1)
        return (f'{(len(received.stamps) - 1) / np.ptp(received.stamps) * 1e9:6.1f} Hz   '
                f'{_summary(self.latencies[-len(received.stamps):], received)}   markers seen '
                f'{seen.sum()} of {len(seen)}')


def _summary(latencies: Sequence[float], received: ReceivedFrames) -> str:
    misses = np.linalg.norm(received.places - received.markers, axis=2)
    p50, p99 = 1e3 * np.percentile(latencies, (50, 99))
    return (f'latency p50 {p50:.2f} ms, p99 {p99:.2f} ms   '
            f'residual {1e3 * np.nanmean(misses):.2f} mm')


def _start(node: str, **parameters: object) -> subprocess.Popen[bytes]:
    """Start one of the package's nodes in a process of its own."""
    settings = [word for name, value in parameters.items() if value not in (None, '')
                for word in ('-p', f'{name}:={value}')]
    return subprocess.Popen(
        [sys.executable, '-m', 'hand_tracker.entry', node, '--ros-args', *settings])


def _stop(process: subprocess.Popen[bytes]) -> int:
    """End a node as Ctrl-C does; return its exit code."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(10.)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def _play(node: Node, listener: Listener, hand: Hand, layout: MarkerLayout, recording: str | Path,
          options: argparse.Namespace, processes: list[subprocess.Popen[bytes]]) -> None:
    """Run both nodes until the recording ends."""
    presets = {f'{name}.preset': value for name, value in (
        ('limits', options.limits), ('coupling', options.coupling)) if value}
    print('Starting the tracker ...', flush=True)
    # What is received is compared with the hand that is given here, the recording's.
    tracker = _start('tracker', hand_file=options.hand, side=options.side, broadcast='all',
                     auto_size='false', **presets)
    processes.append(tracker)
    # However long it takes on a busy machine.
    while not node.count_publishers('joint_states'):
        if tracker.poll() is not None:
            raise HandTrackerError('the tracker did not start; see its message above')
        rclpy.spin_once(node, timeout_sec=.1)
    # Where kernels are on disk they load now, not while frames wait.
    mounting = layout.mounting(hand)
    rest = marker_positions(mounting, forward(joint_table(hand), np.zeros(25)))
    palm = rest[:PALM_MARKER_COUNT]
    place_palm(palm, palm, False, np.eye(3), np.zeros(3), np.zeros((5, 3)))
    # Two wait for the first frame: the tracker and this listener.
    replay = _start('replay', recording=recording, rate=float(options.rate), subscribers=2)
    processes.append(replay)
    due = time.monotonic()
    end: float | None = None
    is_terminal = sys.stdout.isatty()
    waiting = ''
    while end is None or time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=.05)
        if end is None and (replay.poll() is not None or tracker.poll() is not None):
            end = time.monotonic() + LAG
        if end is None and time.monotonic() >= due:
            due += LINE_EVERY
            text = listener.line(hand, layout, 120.)
            if is_terminal:
                print(f'\r{text}', end='', flush=True)
            elif text != waiting:
                print(text, flush=True)
            waiting = text
    print()
    if replay.returncode or tracker.poll() is not None:
        ended = 'replay' if replay.returncode else 'tracker'
        raise HandTrackerError(f'the {ended} ended early; see its message above')


def _save(listener: Listener, hand: Hand, layout: MarkerLayout, output: Path) -> None:
    """Write what was received."""
    received = listener.received_frames(hand, layout)
    if len(received.stamps) < 2:
        raise HandTrackerError('no frame arrived: are there eight labelled markers on /markers?')
    frames, states = listener.counts
    print(f'{frames} frames of markers in, {states} joint states'
          + (f' and {listener.transforms} messages on /tf' if TFMessage else '') + ' out; '
          + _summary(listener.latencies, received), flush=True)
    if states < frames and DEFERRED:
        print('The others were left out, as plain Python tracks until the kernels are compiled: '
              'once, on the first start.')
    seconds = 1e-9 * (received.stamps - received.stamps[0])
    write_angle_table(output / 'angles.csv', listener.joints,
                      ((time_s, row, ()) for time_s, row in zip(seconds, received.angles)))
    points = skeleton_points(
        tip_offsets(hand), forward(joint_table(hand), received.angles),
        np.zeros((len(seconds), 3)))
    seen = np.isfinite(received.markers).all(axis=2)
    markers = np.where(seen[..., None], received.markers, received.places)
    motion = HandMotion(seconds, points, markers, seen)
    title = f'{hand.side} hand, tracked over ROS 2'
    save_sheet(output / 'hand.png', motion, hand, title)
    print('Drawing the animation ...', flush=True)
    save_animation(output / 'hand.gif', motion, hand, title)
    for name, what in (('hand.gif', 'the tracked hand in motion'),
                       ('hand.png', 'poses in time, from above and from the thumb'),
                       ('angles.csv', 'the 25 joint angles of every frame, in degrees')):
        print(f'  {output / name}: {what}')


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='hand_tracker demo', description=__doc__.split('\n')[0])
    parser.add_argument('--recording',
                        help='rosbag2 recording to play, with markers of ids 0 to 7 on /markers '
                        '(default: the packaged one of the side)')
    add_hand_options(parser)
    parser.add_argument('--rate', type=float, default=1., help='speed of the replay (default: 1)')
    parser.add_argument('--output', type=Path, default=Path('demo_output'),
                        help='folder for the pictures and the table (default: demo_output)')
    parser.add_argument('--view', action='store_true',
                        help='instead of all that, show the hand in the browser')
    add_page_options(parser)
    return parser.parse_args(args)


def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit code."""
    options = _parse(args)
    processes: list[subprocess.Popen[bytes]] = []
    # A closing terminal or a killed script ends the nodes too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        hand, layout = choose_hand(options.hand, options.side, options.limits, options.coupling)
        recording = options.recording or packaged_recording(hand.side)
        if options.view:
            view(ViewerRecording(recording, hand, layout), options)
            return 0
        # Before the tracker compiles, and the recording is played.
        with open_bag(recording) as bag:
            marker_topic(bag, USUAL_TOPIC)
        options.output.mkdir(parents=True, exist_ok=True)
        if not os.access(options.output, os.W_OK):
            raise PermissionError(errno.EACCES, 'no permission to write there', options.output)
        rclpy.init()
        node = rclpy.create_node('demo')
        listener = Listener(node)
        _play(node, listener, hand, layout, recording, options, processes)
        codes = [_stop(process) for process in processes]
        _save(listener, hand, layout, options.output)
        if any(codes):
            raise HandTrackerError(f'tracker and replay ended with exit codes {codes}')
    except (HandTrackerError, OSError) as error:
        print(f'hand_tracker demo: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print()
        return 130
    finally:
        for process in processes:
            _stop(process)
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
