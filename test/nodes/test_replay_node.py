"""The replay node over real DDS, in a process of its own."""

import os
import signal
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from helpers.point_bags import MADE, positions_of, stamp_ns, write_point_bag
from helpers.point_files import hand_recording
from helpers.ros_process import PATIENCE, PLAIN_PYTHON, NodeProcess, Process, watching_node
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from visualization_msgs.msg import MarkerArray

from hand_tracker.core.model.marker_layout import PAPER_PLACES
from hand_tracker.files.bags import (
    MARKER_ARRAY,
    TYPE_STORE,
    bag_message,
    joint_state_message,
    marker_array_message,
    write_bag,
)
from hand_tracker.files.recordings import write_recording
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS
from hand_tracker.nodes import replay_node

NEEDS = 'rclpy',

pytestmark = pytest.mark.ros

MODULE = 'hand_tracker.nodes.replay_node'
FIRST_STAMP_NS = 1_700_000_000 * 10**9
PERIOD = 8_333_333  # [ns]
FRAMES = 60
LABELS = ('wrist', 'index', 'thumb')


def frames(count=FRAMES, start=FIRST_STAMP_NS):
    for frame in range(count):
        stamp = start + frame * PERIOD
        yield bag_message('/markers', stamp, marker_array_message(
            stamp, 'mocap', LABELS, np.full((3, 3), float(frame))))
        yield bag_message('/truth', stamp, joint_state_message(stamp, ['a'], [float(frame)]))


def write_folder(path, messages=(), offers=(), storage=StoragePlugin.SQLITE3, foreign=False):
    with Writer(path, version=8, storage_plugin=storage) as writer:
        connections = {}
        if foreign:
            nothing = writer.add_connection('/foreign', 'no_such_msgs/msg/Nothing',
                                            msgdef='int32 a', rihs01=f'RIHS01_{"0" * 64}')
            writer.write(nothing, FIRST_STAMP_NS, b'\0\1\0\0\1\0\0\0')
        for topic, kind, stamp, data in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, kind, typestore=TYPE_STORE, offered_qos_profiles=offers)
            writer.write(connections[topic], stamp, data)


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Recordings by name, half a second each; `long` lasts a minute."""
    folder = tmp_path_factory.mktemp('bags')
    write_bag(folder / 'hand.mcap', frames())
    write_bag(folder / 'hand.db3', frames())
    write_bag(folder / 'long.mcap', frames(7200))
    write_bag(folder / 'truth.mcap', (m for m in frames() if m.topic == '/truth'))
    write_folder(folder / 'hand', frames(), storage=StoragePlugin.MCAP)
    write_folder(folder / 'no_messages')
    offer = Qos(QosHistory.KEEP_LAST, 7, QosReliability.BEST_EFFORT, QosDurability.VOLATILE,
                QosTime(0, 0), QosTime(0, 0), QosLiveliness.AUTOMATIC, QosTime(0, 0), False)
    write_folder(folder / 'foreign', foreign=True)
    write_folder(folder / 'mixed', frames(), offers=[offer], foreign=True)
    data = (folder / 'hand.mcap').read_bytes()
    (folder / 'truncated.mcap').write_bytes(data[:len(data) // 2])
    (folder / 'damaged.mcap').write_bytes(data[:500] + bytes(100) + data[600:])
    data = (folder / 'hand.db3').read_bytes()
    (folder / 'truncated.db3').write_bytes(data[:len(data) // 2])
    (folder / 'no_bytes.mcap').touch()
    (folder / 'hand.bag').write_bytes(b'#ROSBAG V2.0')
    (folder / 'folder').mkdir()
    return folder


@pytest.fixture
def watch():
    with watching_node() as node:
        yield node


def replay(recording, remaps=None, **parameters):
    """Start a replay that waits for as long as it takes until it is heard."""
    return NodeProcess(MODULE, {'recording': str(recording), 'wait_for_subscriber': PATIENCE,
                                **parameters}, remaps)


def stamp_of(message):
    """Return a message's stamp [ns]; all markers must have the same."""
    holders = message.markers if isinstance(message, MarkerArray) else [message]
    stamps = {holder.header.stamp.sec * 10**9 + holder.header.stamp.nanosec for holder in holders}
    assert len(stamps) == 1
    return stamps.pop()


def frame_of(message):
    """Return the number of the recorded frame."""
    if isinstance(message, MarkerArray):
        return int(message.markers[0].pose.position.x)
    return int(message.position[0])


