"""The tracker node over DDS, in a process of its own."""

import os
import re
import sys
import time
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import rclpy.time
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Pose
from helpers.bench import (
    LATE,
    TRACKER_MODULE,
    Bench,
    begun_anew,
    lines,
    message,
    messages,
    tracking,
)
from helpers.hands import BENT_ANGLES, RIGHT, hand_at, markers_of, motion
from helpers.ros_process import PATIENCE, PLAIN_PYTHON, NodeProcess, Process, watching_node
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.core.model.hand import DIGITS, JOINTS, LINKS, Hand, preset_limits
from hand_tracker.core.model.kinematics import tip_offsets
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.model.states import PalmState
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.pose.deviation import unknown_deviation
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.hand_file import load_hand, save_hand
from hand_tracker.messages.stamps import seconds
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking.diagnostics import STATUS_GAP
from hand_tracker.tracking.distal_flexion import DISTAL_JOINTS
from hand_tracker.tracking.rate_limit import KEYS_LOGGED

NEEDS = 'rclpy',

CONFIG = Path(__file__).parents[2] / 'config' / 'tracker.yaml'
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope='module', autouse=True)
def solved():
    """Return what the tracker finds of that hand; compiles before nodes are waited for."""
    angles = HandTracker().update(hand_at()).angles
    assert np.allclose(angles[:20], BENT_ANGLES[:20], rtol=0, atol=1e-9)
    return angles


def matrix(transform):
    """Return a transform as a homogeneous matrix."""
    q, at = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array((
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), at.x),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), at.y),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), at.z),
        (0., 0., 0., 1.)))


def test_joint_states_are_those_of_the_core():
    frames = motion(RIGHT)
    tracker = begun_anew(HandTracker(), frames[0])
    with tracking() as bench:
        bench.meet(frames[0])
        for frame in frames:
            heard = bench.answer(frame)
            state = tracker.update(np.where(frame.any(axis=1)[:, None], frame, np.nan),
                                   seconds(heard.header.stamp))
            assert list(heard.name) == [f'right_{joint}' for joint in JOINTS]
            assert np.array_equal(heard.position, state.angles)
        assert bench.node.count_subscribers('hand_markers') == 0
        check_picture(bench, state.palm)
        bench.process.wait_for_line(': tracking')
        # Said once, and again only after what it had the time to tell of while this was held up.
        told = lines(bench.process, ': tracking')
        assert [line.endswith(': tracking') for line in told] == [True] + [False] * (len(told) - 1)
        assert len(told) <= 1 + len(lines(bench.process, 'the last pose is kept')) + len(
            lines(bench.process, 'no markers on /markers for'))


def check_picture(bench, palm):
    """Check that the hand's picture is made once someone looks."""
    assert palm == PalmState.TRACKED
    pictures = bench.node.collect(MarkerArray, 'hand_markers')
    bench.meet(hand_at(), heard=(pictures,))
    sent = []
    bench.node.repeat(lambda: sent.append(bench.answer(hand_at()).header.stamp),
                      lambda: pictures[-1].markers[0].header.stamp in sent, .05)
    parts = {part.ns: part for part in pictures[-1].markers}
    assert set(parts) == {'right_bones', 'right_joints', 'right_markers'}
    assert all(part.header.frame_id == 'mocap' for part in parts.values())
    shown = [(p.x, p.y, p.z) for p in parts['right_markers'].points]
    assert np.array_equal(shown, hand_at())
    assert bench.set({'display_rate': 5.}).successful
    del pictures[:]
    bench.node.repeat(lambda: sent.append(bench.answer(hand_at()).header.stamp),
                      lambda: len(pictures) > 6, 0.)
    # Of some of the frames, each shown once.
    shown = [picture.markers[0].header.stamp for picture in pictures]
    assert shown == [stamp for stamp in sent if stamp in shown]


