"""The demo's run: starts replay and tracker, receives their messages, draws what came."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import rclpy
from rclpy.node import Node

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, Hand
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.marker_layout import MARKERS
from ..core.model.skeleton import skeleton_points
from ..core.numerics import jit
from ..drawing.animation import HandMotion, save_animation, save_sheet
from ..files.angle_table import write_angle_table
from ..files.hand_file import save_hand
from ..files.layout_file import save_layout
from ..messages.labels import USUAL_TOPIC, WITHOUT_LABELS
from ..nodes.topic_publishers import full_name
from ..retargeting.robot_file import LoadedRobot
from ..tracking.compilation import COMPILE_TIME, PROGRAM
from ..tracking.point_bag import PointBag
from .demo_anonymous import PointOwners
from .demo_grasp import GraspingRobot
from .demo_listener import Listener, ReceivedFrames, TFMessage
from .demo_robot import DrivenRobot
from .recording_options import WornHand

LINE_EVERY = .5  # [s] between live lines
EXPLAINED_SHARE = .01  # of the frames that are missing, from which on that is explained
LAG = .5         # [s] without a message, after which no more comes
DISCOVERY = 3.3  # [s] in which others are discovered: they announce themselves each 3 s


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


def run_demo(options: argparse.Namespace, hands: Sequence[WornHand], recording: Path | PointBag,
             frame_count: int, loaded: LoadedRobot | None,
             owners: PointOwners | None = None) -> None:
    """Play a recording through the nodes, and save what they answered.

    Parameters
    ----------
    options : argparse.Namespace
        Of the command line.
    hands : sequence of WornHand
        One, or the right and the left one.
    recording : Path or PointBag
    frame_count : int
        Messages of markers in the recording.
    loaded : LoadedRobot or None
        Robot that follows.
    owners : PointOwners, optional
        Of the points of a recording without labels, as far as they are known; None where there
        are labels.

    Raises
    ------
    HandTrackerError
        If others use its topics, a node ends early, or nothing was answered.
    """
    processes: list[subprocess.Popen[bytes]] = []
    try:
        rclpy.init()
        node = rclpy.create_node('demo')
        time.sleep(DISCOVERY)
        _refuse_others(node)
        listener = Listener(node, hands, owners)
        robot = None
        if loaded is not None:
            robot = (GraspingRobot if options.grasp else DrivenRobot)(node, loaded)
        if isinstance(recording, PointBag) and not options.hand:
            # The tracker learns from it where the markers are.
            options.hand = str(options.output / 'hand.yaml')
            save_hand(options.hand, hands[0].hand, hands[0].layout)
            for other in hands[1:]:
                options.left_hand = str(options.output / 'left_hand.yaml')
                save_hand(options.left_hand, other.hand, other.layout)
        elif isinstance(recording, PointBag) and hands[0].layout.names != MARKERS:
            # And the replay from this which markers they are.
            options.layout = str(options.output / 'layout.yaml')
            save_layout(options.layout, hands[0].layout)
        _play(node, listener, options, processes, robot)
        codes = [_stop(process) for process in processes]
        _save(listener, options.output, frame_count, robot)
        if any(codes):
            raise HandTrackerError(f'the nodes ended with exit codes {codes}')
    finally:
        for process in processes:
            _stop(process)
        rclpy.try_shutdown()


def _refuse_others(node: Node, *own: str) -> None:
    """Refuse to run where others than the demo's own nodes use a topic, or engage, of the demo."""
    if not own and '/retarget/engage' in dict(node.get_service_names_and_types()):
        raise _disturbed('/retarget/engage', '/retarget')
    for topic in USUAL_TOPIC, '/joint_states', '/robot/joint_states', '/robot/command':
        # Hidden nodes listen, as `ros2 topic echo` does.
        names = [full_name(one) for one in node.get_publishers_info_by_topic(topic)] + [
            name for name in map(full_name, node.get_subscriptions_info_by_topic(topic))
            if name and '/_' not in name]
        # Each of them has one endpoint of a topic: a second one is another's of its name.
        for name in own:
            if name in names:
                names.remove(name)
        if others := list(filter(None, names)):
            raise _disturbed(topic, others[0])