def frames_of(messages):
    return [frame_of(message) for message in messages]


def clean(process, ended, code=0):
    """Check how a process ended."""
    assert 'Traceback' not in process.output
    assert ended == code, process.output


@pytest.mark.parametrize('name', ['hand.mcap', 'hand.db3', 'hand'])
def test_plays_all_as_recorded(bags, watch, name):
    truth = watch.collect(JointState, 'truth')
    markers = watch.collect(MarkerArray, 'markers')
    with replay(bags / name, restamp=False) as process:
        watch.spin_until(lambda: len(markers) == FRAMES and frames_of(truth)[-1:] == [FRAMES - 1])
        clean(process, process.wait())
    assert frames_of(markers) == list(range(FRAMES))
    assert [stamp_of(m) for m in markers] == [FIRST_STAMP_NS + i * PERIOD for i in range(FRAMES)]
    assert [marker.text for marker in markers[0].markers] == list(LABELS)
    assert [stamp_of(m) for m in truth] == [FIRST_STAMP_NS + i * PERIOD for i in frames_of(truth)]


def test_rate_and_restamp(bags, watch):
    truth = watch.collect(JointState, 'truth')
    ages = []
    watch.create_subscription(
        MarkerArray, 'markers', lambda m: ages.append((stamp_of(m), time.time_ns())), 100)
    with replay(bags / 'hand.mcap', rate=0.5) as process:
        watch.spin_until(lambda: len(ages) == FRAMES and frames_of(truth)[-1:] == [FRAMES - 1])
        clean(process, process.wait())
    stamps, received = np.array(ages).T
    assert np.abs(np.diff(stamps) - 2 * PERIOD).max() <= 1
    assert (received >= stamps).all(), 'never before it is due'
    # Half as fast: the last cannot come before its time on any machine.
    assert received[-1] - stamps[0] >= 2 * PERIOD * (FRAMES - 1)
    # Recorded at the same time, stamped the same.
    assert {frame: stamps[frame] for frame in frames_of(truth)} == {
        frame_of(message): stamp_of(message) for message in truth}


def test_loop_goes_on_with_rising_stamps_and_is_interrupted(bags, watch):
    markers = watch.collect(MarkerArray, 'markers')
    offset = 30 * PERIOD * 1e-9
    with replay(bags / 'hand.mcap', loop=True, rate=4.0, start_offset=offset) as process:
        watch.spin_until(lambda: len(markers) > 80)
        clean(process, process.interrupt())
    lap = range(30, FRAMES)
    assert frames_of(markers)[:80] == [*lap, *lap, *lap][:80]
    intervals = np.diff([stamp_of(message) for message in markers])
    assert np.abs(intervals - PERIOD / 4).max() <= 2  # at the seam as well


def test_clock_and_recorded_stamps(bags, watch):
    clock = watch.collect(Clock, '/clock')
    markers = watch.collect(MarkerArray, 'markers')
    with replay(bags / 'hand.mcap', clock=200.0, start_offset=0.099) as process:
        watch.spin_until(lambda: frames_of(markers)[-1:] == [FRAMES - 1])
        clean(process, process.wait())
    assert stamp_of(markers[0]) == FIRST_STAMP_NS + 12 * PERIOD
    times = np.array([message.clock.sec * 10**9 + message.clock.nanosec for message in clock])
    assert (np.diff(times) >= 0).all()
    assert times[0] >= FIRST_STAMP_NS + 99 * 10**6
    assert times[-1] <= FIRST_STAMP_NS + (FRAMES + 1) * PERIOD
    # 200 a second of recorded time at most; a busy machine leaves some out.
    assert 1 < len(times) <= (times[-1] - times[0]) / 5e6 * 1.5 + 2


def test_topics_remaps_and_late_subscriber(bags, watch):
    with replay(bags / 'hand.mcap', {'markers': '/left/leds'}, topics='/markers') as process:
        watch.spin_until(lambda: watch.count_publishers('/left/leds'))
        markers = watch.collect(MarkerArray, '/left/leds')
        watch.spin_until(lambda: len(markers) == FRAMES)
        assert watch.count_publishers('/markers') == watch.count_publishers('/truth') == 0
        clean(process, process.wait())
    assert frames_of(markers) == list(range(FRAMES))


