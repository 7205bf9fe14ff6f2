"""The demo: it says at once what is wrong, and leaves what it promises."""

import csv
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.robots import wide_hand
from PIL import Image

from benchmarks.repository import REPOSITORY
from hand_tracker.cli.demo_anonymous import take_labels_off
from hand_tracker.cli.recording_options import WornHand
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.numerics import jit
from hand_tracker.files.bags import open_bag, write_bag
from hand_tracker.files.urdf_file import urdf
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap, default_labels, label_maps
from hand_tracker.messages.points import PointReader
from hand_tracker.package_data import packaged_recording
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.simulation.packaged_recordings import demo_recording, recording_messages

# Prints the kernels that a listener needs beyond those of tracking.
LISTENS = """
import gc
import numpy as np
from numba.core.dispatcher import Dispatcher
from hand_tracker.cli.demo_listener import ReceivedHand
from hand_tracker.cli.recording_options import WornHand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import marker_positions
from hand_tracker.messages.labels import default_labels
from hand_tracker.tracking.compile_kernels import compile_tracking

def loaded():
    return {(one.__module__, one.__name__, types) for one in gc.get_objects()
            if isinstance(one, Dispatcher) for types in one.signatures}

tracker = compile_tracking()
hand = ReceivedHand(WornHand(tracker.hand, tracker.layout, default_labels(tracker.layout.names)))
before = loaded()
hand.load_kernels()
known = loaded()
markers = marker_positions(tracker.layout.mounting(tracker.hand),
                           forward(joint_table(tracker.hand), np.zeros(25)))
hand.markers, hand.angles = {1: markers, 2: markers.copy()}, {1: np.zeros(25), 2: np.zeros(25)}
hand.markers[2][0] = np.nan
print(hand.received_frames().markers.shape, known - before, loaded() - known)
"""
OTHER_SIDE_FAULT = 'the fingers bend away from the palm of a right hand'


def environment():
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(
        [str(REPOSITORY), os.environ.get('PYTHONPATH', '')])}


def run_demo(*arguments):
    return subprocess.run(
        [sys.executable, '-m', 'hand_tracker', 'demo', *map(str, arguments)],
        capture_output=True, text=True, timeout=240., env=environment())


@pytest.fixture
def ros():
    pytest.importorskip('rclpy', reason='needs ROS 2')
    from helpers import ros_process  # noqa: F401  sets a domain of its own


def test_demo_says_where_kernels_cannot_be_kept_and_goes_on(ros, monkeypatch, capsys, tmp_path):
    from hand_tracker.cli import demo_run

    (tmp_path / 'file').touch()
    monkeypatch.setattr(demo_run.jit, 'JIT_IS_ON', True)
    monkeypatch.setattr(demo_run.jit, 'CACHE_FOLDER', tmp_path / 'file' / 'cache')
    monkeypatch.setattr(subprocess, 'run', None)
    demo_run._complete_kernels('tracking', 'tracks')
    printed = capsys.readouterr()
    assert printed.out == '' and len(printed.err.splitlines()) == 1
    assert str(tmp_path / 'file' / 'cache') in printed.err


@pytest.mark.skipif(not jit.COMPILED, reason='nothing is compiled without numba')
def test_the_listener_needs_no_kernel_that_tracking_does_not_compile(ros):
    """It would measure its own compiling as the tracker's latency."""
    done = subprocess.run([sys.executable, '-c', LISTENS], capture_output=True, text=True,
                          env={**environment(), 'HAND_TRACKER_JIT': '1'})
    assert done.stdout == '(2, 8, 3) set() set()\n', done.stderr


@pytest.mark.parametrize('is_anonymous, kernels', [(False, 'tracking'), (True, 'labelling')])
def test_kernels_are_complete_before_the_node_of_a_robot_starts(
        is_anonymous, kernels, ros, monkeypatch):
    """It would use those that are there at its start, to the end."""
    from hand_tracker.cli import demo_run
    begun = []

    def start(name, **parameters):
        begun.append(name)
        raise KeyboardInterrupt

    monkeypatch.setattr(demo_run, '_complete_kernels', lambda name, what: begun.append(name))
    monkeypatch.setattr(demo_run, '_start', start)
    listener = SimpleNamespace(
        is_anonymous=is_anonymous, hands=[SimpleNamespace(hand=Hand.scaled())])
    options = SimpleNamespace(
        limits=None, coupling=None, robot='plain', hand='', left_hand=None, robot_description='')
    with pytest.raises(KeyboardInterrupt):
        demo_run._play(None, listener, options, [], SimpleNamespace(is_ready=True))
    assert begun == [kernels, 'retarget']