def test_transforms_of_every_frame_are_those_of_the_core():
    kind = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs').TFMessage
    hand = RIGHT.mirrored()
    frames = motion(hand, 30)
    tracker = begun_anew(HandTracker(hand), frames[0])
    with tracking({'side': 'left', 'broadcast': 'all'}) as bench:
        moving, static = bench.node.collect(kind, '/tf'), bench.node.collect(
            kind, '/tf_static', LATCHED)
        bench.meet(frames[0], heard=(moving, static))
        for frame in frames:
            stamp = bench.answer(frame).header.stamp
            state = tracker.update(np.where(frame.any(axis=1)[:, None], frame, np.nan),
                                   seconds(stamp))
            bench.node.spin_until(
                lambda stamp=stamp: moving[-1].transforms[0].header.stamp == stamp)
            world = {'mocap': np.eye(4)}
            for sent in moving[-1].transforms:
                assert sent.header.stamp == stamp
                world[sent.child_frame_id] = (
                    world[sent.header.frame_id] @ matrix(sent.transform))
            assert len(world) == 2 + len(LINKS)
            wrist = world['left_wrist']
            assert np.allclose(wrist[:3, :3], state.wrist_rotation, rtol=0, atol=1e-12)
            assert np.allclose(wrist[:3, 3], state.wrist_position, rtol=0, atol=1e-12)
            for i, link in enumerate(LINKS):
                pose = world[f'left_{link}']
                assert np.allclose(pose[:3, :3], state.pose.rotation[i], rtol=0, atol=1e-12)
                assert np.allclose(pose[:3, 3], state.pose.position[i], rtol=0, atol=1e-12)
        tips = {sent.child_frame_id: sent for sent in static[0].transforms}
        for digit, offset in zip(DIGITS, tip_offsets(hand)):
            sent = tips[f'left_{digit}_tip']
            assert sent.header.frame_id == f'left_{digit}_distal'
            assert np.array_equal(matrix(sent.transform)[:3, 3], offset)


def test_wrist_alone_with_a_hand_file_and_names_of_ones_own(tmp_path):
    kind = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs').TFMessage
    hand = Hand.scaled(.2, .095, side='left', limits=preset_limits('wide'))
    layout = MarkerLayout(offsets=np.full((8, 3), .004))
    save_hand(tmp_path / 'hand.yaml', hand, layout)
    tracker = HandTracker(hand, layout)
    angles = BENT_ANGLES * np.where([joint.endswith('pip_flexion') for joint in JOINTS], 2.3, 1.)
    frame = hand_at(angles, hand, layout)
    state = tracker.update(frame)
    assert np.degrees(state.angles).max() > 100.
    with tracking({'hand_file': str(tmp_path / 'hand.yaml'), 'prefix': 'me/',
                   'wrist_frame': 'strap'}) as bench:
        moving, static = bench.node.collect(kind, '/tf'), bench.node.collect(
            kind, '/tf_static', LATCHED)
        bench.meet(frame, heard=(moving,))
        heard = bench.answer(frame)
        bench.node.spin_until(lambda: moving[-1].transforms[0].header.stamp == heard.header.stamp)
        assert not static
        assert list(heard.name) == [f'me/{joint}' for joint in JOINTS]
        assert np.allclose(heard.position, state.angles, rtol=0, atol=1e-9)
        sent, = moving[-1].transforms
        assert (sent.header.frame_id, sent.child_frame_id) == ('mocap', 'strap')
        assert np.allclose(matrix(sent.transform)[:3, 3], state.wrist_position, rtol=0, atol=1e-9)


def test_parameters_at_run_time(solved):
    pip = JOINTS.index('index_pip_flexion')
    upper, lower = (f'limits.index_pip_flexion.{bound}_deg' for bound in ('upper', 'lower'))
    frame = hand_at()
    # Angles that are filtered go over to what a parameter allows within some frames.
    with tracking({'angle_filter': False}) as bench:
        bench.meet(frame)
        assert bench.angles(frame)[pip] == pytest.approx(BENT_ANGLES[pip])
        assert bench.set({upper: 20.}).successful
        assert bench.angles(frame)[pip] == np.radians(20.)

        for values, reason in (
                ({upper: 30., lower: 200.},
                 rf'{lower} out of range.*Min: -180.*Max: 180.*value: 200'),
                ({upper: 30., lower: 31.},
                 'limits of index_pip_flexion: 31 to 30 degrees; the lower limit must not exceed'),
                ({upper: 30., 'finger_ik': 'magic'},
                 "finger_ik: 'magic' is not one of closed_form, fabrik"),
                ({upper: 30., 'side': 'left'}, 'read-only parameter: side'),
                ({upper: 30., 'labels.wrist': 7}, "labels.thumb: '7' is already wrist's"),
                ({upper: 30., 'labels.wrist': 'led'}, "labels.wrist: 'led'; expected an id"),
                ({upper: 30., 'unit_scale': 0.}, 'unit_scale out of range'),
                ({upper: float('nan')}, f'{upper} out of range'),
                # Kilted's rclpy names the types by their numbers.
                ({upper: 30}, "DOUBLE.*INTEGER|expected '3' got '2'")):
            result = bench.set(values)
            assert not result.successful
            assert re.search(reason, result.reason), result.reason
            assert bench.angles(frame)[pip] == np.radians(20.)

        one_by_one = bench.parameters(
            SetParameters, 'set_parameters', parameters=messages({upper: 30., lower: 200.})).results
        assert [result.successful for result in one_by_one] == [True, False]
        assert bench.angles(frame)[pip] == np.radians(30.)

        # Two sets in one go, and one that needs the other.
        assert bench.set({upper: 95., 'labels.wrist': 90}).successful
        assert bench.set({'labels.thumb': '0', 'labels.wrist': 'leds/7'}).successful
        swapped = frame[[7, *range(1, 7), 0]]
        assert np.allclose(bench.angles(swapped), solved, rtol=0, atol=1e-6)

        assert bench.set({'coupling.index.slope': .5, 'finger_ik': 'fabrik'}).successful
        angles = bench.angles(swapped)
        assert angles[JOINTS.index('index_dip_flexion')] == pytest.approx(.5 * angles[pip])
        assert angles[pip] == pytest.approx(BENT_ANGLES[pip], abs=1e-3)


