"""The fast path in a node: the same as the slow path, whatever comes in between."""

import gc
import signal
import sys
from contextlib import contextmanager
from itertools import count
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point
from helpers.bench import LATE, LOSSLESS, TRACKER_MODULE, Bench, lines, message, stamp_of
from helpers.hands import RIGHT, hand_at, motion
from helpers.ros_process import NodeProcess, watching_node
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.core.model.hand import JOINTS
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.pose.deviation import LIMITS_SHARE
from hand_tracker.messages.stamps import seconds
from hand_tracker.nodes import tracker_node
from hand_tracker.nodes.fast_path import callback_path
from hand_tracker.nodes.runner import INTERRUPTS, run
from hand_tracker.tracking.diagnostics import STATUS_PERIOD

NEEDS = 'rclpy',

# Of the two trackers: whether it has a fast path.
PATHS = {'fast': True, 'slow': False}

pytestmark = pytest.mark.skipif(
    not COMPILED or not sys.platform.startswith('linux'), reason='there is no fast path here')


class Pair:
    """Two trackers that are sent the same, of which one knows the slow path alone."""

    def __init__(self, node, processes):
        self.node, self.processes = node, processes
        self._publishers = {path: node.create_publisher(MarkerArray, f'{path}/markers', 1000)
                            for path in PATHS}
        self.replies = {path: node.collect(JointState, f'{path}/joint_states') for path in PATHS}
        self.diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        for process in processes.values():
            process.wait_for_line('listening')
        node.spin_until(lambda: all(publisher.get_subscription_count()
                                    for publisher in self._publishers.values()))

    def send(self, data):
        """Send a message, or bytes, to both."""
        for publisher in self._publishers.values():
            publisher.publish(data)

    def answer(self, number, data):
        """Send what is answered; return both answers."""
        self.send(data)
        self.node.spin_until(lambda: all(
            found and found[-1].header.stamp == stamp_of(number)
            for found in self.replies.values()))
        return [found[-1] for found in self.replies.values()]

    def values(self):
        """Return the diagnostics of both after all frames so far, by their topics."""
        # What is stamped a second from now was not put together before.
        now = seconds(self.node.get_clock().now().to_msg())
        self.node.spin_until(lambda: len(last_values(
            array for array in self.diagnostics
            if seconds(array.header.stamp) > now + 1.)) == len(PATHS))
        return last_values(self.diagnostics)

    def meet(self):
        """Send frames until both are heard, then begin anew; return the next number."""
        numbers = count(LATE)
        self.node.repeat(lambda: self.send(message(hand_at(), next(numbers))),
                         lambda: all(self.replies.values()), .05)
        for number in 1, 2:
            self.answer(number, message(hand_at(), number))
        return 3


@pytest.fixture
def pair():
    """Yield a pair that ends well."""
    with watching_node() as node:
        processes = {}
        try:
            for path, value in PATHS.items():
                # A size that a thread learns comes at another frame in each.
                processes[path] = NodeProcess(
                    TRACKER_MODULE, {'fast_path': value, 'auto_size': False, **LOSSLESS},
                    {'__ns': f'/{path}', 'markers': f'/{path}/markers'})
            yield Pair(node, processes)
            assert all(process.interrupt() == 0 for process in processes.values())
            assert not any('Traceback' in process.output for process in processes.values())
        finally:
            for process in processes.values():
                process.__exit__()


def points(positions, number):
    """Return a frame as one marker of points, which the fast path does not take."""
    marker = Marker(ns='leds', type=Marker.POINTS)
    marker.header.frame_id, marker.header.stamp = 'mocap', stamp_of(number)
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in np.nan_to_num(positions).tolist()]
    return MarkerArray(markers=[marker])