def test_demo_runs_its_nodes_and_leaves_pictures_and_a_table(ros, tmp_path):
    recording = demo_recording()
    short = recording._replace(stamps=recording.stamps[:120], markers=recording.markers[:120],
                               angles=recording.angles[:120])
    write_bag(tmp_path / 'short.mcap', recording_messages(short, 'right'))
    done = run_demo('--recording', tmp_path / 'short.mcap', '--output', tmp_path / 'out',
                    '--robot')
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.search(r'(\d+) frames of markers played', done.stdout).group(1)) == 120
    for unit in ('Hz', 'latency p50', 'mm', 'markers seen 8 of 8'):
        assert unit in done.stdout
    with open(tmp_path / 'out' / 'angles.csv', newline='', encoding='utf-8') as file:
        header, *rows = csv.reader(file)
    assert header == ['time_s', *(f'right_{joint}_deg' for joint in JOINTS)]
    times, *angles = np.array(rows, dtype=float).T
    # A row has the markers of its frame too, which the listener may have lost.
    assert 0 < len(times) <= int(re.search(r'(\d+) joint states', done.stdout).group(1))
    since_last = 1e-9 * (short.stamps - short.stamps[-1])
    frames = np.searchsorted(since_last, times - times[-1] - .5 / 120.)
    # The recording's noise in an open hand: degrees at the PIP.
    assert np.abs(np.transpose(angles) - np.degrees(short.angles[frames])).mean() < 3.
    assert int(re.search(r'(\d+) commands', done.stdout).group(1)) > 0
    for name in ('hand.gif', 'hand.png', 'robot.gif', 'robot.png'):
        with Image.open(tmp_path / 'out' / name) as image:
            image.verify()


def test_demo_plays_a_c3d_file_of_another_program(ros, tmp_path):
    pytest.importorskip('ezc3d')
    from helpers.other_c3d import ezc3d_file

    recording = demo_recording()
    labels = ('RWRI', 'RIndexMCP', 'RPinkyMCP', 'RIndexDIP', 'RMiddleDIP', 'RRingDIP', 'RPinkyDIP',
              'RThumbTip')
    take = ezc3d_file(tmp_path / 'take.c3d', labels, 1e3 * recording.markers[:120], rate=120.)
    done = run_demo('--recording', take, '--markers', 'wrist=RWRI', '--output', tmp_path / 'out')
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'the file is in mm, z up' in done.stdout
    assert int(re.search(r'(\d+) frames of markers played', done.stdout).group(1)) == 120
    assert int(re.search(r'(\d+) joint states', done.stdout).group(1)) > 0
    with open(tmp_path / 'out' / 'angles.csv', newline='', encoding='utf-8') as file:
        header, *rows = csv.reader(file)
    assert header == ['time_s', *(f'right_{joint}_deg' for joint in JOINTS)]
    times, *angles = np.array(rows, dtype=float).T
    # Stamps are when a frame was due; the first answered one is found by the rest of them.
    step = np.round(120. * times).astype(int)
    error = min(np.abs(np.transpose(angles) - np.degrees(recording.angles[start + step])).mean()
                for start in range(120 - step[-1]))
    assert error < 3.
    for name in ('hand.gif', 'hand.png'):
        with Image.open(tmp_path / 'out' / name) as image:
            image.verify()


def test_demo_finds_the_hand_among_points_without_labels(ros, tmp_path):
    recording = demo_recording()
    np.savez(tmp_path / 'take.npz', markers=recording.markers[:240], rate_hz=120.,
             marker_names=[f'unlabeled {number}' for number in range(8)])
    done = run_demo('--recording', tmp_path / 'take.npz', '--output', tmp_path / 'out')
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.search(r'(\d+) frames of markers played', done.stdout).group(1)) == 240
    assert int(re.search(r'(\d+) joint states', done.stdout).group(1)) > 0
    assert 'labels given to points' not in done.stdout   # nobody knows which are right
    with open(tmp_path / 'out' / 'angles.csv', newline='', encoding='utf-8') as file:
        rows = np.array(list(csv.reader(file))[1:], dtype=float)
    error = min(np.abs(rows[:, 1:] - np.degrees(recording.angles[start + np.round(
        120. * rows[:, 0]).astype(int)])).mean() for start in range(240 - round(120 * rows[-1, 0])))
    assert error < 4.


@pytest.mark.parametrize('arguments, message', [
    (('--recording', 'absent.mcap'), 'absent.mcap'),
    (('--recording', __file__), "that of no known format"),
    (('--hand', 'absent.yaml'), 'absent.yaml'),
    (('--robot', 'hal'), "robot: 'hal' is no file and no preset"),
    (('--robot', '--side', 'both'), 'a robot follows one hand'),
    (('--robot', 'allegro'), 'no urdf: give the path of the robot\'s URDF (--robot-description'),
    (('--recording', packaged_recording('left')), OTHER_SIDE_FAULT),
    (('--recording', packaged_recording('both'), '--side', 'both', '--limits', 'bent'),
     "invalid choice: 'bent'")])