def test_a_misspelt_parameter_is_named_and_help_starts_no_node():
    with NodeProcess(TRACKER_MODULE, {'hand_lenght': .19, 'rigidity': False},
                     environment=PLAIN_PYTHON) as process:
        process.wait_for_line("there is no parameter 'hand_lenght': left out; "
                              "did you mean 'hand_length'?")
        assert process.interrupt() == 0
    assert 'rigidity' not in process.output
    for node, command in (('tracker', False), ('skin', True)):
        with Process([sys.executable, '-m', 'hand_tracker.entry', node, '--help']) as shown:
            assert shown.wait() == 0
        assert f'usage: ros2 run hand_tracker {node}' in shown.output
        assert (f'hand_tracker {node} --help' in shown.output) == command


def test_the_documented_parameter_file_changes_nothing_and_all_is_described(tmp_path):
    file = tmp_path / 'hand.yaml'
    save_hand(file, Hand.scaled(
        .2, .1, side='left', limits=.5 * preset_limits('wide'),
        coupling=((.7, np.radians(3.)),) * 5).with_paper_thumb(), MarkerLayout())
    with NodeProcess(TRACKER_MODULE, {'hand_file': str(file)},
                     environment=PLAIN_PYTHON) as process, watching_node() as node:
        plain = described(Bench(process, node, 10, 'hand_tracker'))
        assert process.interrupt() == 0
    with NodeProcess(TRACKER_MODULE, files=[CONFIG],
                     parameters={'hand_file': str(file)}) as process, watching_node() as node:
        bench = Bench(process, node, 10, 'hand_tracker')
        assert described(bench) == plain
        bench.meet(hand_at(hand=load_hand(file)[0]))
        assert process.interrupt() == 0
    for joint in JOINTS:
        assert {f'limits.{joint}.lower_deg', f'limits.{joint}.upper_deg'} <= set(plain)
    for name, (value, about) in plain.items():
        assert about.description, name
        if value.type in (ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE):
            assert len(about.integer_range) + len(about.floating_point_range) == 1, name


def described(bench):
    """Return value and description of every parameter of ours, by name."""
    names = [name for name in bench.parameters(ListParameters, 'list_parameters').result.names
             if name != 'use_sim_time' and not name.startswith('start_type_description')]
    return dict(zip(names, zip(
        bench.parameters(GetParameters, 'get_parameters', names=names).values,
        bench.parameters(DescribeParameters, 'describe_parameters', names=names).descriptors)))


def test_phasespace_messages_in_millimetres(solved):
    frame = hand_at()
    parameters = {'unit_scale': .001, 'mocap_frame': 'mocap'}
    parameters.update({f'labels.{marker}': f'leds/{10 + i}' for i, marker in enumerate(MARKERS)})

    def phasespace(number):
        array = message(1000. * frame, number)
        for marker in array.markers[:]:
            marker.id += 10
            text = Marker(header=marker.header, ns='ids', id=marker.id,
                          type=Marker.TEXT_VIEW_FACING, pose=Pose())
            at = marker.pose.position
            text.pose.position = Point(x=at.x, y=at.y, z=at.z + 40.)
            array.markers.append(text)
        array.markers.insert(0, Marker(action=Marker.DELETEALL))
        return array

    with tracking(parameters, remaps={'markers': 'phase_space_markers'}) as bench:
        bench.publisher = bench.node.create_publisher(MarkerArray, 'phase_space_markers', 10)
        bench.process.wait_for_line('listening for markers on /phase_space_markers')
        bench.node.spin_until(lambda: bench.publisher.get_subscription_count() > 0)
        numbers = count(1)
        bench.node.repeat(lambda: bench.publisher.publish(phasespace(next(numbers))),
                          lambda: bench.joint_states, .05)
        assert np.allclose(bench.joint_states[-1].position, solved, rtol=0, atol=1e-6)