def _disturbed(used: str, other: str) -> HandTrackerError:
    """Return what is raised where another node uses a topic or service of the demo."""
    domain = 78 if os.environ.get('ROS_DOMAIN_ID') == '77' else 77
    return HandTrackerError(
        f'{used} is used by {other}, which the demo would disturb, and with it any robot that '
        'follows: end it, or run the demo in another ROS domain: '
        f'ROS_DOMAIN_ID={domain} scripts/demo')


def _complete_kernels(kernel_set: str, what: str) -> None:
    """Compile a set of kernels, where that was not done: plain Python is far too slow for it."""
    if not jit.JIT_IS_ON or jit.is_ready(kernel_set):
        return
    try:
        jit.folder_with_room(jit.needed_folder())
    except jit.KernelsUnavailable as error:
        print(error, file=sys.stderr)
        return
    print(f'Compiling what {what}: once, for {COMPILE_TIME} ...', flush=True)
    subprocess.run([sys.executable, '-m', PROGRAM, jit.TRACKING_SET, kernel_set], check=True,
                   env={**os.environ, 'HAND_TRACKER_JIT': '1'})


def _wait_for(name: str, process: subprocess.Popen[bytes], node: Node,
              is_there: Callable[[], bool]) -> None:
    """Wait until a node is there, however long it takes on a busy machine."""
    while not is_there():
        if process.poll() is not None:
            raise HandTrackerError(f'the {name} did not start; see its message above')
        rclpy.spin_once(node, timeout_sec=.1)


def _play(node: Node, listener: Listener, options: argparse.Namespace,
          processes: list[subprocess.Popen[bytes]], robot: DrivenRobot | None) -> None:
    """Run the nodes until the recording ends."""
    presets = {f'{name}.preset': value for name, value in (
        ('limits', options.limits), ('coupling', options.coupling)) if value}
    if options.left_hand:
        presets['left.hand_file'] = options.left_hand
    if listener.is_anonymous:
        _complete_kernels(jit.LABELLING_SET, 'labels points')
    elif robot is not None:
        _complete_kernels(jit.TRACKING_SET, 'tracks')
    # What is received is compared with the hand that is given here, the recording's.
    first = listener.hands[0]
    side = first.hand.side if len(listener.hands) == 1 else BOTH
    if robot is not None:
        # First, as the tracker would warn of the markers that do not come meanwhile.
        print("Starting the robot's node ...", flush=True)
        processes.append(_start('retarget', robot=options.robot, hand_file=options.hand, side=side,
                                robot_description=options.robot_description))
        _wait_for('retarget node', processes[-1], node, lambda: robot.is_ready)
        # Before there is one that another's might be taken for.
        _refuse_others(node, '/demo', '/retarget')
    print('Starting the tracker ...', flush=True)
    tracker = _start('tracker', hand_file=options.hand, layout=options.layout, side=side,
                     broadcast='all', auto_size='false',
                     labels=f"'{WITHOUT_LABELS}'" if listener.is_anonymous else None, **presets)
    processes.append(tracker)
    # Those who wait for the first frame: the tracker and this listener.
    replay = _start('replay', recording=options.recording, rate=float(options.rate), subscribers=2,
                    side=side, markers=','.join(options.markers),
                    layout=options.layout, units=options.units, up=options.up,
                    handed=options.handed, frame_rate=options.frame_rate,
                    subject=options.subject, partial=options.partial)
    processes.append(replay)
    # Now, while the nodes start: messages that come later would wait.
    first.load_kernels()
    _wait_for('tracker', tracker, node, lambda: bool(node.count_publishers('joint_states')))
    if robot is not None:
        # On a busy machine DDS may take seconds longer until those two have met.
        _wait_for('retarget node', processes[0], node, lambda: robot.knows_tracker)
    # Again, as by now all are discovered; nothing is played before.
    _refuse_others(node, '/demo', '/retarget', '/hand_tracker', '/replay')
    listener.listen_to_markers()
    due = time.monotonic()
    end: float | None = None
    counts = listener.counts
    is_terminal = sys.stdout.isatty()
    waiting = ''
    while end is None or time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=.05)
        if replay.poll() is not None or tracker.poll() is not None:
            if end is None or counts != listener.counts:
                end = time.monotonic() + LAG
            counts = listener.counts
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


