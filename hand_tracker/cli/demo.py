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
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, SIDES, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import (
    MARKERS,
    PALM_MARKERS,
    MarkerLayout,
    marker_positions,
)
from ..core.model.palm_triangle import fit_wrist
from ..core.model.skeleton import skeleton_points
from ..core.numerics.jit import DEFERRED
from ..drawing.animation import HandMotion, save_animation, save_sheet
from ..files.angle_table import write_angle_table
from ..files.bags import write_bag
from ..files.hand_file import choose_hand, save_hand
from ..files.layout_file import save_layout
from ..messages.builders import prefixed_names
from ..messages.labels import LabelMap, default_labels, label_maps
from ..messages.marker_array import markers_from_message
from ..messages.stamps import nanoseconds
from ..package_data import packaged_recording
from ..simulation.ball_grasp import grasp_recording
from ..simulation.packaged_recordings import recording_messages
from ..tracking.opened_recording import PointBag, open_recording
from ..tracking.recording import USUAL_TOPIC, MarkerReading, marker_topic
from ..viewer.recording_source import ViewerRecording
from ..viewer.robot_scene import PLAIN_ROBOT, chosen_robot
from ..viewer.serve import add_page_options, view
from .demo_grasp import GraspingRobot
from .demo_robot import DrivenRobot
from .recording_options import (
    add_hand_options,
    add_layout_option,
    add_reading_options,
    label_map,
    recorded_hand,
    recorded_notes,
    require_bag_of_both,
)

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

LINE_EVERY = .5  # [s] between live lines
LAG = .5         # [s] for the last messages to arrive


class ReceivedFrames(NamedTuple):
    """Frames of which both the markers and the joint state arrived.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        [ns]
    angles : ndarray, shape (n, 25)
        [rad]
    markers : ndarray, shape (n, m, 3)
        In the wrist's frame [m].
    places : ndarray, shape (n, m, 3)
        Of the markers on the tracked hand, in the wrist's frame [m].
    """

    stamps: np.ndarray
    angles: np.ndarray
    markers: np.ndarray
    places: np.ndarray


class ReceivedHand:
    """Markers and joint states of one hand, as they were received.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    labels : LabelMap
    """

    def __init__(self, hand: Hand, layout: MarkerLayout, labels: LabelMap) -> None:
        self.hand, self.layout, self.labels = hand, layout, labels
        self.joints = prefixed_names(f'{hand.side}_').joints
        self.markers: dict[int, np.ndarray] = {}  # by stamp [ns]
        self.angles: dict[int, Sequence[float]] = {}

    @property
    def palm_rows(self) -> list[int]:
        """Rows of the three principal markers of the palm."""
        return list(self.layout.principal[:len(PALM_MARKERS)])

    def received_frames(self, recent: float | None = None) -> ReceivedFrames:
        """Return the whole frames of the last so many seconds, or all, with the palm fitted."""
        stamps = [stamp for stamp in self.angles if stamp in self.markers]
        if recent is not None and stamps:
            stamps = [stamp for stamp in stamps if stamp > stamps[-1] - 1e9 * recent]
        angles = np.array([self.angles[stamp] for stamp in stamps]).reshape(-1, 25)
        palm = self.palm_rows
        template = self.layout.principal_mounting(self.hand).position[:len(palm)]
        # Nothing is known of the palm before its markers were all seen.
        rotation, position = np.eye(3), np.full(3, np.nan)
        markers = np.empty((len(stamps), len(self.layout.names), 3))
        for stamp, local in zip(stamps, markers):
            frame = self.markers[stamp]
            if np.isfinite(frame[palm]).all():
                fit_wrist(frame[palm], template, rotation, position)
            local[:] = (frame - position) @ rotation
        places = marker_positions(
            self.layout.mounting(self.hand), forward(joint_table(self.hand), angles))
        return ReceivedFrames(np.array(stamps, dtype=np.int64), angles, markers, places)