def test_junk_is_survived_and_each_cause_logged_once(solved):
    rng = np.random.default_rng(3)
    frame = hand_at()
    junk = [MarkerArray(), MarkerArray(markers=[Marker(action=Marker.DELETEALL)])]
    for i in range(10):
        junk += [
            message(rng.standard_normal((8, 3)) * 10.**rng.uniform(-300, 300), 1, frame=f'{i}'),
            message(rng.choice((np.nan, np.inf, 0., 1e300), (8, 3)), 0),
            message(np.zeros((8, 3)), 0, ns=''),
            message(np.repeat(frame[:1], 8, axis=0), 1),
            message(frame[[0, 0, 1, 1, 4, 4, 7, 7]], 1),
            message(frame, 0, frame=''),
            MarkerArray(markers=message(frame, 1).markers * 20),
            MarkerArray(markers=message(frame, 1).markers[:4]
                        + message(frame, 1, frame=f'{i}').markers[4:]),
            MarkerArray(markers=[Marker(id=j, type=j, action=j % 4, ns=f'{i}', points=[Point()])
                                 for j in range(13)]),
            message(frame, 1, ns='x' * 1000)]
    with tracking() as bench:
        bench.meet(frame)
        for i in range(1000):
            bench.publisher.publish(junk[i % len(junk)])
        bench.publisher.publish(message(frame, 0))
        bench.number = LATE
        for _ in range(2):
            bench.send(frame)
        bench.jump_back(frame)
        assert np.allclose(bench.angles(frame), solved, rtol=0, atol=1e-6)
        for heard in bench.joint_states:
            assert np.isfinite(heard.position).all()
            assert (heard.position >= RIGHT.limits[:, 0]).all()
            assert (heard.position <= RIGHT.limits[:, 1]).all()

        def said():
            return [line.split(']: ', 1)[1] for text in ('left out', 'several markers')
                    for line in lines(bench.process, text)]

        # Lines are logged ten times a second: after the answers.
        bench.node.spin_until(lambda: len(said()) > 1)
        # Each cause once, and no more of them than are ever logged.
        causes = said()
        assert 1 < len(causes) == len(set(causes)) <= KEYS_LOGGED


def test_markers_without_stamp_or_frame_from_a_best_effort_publisher():
    with tracking({'qos.markers.reliability': 'best_effort'}, BEST_EFFORT) as bench:
        bench.meet(hand_at())
        before = bench.node.get_clock().now()
        array = message(hand_at(), 0, frame='')

        def received():
            return rclpy.time.Time.from_msg(bench.joint_states[-1].header.stamp)

        bench.node.repeat(
            lambda: bench.publisher.publish(array), lambda: received() >= before)
        assert received() <= bench.node.get_clock().now()
        bench.process.wait_for_line('have no frame')
        assert len(lines(bench.process, 'have no stamp')) == 1
        assert len(lines(bench.process, 'have no frame')) == 1


def test_stamps_of_any_kind_deviations_and_diagnostics():
    whole = hand_at()
    without_index, palmless = whole.copy(), whole.copy()
    without_index[3] = palmless[0] = np.nan
    with tracking() as bench:
        told = bench.node.collect(DiagnosticArray, '/diagnostics')
        deviations = bench.node.collect(JointState, 'joint_confidence')
        bench.meet(whole, heard=(told, deviations))
        check_stamps(bench, whole, palmless)
        check_deviations(bench, whole, without_index, deviations)
        check_diagnostics(bench, whole, without_index, told)


def check_stamps(bench, whole, palmless):
    """Check that repeated stamps are served, and that all begins anew where they jump back."""
    stamp = bench.answer(whole).header.stamp
    del bench.joint_states[:]
    # One by one: in plain Python, frames that come too fast are left out.
    for answered in range(1, 6):
        bench.number -= 1
        assert bench.send(whole) == stamp
        bench.node.spin_until(lambda answered=answered: len(bench.joint_states) == answered)
    assert all(heard.header.stamp == stamp for heard in bench.joint_states)
    bench.number = LATE
    for _ in range(2):
        bench.answer(whole)
    bench.number = 0
    del bench.joint_states[:]
    # Until the next goes on from it, the stamp is a stray one.
    first = bench.answer(palmless).header.stamp
    for _ in range(3):
        bench.send(palmless)
    stamp = bench.answer(whole).header.stamp
    assert [heard.header.stamp for heard in bench.joint_states] == [first, stamp]
    bench.process.wait_for_line('jumped back')
    assert len(lines(bench.process, 'jumped back')) == 1