def test_demo_says_what_is_wrong_before_it_starts(ros, arguments, message, tmp_path):
    done = run_demo(*arguments, '--output', tmp_path)
    assert done.returncode in (1, 2)
    assert message in done.stderr and 'Starting' not in done.stdout
    assert 'Traceback' not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('name, topic', [('driver', '/robot/command'), ('demo', '/joint_states')])
def test_demo_is_refused_beside_others_on_its_topics(ros, name, topic, tmp_path):
    from helpers.ros_process import watching_node
    from sensor_msgs.msg import JointState

    with watching_node(name) as node:
        node.create_subscription(JointState, topic, print, 1)
        done = run_demo('--robot', '--output', tmp_path)
    assert done.returncode == 1 and 'Starting the tracker' not in done.stdout
    assert done.stderr.splitlines()[-1] == (
        f'hand_tracker demo: {topic} is used by /{name}, which the demo would disturb, and with it '
        'any robot that follows: end it, or run the demo in another ROS domain: ROS_DOMAIN_ID=77 '
        'scripts/demo')
    assert not (tmp_path / 'angles.csv').exists()


def test_nodes_beside_the_demos_own_are_found_also_by_the_same_names(ros, monkeypatch):
    from hand_tracker.cli import demo_run

    def graph(*names):
        found = [SimpleNamespace(node_name=name, node_namespace='/') for name in names]
        return SimpleNamespace(get_publishers_info_by_topic=lambda topic: found[::2],
                               get_subscriptions_info_by_topic=lambda topic: found[1::2])

    own = '/demo', '/hand_tracker'
    demo_run._refuse_others(graph('demo', 'hand_tracker', '_NODE_NAME_UNKNOWN_'), *own)
    demo_run._refuse_others(graph(), *own)
    monkeypatch.setenv('ROS_DOMAIN_ID', '77')
    for names, other in ((('demo', 'hand_tracker', 'rviz'), 'rviz'),
                         (('hand_tracker', 'demo', 'hand_tracker'), 'hand_tracker')):
        with pytest.raises(HandTrackerError, match=f'^/markers is used by /{other}, .*ID=78 '):
            demo_run._refuse_others(graph(*names), *own)


def test_demo_refuses_a_robot_of_the_other_side_before_it_starts(ros, tmp_path):
    (tmp_path / 'left.urdf').write_text(urdf(wide_hand('left')))
    done = run_demo('--robot', tmp_path / 'left.urdf', '--output', tmp_path / 'out')
    assert done.returncode == 1 and 'Starting' not in done.stdout
    assert "the robot's hand is a left one" in done.stderr and '--side left' in done.stderr
    assert not (tmp_path / 'out').exists()


def test_demo_ends_with_the_error_of_track_where_the_side_is_wrong(ros, tmp_path):
    done = run_demo('--side', 'left', '--recording', packaged_recording(), '--output', tmp_path)
    tracked = subprocess.run(
        [sys.executable, '-m', 'hand_tracker', 'track', packaged_recording(), '--side', 'left',
         '-o', tmp_path / 'angles.csv'], capture_output=True, text=True, env=environment())
    assert done.returncode == tracked.returncode == 1
    assert done.stderr.splitlines()[-1].replace('demo: ', 'track: ') == \
        tracked.stderr.splitlines()[-1]


@pytest.fixture
def node(ros):
    import rclpy

    rclpy.init()
    yield rclpy.create_node('demo_test')
    rclpy.shutdown()


def test_frames_that_were_not_answered_are_counted_from_the_first_answer_on(node):
    from hand_tracker.cli.demo_listener import Listener

    listener = Listener(node, [WornHand(Hand.scaled(), MarkerLayout(), LabelMap())])
    recording = demo_recording()
    short = recording._replace(stamps=recording.stamps[:10] - recording.stamps[0] + 10**9,
                               markers=recording.markers[:10], angles=recording.angles[:10])
    answered = {int(short.stamps[row]) for row in (2, 3, 7)}
    for message in recording_messages(short, 'right'):
        if message.topic == '/markers':
            listener._on_markers(message.data)
        elif message.time in answered:
            listener._on_angles(message.data)
    assert listener.counts == (10, 3)
    assert listener.left_out() == (5, 8) and listener.before_first() == 2
    (received,) = (hand.received_frames() for hand in listener.hands)
    assert set(received.stamps.tolist()) == answered
    np.testing.assert_allclose(received.angles, short.angles[[2, 3, 7]])


