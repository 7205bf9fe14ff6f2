"""Several nodes in one process, over DDS: each does what it does in a process of its own."""

import sys
import time
from contextlib import contextmanager
from threading import Event, Thread

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from helpers.hands import BENT_ANGLES, RIGHT, hand_at
from helpers.natnet_server import NatNetServer
from helpers.ros_process import PLAIN_PYTHON, Process, frames_on_fast_path, watching_node
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from hand_tracker.adapters.point_frame import point_frame
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.messages.stamps import Stamp
from hand_tracker.nodes import all_node
from hand_tracker.nodes.runner import spinning
from hand_tracker.nodes.source_node import SourceNode
from hand_tracker.nodes.tracker_node import TrackerNode

NEEDS = 'rclpy',

pytestmark = pytest.mark.ros


def together(*names, remaps=(), environment=None, **parameters):
    """Start nodes in one process."""
    words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    words += [word for remap in remaps for word in ('-r', remap)]
    return Process([sys.executable, '-m', 'hand_tracker.nodes.all_node', *names, '--ros-args',
                    '-p', 'auto_size:=false', *words], environment)


def test_markers_of_motive_are_tracked_in_the_process_that_receives_them():
    with NatNetServer((4, 1), {'RHand': MARKERS}) as server, together(
            'tracker', 'source', remaps=['markers:=source/markers'], source='natnet',
            port=server.port) as process, watching_node() as node:
        answers = node.collect(JointState, 'joint_states')
        statuses = node.collect(DiagnosticArray, '/diagnostics')

        def send():
            if server.is_connected:
                server.send_frame({'RHand': hand_at()}, time.monotonic())

        node.repeat(send, lambda: answers and (not COMPILED or max(
            frames_on_fast_path(statuses).values(), default=0) > 20), .01)
        # Handed over: nobody subscribes, and who does so hears them, too.
        assert node.count_publishers('/source/markers') == 1
        assert node.count_subscribers('/source/markers') == 0
        heard = node.collect(MarkerArray, '/source/markers')
        node.repeat(send, lambda: len(heard) > 20, .01)
        stamps = [(answer.header.stamp.sec, answer.header.stamp.nanosec) for answer in answers]
        assert len(set(stamps)) == len(stamps)
        assert len(answers[-1].name) == 25 and np.isfinite(answers[-1].position).all()
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('sets', [
    {'RHand': MARKERS, 'LHand': MARKERS},
    {'Hands': tuple(f'{side}_{name}' for side in ('right', 'left') for name in MARKERS)}])
def test_markers_of_both_hands_in_motive_are_tracked(sets):
    pair = np.concatenate((hand_at(), hand_at(hand=RIGHT.mirrored(), offset=(0., .4, 1.))))
    parts = dict(zip(sets, np.split(pair, len(sets))))
    with NatNetServer((4, 1), sets) as server, together(
            'tracker', 'source', remaps=['markers:=source/markers'], source='natnet', side='both',
            port=server.port) as process, watching_node() as node:
        answers = node.collect(JointState, 'joint_states')
        statuses = node.collect(DiagnosticArray, '/diagnostics')

        def send():
            if server.is_connected:
                server.send_frame(parts, time.monotonic())

        node.repeat(send, lambda: answers and len(answers[-1].name) == 50 and (
            not COMPILED or min(frames_on_fast_path(statuses).values(), default=0) > 20), .01)
        for number in range(2):
            np.testing.assert_allclose(
                answers[-1].position[25 * number:][:25], BENT_ANGLES, atol=.05)
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output and "labels:='none'" not in process.output


@pytest.mark.skipif(not COMPILED, reason='there is no fast path here')
def test_packets_like_the_last_one_are_relayed():
    with NatNetServer((4, 1), {'RHand': MARKERS}) as server, watching_node() as node:
        answers = node.collect(JointState, 'joint_states')
        rclpy.init(args=['--ros-args', '-r', 'markers:=source/markers', '-p', 'source:=natnet',
                         '-p', f'port:={server.port}', '-p', 'auto_size:=false'])
        tracker, source = TrackerNode(), SourceNode()
        results, sent = [], []
        try:
            source.hand_over(tracker.inputs)
            relay = source._client.relay

            def note(*arguments):
                packets = relay(*arguments)
                results.extend(packet.is_relayed for packet in packets or ())
                return packets

            source._client.relay = note

            def send():
                if server.is_connected:
                    occluded = [('RHand', 6)] * (len(sent) % 10 == 9)
                    sent.append(server.send_frame(
                        {'RHand': hand_at()}, time.monotonic(), occluded=occluded))

            with spinning(tracker, source):
                node.repeat(send, lambda: results.count(True) > 100, .01)
                assert tracker.inputs[0].fast_path.frame_count >= results.count(True)
        finally:
            source.destroy_node()
            tracker.destroy_node()
            rclpy.shutdown()
    stamps = [answer.header.stamp.sec + 1e-9 * answer.header.stamp.nanosec for answer in answers]
    assert (np.diff(stamps) > 0).all() and results.count(False) > 10
    assert len(answers) >= results.count(True)


