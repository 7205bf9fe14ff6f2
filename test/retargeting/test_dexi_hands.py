"""The eight robots that dexi-rs brings: inspected without settings, and driven by what is written.

Their tips by role are those of dex-retargeting's configurations, where these name them.
"""

import numpy as np
import pytest
from helpers.robots import dexi_urdf, wide_hand

from hand_tracker.calibration.landmarks import landmark_positions
from hand_tracker.cli import robot as robot_command
from hand_tracker.core.model.hand import SIDES
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.retargeting.retargeter import Retargeter
from hand_tracker.retargeting.robot_anatomy import ROLES
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.simulation.poses import pose_angles

FINGER_TIPS = 'thumb_tip', 'index_tip', 'middle_tip', 'ring_tip', 'pinky_tip'
ALLEGRO_TIPS = {'right': tuple(f'link_{i}.0_tip' for i in (15, 3, 7, 11)),
                'left': tuple(f'link_{i}.0_tip' for i in (15, 11, 7, 3))}
SHADOW_TIPS = 'thtip', 'fftip', 'mftip', 'rftip', 'lftip'
LEAP_TIPS = tuple(f'{role}_tip_head' for role in ('thumb', 'index', 'middle', 'ring'))
# By hand: its URDFs, and its tips from the thumb on.
HANDS = {
    'ability': (('ability_hand_{side}',), lambda side: FINGER_TIPS),
    'allegro': (('allegro_hand_{side}',), ALLEGRO_TIPS.get),
    'fourier': (('fourier_{side}_hand_6dof', 'fourier_{side}_hand_12dof'),
                lambda side: tuple(f'{side[0].upper()}_{tip}_link' for tip in FINGER_TIPS)),
    'inspire': (('inspire_hand_{side}',), lambda side: FINGER_TIPS),
    'leap': (('leap_hand_{side}',), lambda side: LEAP_TIPS),
    'schunk_svh': (('schunk_svh_hand_{side}',), lambda side: SHADOW_TIPS),
    'shadow': (('shadow_hand_{side}',), lambda side: SHADOW_TIPS)}


def inspected(path, folder):
    """Return the robot of the robot file that inspecting a URDF writes, by way of its command."""
    written = str(folder / 'robot.yaml')
    assert robot_command.main(['inspect', str(path), '-o', written]) == 0
    return load_robot(written)


def driven(robot, pose):
    """Return where a person's pose takes a robot's variables, whatever their speed."""
    hand = wide_hand(robot.side)
    angles = pose_angles(pose, hand)
    landmarks = landmark_positions(hand, forward(joint_table(hand), angles))
    solver = Retargeter(robot, hand)
    for _ in range(10):
        position = solver.update(landmarks, np.inf, angles)
    whole = robot.rest.copy()
    whole[[robot.model.variables.index(name) for name in solver.names]] = position
    assert (robot.model.lower <= whole).all() and (whole <= robot.model.upper).all()
    return whole


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('hand, urdf_name', [
    (hand, name) for hand, (names, _) in HANDS.items() for name in names])
def test_what_inspecting_a_hand_writes_names_all_its_tips_and_drives_it(
        hand, urdf_name, side, tmp_path):
    loaded = inspected(dexi_urdf(urdf_name.format(side=side)), tmp_path)
    robot = loaded.hand
    assert robot.side == side and not robot.anatomy.is_gripper
    tips = HANDS[hand][1](side)
    assert {role: digit.tip_link for role, digit in robot.anatomy.digits.items()} == dict(
        zip(ROLES, tips))
    # All that is unsure is how thick its tips are.
    assert all(note.startswith('radius at the tip of') for note in loaded.notes)
    assert set(loaded.order) == set(robot.model.variables) - set(robot.arm_joints)
    # Seen from the palm, the person's fist brings each finger back.
    straight, bent = (robot.tip_positions(driven(robot, pose)) for pose in ('open', 'fist'))
    assert (bent[1:, 0] < straight[1:, 0] - .02).all()


def test_what_inspecting_the_gripper_writes_says_where_its_pads_are_and_drives_it(tmp_path):
    loaded = inspected(dexi_urdf('panda_gripper_glb'), tmp_path)
    robot = loaded.hand
    assert robot.anatomy.is_gripper
    assert {digit.tip_link for digit in robot.anatomy.digits.values()} == {
        'panda_leftfinger', 'panda_rightfinger'}
    assert len(loaded.notes) == 2
    assert all('no frame at the tip; taken where the two meet' in note for note in loaded.notes)
    wide, closed = (np.linalg.norm(np.subtract(*robot.tip_positions(driven(robot, pose))))
                    for pose in ('spread', 'pinch'))
    assert wide > .07 and closed < .002