def check_deviations(bench, whole, without_index, deviations):
    """Check that the deviations are those of the core, with the stamp of the joint states."""
    bench.number = LATE
    for _ in range(2):
        bench.answer(whole)
    bench.jump_back(whole)
    tracker = begun_anew(HandTracker(), whole)
    for frame in (whole, without_index, without_index):
        stamp = bench.answer(frame).header.stamp
        bench.node.spin_until(lambda stamp=stamp: deviations[-1].header.stamp == stamp)
        assert list(deviations[-1].name) == list(bench.joint_states[-1].name)
        assert np.array_equal(
            deviations[-1].position, tracker.update(frame, seconds(stamp)).deviation)
        assert np.array_equal(deviations[-1].effort, unknown_deviation(tracker.hand.limits))


def test_limits_reach_robot_state_publisher_at_the_start_and_at_run_time():
    def limit():
        shown.spin_for(.01)
        robot = ElementTree.fromstring(shown.get_parameter('robot_description').value or '<robot/>')
        found = robot.find("joint[@name='right_index_pip_flexion']/limit")
        return None if found is None else round(np.degrees(float(found.get('upper'))), 6)

    upper = 'limits.index_pip_flexion.upper_deg'
    with tracking({upper: 100.}) as bench, watching_node('robot_state_publisher') as shown:
        shown.declare_parameter('robot_description', '')
        bench.meet(hand_at())
        bench.node.repeat(lambda: bench.answer(hand_at()), lambda: limit() == 100., 0.)
        assert bench.set({upper: 110.}).successful
        bench.node.repeat(lambda: bench.answer(hand_at()), lambda: limit() == 110., 0.)


def test_the_size_of_the_hand_is_learned_and_reaches_robot_state_publisher():
    hand = Hand.scaled(.205, .095)
    angles, *wrist = motion_named('demo', hand, 7).sample(np.arange(0., 7., 1. / 120.))
    frames = markers_of(hand, angles, None, *wrist)
    with tracking({'auto_size': True}) as bench, watching_node('robot_state_publisher') as shown:
        shown.declare_parameter('robot_description', '')
        told = bench.node.collect(DiagnosticArray, '/diagnostics')
        bench.meet(frames[0])
        for frame in frames:
            bench.answer(frame)
        bench.node.repeat(lambda: bench.answer(frames[-1]),
                          lambda: told and values(told[-1])['hand size'] == 'learned', 0.)

        def urdf():
            shown.spin_for(.01)
            return shown.get_parameter('robot_description').value

        bench.node.repeat(lambda: bench.answer(frames[-1]), urdf, 0.)
        description = urdf()
        found = np.array([bench.angles(frame) for frame in frames[650:]])
        # What the frames before taught was read in another unit.
        assert bench.set({'unit_scale': 1.001}).successful
        del told[:]
        bench.answer(frames[-1])
        bench.node.repeat(lambda: None,
                          lambda: told and values(told[-1])['hand size'] == 'learning', .1)
    pip = JOINTS.index('index_pip_flexion')
    assert np.degrees(np.abs(found - angles[650:])[:, pip].mean()) < 4.
    bone = re.search(r'name="right_index_pip_flexion".*?xyz="(\S+)', description, re.DOTALL)
    assert float(bone.group(1)) == pytest.approx(hand.finger_bones[0, 0], rel=.02)


