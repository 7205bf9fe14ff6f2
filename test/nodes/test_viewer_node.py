"""The viewer beside a running tracker: what it hears, and what its switches do there."""

import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from helpers.bench import hand_at, message, messages
from helpers.hands import markers_of
from helpers.markers import marker
from helpers.ros_process import PATIENCE, NodeProcess, Process, watching_node
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.calibration.live_take import CALIBRATION_KEY, NO_CALIBRATION, Coverage
from hand_tracker.calibration.prompts import PROMPTS
from hand_tracker.core.model.hand import JOINTS, Hand, preset_limits
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.hand_file import save_hand
from hand_tracker.messages.builders import diagnostics
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.stamps import seconds
from hand_tracker.nodes.live_tracker import LiveTracker
from hand_tracker.nodes.runner import spinning
from hand_tracker.package_data import packaged_recording
from hand_tracker.tracking.diagnostics import Level, Status
from hand_tracker.tracking.stream import Stream

NEEDS = 'rclpy',

DIP = JOINTS.index('index_dip_flexion')


def wait(condition):
    until = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < until, f'not in {PATIENCE:g} s'
        time.sleep(.02)


def heard(node):
    """Return the topics of the hand that a node listens to."""
    return {topic for topic, _ in node.get_subscriber_names_and_types_by_node(
        node.get_name(), node.get_namespace())} & {'/joint_states', '/hand_markers', '/markers'}


def refuse_others(line):
    if 'there is' in line:
        raise ValueError(line)


def test_it_shows_what_the_tracker_publishes_and_switches_its_constraints():
    rclpy.init()
    node = rclpy.create_node('viewer')
    try:
        with NodeProcess('hand_tracker.nodes.tracker_node', {'side': 'left'}), NodeProcess(
                'hand_tracker.nodes.replay_node', {
                    'recording': str(packaged_recording('left')), 'loop': True}), spinning(node):
            live = LiveTracker(node)
            live.prepare(print)
            assert live.hand.side == 'left'
            assert 'DIP coupling' in live.constraints
            assert 'Friction' not in live.constraints
            assert not heard(node)
            live.set_demand(looked_at=True, compared=False)
            wait(lambda: live.state() is not None)
            state = live.state()
            np.testing.assert_allclose(state.wrist_rotation @ state.wrist_rotation.T, np.eye(3),
                                       atol=1e-5)
            # Markers are at the joints of this hand, so that they tell whether it is in its place.
            seen = np.flatnonzero(state.marker_states == MarkerState.SEEN)
            assert len(seen) >= 3
            nearest = np.linalg.norm(
                state.markers[seen, None] - np.concatenate(
                    (state.pose.position, state.wrist_position[None])), axis=2).min(axis=1)
            assert np.median(nearest) < .002
            published = live._published
            joints, markers = published.joint_states[-1], published.hand_markers[-1]
            assert published.read(joints, markers) is not None
            assert published.read(joints, serialize_message(MarkerArray())) is None
            assert published.read(serialize_message(JointState()), markers) is None

            live.set_demand(looked_at=True, compared=True)
            wait(lambda: live.bare_state() is not None)
            live.set_demand(looked_at=True, compared=False)
            assert live.bare_state() is None
            wait(lambda: heard(node) == {'/joint_states', '/hand_markers'})
            wait(lambda: 'Hz' in live.numbers(state)['rate'])
            wait(lambda: live.state().angles[DIP] > .05)
            live.constrain(live.constraints - {'DIP coupling'})
            wait(lambda: live.state().angles[DIP] == 0.)
            live.constrain(live.constraints | {'DIP coupling'})
            wait(lambda: live.state().angles[DIP] > .05)
            # What the tracker refuses is not shown as switched.
            before = live.constraints
            live._changes['Friction'] = {'no_such_parameter': 1.}, {}
            live.constrain(before | {'Friction'})
            wait(lambda: live.constraints == before)
            # Who comes later finds the switches as they are.
            live.constrain(live.constraints - {'Rigidity'})
            later = LiveTracker(node)
            wait(lambda: 'Rigidity' not in (later.prepare(print), later.constraints)[1])
            hint = r'there is /hand_tracker \(--ros-args -p tracker:=hand_tracker\)$'
            with pytest.raises(ValueError, match=hint):
                LiveTracker(node, 'wrong').prepare(refuse_others)
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_without_constraints_it_tracks_markers_without_stamps_and_warns_once_of_other_bytes():
    said = []
    live = LiveTracker(SimpleNamespace(
        create_client=lambda *_: None, get_logger=lambda: SimpleNamespace(warning=said.append),
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: Time(sec=1)))))
    stream = Stream(HandTracker(), MarkerReader(LabelMap()))
    for _ in range(2):
        live._on_markers(stream, b'other bytes')
    assert len(said) == 1 and 'no message of markers' in said[0]
    assert live.bare_state() is None
    live._on_markers(stream, serialize_message(message(hand_at(), 0)))
    assert np.isfinite(live.bare_state().angles).all()


