"""The viewer beside a running tracker: what it hears, and what its switches do there."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from helpers.ros_process import PATIENCE, NodeProcess, watching_node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from hand_tracker.calibration.live_take import CALIBRATION_KEY, NO_CALIBRATION, Coverage
from hand_tracker.calibration.prompts import PROMPTS
from hand_tracker.core.model.hand import JOINTS
from hand_tracker.core.model.states import MarkerState
from hand_tracker.messages.builders import diagnostics
from hand_tracker.messages.stamps import seconds
from hand_tracker.nodes.runner import spinning
from hand_tracker.nodes.viewer_node import Live
from hand_tracker.package_data import packaged_recording
from hand_tracker.tracking.diagnostics import Level, Status

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


def test_it_shows_what_the_tracker_publishes_and_switches_its_constraints():
    rclpy.init()
    node = rclpy.create_node('viewer')
    try:
        with NodeProcess('hand_tracker.nodes.tracker_node', {'side': 'left'}), NodeProcess(
                'hand_tracker.nodes.replay_node', {
                    'recording': str(packaged_recording('left')), 'loop': True}), spinning(node):
            live = Live(node)
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
            joints, markers = live._joint_states[-1], live._hand_markers[-1]
            assert live._frame(joints, markers) is not None
            assert live._frame(joints, serialize_message(MarkerArray())) is None
            assert live._frame(serialize_message(JointState()), markers) is None

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
            later = Live(node)
            wait(lambda: 'Rigidity' not in (later.prepare(print), later.constraints)[1])
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_it_hears_how_far_a_calibration_is():
    live = Live(SimpleNamespace(create_client=lambda *_: None))
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
        live = Live(node)
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
            head.look()
            return head.there

        assert not look()
        with NodeProcess('hand_tracker.nodes.replay_node', {'loop': True}):
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
        node.spin_until(lambda: not look())