def test_both_paths_answer_the_same_whatever_comes(pair):
    start = pair.meet()
    rng = np.random.default_rng(5)
    frames = motion(RIGHT, 400)
    for number, frame in enumerate(frames, start):
        if number % 50 == 20:
            frame = frame[[0, 1, 2, 4, 3, 5, 6, 7]]
        if rng.random() < .1:
            frame = np.where(rng.random(8)[:, None] < .3, np.nan, frame)
        data = points(frame, number) if number % 40 == 10 else message(frame, number)
        fast, slow = pair.answer(number, data)
        assert fast == slow, number
        if number % 30 == 7:  # one that is no message, and one of others
            pair.send(serialize_message(data)[:-60])
            pair.send(message(frame, number, ns='others', frame='elsewhere'))
    # However busy the machine is, both paths have had their turn in the end.
    numbers = count(start + len(frames))

    def one_more():
        number = next(numbers)
        fast, slow = pair.answer(number, message(hand_at(), number))
        assert fast == slow, number

    pair.node.repeat(one_more, lambda: int(last_values(pair.diagnostics).get(
        '/fast/markers', {}).get('frames on fast path', 0)) > 0)
    # All are counted, and what became of them.
    found = pair.values()
    fast, slow = found['/fast/markers'], found['/slow/markers']
    # The first ones may have missed them until all were connected.
    assert min(int(fast['frames']), int(slow['frames'])) >= len(frames)
    on_fast_path = int(fast['frames on fast path'])
    assert 0 < on_fast_path <= int(fast['frames']) - len(range(10, len(frames), 40))
    assert slow['frames on fast path'] == '0'
    untimed = [key for key in fast if 'latency' not in key and key not in (
        'rate [Hz]', 'frames', 'frames on fast path', 'frames late', 'frames dropped')]
    assert {key: fast[key] for key in untimed} == {key: slow[key] for key in untimed}
    for process in pair.processes.values():
        process.wait_for_line('left out')
    logged = {path: {line.split(']: ', 1)[1] for line in lines(process, 'left out')}
              for path, process in pair.processes.items()}
    assert logged['fast'] == logged['slow'] and len(logged['fast']) == 1


def test_nothing_of_a_burst_is_lost_or_out_of_order(pair):
    number = pair.meet()
    for found in pair.replies.values():
        found.clear()
    frames = [serialize_message(message(hand_at(offset=(.0001 * i, 0., 1.)), 2 * i))
              for i in range(number, number + 500)]  # of one kind, as their numbers are even
    thread = Thread(target=lambda: [pair.send(frame) for frame in frames])
    thread.start()
    pair.node.spin_until(lambda: len(pair.replies['fast']) == len(frames))
    thread.join()
    stamps = [answer.header.stamp for answer in pair.replies['fast']]
    assert stamps == [stamp_of(2 * i) for i in range(number, number + 500)]
    # Frames that come one by one take the fast path again.
    before = int(pair.values()['/fast/markers']['frames on fast path'])
    numbers = count(2 * (number + 500), 2)

    def one_more():
        at = next(numbers)
        pair.answer(at, message(hand_at(), at))

    pair.node.repeat(one_more, lambda: int(
        last_values(pair.diagnostics)['/fast/markers']['frames on fast path']) > before + 20)


def last_values(diagnostics):
    """Return the last values of each tracker's diagnostics, by its topic."""
    return {status.hardware_id: {value.key: value.value for value in status.values}
            for array in diagnostics for status in array.status}


@contextmanager
def bench_of(node):
    """Yield a bench of a tracker that takes the fast path."""
    with NodeProcess(TRACKER_MODULE, LOSSLESS) as process:
        bench = Bench(process, node, 1000, 'hand_tracker')
        bench.meet(hand_at())
        diagnostics = node.collect(DiagnosticArray, '/diagnostics')
        yield bench
        node.repeat(lambda: bench.answer(hand_at()), lambda: diagnostics and int(
            last_values(diagnostics)['/markers']['frames on fast path']) > 0)


def test_a_parameter_acts_from_the_next_frame_on():
    with watching_node() as node, bench_of(node) as bench:
        for _ in range(20):
            before = bench.angles(hand_at())
        joint = JOINTS.index('index_pip_flexion')
        limit = np.degrees(before[joint]) - 5.
        assert bench.set({'limits.index_pip_flexion.upper_deg': limit}).successful
        assert bench.angles(hand_at())[joint] == pytest.approx(np.radians(limit))
        assert not bench.set({'limits.index_pip_flexion.upper_deg': -400.}).successful
        assert bench.angles(hand_at())[joint] == pytest.approx(np.radians(limit))
        assert bench.set({'labels.index': ''}).successful
        bench.answer(hand_at())
        # Who comes later hears too.
        deviations = node.collect(JointState, 'joint_confidence')
        node.repeat(lambda: bench.answer(hand_at()), lambda: deviations)
        node.spin_until(lambda: deviations[-1].header.stamp == bench.joint_states[-1].header.stamp)
        assert 0. < deviations[-1].position[joint] < .4
        # A live limit changes what the unknown is.
        before = deviations[-1].effort[joint]
        assert bench.set({'limits.index_pip_flexion.upper_deg': .5 * limit}).successful
        bench.answer(hand_at())
        node.spin_until(lambda: deviations[-1].header.stamp == bench.joint_states[-1].header.stamp)
        assert before - deviations[-1].effort[joint] == pytest.approx(
            LIMITS_SHARE * np.radians(.5 * limit))