def test_the_program_takes_options_of_the_page():
    pytest.importorskip('viser')
    command = [sys.executable, '-m', 'hand_tracker.nodes.viewer_node', '--port', '0', '--ros-args']
    with NodeProcess('hand_tracker.nodes.tracker_node'), Process(command) as process:
        process.wait_for_line('http://')
        assert process.interrupt() == 0, process.output


def test_it_follows_the_hand_that_is_tracked(tmp_path):
    mine = Hand.scaled(.2, .095, side='left', limits=preset_limits('wide'))
    layout = MarkerLayout(offsets=np.full((8, 3), .002))
    save_hand(tmp_path / 'mine.yaml', mine, layout)
    rclpy.init()
    node = rclpy.create_node('viewer')
    try:
        with NodeProcess('hand_tracker.nodes.tracker_node', {'side': 'left'}), NodeProcess(
                'hand_tracker.nodes.replay_node', {
                    'recording': str(packaged_recording('left')), 'loop': True}), spinning(node):
            live = LiveTracker(node)
            live.prepare(print)
            live.set_demand(looked_at=True, compared=True)
            wait(lambda: live.bare_state() is not None)
            # Limits that are switched off are no other hand's.
            live.constrain(live.constraints - {'Joint limits'})
            live._answer(live._set, SetParametersAtomically.Request(parameters=messages(
                {'hand_file': str(tmp_path / 'mine.yaml')})))
            load = node.create_client(Trigger, 'hand_tracker/load_hand')
            assert load.wait_for_service(PATIENCE)
            assert live._answer(load, Trigger.Request()).success
            wait(lambda: np.allclose(live.hand.finger_bones, mine.finger_bones, atol=1e-12))
            np.testing.assert_allclose(live.hand.limits, mine.limits, atol=1e-12)
            np.testing.assert_allclose(live._layout.offsets, layout.offsets, atol=1e-12)
            live.set_demand(looked_at=True, compared=True)
            assert live._bare_hand is live.hand
            # Switched on again, they are the new hand's.
            on, _ = live._changes['Joint limits']
            assert on['limits.index_pip_flexion.upper_deg'] == pytest.approx(115.)
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_it_shows_both_hands_of_any_layout():
    rclpy.init()
    node = rclpy.create_node('viewer')
    layout = preset_layout('tips5_palm3')
    try:
        with NodeProcess('hand_tracker.nodes.tracker_node', {
                'side': 'both', 'layout': 'tips5_palm3'}), spinning(node):
            live = LiveTracker(node)
            live.prepare(print)
            hands = live, live.beside
            assert [one.hand.side for one in hands] == ['right', 'left']
            assert [one._layout.names for one in hands] == [layout.names] * 2
            for one in hands:
                one.set_demand(looked_at=True, compared=False)
            publisher = node.create_publisher(MarkerArray, 'markers', 10)
            rest = {one.hand.side: markers_of(one.hand, np.zeros(25), layout) for one in hands}
            frame = iter(range(10**6))

            def show(shown):
                """Publish the hands, apart from each other, until they are shown."""
                message = MarkerArray(markers=[
                    marker(number, place + (0., .4 * (side == 'left'), 0.), side, 'mocap',
                           Marker.SPHERE, 0, Time(sec=9 + next(frame)))
                    for side in shown for number, place in enumerate(rest[side])])
                publisher.publish(message)

            def both_shown():
                show(('right', 'left'))
                return all(one.state() is not None for one in hands)

            wait(both_shown)
            for one in hands:
                state = one.state()
                assert len(state.markers) == len(layout.names)
                np.testing.assert_allclose(
                    state.wrist_position, (0., .4 * (one.hand.side == 'left'), 0.), atol=.02)
            live.constrain(live.constraints - {'Joint limits'})
            assert live.beside.constraints == live.constraints
            wait(lambda: live._values(('left.limits.index_pip_flexion.upper_deg',))[
                'left.limits.index_pip_flexion.upper_deg'] > 100.)
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_it_hears_how_far_a_calibration_is():
    live = LiveTracker(SimpleNamespace(create_client=lambda *_: None))
    assert live.calibration() is None

    def hear(name, values):
        live._on_diagnostics(diagnostics(Time(), name, '/markers', Status(Level.OK, '', values)))
        return live.calibration()

    shares = Coverage(np.linspace(0., 1., len(PROMPTS))).values()
    assert hear('hand_tracker: right hand', {CALIBRATION_KEY: NO_CALIBRATION}) is None
    assert hear('hand_left: left hand', {CALIBRATION_KEY: 'fist', **shares}) is None
    text, bars = hear('calibrate: right hand', {CALIBRATION_KEY: 'fist', **shares})
    assert text == 'fist' and bars['open hand'] == 0. and bars['thumb circles'] == 1.
    assert hear('hand_tracker: right hand', {CALIBRATION_KEY: 'spread'}) == ('spread', {})