def check_diagnostics(bench, whole, without_index, told):
    """Check what is told of the state, and that it is told again without any change."""
    def until(positions, key, value, every=0.):
        """Send frames, with a pause after each [s], until a value is told; return the message."""
        del told[:]

        def found():
            return [each for each in told if values(each)[key].startswith(value)]

        bench.node.repeat(lambda: bench.answer(positions), found, every)
        return found()[0]

    until(whole, 'index marker', 'seen')
    # With the pause the time of the stamps, 120 frames a second, does not outrun the reports.
    status, = until(without_index, 'index marker', 'predicted for 0.', .01).status
    assert (status.name, status.hardware_id) == ('hand_tracker: right hand', '/markers')
    assert (status.level, status.message) == (DiagnosticStatus.OK, 'tracking')
    status, = until(np.full((8, 3), 1e6), 'palm', 'lost').status
    assert status.level == DiagnosticStatus.ERROR
    until(whole, 'palm', 'tracked')
    del told[:]
    bench.node.repeat(lambda: bench.answer(whole),
                      lambda: told and values(told[-1])['latency p50 [ms]'], 0.)
    last = values(told[-1])
    assert 0. < float(last['latency p50 [ms]']) <= float(
        last['latency p99 [ms]']) <= float(last['latency max [ms]'])
    assert last['frames dropped'].isdigit()

    bench.node.spin_until(lambda: told[-1].status[0].level == DiagnosticStatus.STALE)
    before = bench.node.get_clock().now()
    del told[:]
    bench.node.spin_until(lambda: len(told) == 4)
    stamps = [rclpy.time.Time.from_msg(each.header.stamp) for each in told]
    assert before < stamps[0] and stamps == sorted(stamps)
    assert stamps[-1] < bench.node.get_clock().now()
    assert values(told[-1])['rate [Hz]'] == '0.0'


@pytest.mark.skipif(not COMPILED, reason='in plain Python, frames that come too fast are left out')
def test_a_change_is_published_at_once_but_not_at_the_rate_of_the_frames():
    whole, hidden = hand_at(), hand_at()
    hidden[3] = np.nan
    # Each frame is looked at by itself: of those of the fast path several are at a time.
    with tracking({'fast_path': False}) as bench:
        told = bench.node.collect(DiagnosticArray, '/diagnostics')
        bench.meet(whole, heard=(told,))
        at_once = 0
        # What is told once a second may come just before, and delay the next by STATUS_GAP.
        for _ in range(30):
            del told[:]
            bench.answer(whole)
            bench.node.spin_until(lambda: told and not is_hidden(told[-1])
                                  and age(bench.node, told[-1]) > 2. * STATUS_GAP)
            del told[:]
            for _ in range(100):
                bench.send(hidden)
            bench.node.spin_until(lambda: any(map(is_hidden, told)))
            first = next(filter(is_hidden, told))
            at_once += values(first)['index marker'] == 'predicted for 0.01 s'
            if at_once == 3:
                break
        assert at_once == 3

        bench.answer(whole)
        del told[:]
        for _ in range(100):
            bench.send(hidden)
            bench.send(whole)
        bench.answer(hidden)
        bench.node.spin_until(lambda: any(map(is_hidden, told)))
        assert len(told) < 200


def age(node, message):
    """Return how long ago a message was stamped [s]."""
    stamp = rclpy.time.Time.from_msg(message.header.stamp)
    return 1e-9 * (node.get_clock().now() - stamp).nanoseconds


def is_hidden(told):
    """Return whether a message of diagnostics tells that the index marker is not seen."""
    return values(told)['index marker'].startswith('predicted')


def values(told):
    """Return the values of a message of diagnostics by key."""
    return {pair.key: pair.value for pair in told.status[0].values}


def test_simulated_time():
    whole = hand_at()
    with tracking({'use_sim_time': True}) as bench:
        clock = bench.node.create_publisher(Clock, '/clock', 1)
        bench.process.wait_for_line('listening')
        bench.node.spin_until(lambda: bench.publisher.get_subscription_count() > 0
                              and clock.get_subscription_count() > 0)
        # Backwards too, as where a recording begins again.
        for now in (Time(sec=100), Time(sec=100, nanosec=10**7), Time(sec=5),
                    Time(sec=5, nanosec=10**7)):
            def heard(now=now):
                clock.publish(Clock(clock=now))
                bench.publisher.publish(message(whole, 0))
                bench.node.spin_for(.02)
                return bench.joint_states and bench.joint_states[-1].header.stamp == now
            bench.node.spin_until(heard)
        bench.process.wait_for_line('jumped back')


def test_a_looped_recording_on_its_own_clock():
    # Both the tracker and the test hear all of it.
    replayed = {'loop': True, 'clock': 100., 'start_offset': 21.5, 'topics': '/markers',
                'subscribers': 2, 'wait_for_subscriber': PATIENCE}
    with tracking({'use_sim_time': True}) as bench:
        frames = bench.node.collect(MarkerArray, 'markers')
        bench.process.wait_for_line('listening')

        def laps(headers):
            """Return the stamps between one jump back and the next."""
            stamps = np.array([seconds(header.stamp) for header in headers])
            return np.split(stamps, np.flatnonzero(np.diff(stamps) < 0.) + 1)[1:-1]

        def answered():
            return laps([heard.header for heard in bench.joint_states])

        with NodeProcess('hand_tracker.nodes.replay_node', replayed) as replay:
            bench.node.spin_until(lambda: len(answered()) >= 2)
            assert replay.interrupt() == 0
        sent = laps([frame.markers[0].header for frame in frames])
    for got, lap in zip(answered(), sent):
        # In plain Python, frames that come too fast are left out.
        assert np.array_equal(got, lap) if COMPILED else set(got) <= set(lap)
    assert len(lines(bench.process, 'jumped back')) == 1


