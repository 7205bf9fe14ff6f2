"""Captured hands through the whole chain: a recording, the replay, the tracker, over DDS.

`pytest -s test/test_end_to_end.py` prints what went in and what came out.
"""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from captures import capture_messages, capture_path, load_capture  # noqa: E402
from ros_process import NodeProcess, watching_node  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

from hand_tracker.calibration import fit_hand  # noqa: E402
from hand_tracker.core.hand import JOINTS, preset_limits  # noqa: E402
from hand_tracker.core.layout import MarkerLayout  # noqa: E402
from hand_tracker.core.tracker import HandTracker  # noqa: E402
from hand_tracker.files.bags import write_bag  # noqa: E402
from hand_tracker.files.hand_file import load_hand, save_hand  # noqa: E402

RATES = {'manipnet__cup1_leftHand': 2., 'manipnet__cup1_rightHand': 2.,
         'dexret__human_joint_right': 4.}  # times as fast as captured
CALIBRATION = .2


@pytest.mark.parametrize('preset', ['paper', 'wide'])
@pytest.mark.parametrize('name', RATES)
def test_a_captured_hand_goes_through_replay_and_tracker(name, preset, tmp_path):
    capture = load_capture(capture_path(name))
    part = int(CALIBRATION * len(capture.joints))
    hand = fit_hand(capture.joints[:part], capture.side, preset_limits(preset))
    save_hand(tmp_path / 'hand.yaml', hand, MarkerLayout())
    judged = capture._replace(joints=capture.joints[part:])
    write_bag(tmp_path / 'capture.mcap', capture_messages(judged))

    with watching_node() as watcher, NodeProcess(
            'hand_tracker.nodes.tracker', {
                # One capture has its wrist at the origin of each frame.
                'hand_file': str(tmp_path / 'hand.yaml'), 'zero_is_missing': False}) as tracker:
        states = watcher.collect(JointState, 'joint_states', 1000)
        tracker.wait_for_line('listening')
        with NodeProcess('hand_tracker.nodes.replay', {
                'recording': str(tmp_path / 'capture.mcap'), 'rate': RATES[name],
                'restamp': False}) as replay:
            length = len(judged.joints) / judged.rate / RATES[name]
            watcher.spin_until(lambda: 'Played to the end' in replay.output, length + 20.)
            assert replay.wait() == 0
        watcher.spin_for(.5)
        assert tracker.interrupt() == 0

    angles = np.array([state.position for state in states])
    lower, upper = hand.limits.T
    inside = ((lower <= angles) & (angles <= upper)).all(axis=1).mean()
    print(f'{name}, {preset}: {len(judged.joints)} frames in, {len(states)} out, '
          f'{100. * inside:.1f} % of them within the limits')
    assert len(states) >= .99 * len(judged.joints)
    assert inside == 1.
    assert list(states[0].name) == [f'{capture.side}_{joint}' for joint in JOINTS]
    # What came over DDS is what the core says of the same frames.
    stamps = {stamp: i for i, stamp in enumerate(judged.stamps.tolist())}
    rows = [stamps[state.header.stamp.sec * 10**9 + state.header.stamp.nanosec]
            for state in states]
    assert rows == sorted(set(rows))
    core = HandTracker(load_hand(tmp_path / 'hand.yaml')[0])
    expected = np.array([core.update(markers).angles for markers in judged.markers])
    if len(states) == len(judged.joints):
        np.testing.assert_allclose(angles, expected, atol=1e-9)
    else:
        # A frame that was lost leaves its trace only in what is held.
        assert np.median(np.abs(angles - expected[rows])) < 1e-9