def test_no_frame_is_lost_while_a_glove_measures_last_joints():
    with watching_node() as node, bench_of(node) as bench:
        glove = node.create_publisher(JointState, 'distal_flexion', 10)
        node.spin_until(lambda: glove.get_subscription_count() > 0)
        bench.answer(hand_at())
        bench.joint_states.clear()
        first = bench.number
        for number in range(300):
            positions = hand_at()
            if number % 3:
                positions[number % 5 + 3] = np.nan  # now sent, now left out: of another kind
            bench.send(positions)
            glove.publish(JointState(name=['index_dip_flexion'], position=[.3]))
            node.spin_for(.001)
        node.spin_until(lambda: len(bench.joint_states) == bench.number - first)
        stamps = [answer.header.stamp for answer in bench.joint_states]
        assert stamps == [stamp_of(number) for number in range(first + 1, bench.number + 1)]


@contextmanager
def own_node(is_fed=False):
    """Yield a tracker in this very process, and what takes its markers if it is fed."""
    from hand_tracker.nodes.runner import spinning
    from hand_tracker.nodes.tracker_node import TrackerNode
    rclpy.init(args=['--ros-args', '-p', 'qos.markers.reliability:=reliable',
                     '-p', 'qos.markers.depth:=1000', '-p', 'auto_size:=false'])
    node = TrackerNode()
    take = node.inputs[0].taker('/markers', MarkerArray) if is_fed else None
    try:
        with spinning(node):
            yield (node, take) if is_fed else node
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_the_state_is_published_once_a_period():
    with own_node() as tracker:
        assert round(1e9 * STATUS_PERIOD) in [timer.timer_period_ns for timer in tracker.timers]


def test_a_driver_in_the_same_process_is_heard():
    with own_node() as tracker, watching_node() as node:
        assert tracker.inputs[0].subscription not in list(tracker.subscriptions)
        publisher = node.create_publisher(MarkerArray, 'markers', 1000)
        answers = node.collect(JointState, 'joint_states')
        node.spin_until(lambda: publisher.get_subscription_count() > 0)
        numbers = count(2, 2)
        node.repeat(lambda: publisher.publish(message(hand_at(), next(numbers))),
                    lambda: answers, .05)

        def one_more():
            number = next(numbers)
            publisher.publish(message(hand_at(), number))
            node.spin_until(lambda: answers[-1].header.stamp == stamp_of(number))

        node.repeat(one_more, lambda: tracker.inputs[0].fast_path.frame_count > 50, 0.)