def answer(robot, reason):
    """Give a robot the answer of its node to being engaged: why it is not, or nothing."""
    from rclpy.task import Future
    from std_srvs.srv import SetBool

    future = Future()
    future.set_result(SetBool.Response(success=not reason, message=reason))
    robot._on_answer(future)


def test_the_demo_waits_until_the_robots_node_has_met_the_tracker(node):
    from hand_tracker.cli.demo_robot import DrivenRobot

    robot = DrivenRobot(node, load_robot('plain'))
    assert not robot.knows_tracker
    for reason, is_known in (
            ("there is no hand; nobody publishes the hand's /joint_states", False),
            ('there is no hand', True), ('', True)):
        answer(robot, reason)
        assert robot.knows_tracker == is_known


def test_the_robot_that_got_no_command_says_why_it_was_not_engaged(node, tmp_path):
    from hand_tracker.cli.demo_robot import DrivenRobot

    robot = DrivenRobot(node, load_robot('plain'))
    for reason in ('its joint states are missing', '', 'there is no hand', 'there is no hand'):
        answer(robot, reason)
    with pytest.raises(HandTrackerError, match='no command: its joint states are missing; '
                       'there is no hand$'):
        robot.save(tmp_path, Hand.scaled(), np.empty(0, dtype=int), np.empty((0, len(JOINTS))))


def test_the_robot_is_drawn_as_it_was_commanded_for_the_frame_beside_it(
        node, tmp_path, monkeypatch):
    from sensor_msgs.msg import JointState

    from hand_tracker.cli import demo_robot

    drawn = []
    monkeypatch.setattr(demo_robot, 'save_robot_animation', lambda *arguments: None)
    monkeypatch.setattr(demo_robot, 'save_robot_picture',
                        lambda path, name, poses: drawn.extend(poses))
    monkeypatch.setattr(demo_robot, 'robot_pose', lambda title, landmarks, robot, command: (
        title, float(command[0])))
    stamps = np.arange(10**9, 2 * 10**9, 10**8)
    robot = demo_robot.DrivenRobot(node, load_robot('plain'))
    variables = robot.loaded.hand.model.variables
    # Late, and in another order: neither is of importance, but for the frame that is answered.
    for row in reversed(range(2, len(stamps))):
        message = JointState(name=list(variables), position=[.1 * row] * len(variables))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            int(stamps[row]), 10**9)
        robot._on_command(message)
    robot.save(tmp_path, Hand.scaled(), stamps, np.zeros((len(stamps), len(JOINTS))))
    assert drawn == [(f'{.1 * row:.1f} s', pytest.approx(.1 * row)) for row in (2, 4, 5, 6, 8, 9)]


def test_a_joint_that_is_not_commanded_stays_where_the_robot_is(node):
    from sensor_msgs.msg import JointState

    from hand_tracker.cli.demo_robot import DrivenRobot

    robot = DrivenRobot(node, load_robot('plain'))
    first, *others = robot.loaded.hand.model.variables
    robot._on_command(JointState(name=others, position=[.1] * len(others)))
    (command,) = robot.commands.values()
    at_rest = robot.loaded.hand.rest[0]
    np.testing.assert_allclose(command, [at_rest, *[.1] * len(others)])


def test_without_labels_points_keep_their_ids_while_they_are_seen(tmp_path):
    sides = ('right', 'left')
    labels = label_maps(default_labels(MARKERS), {side: f'{side}/0' for side in sides})
    hands = [WornHand(Hand.scaled(side=side), MarkerLayout(), labels[side]) for side in sides]
    with open_bag(packaged_recording('both')) as bag:
        owners = take_labels_off(bag, '/markers', hands, tmp_path / 'points.mcap')
        frames = [np.concatenate([reader.read(message.data).positions for reader in (
            MarkerReader(hand.labels) for hand in hands)]) for message in bag.messages(
                ['/markers'])][:400]
    marker_of: dict[int, int] = {}
    reader, returned = PointReader(), 0
    with open_bag(tmp_path / 'points.mcap') as bag:
        for message, frame in zip(bag.messages(['/markers']), frames):
            found = reader.read(message.data)
            at = [(side, row) for side in sides for row in range(len(MARKERS))]
            markers = [at.index(owners[point.tobytes()]) for point in found.points]
            assert sorted(markers) == np.flatnonzero(np.isfinite(frame).all(axis=1)).tolist()
            new = dict(zip(found.ids.tolist(), markers))
            for label, marker in new.items():
                if marker in marker_of.values():
                    assert marker_of[label] == marker
                else:
                    returned += bool(marker_of)
                    assert label not in marker_of
            marker_of = new
    assert returned
    assert [marker_of[label] for label in sorted(marker_of)] != sorted(marker_of.values())