def test_a_file_of_points_is_played_as_markers(watch, tmp_path):
    recording = hand_recording(FRAMES)
    write_recording(tmp_path / 'take.trc', recording)
    with replay(tmp_path / 'take.trc', up='y', units='mm') as process:
        markers = watch.collect(MarkerArray, 'markers')
        watch.spin_until(lambda: len(markers) == FRAMES)
        clean(process, process.wait())
        assert 'in mm, y up' in process.output
    for message, truth in zip(markers, recording.points.tolist(), strict=True):
        found = {marker.id: marker.pose.position for marker in message.markers}
        for slot, place in enumerate(truth):
            assert (slot in found) == (place[0] == place[0])
            if slot in found:
                point = found[slot]
                assert (point.x, point.y, point.z) == pytest.approx(place, abs=1e-6)


def test_points_without_labels_are_played_as_such(watch, tmp_path):
    recording = hand_recording(FRAMES)
    write_recording(tmp_path / 'take.trc', recording._replace(
        labels=('',) * len(recording.labels)))
    with replay(tmp_path / 'take.trc') as process:
        markers = watch.collect(MarkerArray, 'markers')
        watch.spin_until(lambda: len(markers) == FRAMES)
        clean(process, process.wait())
        assert 'points without labels, as of a tracker with labels:=none' in process.output
    assert {(marker.ns, marker.id) for message in markers for marker in message.markers} <= {
        ('unlabelled', 1000 + row) for row in range(len(recording.labels))}


def test_excluded_topics_are_left_out_unless_named(bags, watch, tmp_path):
    def earlier_run():
        for message in frames():
            yield message
            yield message._replace(
                topic='/left/hand_markers' if message.type == MARKER_ARRAY else '/joint_states')

    write_bag(tmp_path / 'run.mcap', earlier_run())
    excluded = 'joint_states hand_markers tf'
    pictures = watch.collect(MarkerArray, '/left/hand_markers')
    states = watch.collect(JointState, '/joint_states')
    markers = watch.collect(MarkerArray, '/markers')
    truth = watch.collect(JointState, '/truth')
    with replay(tmp_path / 'run.mcap', exclude_topics=excluded) as process:
        watch.spin_until(lambda: len(markers) == FRAMES and truth)
        clean(process, process.wait())
    assert not pictures and not states
    assert process.output.count(
        'Not played (exclude_topics): /left/hand_markers, /joint_states') == 1
    with replay(tmp_path / 'run.mcap', exclude_topics=excluded,
                topics='/markers /joint_states') as process:
        watch.spin_until(lambda: len(states) == FRAMES)
        clean(process, process.wait())
    assert not pictures and 'Not played' not in process.output


def test_namespace_moves_topics(bags, watch):
    truth = watch.collect(JointState, '/left/truth')
    markers = watch.collect(MarkerArray, '/left/markers')
    with replay(bags / 'hand.mcap', {'__ns': '/left'}) as process:
        watch.spin_until(lambda: len(markers) == FRAMES and truth)
        clean(process, process.wait())


def test_plays_the_packaged_recording():
    with NodeProcess(MODULE, {'rate': 100.0, 'wait_for_subscriber': 0.0}) as process:
        clean(process, process.wait())
        assert '/demo.mcap' in process.output and 'Played to the end' in process.output


def test_plays_alone_after_waiting(bags):
    with replay(bags / 'hand.mcap', wait_for_subscriber=0.2) as process:
        clean(process, process.wait())
        assert 'no subscribers of /markers after 0.2 s' in process.output
        assert 'Played to the end' in process.output


@pytest.fixture
def tracker():
    """A node with the name of the tracker's."""
    with watching_node('hand_tracker') as node:
        yield node


class ControlledClock:
    """Stands in for the module `time`: time passes while it is waited for, only."""

    def __init__(self):
        self.now = 0.

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.now += duration


@pytest.mark.parametrize('patience, prepared, until', [
    (10., 0., 10.),           # alone, as long as it may
    (10., 1000., 1000.),      # as long as the tracker prepares
    (10., 1e9, 3000.),        # until it is heard
    (float('inf'), 0., 3000.)])
