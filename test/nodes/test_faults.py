"""What the nodes survive, over DDS and in processes of their own: docs/reliability.md has a table.

Set HAND_TRACKER_FAULTS to repeat faults that often, at random instants.
"""

import os
import random
import signal
import sys
import time
from contextlib import ExitStack
from itertools import count

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from helpers.bench import (
    LATE,
    PERIOD,
    TRACKER_MODULE,
    lines,
    message,
    messages,
    stamp_of,
    tracking,
)
from helpers.hands import bending, hand_at
from helpers.robots import FollowingRobot
from helpers.ros_process import NodeProcess, watching_node
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from hand_tracker.core.model.hand import JOINTS
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.messages.stamps import marker_stamps, nanoseconds, restamp
from hand_tracker.nodes.fast_path import PUBLISHER_SILENCE

NEEDS = 'rclpy',

TIMES = int(os.environ.get('HAND_TRACKER_FAULTS', '1'))
PIP = JOINTS.index('index_pip_flexion')
SENDING_PERIOD = .005  # [s]
MANY = 10**6
HUGE_MEMORY = 2.5e9  # [bytes] for a message of that many markers, which has 0.15e9

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith('linux'), reason='signals and /proc as on Linux')
on_fast_path = pytest.mark.skipif(not COMPILED, reason='needs the fast path')


class Sender:
    """A publisher that goes on with a bending hand by a timer, with stamps as if it were live."""

    def __init__(self, node, topic='markers', period=SENDING_PERIOD):
        self.node = node
        self.publisher = node.create_publisher(MarkerArray, topic, 1000)
        self.numbers = count(LATE)
        self._timer = node.create_timer(period, self.send)

    def send(self):
        """Send the next frame."""
        number = next(self.numbers)
        self.publisher.publish(message(bending(number), 2 * number))

    def stop(self):
        """Send no more."""
        self._timer.cancel()


def diagnosed(node):
    """Return a function that gives the last values of each tracker's diagnostics, by its topic."""
    heard = node.collect(DiagnosticArray, '/diagnostics')
    return lambda: {status.hardware_id: {value.key: value.value for value in status.values}
                    for array in heard for status in array.status}


def kill(process):
    """Kill a process in the middle of its work, and wait until it is gone."""
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL


def answered_anew(node, answers):
    """Wait for answers that were not there before."""
    del answers[:]
    node.spin_until(lambda: len(answers) > 5)


def test_a_killed_tracker_comes_back_and_the_robot_does_not_jump():
    pytest.importorskip('trajectory_msgs', reason='needs trajectory_msgs')
    with NodeProcess('hand_tracker.nodes.retarget_node', {'robot': 'plain'}) as retarget, \
            watching_node() as node, ExitStack() as stack:
        answers = node.collect(JointState, 'joint_states')
        retarget.wait_for_line('listening')
        robot = FollowingRobot(node)
        Sender(node)
        tracker = stack.enter_context(NodeProcess(TRACKER_MODULE))
        for killed in (*[True] * TIMES, False):
            # Before, answers of the killed one may be on their way.
            tracker.wait_for_line('listening')
            answered_anew(node, answers)
            robot.engage()
            if killed:
                node.spin_for(random.uniform(0., .3))
                kill(tracker)
                tracker = stack.enter_context(NodeProcess(TRACKER_MODULE))
        assert tracker.interrupt() == 0, tracker.output
        # The robot is held, then disengaged; its node goes on.
        retarget.wait_for_line('holding')
        assert retarget.interrupt() == 0, retarget.output
        assert 'Traceback' not in retarget.output
    assert np.ptp([command.position for command in robot.commands], axis=0).max() > .02
    steps, allowed = robot.steps_and_bounds(SENDING_PERIOD, 2e-9 * PERIOD)
    assert (steps <= allowed).all()


@pytest.mark.parametrize('source', ['replay', 'simulate'])
def test_a_killed_source_is_followed_by_the_next_one(source):
    with NodeProcess(TRACKER_MODULE) as tracker, watching_node() as node, ExitStack() as stack:
        answers = node.collect(JointState, 'joint_states')
        tracker.wait_for_line('listening')
        for _ in range(TIMES + 1):
            driver = stack.enter_context(NodeProcess(
                f'hand_tracker.nodes.{source}_node', {'loop': True} if source == 'replay' else {}))
            answered_anew(node, answers)
            node.spin_for(random.uniform(0., .2))
            kill(driver)
        assert tracker.interrupt() == 0, tracker.output
        assert 'Traceback' not in tracker.output