def test_measured_flexion_of_a_last_joint_replaces_its_coupling_while_it_is_fresh():
    dip = JOINTS.index(DISTAL_JOINTS[0])
    measured = JointState(name=['right_index_dip_flexion', 'nose', 'thumb_ip_flexion'],
                          position=[.4, .1, float('nan')])
    with tracking({'distal_flexion_timeout': 1.}) as bench:
        flexion = bench.node.create_publisher(JointState, 'distal_flexion', 10)
        bench.meet(hand_at())
        coupled = bench.angles(hand_at())
        bench.node.spin_until(lambda: flexion.get_subscription_count() > 0)

        def follows():
            flexion.publish(measured)
            angles = bench.angles(hand_at())
            return abs(angles[dip] - .4) < 1e-3 and np.allclose(
                np.delete(angles, dip), np.delete(coupled, dip), rtol=0, atol=1e-3)

        bench.node.spin_until(follows)
        bench.node.spin_until(
            lambda: np.allclose(bench.angles(hand_at()), coupled, rtol=0, atol=1e-3))
        bench.process.wait_for_line("left out is 'nose'")
        assert len(lines(bench.process, 'left out is')) == 1


def test_one_hand_is_tracked_beside_the_other_ones_markers(solved):
    with tracking() as bench:
        bench.meet(hand_at(), ns='right')
        both = message(hand_at(), 1, ns='right')
        # Behind the right hand's, whose labels they would take over.
        both.markers += message(hand_at(offset=(.3, 0., 1.2)), 1, ns='left').markers
        del bench.joint_states[:]
        bench.node.repeat(
            lambda: bench.publisher.publish(both), lambda: len(bench.joint_states) > 3, .05)
        for heard in bench.joint_states:
            assert np.allclose(heard.position, solved, rtol=0, atol=1e-6)
        line, = lines(bench.process, "markers of namespace 'left' are left out")
        assert 'side:=both' in line and not lines(bench.process, 'several markers')


def test_says_once_when_no_label_matches():
    with tracking({'labels.wrist': 'hand/0'}) as bench:
        bench.process.wait_for_line('listening')
        # As many as the hand has would be labelled by its shape.
        array = message(hand_at()[:-1], 1)
        for marker in array.markers:
            marker.id += 100

        def keep_sending():
            bench.publisher.publish(array)
            return 'have held no marker of the hand' in bench.process.output

        bench.node.spin_until(keep_sending)
        for _ in range(20):
            keep_sending()
            bench.node.spin_for(.02)
        line, = lines(bench.process, 'have held no marker of the hand')
        assert "'leds/100'" in line and "'hand/0' (wrist)" in line
        assert not bench.joint_states


def test_a_unit_that_is_set_at_run_time_is_judged_by_the_frames_read_in_it():
    frame = hand_at()
    with tracking() as bench:
        bench.meet(frame)
        bench.answer(frame)
        assert bench.set({'unit_scale': .001}).successful
        del bench.joint_states[:]
        bench.node.repeat(lambda: bench.send(frame), lambda: (
            'palm markers are too close together for this hand: check unit_scale'
            in bench.process.output), .02)
        assert not bench.joint_states
        assert bench.set({'unit_scale': 1.}).successful
        bench.node.repeat(lambda: bench.send(frame), lambda: bench.joint_states, .02)


def test_stamps_of_another_clock_are_said_once():
    frame = hand_at()
    with tracking() as bench:
        told = bench.node.collect(DiagnosticArray, '/diagnostics')
        bench.meet(frame)
        bench.node.repeat(lambda: bench.send(frame), lambda: (
            'behind this clock, and so are joint states' in bench.process.output), .02)
        del told[:]
        bench.node.repeat(lambda: bench.send(frame), lambda: len(told) > 2, .02)
    assert len(lines(bench.process, 'behind this clock')) == 1


def test_says_when_nothing_can_come_even_without_a_clock():
    with tracking({'use_sim_time': True}, BEST_EFFORT, environment=PLAIN_PYTHON) as bench:
        bench.process.wait_for_line('no markers on /markers for 3 s: /test publishes with best '
                                    'effort')