def test_how_long_it_waits(monkeypatch, patience, prepared, until):
    clock = ControlledClock()
    monkeypatch.setattr(replay_node, 'time', clock)
    publisher = SimpleNamespace(
        topic_name='/markers', get_subscription_count=lambda: int(clock.now >= 3000.))
    log = []
    node = SimpleNamespace(
        _options=SimpleNamespace(wait_for_subscriber=patience, subscribers=1),
        _tracker_prepares=lambda: clock.now < prepared,
        get_logger=lambda: SimpleNamespace(info=log.append, warning=log.append))
    replay_node.ReplayNode._wait_for_subscribers(node, [publisher])
    assert clock.now == pytest.approx(until, abs=1.)
    assert log.count('Replay waits on: hand_tracker is preparing') == (prepared > patience)
    assert ('no subscribers of /markers after 10 s' in log) == (until < 3000.)


def test_a_tracker_that_is_preparing_is_noticed(bags, tracker):
    # However long this machine takes to discover the node.
    for patience in (2., 10., 50., PATIENCE):
        with replay(bags / 'hand.mcap', wait_for_subscriber=patience,
                    topics='/markers') as process:
            tracker.spin_until(lambda: any(
                line in process.output for line in ('is preparing', 'no subscribers')),
                timeout=2. * PATIENCE)
            if 'no subscribers' in process.output:
                continue
            markers = tracker.collect(MarkerArray, 'markers')
            tracker.spin_until(lambda heard=markers: len(heard) == FRAMES)
            clean(process, process.wait())
            break
    assert 'Replay waits on: hand_tracker is preparing' in process.output
    assert frames_of(markers) == list(range(FRAMES))


def test_does_not_wait_for_a_tracker_of_other_markers(bags, tracker):
    tracker.collect(MarkerArray, 'other')
    with replay(bags / 'hand.mcap', wait_for_subscriber=0.2) as process:
        clean(process, process.wait())
        assert 'no subscribers of /markers after 0.2 s' in process.output


def test_waits_for_ever_when_asked_to(bags, watch, tmp_path):
    (tmp_path / 'wait.yaml').write_text('/**: {ros__parameters: {wait_for_subscriber: .inf}}')
    with NodeProcess(MODULE, {'recording': str(bags / 'hand.mcap'), 'topics': '/markers'},
                     files=[tmp_path / 'wait.yaml']) as process:
        process.wait_for_line('Replay waits')
        markers = watch.collect(MarkerArray, 'markers')
        watch.spin_until(lambda: len(markers) == FRAMES)
        clean(process, process.wait())


def test_offered_qos_and_types_that_are_not_installed(bags, watch):
    with replay(bags / 'mixed', wait_for_subscriber=PATIENCE) as process:
        watch.spin_until(lambda: watch.get_publishers_info_by_topic('/markers'))
        qos = watch.get_publishers_info_by_topic('/markers')[0].qos_profile
        assert qos.reliability == rclpy.qos.ReliabilityPolicy.BEST_EFFORT
        markers = watch.collect(MarkerArray, 'markers', rclpy.qos.qos_profile_sensor_data)
        watch.spin_until(lambda: markers)  # some of them: nothing is sent again
        clean(process, process.wait())
    assert process.output.count('/foreign: not played, no_such_msgs/msg/Nothing is not') == 1


def test_reliable_where_the_recording_offers_nothing(bags, watch):
    with replay(bags / 'hand.mcap', wait_for_subscriber=PATIENCE) as process:
        watch.spin_until(lambda: watch.get_publishers_info_by_topic('/markers'))
        qos = watch.get_publishers_info_by_topic('/markers')[0].qos_profile
        assert qos.reliability == rclpy.qos.ReliabilityPolicy.RELIABLE
        process.wait_for_line('Replay waits for 1 subscriber of /markers')
        clean(process, process.interrupt(signal.SIGTERM))


@pytest.mark.parametrize('state', ['playing', 'paused', 'waiting'])
def test_interrupt(bags, state):
    parameters = {'playing': {'wait_for_subscriber': 0.0}, 'paused': {'start_paused': True},
                  'waiting': {}}[state]
    line = 'Replay waits' if state == 'waiting' else 'Playing'
    with replay(bags / 'long.mcap', **parameters) as process:
        process.wait_for_line(line)
        clean(process, process.interrupt(times=2))  # as impatient users do


