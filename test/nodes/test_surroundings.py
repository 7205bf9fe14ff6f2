"""What the nodes survive of the machine and the network around them: docs/reliability.md.

Each is skipped, with the reason, where the machine does not let a test make the fault.
"""

import os
import subprocess
import sys
from contextlib import contextmanager
from glob import glob

import pytest
from helpers import network
from helpers.bench import LOSSLESS, TRACKER_MODULE, Bench, lines, message, stamp_of, tracking
from helpers.hands import bending, hand_at
from helpers.ros_process import NodeProcess, Process, watching_node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from hand_tracker.messages.stamps import nanoseconds

NEEDS = 'rclpy',

TIMES = int(os.environ.get('HAND_TRACKER_FAULTS', '1'))
LOSS, LATENESS = .3, .25  # shares of packets
PARTICIPANTS, NODES_OF_EACH = 5, 10
CROWD = """
import sys
import rclpy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

nodes = []
for group in range(int(sys.argv[1])):
    context = rclpy.Context()
    rclpy.init(context=context)
    for number in range(int(sys.argv[2])):
        nodes.append(rclpy.create_node(f'other_{group}_{number}', context=context))
        nodes[-1].create_subscription(JointState, 'joint_states', print, 10)
        nodes[-1].create_publisher(MarkerArray, f'other_{group}_{number}/markers', 10)
print('all there', flush=True)
sys.stdin.read()
"""
FAKETIME = next(iter(glob('/usr/lib/*/faketime/libfaketimeMT.so.1')), '')

takes_long = pytest.mark.skipif(TIMES == 1, reason='takes long: set HAND_TRACKER_FAULTS')


@pytest.mark.skipif(bool(network.lack()), reason=network.lack())
@pytest.mark.parametrize('reliability', [
    'best_effort', pytest.param('reliable', marks=takes_long)])
def test_frames_come_in_order_over_a_network_that_loses_and_reorders(reliability):
    # Fast DDS keeps the first network that a process had. There is nobody else in these.
    subprocess.run([sys.executable, __file__, reliability], check=True, env={
        **os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)})


def send_over_a_bad_cable(reliability):
    """Send frames of a reliability over a cable that gets bad and is good again."""
    qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy[reliability.upper()])
    with network.connected_networks() as (here, there, cable):
        with there:
            process = NodeProcess(
                TRACKER_MODULE, {**LOSSLESS, 'qos.markers.reliability': reliability})
        with process, here, watching_node() as node:
            answers = node.collect(JointState, 'joint_states')
            publisher = node.create_publisher(MarkerArray, 'markers', qos)
            process.wait_for_line('listening')
            sent = []

            def send():
                sent.append(len(sent) + 1)
                publisher.publish(message(bending(sent[-1]), sent[-1]))

            node.repeat(send, lambda: len(answers) > 5, .005)
            # To meet over such a cable would take DDS minutes.
            cable.loss, cable.lateness = LOSS, LATENESS
            first = sent[-1]
            node.repeat(send, lambda: sent[-1] >= first + 100 * TIMES and (
                nanoseconds(answers[-1].header.stamp) > nanoseconds(stamp_of(first))), .005)
            frames, early = sent[-1] - first, len(answers)
            cable.loss = cable.lateness = 0.
            until = nanoseconds(stamp_of(sent[-1]))
            # By what comes after them a reader hears that it lacks some.
            node.repeat(send, lambda: nanoseconds(answers[-1].header.stamp) > until, .005)
            stamps = [nanoseconds(answer.header.stamp) for answer in answers]
            assert stamps == sorted(set(stamps))
            expected = {nanoseconds(stamp_of(number))
                        for number in range(first + 1, first + frames + 1)}
            answered = expected.intersection(stamps)
            print(f'{reliability}: {len(answered)} of {frames} frames answered, {early} answers '
                  f'before the cable was good again; {cable.carried} '
                  f'packets carried, {cable.late} of them late, {cable.lost} lost')
            if reliability == 'reliable':
                assert answered == expected
            else:
                assert len(answered) > 0
            assert process.interrupt() == 0, process.output
            assert 'Traceback' not in process.output
            assert not lines(process, 'jumped')
        assert cable.lost > 0 and cable.late > 0


