"""Every example runs as it is and does what it says."""

import csv
import os
import re
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.repository import REPOSITORY
from hand_tracker import load_hand
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions

EXAMPLES = sorted((REPOSITORY / 'examples').glob('*.py'))


def run(name, folder):
    """Run an example in a folder; return the numbers of the line that it prints."""
    done = subprocess.run([sys.executable, REPOSITORY / 'examples' / f'{name}.py'], cwd=folder,
                          check=True, stdout=subprocess.PIPE, text=True)
    return [float(number) for number in re.findall(r'(?<![\w/])\d+(?:\.\d+)?(?= )', done.stdout)]


def rows_of(path):
    with open(path, encoding='utf-8', newline='') as file:
        return list(csv.reader(file))


def test_each_example_is_short_and_has_a_test():
    assert [path.stem for path in EXAMPLES] == [
        'both_hands', 'fit_hand', 'live_node', 'mujoco_hand', 'track_array', 'track_bag']
    for path in EXAMPLES:
        assert len(path.read_text(encoding='utf-8').splitlines()) < 40, path


def test_track_array(tmp_path):
    frames, error = run('track_array', tmp_path)[:2]
    head, *rows = rows_of(tmp_path / 'array_angles.csv')
    assert head == ['time', *JOINTS]
    assert len(rows) == frames == 600
    assert 0. < error < 3.


def test_track_bag(tmp_path):
    messages = run('track_bag', tmp_path)[0]
    head, *rows = rows_of(tmp_path / 'bag_angles.csv')
    assert set(head) > {f'right_{joint}_deg' for joint in JOINTS}
    assert 0 < len(rows) <= messages
    assert np.isfinite(np.array(rows, dtype=float)).all()


def test_track_bag_says_in_a_line_what_it_does_not_read(tmp_path):
    (tmp_path / 'take.c3d').write_bytes(b'none')
    done = subprocess.run([sys.executable, REPOSITORY / 'examples/track_bag.py', 'take.c3d'],
                          cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert "track_bag: take.c3d: unknown extension '.c3d'; expected" in done.stderr


def test_mujoco_hand(tmp_path):
    pytest.importorskip('mujoco')
    frames, error = run('mujoco_hand', tmp_path)[:2]
    assert frames > 2500 and 0. < error < 5.


def test_without_mujoco_its_example_says_what_to_install(tmp_path):
    (tmp_path / 'mujoco.py').write_text("raise ModuleNotFoundError('No module named mujoco')")
    done = subprocess.run(
        [sys.executable, REPOSITORY / 'examples' / 'mujoco_hand.py'], capture_output=True,
        text=True, env={**os.environ, 'PYTHONPATH': os.pathsep.join(
            [str(tmp_path), str(REPOSITORY)])})
    assert done.returncode == 1
    assert done.stderr == 'This example needs MuJoCo: pip install mujoco\n'


def test_fit_hand(tmp_path):
    frames, error = run('fit_hand', tmp_path)[:2]
    hand, _ = load_hand(tmp_path / 'fitted_hand.yaml')
    assert frames > 100 and error < 1.
    assert hand.side == 'right'


def test_both_hands(tmp_path):
    frames, apart = run('both_hands', tmp_path)[:2]
    assert frames > 500
    # The left recording lies 0.4 m beside the right one.
    assert abs(apart - .4) < .02


@pytest.mark.ros
def test_live_node(tmp_path):
    pytest.importorskip('rclpy', reason='no ROS 2')
    from helpers.ros_process import Process, watching_node
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import Marker, MarkerArray

    hand = Hand.scaled()
    seen = marker_positions(MarkerLayout().mounting(hand),
                            forward(joint_table(hand), np.zeros(len(JOINTS))))
    array = MarkerArray(markers=[Marker(id=slot, type=Marker.SPHERE) for slot in range(8)])
    for marker, place in zip(array.markers, seen.tolist()):
        at = marker.pose.position
        at.x, at.y, at.z = place
        at.z += 1.    # zero would be a marker that is lost
        marker.header.frame_id, marker.header.stamp.sec = 'mocap', 7
    command = [sys.executable, REPOSITORY / 'examples' / 'live_node.py']
    with Process(command, cwd=tmp_path) as process, watching_node() as node:
        publisher = node.create_publisher(MarkerArray, 'markers', 10)
        answers = node.collect(JointState, 'joint_states')

        def answered():
            publisher.publish(array)
            return bool(answers)

        node.spin_until(answered)
        assert process.interrupt() == 0
    assert list(answers[0].name) == list(JOINTS)
    assert answers[0].header.stamp.sec == 7