def test_says_when_the_palm_is_lost_and_found_even_without_tf2_msgs(
        tmp_path, monkeypatch, solved):
    (tmp_path / 'tf2_msgs.py').write_text('raise ImportError')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    frame = hand_at()
    lost = frame.copy()
    lost[:3] = np.nan
    with tracking({'stale': 'hold'}) as bench:
        bench.process.wait_for_line('listening')
        bench.node.spin_until(lambda: bench.publisher.get_subscription_count() > 0)

        def until(positions, said):
            def sent():
                bench.send(positions)
                return said in bench.process.output
            bench.node.spin_until(sent)

        until(lost, 'waiting for the palm')
        assert not bench.joint_states
        until(frame, ': tracking')
        until(lost, 'the palm is lost')
        # The digits keep their places in the palm.
        assert np.allclose(bench.angles(lost), solved, rtol=0, atol=np.radians(2.))
        until(frame, 'tracking again')
        assert len(lines(bench.process, 'tf2_msgs is not installed')) == 1


def test_a_wrong_start_ends_with_one_line_and_exit_code_1(tmp_path):
    bad = tmp_path / 'hand.yaml'
    bad.write_text('finger_bones_mm: {index: [45, 26, 900]}')
    cases = (
        ({'side': 'middle'}, r"\]: side: 'middle' is not one of auto, right, left, both$"),
        ({'hand_breadth': 1}, "'hand_breadth'.*expecting type 'DOUBLE'$"),
        ({'limits.ring_mcp_flexion.upper_deg': -181.}, 'ring_mcp_flexion.upper_deg out of range'),
        ({'labels.thumb': '0'}, "labels.thumb: '0' is already wrist's"),
        ({'hand_file': str(bad)}, r'hand_file: .*hand.yaml: finger_bones_mm.index.*900'))
    with ExitStack() as stack:
        started = [(stack.enter_context(NodeProcess(
            TRACKER_MODULE, parameters, environment=PLAIN_PYTHON)), said)
            for parameters, said in cases]
        for process, said in started:
            assert process.wait() == 1, process.output
            line, = process.output.splitlines()
            assert '[ERROR]' in line
            assert re.search(said, line), line


def test_a_lack_of_numba_is_logged_in_one_line(tmp_path):
    (tmp_path / 'numba.py').write_text('raise ImportError')
    path = os.pathsep.join((str(tmp_path), os.environ.get('PYTHONPATH', '')))
    with NodeProcess(TRACKER_MODULE, environment={'PYTHONPATH': path}) as process:
        process.wait_for_line('listening')
        warning, = lines(process, 'slower')
        assert '[WARN]' in warning and 'numba is not installed' in warning
        assert 'pip install numba' in warning and 'compiles' not in process.output


def test_numba_turned_off_is_logged_in_one_line():
    pytest.importorskip('numba', reason='numba is not installed: there is nothing to turn off')
    with NodeProcess(TRACKER_MODULE, environment=PLAIN_PYTHON) as process:
        process.wait_for_line('listening')
        warning, = lines(process, 'slower')
        assert '[WARN]' in warning and 'HAND_TRACKER_JIT=0' in warning
        assert 'pip install' not in warning and 'compiles' not in process.output


@pytest.mark.parametrize('rule', [
    ('-r', 'a b'), ('-r', '__node:=a-b'), ('--params-file', '/nowhere.yaml'), ('--bogus',)])
def test_a_wrong_command_line_ends_with_one_line_and_exit_code_1(rule):
    with Process([sys.executable, '-m', TRACKER_MODULE, '--ros-args', *rule],
                 PLAIN_PYTHON) as process:
        assert process.wait() == 1, process.output
    # rcl says a line of its own before.
    line, = [line for line in process.output.splitlines() if '[rcl]' not in line]
    assert '[ERROR]' in line and '[hand_tracker]' in line
    assert rule[-1] in line and 'arguments.c' not in line
    assert 'Traceback' not in process.output


@pytest.mark.parametrize('delay', [.2, .35, .5, .7, .9])
def test_an_interrupt_while_importing_is_quiet(delay):
    # Python tells of each module: the time counts from the entry on, however slow its own start.
    with Process([sys.executable, '-X', 'importtime', '-m', 'hand_tracker.entry', 'tracker'],
                 ) as process:
        process.wait_for_line('hand_tracker.nodes')
        time.sleep(delay)
        assert not process.ended, process.output
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output and 'KeyboardInterrupt' not in process.output
