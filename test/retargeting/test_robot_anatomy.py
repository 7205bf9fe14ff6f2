"""Palm, digits, side and axes by geometry, whatever the base's frame and the names are."""

import re

import numpy as np
import pytest
from helpers.robots import (
    GRIPPER,
    PARALLEL_GRIPPER,
    human_robot,
    third_party_robot,
    wide_hand,
)

from hand_tracker.core.model.hand import LEFT_HAND_MIRROR
from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.robot_anatomy import find_anatomy
from hand_tracker.retargeting.robot_hand import robot_hand
from hand_tracker.retargeting.robot_model import robot_model
from hand_tracker.retargeting.robot_urdf import InvalidRobot, read_urdf_tree

ROBOTS = {'allegro': 4, 'leap': 4, 'shadow': 5, 'inspire': 5, 'ability': 5}


def nameless(text):
    """Return a URDF with names that tell nothing."""
    names = sorted(set(re.findall(r'(?:link|joint) name="([^"]+)"', text)), key=len, reverse=True)
    for i, name in enumerate(names):
        text = text.replace(f'"{name}"', f'"n{i}"')
    return text


def on_an_arm(text, rpy):
    """Return a URDF on two more links, turned."""
    root = re.search('<link name="wrist"', text)
    assert root
    return text.replace('</robot>', (
        '<link name="world"/><link name="arm"/>'
        '<joint name="lift" type="revolute"><parent link="world"/><child link="arm"/>'
        '<origin xyz="1 2 3"/><axis xyz="1 0 0"/><limit lower="-1" upper="1"/></joint>'
        f'<joint name="mount" type="fixed"><parent link="arm"/><child link="wrist"/>'
        f'<origin xyz="0 0 .2" rpy="{rpy}"/></joint></robot>'))


@pytest.mark.parametrize('side', ['right', 'left'])
def test_our_own_hand_is_found_without_its_names(side):
    hand = wide_hand(side)
    model = robot_model(read_urdf_tree(nameless(urdf(hand))))
    anatomy = find_anatomy(model)
    assert anatomy.side == side and not anatomy.is_gripper and not anatomy.unsure
    # The palm's axes are the wrist's; distal and dorsal are the fingers' means.
    np.testing.assert_allclose(anatomy.axes, np.eye(3), atol=.15)
    frames = model.frames(model.open_position())
    mirror = LEFT_HAND_MIRROR if side == 'left' else np.ones(3)
    for role, place in zip(('index', 'middle', 'ring', 'little'), hand.finger_mcp):
        digit = anatomy.digits[role]
        np.testing.assert_allclose(frames[1][digit.base], place * mirror, atol=1e-9)
        assert len(digit.bones) == 3
    lengths = [anatomy.digits[role].length for role in ('index', 'middle', 'ring', 'little')]
    np.testing.assert_allclose(lengths, hand.finger_bones.sum(axis=1), atol=1e-6)


@pytest.mark.parametrize('rpy', ['0 0 0', '1 2 3', '3.1 0 1.5'])
def test_on_an_arm_the_palm_is_where_the_digits_part(rpy):
    model = robot_model(read_urdf_tree(on_an_arm(urdf(wide_hand()), rpy)))
    anatomy = find_anatomy(model)
    assert anatomy.side == 'right' and set(anatomy.digits) == {
        'thumb', 'index', 'middle', 'ring', 'little'}
    assert model.joint_names[anatomy.palm_joint] == 'lift'
    rotation = model.links['wrist'].rotation
    np.testing.assert_allclose(anatomy.axes, rotation, atol=.15)


def test_a_gripper_has_a_thumb_and_a_finger():
    anatomy = find_anatomy(robot_model(read_urdf_tree(GRIPPER)))
    assert anatomy.is_gripper and set(anatomy.digits) == {'thumb', 'index'}
    np.testing.assert_allclose(anatomy.axes[:, 0], (0., 0., 1.))
    np.testing.assert_allclose(np.abs(anatomy.axes[:, 1]), (0., 1., 0.))


def test_the_pads_of_a_gripper_without_frames_there_meet_as_it_closes():
    robot = robot_hand(read_urdf_tree(PARALLEL_GRIPPER))
    assert set(robot.anatomy.digits) == {'thumb', 'index'}
    assert all(f"tip of '{side}_pad_carrier': no frame at the tip; taken where the two meet" in
               ' '.join(robot.anatomy.unsure) for side in ('left', 'right'))
    gaps = [np.linalg.norm(np.subtract(*robot.tip_positions(np.array([drive])))) - sum(
        sphere.radius for sphere in robot.spheres.values()) for drive in (0., .4, .8)]
    assert gaps[2] == pytest.approx(0., abs=1e-9)
    # Each pad comes in by 37 mm at a radius of 57 mm.
    assert gaps[0] == pytest.approx(2. * (.037 - .037 * np.cos(.8) + .043 * np.sin(.8)), abs=1e-9)
    assert 0. < gaps[1] < gaps[0]