class Listener:
    """Collect the messages of the nodes.

    Parameters
    ----------
    node : rclpy.node.Node
    hands : sequence of ReceivedHand
    """

    def __init__(self, node: Node, hands: Sequence[ReceivedHand]) -> None:
        self.hands = hands
        self.transforms = 0
        self.latencies: list[float] = []  # [s]
        self._frames: set[int] = set()    # stamps of markers [ns]
        quick = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        node.create_subscription(MarkerArray, 'markers', self._on_markers, quick)
        node.create_subscription(JointState, 'joint_states', self._on_angles, 100)
        if TFMessage is not None:
            # Only counted: as bytes they cost this listener nothing.
            node.create_subscription(TFMessage, '/tf', self._on_transforms, 100, raw=True)

    def _on_markers(self, message: MarkerArray) -> None:
        for hand in self.hands:
            frame = markers_from_message(message, hand.labels)
            if frame.stamp is not None:
                stamp = nanoseconds(frame.stamp)
                hand.markers[stamp] = frame.positions
                self._frames.add(stamp)

    def _on_angles(self, message: JointState) -> None:
        stamp = nanoseconds(message.header.stamp)
        # The replay stamps a frame with the time at which it is due.
        self.latencies.append(1e-9 * (time.time_ns() - stamp))
        for hand in self.hands:
            if hand.joints[0] in message.name:
                first = message.name.index(hand.joints[0])
                hand.angles[stamp] = message.position[first:first + len(hand.joints)]

    def _on_transforms(self, _: object) -> None:
        self.transforms += 1

    @property
    def counts(self) -> tuple[int, int]:
        """Return the numbers of received frames of markers and of joint states."""
        return len(self._frames), len(self.latencies)

    def line(self) -> str:
        """Return a line on the last second of frames."""
        received = [hand.received_frames(1.) for hand in self.hands]
        if min(len(one.stamps) for one in received) < 2:
            return 'waiting for the first frames'
        stamps = received[0].stamps
        seen = np.concatenate([np.isfinite(one.markers[-1]).all(axis=1) for one in received])
        return (f'{(len(stamps) - 1) / np.ptp(stamps) * 1e9:6.1f} Hz   '
                f'{_summary(self.latencies[-len(stamps):], received)}   markers seen '
                f'{seen.sum()} of {len(seen)}')


def _summary(latencies: Sequence[float], received: Sequence[ReceivedFrames]) -> str:
    misses = np.concatenate([np.linalg.norm(one.places - one.markers, axis=2)
                             for one in received])
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


def _play(node: Node, listener: Listener, options: argparse.Namespace,
          processes: list[subprocess.Popen[bytes]], robot: DrivenRobot | None) -> None:
    """Run the nodes until the recording ends."""
    presets = {f'{name}.preset': value for name, value in (
        ('limits', options.limits), ('coupling', options.coupling)) if value}
    print('Starting the tracker ...', flush=True)
    # What is received is compared with the hand that is given here, the recording's.
    first = listener.hands[0]
    side = first.hand.side if len(listener.hands) == 1 else BOTH
    tracker = _start('tracker', hand_file=options.hand, layout=options.layout, side=side,
                     broadcast='all', auto_size='false', **presets)
    processes.append(tracker)
    if robot is not None:
        processes.append(_start('retarget', robot=options.robot, hand_file=options.hand, side=side,
                                robot_description=options.robot_description))
    # However long it takes on a busy machine.
    while not node.count_publishers('joint_states') or robot and not robot.is_ready:
        for process, name in zip(processes, ('tracker', 'retarget node')):
            if process.poll() is not None:
                raise HandTrackerError(f'the {name} did not start; see its message above')
        rclpy.spin_once(node, timeout_sec=.1)
    # Where kernels are on disk they load now, not while frames wait.
    rest = marker_positions(
        first.layout.mounting(first.hand), forward(joint_table(first.hand), np.zeros(25)))
    palm = rest[first.palm_rows]
    fit_wrist(palm, palm, np.eye(3), np.zeros(3))
    # Those who wait for the first frame: the tracker and this listener.
    replay = _start('replay', recording=options.recording, rate=float(options.rate), subscribers=2,
                    side='' if side == BOTH else side, markers=','.join(options.markers),
                    layout=options.layout, units=options.units, up=options.up,
                    handed=options.handed, partial=options.partial)
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
            text = listener.line()
            if is_terminal:
                print(f'\r{text}', end='', flush=True)
            elif text != waiting:
                print(text, flush=True)
            waiting = text
    print()
    if replay.returncode or tracker.poll() is not None:
        ended = 'replay' if replay.returncode else 'tracker'
        raise HandTrackerError(f'the {ended} ended early; see its message above')


