"""Captured hands through the whole chain: a recording, the replay, the tracker, over DDS.

`pytest -s test/package/test_end_to_end.py` prints what went in and what came out.
"""

import numpy as np
import pytest
from helpers.baseline import class_errors, plain_pip_errors
from helpers.bench import LOSSLESS
from helpers.capture_files import capture_messages, capture_path, capture_stamps
from helpers.ros_process import PATIENCE, NodeProcess, watching_node
from sensor_msgs.msg import JointState

from hand_tracker.calibration import fit_hand, landmark_positions
from hand_tracker.core.model.hand import JOINTS, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.tracker import HandTracker
from hand_tracker.evaluation.captures import load_capture
from hand_tracker.files.bags import write_bag
from hand_tracker.files.hand_file import load_hand, save_hand

NEEDS = 'rclpy',

# Times as fast as captured: the queues hold several seconds.
CASES = [('manipnet__cup1_leftHand', 'wide', 2.), ('manipnet__cup1_rightHand', 'paper', 2.),
         ('dexret__human_joint_right', 'wide', 4.)]
CALIBRATION = .2
JUDGED_FRAMES = 800  # at most, from then on


@pytest.mark.parametrize('name, preset, rate', CASES)
def test_a_captured_hand_goes_through_replay_and_tracker(name, preset, rate, tmp_path):
    capture = load_capture(capture_path(name))
    part = int(CALIBRATION * len(capture.joints))
    hand = fit_hand(capture.joints[:part], capture.side, preset_limits(preset))
    save_hand(tmp_path / 'hand.yaml', hand, MarkerLayout())
    judged = capture._replace(joints=capture.joints[part:part + JUDGED_FRAMES])
    write_bag(tmp_path / 'capture.mcap', capture_messages(judged))

    with watching_node() as watcher, NodeProcess(
            'hand_tracker.nodes.tracker_node', {
                # One capture has its wrist at the origin of each frame.
                'hand_file': str(tmp_path / 'hand.yaml'), 'zero_is_missing': False,
                # Every frame counts here, on a machine of any load.
                **LOSSLESS}) as tracker:
        states = watcher.collect(JointState, 'joint_states', 1000)
        tracker.wait_for_line('listening')
        # What is published before it knows the watcher does not come.
        watcher.spin_until(lambda: watcher.count_publishers('joint_states') > 0)
        with NodeProcess('hand_tracker.nodes.replay_node', {
                'recording': str(tmp_path / 'capture.mcap'), 'rate': rate,
                'restamp': False, 'wait_for_subscriber': PATIENCE}) as replay:
            watcher.spin_until(lambda: 'Played to the end' in replay.output)
            assert replay.wait() == 0
        # A loaded machine may still have frames waiting: in order they come, to the last.
        last = capture_stamps(judged)[-1]
        watcher.spin_until(lambda: states and nanoseconds(states[-1].header.stamp) == last)
        assert tracker.interrupt() == 0

    angles = np.array([state.position for state in states])
    lower, upper = hand.limits.T
    inside = ((lower <= angles) & (angles <= upper)).all(axis=1).mean()
    print(f'{name}, {preset}: {len(judged.joints)} frames in, {len(states)} out, '
          f'{100. * inside:.1f} % of them within the limits')
    assert inside == 1.
    assert list(states[0].name) == [f'{capture.side}_{joint}' for joint in JOINTS]
    # What came over DDS is what the core says of the same frames.
    stamps = capture_stamps(judged).tolist()
    assert [nanoseconds(state.header.stamp) for state in states] == stamps
    hand = load_hand(tmp_path / 'hand.yaml')[0]
    core = HandTracker(hand)
    tracked = [core.update(markers, 1e-9 * (stamp % 10**9) + stamp // 10**9)
               for markers, stamp in zip(judged.markers, stamps)]
    expected = np.array([state.angles for state in tracked])
    np.testing.assert_allclose(angles, expected, rtol=0, atol=1e-9)

    # What came over DDS is as near to the hand as what anyone would try first. The joint states
    # have no pose of the wrist: it is the core's, which is that of each frame's palm markers.
    whole = np.flatnonzero(np.isfinite(judged.joints).all(axis=(1, 2)))
    wrists = [tracked[i] for i in whole]
    rotation, position = (np.array([getattr(state, field) for state in wrists])
                          for field in ('wrist_rotation', 'wrist_position'))
    joints = landmark_positions(
        hand, forward(joint_table(hand), angles[whole], rotation, position), position)
    truth = judged._replace(joints=judged.joints[whole])
    errors = class_errors(joints, truth)
    plain = plain_pip_errors(capture._replace(joints=_whole(capture.joints[:part])), truth)
    print(f'mean errors [mm]: plain pip {1e3 * plain.mean():.2f}; ' + ', '.join(
        f'{joint} {1e3 * error.mean():.2f}' for joint, error in errors.items()))
    if preset == 'wide':
        assert errors['pip'].mean() <= plain.mean()


def nanoseconds(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def _whole(joints):
    return joints[np.isfinite(joints).all(axis=(1, 2))]
