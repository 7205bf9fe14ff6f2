"""The tracker node of both hands over DDS: each as it would be tracked alone."""

import time
from contextlib import contextmanager

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.bench import LOSSLESS, TRACKER_MODULE, Bench, begun_anew, message, stamp_of
from helpers.hands import RIGHT, hand_at, motion
from helpers.ros_process import (
    PLAIN_PYTHON,
    NodeProcess,
    frames_on_fast_path,
    watching_node,
)
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from hand_tracker.core.model.hand import DIGITS, JOINTS, SIDES
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.stamps import seconds
from hand_tracker.tracking.marker_events import UNLABELLED_AFTER

NEEDS = 'rclpy',

LEFT = RIGHT.mirrored()
MIRROR = np.array((1., -1., 1.))
HANDS = {'right': RIGHT, 'left': LEFT}
REST_HANDS = hand_at(), hand_at(hand=LEFT)


class BothBench(Bench):
    """A bench whose frames are pairs: markers of the right and of the left hand, or None."""

    namespaces = SIDES
    first_ids = 0, 0

    def send(self, positions, **fields):
        """Send a frame of both hands in one message; return the stamp that it has."""
        self.number += 1
        stamp = None
        array = MarkerArray()
        for of_hand, ns, first in zip(positions, self.namespaces, self.first_ids):
            if of_hand is None:
                continue
            for marker in message(of_hand, self.number, ns=ns).markers:
                marker.id += first
                stamp = marker.header.stamp
                array.markers.append(marker)
        self.publisher.publish(array)
        return stamp


@contextmanager
def tracking_both(parameters=None, kind=BothBench):
    """Yield a bench of a tracker of both hands that loses nothing."""
    parameters = {'side': 'both', **LOSSLESS, **(parameters or {})}
    with NodeProcess(TRACKER_MODULE, parameters) as process, \
            watching_node() as node:
        yield kind(process, node, 1000, 'hand_tracker')
        assert process.interrupt() == 0, process.output
        assert 'Traceback' not in process.output


def names(*sides):
    return [f'{side}_{joint}' for side in sides for joint in JOINTS]