def _save(listener: Listener, output: Path, robot: DrivenRobot | None) -> None:
    """Write the received messages."""
    received = [hand.received_frames() for hand in listener.hands]
    if min(len(one.stamps) for one in received) < 2:
        raise HandTrackerError('no frame arrived: are there labelled markers of each hand on '
                               '/markers?')
    frames, states = listener.counts
    print(f'{frames} frames of markers in, {states} joint states'
          + (f' and {listener.transforms} messages on /tf' if TFMessage else '') + ' out; '
          + _summary(listener.latencies, received), flush=True)
    if states < frames and DEFERRED:
        print('The others were left out, as plain Python tracks until the kernels are compiled: '
              'once, on the first start.')
    start = min(one.stamps[0] for one in received)
    write_angle_table(output / 'angles.csv', [
        joint for hand in listener.hands for joint in hand.joints], _rows(received, start))
    motions = [_motion(hand.hand, one, start) for hand, one in zip(listener.hands, received)]
    for motion, hand in motions:
        name = 'hand.png' if len(motions) == 1 else f'{hand.side}_hand.png'
        save_sheet(output / name, motion, hand, f'{hand.side} hand, tracked over ROS 2')
        print(f'  {output / name}: poses in time, from above and from the thumb')
    print('Drawing the animation ...', flush=True)
    (motion, hand), *others = motions
    title = 'both hands' if others else f'{hand.side} hand'
    save_animation(output / 'hand.gif', motion, hand, f'{title}, tracked over ROS 2', others)
    for name, what in (('hand.gif', f"the tracked {'hands' if others else 'hand'} in motion"),
                       ('angles.csv', f'the {25 * len(motions)} joint angles of every frame, in '
                        'degrees')):
        print(f'  {output / name}: {what}')
    if robot is not None:
        (one,) = received
        robot.save(output, hand, one.stamps, one.angles)


def _rows(received: Sequence[ReceivedFrames],
          start: int) -> Iterator[tuple[float, np.ndarray, Sequence[float]]]:
    """Yield the rows of the table: time [s] and the angles of all hands, NaN of one not tracked."""
    by_stamp = [dict(zip(one.stamps.tolist(), one.angles)) for one in received]
    unknown = np.full(25, np.nan)
    for stamp in sorted(set().union(*by_stamp)):
        yield 1e-9 * (stamp - start), np.concatenate(
            [angles.get(stamp, unknown) for angles in by_stamp]), ()


def _motion(hand: Hand, received: ReceivedFrames, start: int) -> tuple[HandMotion, Hand]:
    """Return a hand as it is drawn, in times since the start [ns]."""
    seconds = 1e-9 * (received.stamps - start)
    points = skeleton_points(
        tip_offsets(hand), forward(joint_table(hand), received.angles),
        np.zeros((len(seconds), 3)))
    seen = np.isfinite(received.markers).all(axis=2)
    markers = np.where(seen[..., None], received.markers, received.places)
    return HandMotion(seconds, points, markers, seen), hand


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='hand_tracker demo', description=__doc__.split('\n')[0])
    parser.add_argument('--recording', type=Path,
                        help='recording to play: rosbag2 with markers of ids from 0 on /markers, '
                        'those of both hands in namespaces right and left; or C3D, TRC, TSV, CSV, '
                        'BVH, npz of one hand (default: the packaged one of the side)')
    add_hand_options(parser, both=True)
    add_layout_option(parser)
    parser.add_argument('--markers', action='append', default=[], metavar='MARKER=LABEL,...',
                        help='which point of a file is which marker')
    add_reading_options(parser)
    parser.add_argument('--rate', type=float, default=1., help='speed of the replay (default: 1)')
    parser.add_argument('--output', type=Path, default=Path('demo_output'),
                        help='folder for the pictures and the table (default: demo_output)')
    parser.add_argument('--grasp', action='store_true',
                        help='instead of a recording, a hand that grasps a ball: the plain robot '
                        'hand follows it in MuJoCo (pip install mujoco)')
    parser.add_argument('--view', action='store_true',
                        help='instead of all that, show the hand in the browser')
    add_page_options(parser)
    return parser.parse_args(args)