ERRORS = {
    'missing': ({'recording': 'none.mcap'}, 'no such file or folder; expected a rosbag2 folder'),
    'extension': ({'recording': 'hand.bag'}, "that of no known format; expected C3D"),
    'folder': ({'recording': 'folder'}, 'a folder without metadata.yaml; expected'),
    'no bytes': ({'recording': 'no_bytes.mcap'}, 'the file has no bytes; expected'),
    'no messages': ({'recording': 'no_messages'}, 'a recording without messages; expected'),
    'truncated mcap': ({'recording': 'truncated.mcap'}, 'expected a complete recording'),
    'truncated db3': ({'recording': 'truncated.db3'}, 'expected a complete recording'),
    'damaged': ({'recording': 'damaged.mcap', 'wait_for_subscriber': 0.0},
                'expected a complete recording'),
    'wrong type': ({'recording': 'truth.mcap'},
                   f'no markers in /truth (sensor_msgs/msg/JointState); expected a topic of '
                   f'{MARKER_ARRAY}'),
    'foreign': ({'recording': 'foreign', 'topics': '/foreign'},
                          'no markers in /foreign (no_such_msgs/msg/Nothing); expected a topic'),
    'all excluded': ({'recording': 'hand.mcap', 'exclude_topics': 'markers truth'},
                     f'no markers in what is not excluded; expected a topic of {MARKER_ARRAY}'),
    'topic': ({'recording': 'hand.mcap', 'topics': '/leds'},
              'no topic /leds; expected topics among /markers, /truth'),
    'offset': ({'recording': 'hand.mcap', 'start_offset': 2.0, 'loop': True,
                'wait_for_subscriber': 0.0}, 'no message after start_offset 2 s; expected'),
    'rate': ({'recording': 'hand.mcap', 'rate': 0.0}, 'rate out of range'),
    'rate type': ({'recording': 'hand.mcap', 'rate': 'fast'}, "expecting type 'DOUBLE'"),
}


@pytest.mark.parametrize('name', ERRORS)
def test_error(bags, name):
    parameters, message = ERRORS[name]
    recording = bags / parameters['recording']
    with replay(**{**parameters, 'recording': recording}) as process:
        clean(process, process.wait(), code=1)
        output = process.output
    errors = [line for line in output.splitlines() if 'ERROR' in line]
    assert len(errors) == 1 and message in errors[0]
    assert 'rate' in name or str(recording) in errors[0]
    assert 'Played' not in output


@pytest.fixture(scope='module')
def srv():
    """Services as ros2 bag play names them."""
    return pytest.importorskip(
        'rosbag2_interfaces.srv', reason='rosbag2_interfaces is not installed')


def test_services_step_resume_pause_rate(bags, watch, srv):
    def paused():
        return watch.call(srv.IsPaused, '/replay/is_paused').paused

    markers = watch.collect(MarkerArray, 'markers')
    with replay(bags / 'long.mcap', start_paused=True, topics='/markers') as process:
        process.wait_for_line('paused')
        watch.spin_until(lambda: watch.count_publishers('/markers'))
        assert paused()
        called = []
        for _ in range(3):
            called.append(time.time_ns())
            assert watch.call(srv.PlayNext, '/replay/play_next').success
        called.append(time.time_ns())
        watch.call(srv.Resume, '/replay/resume')
        assert not paused()
        assert not watch.call(srv.PlayNext, '/replay/play_next').success
        watch.spin_until(lambda: len(markers) > 20)
        assert frames_of(markers[:4]) == [0, 1, 2, 3]
        # A step plays one: the next is due after the next call.
        assert all(stamp_of(m) >= before for m, before in zip(markers, called))

        watch.call(srv.Pause, '/replay/pause')
        pause = time.time_ns()
        assert paused()
        pause_end = time.time_ns()
        watch.call(srv.TogglePaused, '/replay/toggle_paused')
        watch.spin_until(lambda: stamp_of(markers[-1]) > pause_end)
        # No frame is due in the pause: it makes one gap longer, by itself.
        *usual, longest = sorted(np.diff([stamp_of(m) for m in markers[3:]]))
        assert longest >= PERIOD + pause_end - pause - 2
        assert np.abs(np.array(usual) - PERIOD).max() <= 2

        set_rate = srv.SetRate.Request
        assert not watch.call(srv.SetRate, '/replay/set_rate', set_rate(rate=0.0)).success
        assert watch.call(srv.SetRate, '/replay/set_rate', set_rate(rate=200.0)).success
        watch.spin_until(lambda: frames_of(markers[-1:]) == [7199])
        clean(process, process.wait())
    # The queues hold fewer messages than come at 200 times the rate; in order they are.
    assert (np.diff(frames_of(markers)) > 0).all()


