"""Another hand for a running tracker: `~/load_hand` and `~/calibrate`, between two frames."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.bench import tracking
from helpers.hands import hand_at, markers_of
from helpers.ros_process import PLAIN_PYTHON, watching_node
from helpers.skin_markers import worn_markers
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from hand_tracker.calibration.live_take import progress_from_diagnostics
from hand_tracker.calibration.prompts import PROMPTS
from hand_tracker.core.model.hand import DIGITS, JOINTS, Hand
from hand_tracker.core.model.kinematics import tip_offsets
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.files.hand_file import load_hand, save_hand
from hand_tracker.nodes.hand_description import follow_hand
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.poses import pose_angles
from hand_tracker.simulation.visibility import skin_layout

NEEDS = 'rclpy',

HAND = Hand.scaled(.2, .092)
LAYOUT = skin_layout(HAND)
REENTRY = 5. / 120.  # [rad] in a frame
PIP = JOINTS.index('index_pip_flexion')

pytestmark = pytest.mark.ros


def relaxed():
    """Return the angles of a relaxed hand, and a frame of its markers."""
    angles = pose_angles('relaxed', HAND)
    return angles, worn_markers(HAND, LAYOUT, angles[None])[0]


def call(bench, service):
    return bench.node.call(Trigger, f'hand_tracker/{service}')


def test_a_hand_is_loaded_without_a_jump(tmp_path):
    angles, frame = relaxed()
    limits = HAND.limits.copy()
    limits[PIP, 1] = 1.8
    save_hand(tmp_path / 'mine.yaml', HAND.replace(limits=limits), LAYOUT)
    with tracking() as bench, watching_node('robot_state_publisher') as shown:
        shown.declare_parameter('robot_description', '')
        bench.meet(frame)
        before = [bench.angles(frame) for _ in range(60)][-1]
        assert np.abs(before - angles)[PIP] > .05
        assert bench.set({'hand_file': str(tmp_path / 'mine.yaml'),
                          'limits.ring_pip_flexion.upper_deg': 80.}).successful
        assert np.allclose(bench.angles(frame), before, atol=.01)
        answer = call(bench, 'load_hand')
        assert answer.success and 'mine.yaml' in answer.message
        found = np.array([before, *(bench.angles(frame) for _ in range(120))])
        assert np.abs(np.diff(found, axis=0)).max() < REENTRY + 1e-3
        assert np.abs(found[-1] - angles)[:20].max() < .03
        values = bench.parameters(GetParameters, 'get_parameters', names=[
            'limits.index_pip_flexion.upper_deg', 'limits.ring_pip_flexion.upper_deg']).values
        assert [value.double_value for value in values] == [
            pytest.approx(np.degrees(1.8)), 80.]

        def urdf():
            shown.spin_for(.01)
            return shown.get_parameter('robot_description').value

        bench.node.repeat(lambda: bench.answer(frame), urdf, 0.)
        # Who comes now is told of the hand, without what was set as a parameter.
        described = []
        follow_hand(bench.node, lambda *hand: described.append(hand))
        bench.node.spin_until(lambda: described)
        np.testing.assert_allclose(described[0][0].finger_bones, HAND.finger_bones, atol=1e-12)
        np.testing.assert_allclose(described[0][0].limits, limits, atol=1e-12)
        np.testing.assert_allclose(described[0][1].offsets, LAYOUT.offsets, atol=1e-12)


def test_tips_of_a_loaded_hand_reach_listeners_of_now_and_later(tmp_path):
    kind = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs').TFMessage
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    large = Hand.scaled(.22, .1)
    save_hand(tmp_path / 'large.yaml', large, MarkerLayout())
    frame = hand_at()

    def tips(messages):
        found = {sent.child_frame_id: sent.transform.translation
                 for sent in messages[-1].transforms}
        return np.array([(at.x, at.y, at.z) for at in (
            found[f'right_{digit}_tip'] for digit in DIGITS)])

    with tracking({'broadcast': 'all'}, environment=PLAIN_PYTHON) as bench:
        early = bench.node.collect(kind, '/tf_static', latched)
        bench.meet(frame, heard=(early,))
        assert not np.allclose(tips(early), tip_offsets(large), rtol=0, atol=1e-4)
        assert bench.set({'hand_file': str(tmp_path / 'large.yaml')}).successful
        assert call(bench, 'load_hand').success
        bench.node.repeat(
            lambda: bench.answer(frame),
            lambda: np.allclose(tips(early), tip_offsets(large), rtol=0, atol=1e-9))
        late = bench.node.collect(kind, '/tf_static', latched)
        bench.node.spin_until(lambda: late)
        np.testing.assert_allclose(tips(late), tip_offsets(large), rtol=0, atol=1e-9)


def test_markers_worn_elsewhere_are_taken_without_a_jump(tmp_path):
    _, frame = relaxed()
    moved = LAYOUT.offsets.copy()
    moved[3:7] += (.006, 0., .004)
    save_hand(tmp_path / 'mine.yaml', HAND, LAYOUT)
    save_hand(tmp_path / 'moved.yaml', HAND, MarkerLayout(LAYOUT.places, moved))
    with tracking({'hand_file': str(tmp_path / 'mine.yaml')}) as bench:
        bench.meet(frame)
        before = [bench.angles(frame) for _ in range(30)][-1]
        assert bench.set({'hand_file': str(tmp_path / 'moved.yaml')}).successful
        assert call(bench, 'load_hand').success
        found = np.array([before, *(bench.angles(frame) for _ in range(60))])
        assert np.abs(found[-1] - before).max() > REENTRY
        assert np.abs(np.diff(found, axis=0)).max() < REENTRY + 1e-3


def test_a_bad_hand_file_is_refused_with_the_reason(tmp_path):
    _, frame = relaxed()
    (tmp_path / 'bad.yaml').write_text('finger_bones_mm: {index: [45, 26, 900]}')
    save_hand(tmp_path / 'left.yaml', HAND.mirrored(), LAYOUT)
    with tracking() as bench:
        bench.meet(frame)
        before = [bench.angles(frame) for _ in range(60)][-1]
        for path, reason in (('', 'by ros2 param set /hand_tracker hand_file '),
                             (tmp_path / 'none.yaml', 'No such file'),
                             (tmp_path / 'bad.yaml', 'finger_bones_mm.index[2]: 900'),
                             (tmp_path / 'left.yaml', 'of a left hand; expected a right one')):
            assert bench.set({'hand_file': str(path)}).successful
            answer = call(bench, 'load_hand')
            assert not answer.success and reason in answer.message, answer.message
            assert np.allclose(bench.angles(frame), before, atol=.01)


def test_a_hand_is_calibrated_while_it_is_tracked(tmp_path):
    moving = motion_named('range_of_motion', HAND, 2)
    motion = moving.sample(np.arange(0., moving.duration, 1. / 30.))[0]
    frames = worn_markers(HAND, LAYOUT, motion)
    angles, frame = relaxed()
    output = tmp_path / 'my_hand.yaml'
    with tracking({'calibration_file': str(output)}) as bench:
        told = bench.node.collect(DiagnosticArray, '/diagnostics')

        def progress():
            return told and progress_from_diagnostics(
                {value.key: value.value for value in told[-1].status[0].values})

        bench.meet(frame)
        bench.answer(frame)
        answer = call(bench, 'calibrate')
        assert answer.success and str(output) in answer.message
        again = call(bench, 'calibrate')
        assert not again.success and 'not done yet' in again.message
        bench.node.repeat(lambda: bench.answer(frames[0]),
                          lambda: progress() and set(progress()[1]) == {
                              prompt.name for prompt in PROMPTS}, 0.)
        for each in frames:
            bench.number += 3  # 30 Hz
            bench.answer(each)
        bench.process.wait_for_line('fitting a hand')
        found = [bench.angles(frame) for _ in range(60)][-1:]
        bench.node.repeat(lambda: found.append(bench.angles(frame)),
                          lambda: 'is tracked from the next frame on' in bench.process.output, .01)
        found += [bench.angles(frame) for _ in range(120)]
        bench.node.spin_until(lambda: progress()[0].startswith(f'{output}: right hand of '))
        assert not progress()[1]
        assert np.abs(np.diff(found, axis=0)).max() < REENTRY + 1e-3
        # The fitted hand is tracked: nearer than the mean one was.
        assert np.abs(found[-1] - angles)[PIP] < .6 * np.abs(found[0] - angles)[PIP]
        assert 'not shown' not in bench.process.output
    hand, _ = load_hand(output)
    np.testing.assert_allclose(hand.finger_bones[:, :2].sum(axis=1),
                               HAND.finger_bones[:, :2].sum(axis=1), rtol=.12)


@pytest.mark.skipif(not COMPILED, reason='in plain Python, frames that come too fast are left out')
def test_a_tracker_that_is_reset_learns_the_size_of_another_person():
    wearers = Hand.scaled(.205, .095), Hand.scaled(.175, .08)
    with tracking({'auto_size': True}) as bench:
        told = bench.node.collect(DiagnosticArray, '/diagnostics')
        hands = []
        follow_hand(bench.node, lambda *hand: hands.append(hand[0]))
        for number, wearer in enumerate(wearers):
            angles, *wrist = motion_named('demo', wearer, 7).sample(np.arange(0., 7., 1. / 120.))
            frames = markers_of(wearer, angles, None, *wrist)
            if number:
                assert call(bench, 'calibrate').success
                assert call(bench, 'reset').message.endswith('; the calibration is cancelled')
                bench.node.spin_until(lambda: np.allclose(
                    hands[-1].finger_bones, Hand.scaled().finger_bones, rtol=1e-9))
                del told[:]
            else:
                bench.meet(frames[0])
            for frame in frames:
                bench.answer(frame)
            bench.node.repeat(lambda frame=frame: bench.answer(frame), lambda: told and {
                value.key: value.value for value in told[-1].status[0].values}[
                    'hand size'] == 'learned', 0.)
            bench.node.spin_until(lambda wearer=wearer: np.allclose(
                hands[-1].finger_bones[:, 0], wearer.finger_bones[:, 0], rtol=.03))
        assert call(bench, 'reset').message.endswith('as if no frame had come yet')
        assert call(bench, 'calibrate').success


def test_a_hand_file_of_the_other_side_is_said(tmp_path):
    path = tmp_path / 'right.yaml'
    save_hand(path, HAND, LAYOUT)
    note = f'{path} is of a right hand: its mirror image is taken for the left one'
    for parameters, count in (({'side': 'left', 'hand_file': str(path)}, 1),
                              ({'side': 'both', 'left.hand_file': str(path)}, 1),
                              ({'hand_file': str(path)}, 0)):
        with tracking(parameters) as bench:
            scope = 'left/' if parameters.get('side') == 'both' else ''
            loaded = call(bench, f'{scope}load_hand')
            assert loaded.success and (note in loaded.message) == bool(count)
            bench.process.wait_for_line('is tracked from the next frame on')
            time.sleep(.3)  # what is said of the input is logged a few times a second
        # With what `load_hand` logs.
        assert bench.process.output.count(note) == 2 * count


def test_the_hand_file_of_both_hands_is_loaded_for_each_that_has_none_of_its_own(tmp_path):
    both, own = tmp_path / 'both.yaml', tmp_path / 'own.yaml'
    save_hand(both, HAND, LAYOUT)
    save_hand(own, HAND, LAYOUT)
    with tracking({'side': 'both', 'hand_file': str(both), 'left.hand_file': str(own)}) as bench:
        for side, path in (('right', both), ('left', own)):
            loaded = call(bench, f'{side}/load_hand')
            assert loaded.success and f'the {side} hand of {path} is tracked' in loaded.message
        both.write_text('nonsense: [')
        assert str(both) in call(bench, 'right/load_hand').message