def test_a_killed_viewer_leaves_the_tracker_and_the_next_one_takes_over_its_switches():
    pytest.importorskip('viser', reason='needs viser')
    pytest.importorskip('skimage', reason='needs scikit-image')
    with tracking() as bench, ExitStack() as stack:
        bench.meet(hand_at())
        for _ in range(TIMES + 1):
            viewer = stack.enter_context(NodeProcess('hand_tracker.nodes.viewer_node'))
            viewer.wait_for_line('The hand is at')
            # It listens to the tracker once somebody looks; killed while it prepares to.
            bench.node.spin_for(random.uniform(0., .5))
            bench.answer(hand_at())
            kill(viewer)
        bench.answer(hand_at())


def test_nothing_is_lost_while_the_tracker_is_stopped():
    with tracking() as bench:
        bench.meet(hand_at())
        for _ in range(TIMES):
            bench.answer(hand_at())
            bench.joint_states.clear()
            first = bench.number
            bench.process.send_signal(signal.SIGSTOP)
            for _ in range(200):
                bench.send(bending(bench.number))
                bench.node.spin_for(.005)
            assert len(bench.joint_states) < 200
            bench.process.send_signal(signal.SIGCONT)
            bench.node.spin_until(lambda: len(bench.joint_states) == 200)
            stamps = [answer.header.stamp for answer in bench.joint_states]
            assert stamps == [stamp_of(number) for number in range(first + 1, first + 201)]


@on_fast_path
def test_of_two_publishers_the_first_is_kept_and_it_is_said():
    with tracking() as bench, watching_node('stranger') as stranger:
        bench.meet(hand_at())
        other = stranger.create_publisher(MarkerArray, 'markers', 1000)
        strange = hand_at(offset=(.3, .2, 1.2))
        stranger.spin_until(lambda: other.get_subscription_count() > 0)
        numbers = count(10**6)
        sent = set()
        tracked = [time.monotonic()]  # when the first was last sent something

        def both():
            number = next(numbers)
            bench.answer(hand_at())
            if time.monotonic() - tracked[0] > PUBLISHER_SILENCE / 2:
                sent.clear()  # other work held up the first: the other may have been tracked
            tracked[0] = time.monotonic()
            sent.add(nanoseconds(stamp_of(number)))
            other.publish(message(strange, number))

        for _ in range(50):
            both()
        # It has come: else there would be nothing to say.
        bench.node.repeat(both, lambda: lines(bench.process, 'several nodes publish on'), 0.)
        assert '/markers: /test is tracked until' in bench.process.output
        assert 'what /stranger sends' in bench.process.output
        answered = {nanoseconds(answer.header.stamp) for answer in bench.joint_states}
        assert sent and not sent & answered
        # Once the first is silent, the other is tracked, and then it is the first that is left out.
        heard = []

        def next_one():
            number = next(numbers)
            heard.append(stamp_of(number))
            other.publish(message(strange, number))

        bench.node.repeat(next_one, lambda: bench.joint_states[-1].header.stamp in heard)
        assert bench.joint_states[-1].header.stamp in heard


@on_fast_path
def test_all_publishers_are_tracked_where_that_is_asked_for():
    with tracking({'publishers': 'all'}) as bench, watching_node('stranger') as stranger:
        bench.meet(hand_at())
        other = stranger.create_publisher(MarkerArray, 'markers', 1000)
        stranger.spin_until(lambda: other.get_subscription_count() > 0)
        for _ in range(20):
            bench.answer(hand_at())
            bench.number += 1
            other.publish(message(hand_at(), bench.number))
            bench.node.spin_until(
                lambda: bench.joint_states[-1].header.stamp == stamp_of(bench.number))
        assert not lines(bench.process, 'several nodes')