def test_a_domain_with_fifty_other_nodes_changes_nothing():
    others = PARTICIPANTS * NODES_OF_EACH
    with Process([sys.executable, '-c', CROWD, str(PARTICIPANTS), str(NODES_OF_EACH)],
                 stdin=subprocess.PIPE) as crowd:
        crowd.wait_for_line('all there')
        with tracking() as bench:
            bench.meet(hand_at())
            bench.node.spin_until(lambda: sum(
                name.startswith('other_') for name in bench.node.get_node_names()) == others)
            for _ in range(100 * TIMES):
                bench.answer(hand_at())


@contextmanager
def full_disk(folder, size):
    """Mount a disk of so many bytes on a folder."""
    if not hasattr(os, 'geteuid') or os.geteuid():
        pytest.skip('only root mounts a disk')
    words = ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', str(folder)]
    if subprocess.run(words, stderr=subprocess.DEVNULL).returncode:
        pytest.skip('no disk can be mounted here')
    try:
        yield
    finally:
        subprocess.run(['umount', '--lazy', str(folder)], check=True)


def test_a_full_disk_leaves_what_was_there_and_stops_no_node(tmp_path):
    with full_disk(tmp_path, 65536), tracking(environment={'ROS_LOG_DIR': str(tmp_path)}) as bench:
        bench.meet(hand_at())
        out = tmp_path / 'hand.mcap'
        out.write_bytes(b'what was there')
        for words in (['record', '-o', out], ['convert', out_of_package(), out]):
            done = subprocess.run([sys.executable, '-m', 'hand_tracker', *words],
                                  stderr=subprocess.PIPE, text=True)
            assert done.returncode == 1
            assert f'{out}: cannot be written (No space left on device)' in done.stderr
            assert out.read_bytes() == b'what was there'
            assert not [path for path in tmp_path.iterdir() if path.is_dir()]
        with open(tmp_path / 'rest', 'wb', buffering=0) as file, pytest.raises(OSError):
            while file.write(bytes(4096)):
                pass
        # The tracker's log cannot be written now; it goes on, and says so on the terminal.
        bench.jump_back(hand_at())
        for _ in range(20):
            bench.answer(hand_at())


def out_of_package():
    """Return the packaged recording."""
    from hand_tracker.package_data import packaged_recording
    return packaged_recording('right')


@takes_long
@pytest.mark.skipif(not FAKETIME, reason='needs libfaketime')
def test_frames_are_answered_after_the_system_time_is_set(tmp_path):
    offset = tmp_path / 'offset'

    def set_clock(seconds):
        (tmp_path / 'next').write_text(f'{seconds:+d}\n')
        (tmp_path / 'next').replace(offset)

    set_clock(0)
    environment = {'LD_PRELOAD': FAKETIME, 'FAKETIME_TIMESTAMP_FILE': str(offset),
                   'FAKETIME_NO_CACHE': '1', 'FAKETIME_DONT_FAKE_MONOTONIC': '1'}
    with NodeProcess(TRACKER_MODULE, LOSSLESS, environment=environment) as process, (
            watching_node()) as node:
        bench = Bench(process, node, 1000, 'hand_tracker')
        bench.meet(hand_at())
        solved = bench.angles(hand_at())
        for seconds in (3600, -3600, 0):
            set_clock(seconds)
            for _ in range(20):
                assert bench.angles(hand_at()) == pytest.approx(solved, abs=1e-3)
        assert process.interrupt() == 0, process.output
        assert 'Traceback' not in process.output


if __name__ == '__main__':
    # ros_process chose this machine alone when it was imported.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    send_over_a_bad_cable(sys.argv[1])