def test_each_hand_is_tracked_as_if_it_were_alone_while_the_other_vanishes():
    rights, lefts = motion(RIGHT, 120), motion(LEFT, 120)
    lefts[40:60] = [np.full((8, 3), np.nan)] * 20  # now as NaN, now left out
    alone = {side: begun_anew(HandTracker(HANDS[side]), frame)
             for side, frame in zip(SIDES, REST_HANDS)}
    with tracking_both() as bench:
        transforms = collected_transforms(bench.node)
        diagnostics = bench.node.collect(DiagnosticArray, '/diagnostics')
        bench.meet(REST_HANDS, heard=(transforms,) if transforms is not None else ())
        for number, frames in enumerate(zip(rights, lefts)):
            seen = {side: frame for side, frame in zip(SIDES, frames)
                    if not (number % 30 > 24 and side == SIDES[number // 30 % 2])}
            heard = bench.answer([seen.get(side) for side in SIDES])
            if bench.number % 2:
                # Markers that are NaN were left out: a hand without any is not in the message.
                seen = {side: frame for side, frame in seen.items() if not np.isnan(frame).all()}
            assert list(heard.name) == names(*seen)
            expected = [alone[side].update(
                np.where(frame.any(axis=1)[:, None], frame, np.nan), seconds(heard.header.stamp))
                for side, frame in seen.items()]
            assert np.array_equal(heard.position, np.concatenate(
                [state.angles for state in expected])), number
            if transforms is not None:
                bench.node.spin_until(lambda stamp=heard.header.stamp: (
                    transforms[-1].transforms[0].header.stamp == stamp))
                check_wrists(transforms[-1], dict(zip(seen, expected)))

        bench.node.repeat(lambda: bench.answer(REST_HANDS),
                          lambda: len(frames_on_fast_path(diagnostics)) == 2 and (
                              not COMPILED or min(frames_on_fast_path(diagnostics).values()) > 0))
        assert set(frames_on_fast_path(diagnostics)) == {
            f'hand_tracker: {side} hand' for side in SIDES}


def collected_transforms(node):
    """Return a list of the messages on /tf; None where there is none."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return None
    return node.collect(TFMessage, '/tf')


def check_wrists(message, states):
    """Check that one message has the wrist of each hand."""
    assert [sent.child_frame_id for sent in message.transforms] == [
        f'{side}_wrist' for side in states]
    for sent, state in zip(message.transforms, states.values()):
        at = sent.transform.translation
        assert np.array_equal((at.x, at.y, at.z), state.wrist_position)


def test_mirrored_markers_give_mirrored_hands():
    frames = motion(RIGHT, 60)
    with tracking_both() as bench:
        transforms = collected_transforms(bench.node)
        bench.meet(REST_HANDS)
        for frame in frames:
            heard = bench.answer((frame, frame * MIRROR))
            assert np.array_equal(heard.position[:25], heard.position[25:])
        if transforms is not None:
            bench.node.spin_until(
                lambda: transforms[-1].transforms[0].header.stamp == heard.header.stamp)
            right, left = (sent.transform for sent in transforms[-1].transforms)
            assert right.translation.x == left.translation.x
            assert right.translation.y == -left.translation.y
            # A mirror reverses the turns about the two axes in its plane.
            assert (right.rotation.x, right.rotation.y) == (-left.rotation.x, left.rotation.y)
            assert (right.rotation.z, right.rotation.w) == (-left.rotation.z, left.rotation.w)


def test_a_late_listener_hears_the_tips_of_both_hands():
    kind = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs').TFMessage
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with NodeProcess(TRACKER_MODULE, {'side': 'both', 'broadcast': 'all'},
                     environment=PLAIN_PYTHON) as process, watching_node() as node:
        process.wait_for_line('listening')
        late = node.collect(kind, '/tf_static', latched)
        node.spin_until(lambda: late)
        assert {sent.child_frame_id for sent in late[-1].transforms} == {
            f'{side}_{digit}_tip' for side in SIDES for digit in DIGITS}
        assert process.interrupt() == 0, process.output


class IdBench(BothBench):
    """A bench with both hands in one namespace, told apart by their ids."""

    namespaces = 'leds', 'leds'
    first_ids = 0, 8


def test_hands_are_told_apart_by_ids_and_two_of_one_place_are_refused():
    frames = {'right.markers': '0', 'left.markers': 'leds/8'}
    with tracking_both(frames, IdBench) as bench:
        pictures = {side: bench.node.collect(MarkerArray, f'{side}/hand_markers')
                    for side in SIDES}
        bench.meet(REST_HANDS, heard=tuple(pictures.values()))
        assert list(bench.answer(REST_HANDS).name) == names(*SIDES)
        for side in SIDES:
            assert {part.ns.split('_')[0] for part in pictures[side][-1].markers} == {side}
        result = bench.set({'left.markers': '0'})
        assert not result.successful and 'of both hands' in result.reason
        result = bench.set({'left.markers': 'leds'})
        assert not result.successful and 'left.markers' in result.reason
        # An option is of both hands, a limit of one.
        joint = JOINTS.index('index_pip_flexion')
        before = bench.angles(REST_HANDS)
        limit = np.degrees(before[joint]) - 5.
        assert bench.set({'left.limits.index_pip_flexion.upper_deg': limit,
                          'smoothing': False}).successful
        for _ in range(3):
            after = bench.angles(REST_HANDS)
        assert after[joint] == pytest.approx(before[joint], abs=1e-6)
        assert after[25 + joint] == pytest.approx(np.radians(limit))
        assert 'belong' not in bench.process.output


def test_each_hand_may_have_topics_of_its_own():
    with tracking_both({'marker_topics': 'separate', 'joint_state_topics': 'separate'}) as bench:
        node = bench.node
        publishers = {side: node.create_publisher(MarkerArray, f'{side}/markers', 1000)
                      for side in SIDES}
        answers = {side: node.collect(JointState, f'{side}/joint_states') for side in SIDES}
        bench.process.wait_for_line('listening for markers on /right/markers and /left/markers')

        def send(*sides):
            bench.number += 1
            for side in sides:
                publishers[side].publish(message(hand_at(hand=HANDS[side]), bench.number))

        node.repeat(lambda: send(*SIDES), lambda: all(answers.values()))
        for side in SIDES:
            assert list(answers[side][-1].name) == names(side)
        # What comes of one hand alone is answered alone.
        send('left')
        last = message(hand_at(), bench.number).markers[0].header.stamp
        node.spin_until(lambda: answers['left'][-1].header.stamp == last)
        assert answers['right'][-1].header.stamp != last


def test_names_of_one_hand_are_refused_for_both():
    with NodeProcess(TRACKER_MODULE, {'side': 'both', 'prefix': 'my_'}) as process:
        assert process.wait() == 1
        assert "prefix: 'my_'; expected auto for both hands" in process.output
        assert 'Traceback' not in process.output


class CloudBench(BothBench):
    """A bench whose points have no labels and no order, with two of no hand among them."""

    random = np.random.default_rng(1)

    def send(self, positions, **fields):
        """Send the points of both hands in one message; return the stamp that it has."""
        self.number += 1
        ghosts = positions[0][0] + self.random.uniform(.15, .2, (2, 3))
        cloud = np.concatenate((*positions, ghosts))
        self.publisher.publish(message(self.random.permutation(cloud), self.number))
        return stamp_of(self.number)


PAIRS = list(zip(motion(RIGHT)[:8], (left + (0., .4, 0.) for left in motion(LEFT)[:8])))


def test_points_without_labels_are_told_apart_by_the_shape_of_both_hands():
    with tracking_both({'labels': 'none', 'auto_size': False}, CloudBench) as bench:
        labelled = {side: bench.node.collect(MarkerArray, f'{side}/labelled_markers')
                    for side in SIDES}
        bench.meet(PAIRS[0], heard=tuple(labelled.values()))
        for pair in PAIRS:
            answer = bench.answer(pair)
            assert list(answer.name) == names(*SIDES)
            for side, expected in zip(SIDES, pair):
                found = labelled[side]
                bench.node.spin_until(lambda: found[-1].markers and (  # noqa: B023
                    found[-1].markers[0].header.stamp == answer.header.stamp))  # noqa: B023
                places = [(at.x, at.y, at.z) for at in (
                    marker.pose.position for marker in found[-1].markers)]
                np.testing.assert_array_equal(places, expected)


def test_labels_of_no_use_are_left_for_the_shape_of_both_hands():
    with tracking_both({'auto_size': False}, CloudBench) as bench:
        answers = bench.node.collect(JointState, 'joint_states')
        bench.node.repeat(lambda: bench.send(PAIRS[0]),
                          lambda: answers and list(answers[-1].name) == names(*SIDES), .02)
    assert bench.process.output.count("as with labels:='none'") == len(SIDES)


class CrowdedBench(BothBench):
    """A bench with as many markers of something else in each message as both hands have."""

    def send(self, positions, **fields):
        """Send a frame of both hands and the others in one message."""
        self.number += 1
        array = MarkerArray()
        for of_hand, ns in zip((*positions, hand_at(), hand_at()), (*SIDES, 'chair', 'table')):
            if of_hand is not None:
                array.markers += message(of_hand, self.number, ns=ns).markers
        self.publisher.publish(array)


def test_labels_stay_while_those_of_one_hand_come():
    with tracking_both({'fast_path': False}, CrowdedBench) as bench:
        answers = bench.node.collect(JointState, 'joint_states')
        bench.node.repeat(lambda: bench.send(REST_HANDS), lambda: answers, .02)
        for hidden in (None, REST_HANDS[1]), REST_HANDS, (REST_HANDS[0], None), REST_HANDS:
            until = time.monotonic() + 1.5 * UNLABELLED_AFTER
            bench.node.repeat(lambda hidden=hidden: bench.send(hidden),
                              lambda until=until: time.monotonic() > until, .02)
        assert list(answers[-1].name) == names(*SIDES)
    assert "labels:='none'" not in bench.process.output
