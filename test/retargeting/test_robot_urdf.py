"""Reading robots: trees, and clear refusals."""

import numpy as np
import pytest
from helpers.robots import GRIPPER

from hand_tracker.retargeting.robot_urdf import (
    InvalidRobot,
    load_urdf_tree,
    read_urdf_tree,
    rotation_from_rpy,
)

JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>{}</joint>'


def robot(*joints, links=('a', 'b', 'c')):
    return '<robot name="r">{}{}</robot>'.format(
        ''.join(f'<link name="{link}"/>' for link in links), ''.join(joints))


def test_a_tree_is_read_with_limits_mimics_and_parents_first():
    tree = read_urdf_tree(GRIPPER)
    assert tree.name == 'gripper' and tree.root == 'base'
    assert [joint.name for joint in tree.joints] == ['slide', 'other', 'left_end', 'right_end']
    slide, other = tree.joints[:2]
    assert (slide.lower, slide.upper, slide.velocity) == (0., .04, .2)
    assert other.mimic == ('slide', 1., 0.) and not tree.joints[2].is_movable
    np.testing.assert_allclose(tree.joints[2].translation, (0., .006, .1))


@pytest.mark.parametrize('soft, limits', [
    ('k_velocity="1"', (0., .04)),
    ('k_velocity="1" soft_lower_limit="0.002" soft_upper_limit="0.03"', (.002, .03)),
    ('k_velocity="1" soft_lower_limit="-1" soft_upper_limit="0.03"', (0., .03)),
    ('k_velocity="1" soft_lower_limit="0.01"', (.01, .04))])
def test_soft_limits_narrow_the_limits(soft, limits):
    text = GRIPPER.replace('velocity="0.2"/></joint>',
                           f'velocity="0.2"/><safety_controller {soft}/></joint>')
    slide = read_urdf_tree(text).joints[0]
    assert (slide.lower, slide.upper) == limits


def test_soft_limits_of_a_joint_without_limits_do_not_count():
    soft = ('<safety_controller k_velocity="1" soft_lower_limit="0.1" soft_upper_limit="0.9"/>')
    tree = read_urdf_tree(robot(JOINT.format('j', 'fixed', 'a', 'b', soft),
                                JOINT.format('k', 'continuous', 'b', 'c', soft)))
    assert [joint.upper for joint in tree.joints] == [0., np.pi]


def test_soft_limits_beyond_the_limits_are_refused():
    text = GRIPPER.replace(
        'velocity="0.2"/></joint>', 'velocity="0.2"/><safety_controller k_velocity="1" '
        'soft_lower_limit="1" soft_upper_limit="2"/></joint>')
    with pytest.raises(InvalidRobot, match="'slide': soft limits 1 to 2 of its safety_controller; "
                                           'expected a range within 0 to 0.04'):
        read_urdf_tree(text)


def test_roll_pitch_yaw_are_about_fixed_axes():
    x = rotation_from_rpy(np.array((np.pi / 2, 0., 0.)))
    np.testing.assert_allclose(x @ (0., 1., 0.), (0., 0., 1.), atol=1e-15)
    both = rotation_from_rpy(np.array((np.pi / 2, 0., np.pi / 2)))
    np.testing.assert_allclose(both @ (0., 1., 0.), (0., 0., 1.), atol=1e-15)
    np.testing.assert_allclose(both @ (1., 0., 0.), (0., 1., 0.), atol=1e-15)


def test_the_greatest_sphere_of_a_link_is_its_tip_radius():
    text = ('<robot name="r"><link name="a"><collision><geometry><sphere radius="0.01"/>'
            '</geometry></collision></link></robot>')
    assert read_urdf_tree(text).spheres == {'a': .01}


@pytest.mark.parametrize('text, message', [
    ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>', 'document type or entities'),
    ('<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>', 'document type or entities'),
    ('<robot', 'not XML'),
    ('<robot>' + '<a>' * 100 + '</a>' * 100 + '</robot>', 'nested more than 100 deep'),
    ('<sdf/>', 'expected <robot>'),
    ('<robot><link/></robot>', 'a <link> has no name'),
    (robot(JOINT.format('j', 'floating', 'a', 'b', '')), "its type is 'floating'"),
    (robot(JOINT.format('j', 'fixed', 'a', 'x', '')), "there is no link 'x'"),
    (robot(JOINT.format('j', 'fixed', 'a', 'b', '')), '2 links have no parent'),
    (robot(JOINT.format('j', 'fixed', 'a', 'b', ''), JOINT.format('j', 'fixed', 'b', 'c', '')),
     "two joints have the name 'j'"),
    (robot(JOINT.format('j', 'fixed', 'a', 'b', ''), JOINT.format('k', 'fixed', 'c', 'b', '')),
     'more than one parent'),
    (robot(JOINT.format('j', 'fixed', 'b', 'c', ''), JOINT.format('k', 'fixed', 'c', 'b', '')),
     'a loop'),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', '<axis xyz="0 0 0"/>'),
           JOINT.format('k', 'fixed', 'b', 'c', '')), 'axis has no direction'),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', '<limit lower="1" upper="0"/>'),
           JOINT.format('k', 'fixed', 'b', 'c', '')), 'lower limit 1 exceeds upper limit 0'),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', '<limit lower="nan" upper="0"/>'),
           JOINT.format('k', 'fixed', 'b', 'c', '')), "lower is 'nan'; expected a number"),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', '<origin xyz="1 2"/>'),
           JOINT.format('k', 'fixed', 'b', 'c', '')), 'expected three numbers'),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', ''), JOINT.format('k', 'fixed', 'b', 'c', '')),
     'no <limit>; expected the range of a revolute joint'),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', '<limit lower="0" upper="1e300"/>'),
           JOINT.format('k', 'fixed', 'b', 'c', '')), 'limits 0 to 1e+300; expected radians or'),
    ('<robot/>', 'no link; expected those of a robot'),
    (robot(JOINT.format('j', 'revolute', 'a', 'b', '<mimic joint="j"/>'),
           JOINT.format('k', 'fixed', 'b', 'c', '')), "joint 'j' mimics 'j'"),
])
def test_what_is_no_robot_is_refused_with_the_reason(text, message):
    with pytest.raises(InvalidRobot, match='^hand.urdf: ') as refusal:
        read_urdf_tree(text, 'hand.urdf')
    assert message in str(refusal.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InvalidRobot, match='none.urdf: No such file'):
        load_urdf_tree(tmp_path / 'none.urdf')
    (tmp_path / 'binary.urdf').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(InvalidRobot, match='binary.urdf: not a text in UTF-8'):
        load_urdf_tree(tmp_path / 'binary.urdf')