def _hands(options: argparse.Namespace) -> tuple[list[ReceivedHand], Path | PointBag]:
    """Return the hand that the options ask for, or both, and the recording.

    Where the options name no recording, the packaged one is noted there.
    """
    if options.grasp:
        return [_grasping_hand(options)], options.recording
    if options.recording is None:
        side = options.side or choose_hand(options.hand)[0].side
        options.recording = packaged_recording(side)
    if options.side != BOTH:
        hand, layout, recording = recorded_hand(options)
        return [ReceivedHand(hand, layout, label_map((), layout.names))], recording
    require_bag_of_both(options.recording)
    chosen = {side: choose_hand(options.hand, side, options.limits, options.coupling,
                                options.layout) for side in SIDES}
    names = chosen[SIDES[0]][1].names
    labels = label_maps(default_labels(names), {side: f'{side}/0' for side in SIDES}, names)
    return [ReceivedHand(*chosen[side], labels[side]) for side in SIDES], options.recording


def _grasping_hand(options: argparse.Namespace) -> ReceivedHand:
    """Write the recording of a hand that grasps, and return the hand."""
    for name, allowed in (('recording', (None,)), ('side', (None, 'right')), ('hand', (None,)),
                          ('robot', ('', PLAIN_ROBOT)), ('rate', (1.,)), ('view', (False,))):
        if getattr(options, name) not in allowed:
            raise HandTrackerError(f'--grasp: leave out --{name}; it has the mean right hand and '
                                   'the plain robot hand')
    hand, layout = choose_hand(None, 'right', options.limits, options.coupling)
    options.robot = PLAIN_ROBOT
    options.output.mkdir(parents=True, exist_ok=True)
    options.recording = options.output / 'grasp.mcap'
    write_bag(options.recording, recording_messages(grasp_recording(hand), hand.side))
    return ReceivedHand(hand, layout, label_map((), layout.names))


def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit code."""
    options = _parse(args)
    processes: list[subprocess.Popen[bytes]] = []
    # A closing terminal or a killed script ends the nodes too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        hands, recording = _hands(options)
        for note in recorded_notes(recording):
            print(f'{options.recording}: {note}', flush=True)
        if options.view:
            sources: list[ViewerRecording] = []
            for one in reversed(hands):
                labels = recording.labels if isinstance(recording, PointBag) else one.labels
                sources.append(ViewerRecording(
                    recording, one.hand, one.layout, None, next(iter(sources), None),
                    MarkerReading(labels)))
            view(sources[-1], options)
            return 0
        loaded = chosen_robot(options, hands[0].hand.side)
        if loaded is not None and len(hands) > 1:
            raise HandTrackerError('--side both: a robot follows one hand; choose a side')
        # Before the tracker compiles, and the recording is played.
        with open_recording(recording) as bag:
            marker_topic(bag, USUAL_TOPIC)
        options.output.mkdir(parents=True, exist_ok=True)
        if not os.access(options.output, os.W_OK):
            raise PermissionError(errno.EACCES, 'no permission to write there', options.output)
        rclpy.init()
        node = rclpy.create_node('demo')
        listener = Listener(node, hands)
        robot = None
        if loaded is not None:
            robot = (GraspingRobot if options.grasp else DrivenRobot)(node, loaded)
        if isinstance(recording, PointBag) and not options.hand:
            # The tracker learns from it where the markers are.
            options.hand = str(options.output / 'hand.yaml')
            save_hand(options.hand, hands[0].hand, hands[0].layout)
        elif isinstance(recording, PointBag) and hands[0].layout.names != MARKERS:
            # And the replay from this which markers they are.
            options.layout = str(options.output / 'layout.yaml')
            save_layout(options.layout, hands[0].layout)
        _play(node, listener, options, processes, robot)
        codes = [_stop(process) for process in processes]
        _save(listener, options.output, robot)
        if any(codes):
            raise HandTrackerError(f'the nodes ended with exit codes {codes}')
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