def test_a_pause_while_waiting_for_subscribers_skips_nothing(bags, watch, srv):
    with replay(bags / 'hand.mcap', wait_for_subscriber=PATIENCE, topics='/markers') as process:
        process.wait_for_line('Replay waits')
        watch.call(srv.Pause, '/replay/pause')
        watch.call(srv.SetRate, '/replay/set_rate', srv.SetRate.Request(rate=2.))
        watch.call(srv.Resume, '/replay/resume')
        before = time.time_ns()
        markers = watch.collect(MarkerArray, 'markers')
        watch.spin_until(lambda: len(markers) == FRAMES)
        clean(process, process.wait())
    stamps = np.array([stamp_of(message) for message in markers])
    # The time stood still while it waited.
    assert stamps[0] >= before
    assert np.abs(np.diff(stamps) - PERIOD / 2).max() <= 2


# The replay node, which says when a step begins.
STEPS_LOUDLY = '''
from hand_tracker.nodes import replay_node
from hand_tracker.tracking import playback
def play_next(self, step=playback.Playback.play_next):
    print('a step begins', flush=True)
    return step(self)
playback.Playback.play_next = play_next
raise SystemExit(replay_node.main())
'''


def test_interrupt_while_a_step_waits_for_its_turn(bags, watch, srv):
    with Process([sys.executable, '-c', STEPS_LOUDLY, '--ros-args',
                  '-p', f"recording:={bags / 'long.mcap'}",
                  '-p', f'wait_for_subscriber:={PATIENCE}'], PLAIN_PYTHON) as process:
        process.wait_for_line('Replay waits')
        watch.call(srv.Pause, '/replay/pause')
        client = watch.create_client(srv.PlayNext, '/replay/play_next')
        assert client.wait_for_service(PATIENCE)
        client.call_async(srv.PlayNext.Request())
        process.wait_for_line('a step begins')
        clean(process, process.interrupt())


def test_says_that_services_are_missing(bags, tmp_path):
    (tmp_path / 'rosbag2_interfaces.py').write_text('raise ImportError')
    path = os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])
    with NodeProcess(MODULE, {'recording': str(bags / 'hand.mcap'), 'wait_for_subscriber': 0.0},
                     environment={'PYTHONPATH': path}) as process:
        clean(process, process.wait())
    assert process.output.count('rosbag2_interfaces is not installed: playing without') == 1


@pytest.mark.parametrize('kind', ['cloud', 'bodies', 'named'])
def test_other_messages_of_points_are_played_as_markers(tmp_path, watch, kind):
    recording = write_point_bag(tmp_path / 'take', [kind])
    markers = watch.collect(MarkerArray, 'markers')
    with replay(recording, restamp=False, side='right') as process:
        watch.spin_until(lambda: len(markers) == 60)
        clean(process, process.wait())
        assert f'points of {MADE[kind][1]} ({MADE[kind][0]})' in process.output
    assert [stamp_of(m) for m in markers] == [stamp_ns(i) for i in range(60)]
    for row, message in enumerate(markers):
        found = {one.id: one.pose.position for one in message.markers}
        points = np.array([(at.x, at.y, at.z) for _, at in sorted(found.items())])
        expected = positions_of(kind, 60)[row]
        if kind == 'cloud':
            expected = np.roll(expected, row, axis=0)
        elif kind == 'named':
            expected = expected[[LANDMARK_ORDERS[21].index(place) for place in PAPER_PLACES]]
        np.testing.assert_allclose(points, expected, atol=1e-6)


def test_topics_that_are_named_are_played_as_recorded(tmp_path, watch):
    recording = write_point_bag(tmp_path / 'take', ['cloud', 'poses'], suffix='.db3')
    clouds = watch.collect(PointCloud2, 'pointCloud')
    with replay(recording, restamp=False, topics='/pointCloud') as process:
        watch.spin_until(lambda: len(clouds) == 60)
        clean(process, process.wait())
    points = np.array([bytes(message.data) for message in clouds[:1]])
    np.testing.assert_array_equal(
        np.frombuffer(points[0]).reshape(-1, 3), positions_of('cloud', 1)[0])
    assert clouds[0].header.frame_id == 'stage'


def test_faults_of_files_are_told_in_words_of_parameters(tmp_path):
    write_recording(tmp_path / 'take.trc', hand_recording(FRAMES))
    with replay(tmp_path / 'take.trc', side='left') as process:
        clean(process, process.wait(), code=1)
        assert 'expected side:=right, of which they are, or markers:=wrist=LABEL' in process.output
        assert ' --' not in process.output.replace(' --ros-args', '')