def test_it_pauses_and_slows_the_player():
    srv = pytest.importorskip('rosbag2_interfaces.srv', reason='needs rosbag2_interfaces')
    with watching_node('viewer') as node:
        live = LiveTracker(node)
        head = live.playhead
        frames = node.collect(MarkerArray, 'markers')

        def stamps():
            return [seconds(frame.markers[0].header.stamp) for frame in frames]

        def rate():
            """Return the rate at which frames are due [Hz], whenever they come."""
            frames.clear()
            node.spin_until(lambda: len(frames) > 20)
            return 1. / np.median(np.diff(stamps()[-20:]))

        def look():
            head.poll()
            return head.there

        assert not look()
        with NodeProcess('hand_tracker.nodes.replay_node', {'loop': True}) as player:
            node.spin_until(look)
            assert head.playing
            assert rate() == pytest.approx(120., rel=.01)
            head.set_rate(.25)
            node.spin_until(lambda: rate() == pytest.approx(30., rel=.01))
            head.toggle()
            node.spin_until(lambda: node.call(srv.IsPaused, '/replay/is_paused').paused)
            pause = time.time()
            node.spin_until(lambda: look() and not head.playing)
            # Another lets it go on.
            pause_end = time.time()
            node.call(srv.Resume, '/replay/resume')
            node.spin_until(lambda: look() and head.playing)
            node.spin_until(lambda: frames and stamps()[-1] > pause_end)
            # No frame was due in the pause.
            assert np.diff(stamps()).max() > pause_end - pause + 1. / 31.
            assert rate() == pytest.approx(30., rel=.01)
            head.toggle()
            head.toggle()
            assert not node.call(srv.IsPaused, '/replay/is_paused').paused
            assert head.playing and rate() == pytest.approx(30., rel=.01)
            assert player.interrupt() == 0
        node.spin_until(lambda: not look())
