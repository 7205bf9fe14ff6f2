"""Live calibration over DDS: markers in, a hand file out. The stamps are the only clock."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.bench import message
from helpers.ros_process import NodeProcess, watching_node
from helpers.skin_markers import worn_markers
from visualization_msgs.msg import MarkerArray

from hand_tracker.calibration.live_take import CALIBRATION_KEY, progress_from_diagnostics
from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, Hand
from hand_tracker.files.hand_file import load_hand
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.poses import pose_angles
from hand_tracker.simulation.visibility import skin_layout

NEEDS = 'rclpy',

MODULE = 'hand_tracker.nodes.calibrate_node'
LOSSLESS = {'qos.markers.reliability': 'reliable', 'qos.markers.depth': 1000}
HAND = Hand.scaled(.195, .09)
EVERY = 4   # frame of the bench's stamps: 30 Hz

pytestmark = pytest.mark.ros


def send(process, node, frames):
    """Send frames as fast as they are taken."""
    publisher = node.create_publisher(MarkerArray, 'markers', 1000)
    process.wait_for_line('listening')
    node.spin_until(lambda: publisher.get_subscription_count() > 0)
    for number, frame in enumerate(frames, 1):
        publisher.publish(message(frame, EVERY * number))
    return publisher


def test_a_hand_that_shows_everything_is_fitted(tmp_path):
    moving = motion_named('range_of_motion', HAND, 2)
    angles = moving.sample(np.arange(0., moving.duration, 1. / 30.))[0]
    layout = skin_layout(HAND)
    frames = worn_markers(HAND, layout, angles)
    frames += .0003 * np.random.default_rng(1).standard_normal(frames.shape)
    output = tmp_path / 'my_hand.yaml'
    with NodeProcess(MODULE, {'output': str(output), **LOSSLESS}) as process, \
            watching_node() as node:
        told = node.collect(DiagnosticArray, '/diagnostics')
        sent = send(process, node, frames)
        node.spin_until(lambda: process.ended)
        node.destroy_publisher(sent)
        assert process.wait() == 0, process.output
    hand, fitted = load_hand(output)
    assert f'{output}: right hand of ' in process.output
    assert 'not shown' not in process.output and 'Traceback' not in process.output
    assert 'distance from its place on the fitted hand' in process.output
    assert output.with_suffix('.png').exists()
    reach = hand.finger_bones[:, :2].sum(axis=1) + fitted.offsets[3:7, 0]
    np.testing.assert_allclose(
        reach, HAND.finger_bones[:, :2].sum(axis=1) + layout.offsets[3:7, 0], atol=.006)
    texts = [value.value for each in told for value in each.status[0].values
             if value.key == CALIBRATION_KEY]
    assert any('fitting' in text for text in texts)
    last = {value.key: value.value for value in told[-1].status[0].values}
    assert progress_from_diagnostics(last)[1] == {}


def test_the_other_side_is_told_while_the_take_is_collected(tmp_path):
    fist = worn_markers(HAND, skin_layout(HAND), np.repeat(
        pose_angles('fist', HAND)[None], 60, axis=0)) * LEFT_HAND_MIRROR
    with NodeProcess(MODULE, {'output': str(tmp_path / 'hand.yaml'), **LOSSLESS}) as process, \
            watching_node() as node:
        sent = send(process, node, fist)
        process.wait_for_line('bend away from the palm of a right hand')
        node.destroy_publisher(sent)
    assert 'side:=left' in process.output


def test_a_still_hand_is_refused_when_the_time_is_over(tmp_path):
    output = tmp_path / 'my_hand.yaml'
    still = worn_markers(HAND, skin_layout(HAND), np.repeat(
        pose_angles('open', HAND)[None], 200, axis=0))
    with NodeProcess(MODULE, {'output': str(output), 'max_duration': 6., **LOSSLESS}) as process, \
            watching_node() as node:
        send(process, node, still)
        assert process.wait() == 1, process.output
    assert 's are over; not shown: make a fist' in process.output
    assert 'the hand does not move' in process.output.splitlines()[-1]
    assert not output.exists()


def test_an_interrupted_calibration_is_no_success(tmp_path):
    output = tmp_path / 'my_hand.yaml'
    with NodeProcess(MODULE, {'output': str(output)}) as process:
        process.wait_for_line('open the hand')
        assert process.interrupt() == 1
    assert f'interrupted: {output} is as it was' in process.output
    assert 'Traceback' not in process.output and not output.exists()


def test_the_time_is_over_where_no_marker_comes_any_more(tmp_path):
    still = worn_markers(HAND, skin_layout(HAND), np.repeat(
        pose_angles('open', HAND)[None], 30, axis=0))
    parameters = {'output': str(tmp_path / 'my_hand.yaml'), 'max_duration': 5., **LOSSLESS}
    with NodeProcess(MODULE, parameters) as process, watching_node() as node:
        send(process, node, still)
        assert process.wait() == 1, process.output
    assert 'no marker comes any more; not shown: ' in process.output


def test_what_cannot_be_written_is_refused_at_once(tmp_path):
    with NodeProcess(MODULE, {'output': str(tmp_path / 'none' / 'hand.yaml')}) as process:
        assert process.wait() == 1
    assert 'cannot be written' in process.output and 'Traceback' not in process.output