def test_without_compiled_kernels_markers_are_handed_over_too():
    with NatNetServer((4, 1), {'RHand': MARKERS}) as server, together(
            'tracker', 'source', remaps=['markers:=source/markers'], source='natnet',
            port=server.port, environment=PLAIN_PYTHON) as process, \
            watching_node() as node:
        answers = node.collect(JointState, 'joint_states')

        def send():
            if server.is_connected:
                server.send_frame({'RHand': hand_at()}, time.monotonic())

        node.repeat(send, lambda: len(answers) > 3, .05)
        assert node.count_subscribers('/source/markers') == 0
        with repeated(send):
            assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


@contextmanager
def repeated(act):
    """Act all the while in a thread."""
    ended = Event()

    def go_on():
        while not ended.wait(.001):
            act()

    thread = Thread(target=go_on)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_what_is_relayed_is_like_the_last_frame_also_where_that_waits():
    rclpy.init(args=['--ros-args', '-r', 'markers:=source/markers', '-p', 'source:=point_cloud'])
    tracker, source, installed = TrackerNode(), SourceNode(), []

    class Relay:
        def install(self, origin, writer):
            installed.append((origin, writer))

    try:
        source.hand_over(tracker.inputs)
        tracker.inputs[0]._relay = Relay()
        for number in range(3):
            source._publish(point_frame(Stamp(number, 0), '', MARKERS, hand_at()))
        # No executor has tracked them.
        assert installed == 3 * [(None, source._writer)] and tracker.inputs[0].relay is None
    finally:
        source.destroy_node()
        tracker.destroy_node()
        rclpy.shutdown()


def test_a_client_has_ended_before_the_tracker_is_destroyed(monkeypatch):
    def interrupted(*nodes):
        raise KeyboardInterrupt

    monkeypatch.setattr(all_node, 'spin', interrupted)
    with NatNetServer((4, 1), {'RHand': MARKERS}) as server:
        rclpy.init(args=['--ros-args', '-p', 'source:=natnet', '-p', f'port:={server.port}'])
        tracker, source = TrackerNode(), SourceNode()
        try:
            assert source._thread.is_alive()
            with pytest.raises(KeyboardInterrupt):
                all_node.serve(tracker, source)
            assert not source._thread.is_alive()
        finally:
            tracker.destroy_node()
            source.destroy_node()
            rclpy.shutdown()


def test_tracker_and_replay_are_what_it_runs_by_itself_and_it_ends_with_the_recording():
    with together('tracker', 'replay', rate=20., wait_for_subscriber=60.) as process:
        assert process.wait() == 0, process.output
    assert 'Played to the end' in process.output and 'Traceback' not in process.output
    assert '[hand_tracker]: tracking' in process.output
    with together() as process, watching_node() as node:
        answers = node.collect(JointState, 'joint_states')
        node.spin_until(lambda: answers)
        assert process.interrupt() == 0, process.output
    assert 'Playing' in process.output and 'Traceback' not in process.output


def test_many_nodes_are_served_together_and_end_quietly():
    with together('tracker', 'source', 'landmarks', 'mount', 'simulate', body_frame='arm'
                  ) as process, watching_node() as node:
        answers = node.collect(JointState, 'joint_states')
        node.spin_until(lambda: answers)
        for line in ('listening for markers', '/pointCloud: publishing', 'publishing 25 landmarks',
                     'right_wrist rests in arm', 'demo at 120 Hz'):
            process.wait_for_line(line)
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output and 'number of timers' not in process.output


@pytest.mark.parametrize('names, line', [
    (('tracker', 'replay', 'simulate'), 'replay and simulate: each has a loop of its own'),
    (('tracker', 'cook'), "'cook' is no node; expected tracker, replay")])
def test_what_cannot_run_together_is_refused(names, line):
    with together(*names) as process:
        assert process.wait() == 2
    assert line in process.output and 'Traceback' not in process.output


def test_a_parameter_for_a_node_that_is_not_there_is_said():
    words = ('-r', 'markers:=mine', '-r', 'hand_tracker:__node:=mine', '-p', 'mine:side:=left',
             '-p', 'hand_skin:rate:=20.0', '-p', 'tracker:side:=both', '-p', 'skim:rate:=1.0')
    with Process([sys.executable, '-m', 'hand_tracker.nodes.all_node', 'tracker', 'skin',
                  '--ros-args', *words], PLAIN_PYTHON) as process:
        process.wait_for_line('left hand: listening for markers on /mine')
        for name in ('tracker:side:=both', 'skim:rate:=1.0'):
            process.wait_for_line(f"{name}: left out, as no node is called '{name.split(':')[0]}' "
                                  'here; expected mine, hand_skin')
        assert process.interrupt() == 0, process.output
    assert process.output.count('left out, as no node') == 2


def test_a_wrong_parameter_of_one_ends_all_with_its_line():
    with together('tracker', 'source', source='nonsense') as process:
        assert process.wait() == 1
    assert "[source]: source: 'nonsense' is not one of" in process.output
    assert 'Traceback' not in process.output