def test_tips_that_are_given_are_taken_and_a_wrong_side_is_told():
    model = robot_model(read_urdf_tree(urdf(wide_hand())))
    tips = {role: f'{role}_tip' for role in ('thumb', 'index', 'middle')}
    anatomy = find_anatomy(model, tips, 'left')
    assert {role: digit.tip_link for role, digit in anatomy.digits.items()} == tips
    assert anatomy.side == 'left'
    assert 'side: left as given; the geometry says right' in anatomy.unsure


def test_fingers_that_are_given_crossed_are_told():
    for side in ('right', 'left'):
        model = robot_model(read_urdf_tree(urdf(wide_hand(side))))
        tips = {role: f'{role}_tip' for role in ('thumb', 'index', 'middle', 'ring')}
        assert find_anatomy(model, tips).unsure == ()
        tips['index'], tips['ring'] = tips['ring'], tips['index']
        told, = find_anatomy(model, tips).unsure
        assert told.startswith("digits: from the thumb's side on they lie as ring, middle, index: ")


def test_what_is_no_hand_is_refused():
    model = robot_model(read_urdf_tree(urdf(wide_hand())))
    with pytest.raises(InvalidRobot, match="index: there is no link 'finger'"):
        find_anatomy(model, {'thumb': 'thumb_tip', 'index': 'finger'})
    with pytest.raises(InvalidRobot, match='none of them is the thumb'):
        find_anatomy(model, {'middle': 'middle_tip', 'index': 'index_tip', 'ring': 'ring_tip'})
    with pytest.raises(InvalidRobot, match='at least two digits'):
        find_anatomy(robot_model(read_urdf_tree('<robot name="r"><link name="a"/></robot>')))


@pytest.mark.parametrize('side', ['right', 'left'])
@pytest.mark.parametrize('name', ROBOTS)
def test_third_party_hands_are_found(name, side):
    robot = third_party_robot(f'{name}_hand_{side}')
    assert robot.side == side and len(robot.anatomy.digits) == ROBOTS[name]
    assert robot.anatomy.unsure == ()


def test_fingers_that_bend_against_each_other_are_refused_with_an_advice_that_works():
    # Two bend towards -y, the third, between and opposite to them, towards +y.
    text = '<robot name="claw"><link name="palm"/>' + ''.join(
        f'<link name="{name}"/><link name="{name}_tip"/><joint name="{name}" type="revolute">'
        f'<parent link="palm"/><child link="{name}"/><origin xyz="{x} {y} 0"/>'
        f'<axis xyz="{axis} 0 0"/><limit lower="0" upper="1.5"/></joint>'
        f'<joint name="{name}_end" type="fixed"><parent link="{name}"/><child link="{name}_tip"/>'
        '<origin xyz="0 0 .08"/></joint>'
        for name, x, y, axis in (('a', -.03, .03, 1), ('b', .03, .03, 1), ('c', 0., -.03, -1))
    ) + '</robot>'
    model = robot_model(read_urdf_tree(text))
    with pytest.raises(InvalidRobot, match='name in the robot file .digits. as fingers those that '
                                           'bend alike, as thumb one against them'):
        find_anatomy(model, {'thumb': 'a_tip', 'index': 'b_tip', 'middle': 'c_tip'})
    anatomy = find_anatomy(model, {'index': 'a_tip', 'middle': 'b_tip', 'thumb': 'c_tip'})
    np.testing.assert_allclose(anatomy.axes[:, [0, 2]].T, ((0., 0., 1.), (0., 1., 0.)))


def test_names_that_contradict_are_told():
    text = urdf(wide_hand()).replace('index_tip', 'x').replace('ring_tip', 'index_tip').replace(
        '"x"', '"ring_tip"')
    unsure = find_anatomy(robot_model(read_urdf_tree(text))).unsure
    assert any("index: by geometry the digit of 'ring_tip'" in line for line in unsure)


def test_our_own_hand_has_its_sphere_at_the_tip():
    robot = human_robot()
    for role, digit in robot.anatomy.digits.items():
        centre, radius = robot.spheres[role]
        np.testing.assert_allclose(np.linalg.norm(digit.tip - centre), radius, atol=1e-9)


@pytest.mark.parametrize('side', ['right', 'left'])
def test_two_digits_that_more_than_two_variables_move_are_a_hand(side):
    tree = read_urdf_tree(urdf(wide_hand(side)))
    whole, robot = robot_hand(tree), robot_hand(tree, {
        role: f'{role}_tip' for role in ('thumb', 'index')})
    assert not robot.anatomy.is_gripper and robot.side == side
    for role, digit in robot.anatomy.digits.items():
        assert len(digit.bones) == 3
        np.testing.assert_allclose(digit.length, whole.anatomy.digits[role].length)
        assert robot.spheres[role].radius < .02


def test_the_thumb_of_two_digits_without_names_is_unsure():
    text = urdf(wide_hand())
    text = re.sub(r'(<joint name="(?:middle|ring|little)_\w+" type=)"revolute"', r'\1"fixed"', text)
    anatomy = find_anatomy(robot_model(read_urdf_tree(nameless(text))))
    assert not anatomy.is_gripper and set(anatomy.digits) == {'thumb', 'index'}
    assert any(line.startswith('thumb: taken is the digit of') for line in anatomy.unsure)