def _save(listener: Listener, output: Path, frame_count: int,
          robot: DrivenRobot | None) -> None:
    """Write the received messages of a recording with so many frames."""
    received = [hand.received_frames() for hand in listener.hands]
    if min(len(one.stamps) for one in received) < 2:
        raise HandTrackerError(
            'no frame arrived: the hand was not found among the points; is it of another --side or '
            '--layout?' if listener.is_anonymous else
            'no frame arrived: are there labelled markers of each hand on /markers?')
    for line in _count_lines(listener, received, frame_count):
        print(line, flush=True)
    start = min(one.stamps[0] for one in received)
    write_angle_table(output / 'angles.csv', [
        joint for hand in listener.hands for joint in hand.joints], _rows(received, start))
    how = 'found among points without labels' if listener.is_anonymous else 'tracked over ROS 2'
    motions = [_motion(hand.hand, one, start) for hand, one in zip(listener.hands, received)]
    for motion, hand in motions:
        name = 'hand.png' if len(motions) == 1 else f'{hand.side}_hand.png'
        save_sheet(output / name, motion, hand, f'{hand.side} hand, {how}')
        print(f'  {output / name}: poses in time, from above and from the thumb')
    print('Drawing the animation ...', flush=True)
    (motion, hand), *others = motions
    title = 'both hands' if others else f'{hand.side} hand'
    save_animation(output / 'hand.gif', motion, hand, f'{title}, {how}', others)
    for name, what in (('hand.gif', f"the tracked {'hands' if others else 'hand'} in motion"),
                       ('angles.csv', f'the {25 * len(motions)} joint angles of every answered '
                        'frame, in degrees')):
        print(f'  {output / name}: {what}')
    if robot is not None:
        (one,) = received
        robot.save(output, hand, one.stamps, one.angles)


def _count_lines(listener: Listener, received: Sequence[ReceivedFrames],
                 frame_count: int) -> Iterator[str]:
    """Yield how many frames were played, heard and answered, and why not all."""
    frames, states = listener.counts
    transforms = f' and {listener.transforms} messages on /tf' if TFMessage else ''
    yield (f'{frame_count} frames of markers played, {states} joint states{transforms} answer '
           f'them; {listener.summary(received)}')
    if listener.knows_owners:
        right, labelled = listener.label_counts
        yield f'{right} of {labelled} labels given to points are those of the recording'
    if (before := listener.before_first()):
        event = ('the hand was found among the points' if listener.is_anonymous
                 else 'the first that was answered, in which the palm was seen')
        yield f'{before} of the frames came before {event}'
    left_out, count = listener.left_out()
    if 0 < left_out <= EXPLAINED_SHARE * count:
        yield (f'{left_out} of {count} frames were left out, as newer ones had come before they '
               'were tracked')
    elif left_out:
        cause = ('plain Python tracks until the kernels are compiled, once, on the first start'
                 if jit.DEFERRED and not listener.is_anonymous else 'this machine had other work')
        yield (f'{left_out} of {count} frames were left out, as {cause}: run it again, and more '
               'are answered.')
    if frame_count - frames > EXPLAINED_SHARE * frame_count:
        yield (f'{frame_count - frames} of the frames played were not heard here, by the program '
               'that draws: it had no turn on this machine.')


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