def test_a_publisher_at_five_kilohertz_is_answered_frame_by_frame():
    window, frames = 300, 5000 * TIMES
    with tracking() as bench:
        bench.meet(hand_at())
        bench.answer(hand_at())
        before = bench.process.resident
        bench.joint_states.clear()
        step, start = 200_000, nanoseconds(stamp_of(bench.number))  # [ns]
        data = bytearray(serialize_message(message(hand_at(), bench.number)))
        places = marker_stamps(bytes(data))
        for number in range(1, frames + 1):
            bench.publisher.publish(restamp(bytes(data), places, start + number * step))
            # No more than the queue holds: what is asked is that none of these is lost.
            if number - len(bench.joint_states) > window:
                bench.node.spin_until(
                    lambda least=number - window // 2: len(bench.joint_states) >= least)
        bench.node.spin_until(lambda: len(bench.joint_states) == frames)
        stamps = [nanoseconds(answer.header.stamp) for answer in bench.joint_states]
        assert stamps == [start + number * step for number in range(1, frames + 1)]
        assert bench.process.resident - before < 1e8
        bench.number = LATE


def test_a_message_of_a_million_markers_is_survived():
    with tracking() as bench:
        bench.meet(hand_at())
        solved = bench.angles(hand_at())
        for _ in range(TIMES):
            bench.publisher.publish(huge_message(MANY, bench.number))
            bench.node.repeat(lambda: bench.send(hand_at()), lambda: lines(
                bench.process, 'several markers of one message answer'), .2)
            assert np.allclose(bench.angles(hand_at()), solved, rtol=0, atol=1e-3)
        assert bench.process.resident < HUGE_MEMORY


def huge_message(number_of_markers, number):
    """Return a serialized MarkerArray of so many markers, each with the label of one of eight."""
    # Names such that markers are of a multiple of eight bytes, and can be repeated.
    for ns in ('leds', 'leds12', 'leds1234', 'leds1234leds'):
        one, two = (serialize_message(MarkerArray(markers=message(
            hand_at(), number, ns=ns).markers[:count])) for count in (1, 2))
        if (len(two) - len(one)) % 8 == 0:
            head, marker = one[:4], one[8:].ljust(len(two) - len(one), b'\0')
            return head + number_of_markers.to_bytes(4, 'little') + marker * number_of_markers
    raise AssertionError('no such name')


def test_jumps_of_the_stamps_by_an_hour_begin_tracking_anew():
    with tracking() as bench:
        bench.meet(hand_at())
        solved = bench.angles(hand_at())
        hour = round(3600e9 / PERIOD)
        bench.number = 10 * hour
        for jump in (hour, -hour, -2 * hour, 3 * hour) * TIMES:
            bench.number += jump
            for _ in range(3):
                # The first after a jump may be a stray stamp, which changes nothing.
                angles = bench.angles(hand_at())
            assert np.allclose(angles, solved, rtol=0, atol=1e-6)
        bench.process.wait_for_line('the stamps jumped back, tracking begins anew')


def test_a_clock_that_jumps_and_stops_holds_up_nothing():
    with tracking({'use_sim_time': True}) as bench:
        clock = bench.node.create_publisher(Clock, '/clock', 10)
        values = diagnosed(bench.node)
        bench.meet(hand_at())
        for sec in (100, 3700, 100, 101):
            clock.publish(Clock(clock=Time(sec=sec)))
            # A frame without a stamp of its own is answered with the clock's.
            bench.node.repeat(
                lambda: bench.publisher.publish(message(hand_at(), 0)),
                lambda sec=sec: bench.joint_states[-1].header.stamp == Time(sec=sec))
            for _ in range(5):
                bench.answer(hand_at())
        # Now it stands: frames and diagnostics go on.
        bench.joint_states.clear()
        for _ in range(20):
            bench.publisher.publish(message(hand_at(), 0))
        bench.node.spin_until(lambda: 20 <= sum(
            answer.header.stamp == Time(sec=101) for answer in bench.joint_states))
        frames = int(values()['/markers']['frames'])
        bench.node.repeat(lambda: bench.send(hand_at()),
                          lambda: int(values()['/markers']['frames']) > frames + 20)
        bench.number = LATE


def test_a_storm_of_parameters_loses_no_frame():
    upper = 'limits.index_pip_flexion.upper_deg'
    storm = [{upper: 90.}, {'smoothing': False}, {upper: 1e9}, {'finger_ik': 'magic'},
             {'smoothing': True, upper: 100.}, {'labels.wrist': 7}, {'display_rate': 30.}]
    allowed = [True, True, False, False, True, False, True]
    with tracking() as bench:
        bench.meet(hand_at())
        bench.answer(hand_at())
        bench.joint_states.clear()
        client = bench.node.create_client(
            SetParametersAtomically, 'hand_tracker/set_parameters_atomically')
        assert client.wait_for_service()
        first, calls = bench.number, []
        for number in range(200 * TIMES):
            calls.append(client.call_async(SetParametersAtomically.Request(
                parameters=messages(storm[number % len(storm)]))))
            bench.send(bending(number))
            bench.node.spin_for(.001)
            # A service has a queue, too.
            bench.node.spin_until(lambda: sum(not call.done() for call in calls) < 5)
        bench.node.spin_until(lambda: all(call.done() for call in calls))
        assert [call.result().result.successful for call in calls] == [
            allowed[number % len(storm)] for number in range(len(calls))]
        bench.node.spin_until(lambda: len(bench.joint_states) == len(calls))
        assert [answer.header.stamp for answer in bench.joint_states] == [
            stamp_of(number) for number in range(first + 1, bench.number + 1)]
        assert bench.set({upper: 20.}).successful
        bench.node.repeat(lambda: bench.answer(hand_at()), lambda: (
            bench.joint_states[-1].position[PIP] <= np.radians(20.) + 1e-9))
        assert len(lines(bench.process, '')) < len(calls)
