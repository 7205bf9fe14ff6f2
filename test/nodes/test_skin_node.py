"""The skin node: triangles where the joint states put the hand, only while somebody looks."""

import os
import time

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from helpers.ros_process import PATIENCE, NodeProcess, watching_node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.numerics import jit
from hand_tracker.files.hand_file import hand_text, parse_hand
from hand_tracker.messages.builders import joint_state, prefixed_names
from hand_tracker.nodes import skin_node
from hand_tracker.nodes.hand_description import HandDescription
from hand_tracker.simulation.poses import pose_angles
from hand_tracker.skin import deform, load_skin
from hand_tracker.tracking.rate_limit import period_ns

NEEDS = 'rclpy', 'skimage'

MODULE = 'hand_tracker.nodes.skin_node'
LEFT = Hand.scaled(side='left')
RATE = 100.     # of the joint states [Hz]
# What a Marker display of RViz asks for, unless told otherwise.
RVIZ = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE,
                  durability=DurabilityPolicy.VOLATILE)

pytestmark = pytest.mark.ros


@pytest.fixture(scope='module')
def cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('cache')))
        # The kernels are where they were.
        patch.setenv('NUMBA_CACHE_DIR', str(jit.CACHE_FOLDER))
        yield


def test_triangles_are_the_deformed_skin_while_somebody_looks(cache):
    skin = load_skin(LEFT)
    names, angles = prefixed_names('left_'), pose_angles('pinch', LEFT)
    expected = deform(skin, forward(joint_table(LEFT), angles))[skin.faces].reshape(-1, 3)
    with NodeProcess(MODULE, {'side': 'left'}) as process, watching_node() as node:
        publisher = node.create_publisher(JointState, 'joint_states', 10)
        process.wait_for_line('a skin of')
        sent = []

        def send():
            sent.append(Time(sec=1 + len(sent)))
            publisher.publish(joint_state(sent[-1], names.joints, angles))
            publisher.publish(JointState(name=['wheel'], position=[1.]))

        node.create_timer(1. / RATE, send)
        heard = []
        looking = node.create_subscription(Marker, 'hand_skin', heard.append, RVIZ)
        node.spin_until(lambda: len(heard) > 10)
        marker = heard[-1]
        assert marker.type == Marker.TRIANGLE_LIST
        assert (marker.ns, marker.header.frame_id, marker.frame_locked) == (
            'left_skin', 'left_wrist', True)
        assert marker.header.stamp in sent
        places = np.array([(point.x, point.y, point.z) for point in marker.points])
        np.testing.assert_allclose(places, expected, rtol=0., atol=1e-9)
        node.destroy_subscription(looking)
        node.spin_until(lambda: publisher.get_subscription_count() == 0)
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


def test_it_follows_the_hand_that_is_tracked(cache):
    # As the node reads it, to the bit, so that it finds this skin in the cache.
    larger, _ = parse_hand(
        hand_text(Hand.scaled(.2, .095, side='left'), MarkerLayout()), 'larger hand')
    skin = load_skin(larger)
    names, angles = prefixed_names('left_'), pose_angles('pinch', LEFT)
    expected = deform(skin, forward(joint_table(larger), angles))[skin.faces].reshape(-1, 3)
    with NodeProcess(MODULE, {'side': 'left'}) as process, watching_node() as node:
        # Said before the node is there, as by a tracker that has learned a size.
        HandDescription(node).publish(larger, MarkerLayout())
        # A tracker of the other hand has no part in it.
        other = HandDescription(node)
        other.publish(larger.mirrored(), MarkerLayout())
        publisher = node.create_publisher(JointState, 'joint_states', 10)
        process.wait_for_line('a skin of')
        heard = []
        node.create_subscription(Marker, 'hand_skin', heard.append, RVIZ)

        def is_shown():
            places = heard and np.array([(p.x, p.y, p.z) for p in heard[-1].points])
            return len(places) == len(expected) and np.allclose(places, expected, atol=1e-9)

        node.repeat(lambda: publisher.publish(joint_state(Time(sec=1), names.joints, angles)),
                    is_shown, .05)
        assert process.interrupt() == 0, process.output
    assert 'of the hand that the tracker has now' in process.output
    assert 'Traceback' not in process.output


def test_it_computes_new_joint_states_alone_and_only_while_somebody_looks(cache, monkeypatch):
    skins = []

    def counted(*arguments):
        skins.append(deform(*arguments))
        return skins[-1]

    def listens():
        return '/joint_states' in dict(node.get_subscriber_names_and_types_by_node(
            node.get_name(), node.get_namespace()))

    def show_until(condition):
        until = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < until
            node._show()

    monkeypatch.setattr(skin_node, 'deform', counted)
    state = serialize_message(joint_state(
        Time(sec=1), prefixed_names('right_').joints, np.zeros(len(JOINTS))))
    rclpy.init(args=[])
    node = skin_node.SkinNode()
    try:
        # That is how often it looks for new ones.
        assert [timer.timer_period_ns for timer in node.timers] == [period_ns(30.)]
        node._show()
        assert not listens()
        # What still comes while nobody looks is left alone.
        node._on_joint_states(state)
        node._show()
        assert not skins
        looking = node.create_subscription(Marker, 'hand_skin', print, RVIZ)
        show_until(listens)
        for count in (1, 2):
            del skins[:]
            for _ in range(count):
                node._on_joint_states(state)
            node._on_joint_states(serialize_message(JointState(name=['wheel'], position=[1.])))
            for _ in range(3):
                node._show()
            assert len(skins) == 1
        node.destroy_subscription(looking)
        show_until(lambda: not listens())
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_without_its_libraries_it_says_what_is_missing(tmp_path):
    (tmp_path / 'skimage').mkdir()
    (tmp_path / 'skimage' / '__init__.py').write_text('raise ImportError')
    path = os.pathsep.join((str(tmp_path), os.environ.get('PYTHONPATH', '')))
    missing = {'PYTHONPATH': path, 'XDG_CACHE_HOME': str(tmp_path)}
    with NodeProcess(MODULE, environment=missing) as process:
        assert process.wait() == 1
    assert process.output.count('making the skin of a hand needs scikit-image') == 1
    assert 'Traceback' not in process.output


def test_a_mesh_that_is_none_ends_it_with_one_line(tmp_path):
    with NodeProcess(MODULE, {'mesh': str(tmp_path / 'none.obj')}) as process:
        assert process.wait() == 1
    assert 'none.obj: No such file' in process.output
    assert 'Traceback' not in process.output
