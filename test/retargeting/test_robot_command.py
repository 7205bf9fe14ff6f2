"""`hand_tracker robot inspect`: what it prints, writes and draws."""

import numpy as np
import pytest
from helpers.robots import GRIPPER, wide_hand
from PIL import Image

from hand_tracker.calibration.landmarks import landmark_positions
from hand_tracker.cli import robot
from hand_tracker.cli.robot_poses import robot_pose
from hand_tracker.core.model.hand import Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.files.hand_file import save_hand
from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.retargeter import Retargeter
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.simulation.poses import pose_angles
from hand_tracker.viewer import serve


def test_inspecting_prints_writes_and_draws(tmp_path, capsys):
    (tmp_path / 'hand.urdf').write_text(urdf(wide_hand('left')))
    assert robot.main(['inspect', str(tmp_path / 'hand.urdf'), '-o', str(tmp_path / 'hand.yaml'),
                       '--picture', str(tmp_path / 'hand.png')]) == 0
    printed = capsys.readouterr().out
    assert 'left hand of 5 digits' in printed and "thumb: tip 'thumb_tip'" in printed
    assert load_robot(str(tmp_path / 'hand.yaml')).hand.side == 'left'
    assert f'{tmp_path / "hand.yaml"}: the robot file written' in printed
    assert f'{tmp_path / "hand.png"}: the robot beside a human hand' in printed
    assert f'hand_tracker robot view {tmp_path / "hand.yaml"} --side left' in printed
    assert f'robot:={tmp_path / "hand.yaml"} side:=left' in printed
    picture = np.asarray(Image.open(tmp_path / 'hand.png').convert('RGB'))
    # Every digit's colour is in both rows of hands, person and robot.
    for colour in ((86, 180, 233), (0, 114, 178), (0, 158, 115), (204, 121, 167), (230, 159, 0)):
        found = (np.abs(picture.astype(int) - colour).max(axis=2) < 8).any(axis=1)
        assert [part.any() for part in np.array_split(found, 4)] == [True] * 4


def test_the_commands_that_are_proposed_quote_paths_with_spaces(tmp_path, capsys):
    written = tmp_path / 'my robots' / 'hand.yaml'
    written.parent.mkdir()
    assert robot.main(['inspect', 'plain', '-o', str(written)]) == 0
    printed = capsys.readouterr().out
    assert f"robot view '{written}', in the browser" in printed
    assert printed.endswith(f"source:=markers 'robot:={written}'\n")


def test_a_hand_file_is_no_robot(tmp_path, capsys):
    save_hand(tmp_path / 'hand.yaml', Hand.scaled(), MarkerLayout())
    assert robot.main(['inspect', str(tmp_path / 'hand.yaml')]) == 1
    said = capsys.readouterr().err
    assert "hand.yaml: this is a person's hand file (--hand); expected a robot's URDF" in said


def test_the_spheres_that_are_drawn_touch_where_the_robot_pinches():
    robot = load_robot('plain').hand
    hand = Hand.scaled(limits=preset_limits('wide'))
    angles = pose_angles('pinch', hand)
    landmarks = landmark_positions(hand, forward(joint_table(hand), angles))
    solver = Retargeter(robot, hand)
    for _ in range(60):
        position = solver.update(landmarks, np.inf, angles)
    (thumb, thumb_radius), (index, index_radius), *others = robot_pose(
        'pinch', landmarks, robot, position).spheres
    assert np.linalg.norm(thumb - index) == pytest.approx(thumb_radius + index_radius, abs=1e-3)
    assert [radius for _, radius in others] == [.009, .009]


def test_what_is_written_of_a_preset_names_its_urdf(tmp_path, capsys):
    (tmp_path / 'hand.urdf').write_text(GRIPPER)
    written = str(tmp_path / 'hand.yaml')
    assert robot.main(['inspect', 'robotiq_2f', '--urdf', str(tmp_path / 'hand.urdf'),
                       '-o', written]) == 0
    assert load_robot(written).urdf == str(tmp_path / 'hand.urdf')
    assert robot.main(['inspect', 'plain', '--side', 'left', '-o', written]) == 0
    assert load_robot(written).urdf.endswith('plain_hand_left.urdf')


def test_what_cannot_be_read_is_one_line(tmp_path, capsys):
    assert robot.main(['inspect', str(tmp_path / 'none.urdf')]) == 1
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'none.urdf: No such file' in error


@pytest.mark.parametrize('arguments, said', [
    (['none.urdf'], 'none.urdf: No such file'),
    (['allegro'], '--robot-description'),
    (['plain', '--robot-description', 'none.urdf'], 'none.urdf: No such file'),
    (['{left}'], '--side left')])
def test_a_robot_that_cannot_be_shown_is_refused_before_the_page_is_there(
        arguments, said, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(serve, 'Viewer', None)
    left = tmp_path / 'left.urdf'
    left.write_text(urdf(wide_hand('left')))
    assert robot.main(['view', *(word.format(left=left) for word in arguments)]) == 1
    output = capsys.readouterr()
    assert said in output.err and output.err.count('\n') == 1
    assert 'http' not in output.out


@pytest.mark.parametrize('output', [
    ('-o', 'hand.urdf'), ('--picture', 'a.svg'), ('-o', 'none/hand.yaml'),
    ('--picture', 'none/a.png')])
def test_outputs_are_refused_before_anything_is_written(tmp_path, monkeypatch, capsys, output):
    monkeypatch.chdir(tmp_path)
    text = urdf(wide_hand('right'))
    (tmp_path / 'hand.urdf').write_text(text)
    assert robot.main(['inspect', 'hand.urdf', '-o', 'hand.yaml', *output]) == 1
    assert capsys.readouterr().err.startswith(f'hand_tracker robot: {output[1]}: ')
    assert (tmp_path / 'hand.urdf').read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == ['hand.urdf']