def changing_messages(count):
    """Return messages and stamps; some lack a marker or are of another layout, or are damaged."""
    random = np.random.default_rng(2)
    found = []
    for number, positions in enumerate(motion(RIGHT, count), 1):
        positions = positions.copy()
        if random.random() < .2:
            positions[random.integers(3, 8)] = np.nan  # left out: of another layout
        # Time jumps back twice; a stray stamp is not believed at once.
        array = message(positions, 1 + number % (count // 3) + LATE * (number < count // 3))
        if random.random() < .1:
            array.markers.reverse()
        data, stamp = serialize_message(array), array.markers[0].header.stamp
        found.append((data[:random.integers(4, len(data))], None) if random.random() < .05
                     else (data, stamp))
    return found


def test_messages_that_are_handed_over_are_answered_as_those_that_are_heard():
    with NodeProcess(TRACKER_MODULE, LOSSLESS, {'__ns': '/heard'}) as process, \
            own_node(is_fed=True) as (tracker, take), watching_node() as node:
        assert node.count_subscribers('/markers') == 0
        publisher = node.create_publisher(MarkerArray, '/heard/markers', 1000)
        heard = node.collect(JointState, '/heard/joint_states')
        handed = node.collect(JointState, '/joint_states')
        process.wait_for_line('listening')
        node.spin_until(lambda: publisher.get_subscription_count() > 0)
        numbers = count(2 * LATE, 2)

        sent = []

        def meet():
            sent.append(next(numbers))
            data = serialize_message(message(hand_at(), sent[-1]))
            publisher.publish(data)
            take(data)

        node.repeat(meet, lambda: heard and handed, .05)
        node.spin_until(lambda: all(
            found[-1].header.stamp == stamp_of(sent[-1]) for found in (heard, handed)))
        heard.clear(), handed.clear()
        for data, stamp in changing_messages(300):
            publisher.publish(data)
            take(data)
            if stamp is not None:
                node.spin_until(lambda stamp=stamp: all(
                    found and found[-1].header.stamp == stamp for found in (heard, handed)))
        assert len(heard) == len(handed) > 250
        for one, other in zip(heard, handed):
            assert one.header == other.header and one.position == other.position
        assert 0 < tracker.inputs[0].fast_path.frame_count < len(handed)
        assert process.interrupt() == 0


def test_none_is_lost_or_overtaken_of_what_is_handed_over_in_haste():
    with own_node(is_fed=True) as (tracker, take), watching_node() as node:
        answers = node.collect(JointState, 'joint_states')
        sent = [2]

        def meet():
            sent.append(sent[-1] + 2)
            take(serialize_message(message(hand_at(), sent[-1])))

        node.repeat(meet, lambda: answers, .05)
        node.spin_until(lambda: answers[-1].header.stamp == stamp_of(sent[-1]))
        answers.clear()
        first = sent[-1] + 2

        def hurry():
            for number in range(first, first + 1000):
                positions = hand_at()
                if number % 50 == 0:
                    positions[number // 50 % 5 + 3] = np.nan
                take(serialize_message(message(positions, number)))

        thread = Thread(target=hurry)
        thread.start()
        node.spin_until(lambda: len(answers) == 1000)
        thread.join()
        assert [answer.header.stamp for answer in answers] == [
            stamp_of(number) for number in range(first, first + 1000)]
        assert tracker.inputs[0].fast_path.frame_count > 0


def test_pictures_are_limited_to_the_rate_of_the_parameter():
    rates = []

    def every_third(now, rate):
        rates.append(rate)
        return len(rates) % 3 == 0

    with own_node() as tracker, watching_node() as node:
        tracker.hands[0].display._limiter = SimpleNamespace(due=every_third)
        assert tracker.set_parameters([Parameter('display_rate', value=7.)])[0].successful
        publisher = node.create_publisher(MarkerArray, 'markers', 1000)
        pictures = node.collect(MarkerArray, 'hand_markers')
        numbers = count(2, 2)
        node.repeat(lambda: publisher.publish(message(hand_at(), next(numbers))),
                    lambda: len(pictures) > 2, .05)
        node.spin_until(lambda: len(pictures) == len(rates) // 3)
        assert set(rates) == {7.}


@contextmanager
def handlers_restored():
    handlers = {number: signal.getsignal(number) for number in INTERRUPTS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@pytest.mark.parametrize('auto_size', ['false', 'true'])
def test_the_end_of_ros_is_the_end_of_the_node(auto_size):
    with watching_node() as node:
        publisher = node.create_publisher(MarkerArray, 'markers', 10)
        answers = node.collect(JointState, 'joint_states')
        ended = Event()

        def drive():
            number = 0
            while not ended.wait(.002):
                number += 2
                publisher.publish(message(hand_at(), number))

        def listen():
            try:
                node.spin_until(lambda: len(answers) > 100 or ended.is_set())
            finally:
                rclpy.try_shutdown()

        threads = Thread(target=drive), Thread(target=listen)
        for thread in threads:
            thread.start()
        try:
            # While the size is learned, the slow path publishes.
            with handlers_restored():
                assert run(tracker_node.TrackerNode,
                           args=['--ros-args', '-p', f'auto_size:={auto_size}']) == 0
        finally:
            ended.set()
            for thread in threads:
                thread.join()
            gc.unfreeze()
        assert len(answers) > 100


def test_the_end_of_ros_within_a_callback_is_the_end_of_the_node():
    def publish_after_the_end(node):
        publisher = node.create_publisher(JointState, 'joint_states', 10)
        rclpy.shutdown()
        publisher.publish(JointState())

    with handlers_restored():
        assert run(lambda: Node('ending'), publish_after_the_end, args=[]) == 0


def test_an_error_of_ros_that_is_not_its_end_is_raised():
    def fail(node):
        raise RuntimeError('the publisher is broken')

    with handlers_restored(), pytest.raises(RuntimeError, match='broken'):
        run(lambda: Node('failing'), fail, args=[])


def test_an_executor_that_waits_for_conditions_takes_the_slow_path():
    from hand_tracker.nodes.tracker_node import TrackerNode
    rclpy.init()
    tracker, executor = TrackerNode(), SingleThreadedExecutor()
    try:
        assert tracker._loaded_fast_paths and tracker.inputs[0].fast_path is None
        assert tracker.inputs[0].subscription in list(tracker.subscriptions)
        executor.add_node(tracker)
        with watching_node() as node:
            publisher = node.create_publisher(MarkerArray, 'markers', 10)
            answers = node.collect(JointState, 'joint_states')
            numbers = count(1)

            def one_more():
                publisher.publish(message(hand_at(), next(numbers)))
                executor.spin_once(.01)

            node.repeat(one_more, lambda: len(answers) > 9, .01)
    finally:
        executor.shutdown()
        tracker.destroy_node()
        rclpy.shutdown()


def test_a_middleware_that_was_not_tried_takes_the_slow_path(monkeypatch):
    monkeypatch.setattr(callback_path, 'SUPPORTED_MIDDLEWARES', ())
    with own_node() as tracker:
        assert not tracker._loaded_fast_paths
        assert tracker.inputs[0].subscription in list(tracker.subscriptions)
