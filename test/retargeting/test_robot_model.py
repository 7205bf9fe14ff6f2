"""Kinematics of robots against another library's."""

import numpy as np
import pytest
from helpers.robots import GRIPPER, wide_hand

from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.robot_model import robot_model
from hand_tracker.retargeting.robot_urdf import InvalidRobot, read_urdf_tree

MIMICS = """<robot name="chain">
<link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/>
<origin xyz="0.1 0 0.2" rpy="0.3 -0.2 1"/><axis xyz="0 1 1"/><limit lower="-1" upper="1"/></joint>
<joint name="two" type="revolute"><parent link="b"/><child link="c"/>
<origin xyz="0 0.3 0" rpy="0 0.4 0"/><axis xyz="1 0 0"/><limit lower="-1" upper="0.5"/>
<mimic joint="one" multiplier="-0.5" offset="0.1"/></joint>
<joint name="hold" type="fixed"><parent link="c"/><child link="d"/>
<origin xyz="0.1 0 0" rpy="0 0 0.5"/></joint>
<joint name="three" type="continuous"><parent link="d"/><child link="e"/>
<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.mark.parametrize('text', [MIMICS, GRIPPER, urdf(wide_hand('left'))])
def test_links_are_where_another_library_has_them(text, tmp_path):
    yourdfpy = pytest.importorskip('yourdfpy')
    (tmp_path / 'robot.urdf').write_text(text.replace('</visual>', '</visual>'))
    peer = yourdfpy.URDF.load(str(tmp_path / 'robot.urdf'), load_meshes=False,
                              build_scene_graph=True)
    model = robot_model(read_urdf_tree(text))
    random = np.random.default_rng(0)
    for _ in range(3):
        position = random.uniform(model.lower, model.upper)
        peer.update_cfg(dict(zip(model.variables, position)))
        frames = model.frames(position)
        for link in model.links:
            expected = peer.get_transform(link)
            rotation, place = model.link_pose(link, frames)
            np.testing.assert_allclose(place, expected[:3, 3], atol=1e-9)
            np.testing.assert_allclose(rotation, expected[:3, :3], atol=1e-9)


def test_mimic_joints_share_a_variable_and_narrow_its_limits():
    model = robot_model(read_urdf_tree(MIMICS))
    assert model.variables == ('one', 'three')
    assert model.joint_names == ('one', 'two', 'three')
    np.testing.assert_allclose(model.joint_positions(np.array((.4, 2.))), (.4, -.1, 2.))
    # two = -0.5 one + 0.1 <= 0.5 needs one >= -0.8
    np.testing.assert_allclose(model.lower, (-.8, -np.pi))
    np.testing.assert_allclose(model.upper, (1., np.pi))


def gripper(limit, mimic='<mimic joint="slide"/>'):
    """Return a gripper whose second finger has limits and a line of its own."""
    text = GRIPPER.replace('<limit lower="0" upper="0.04" velocity="0.2"/><mimic joint="slide"/>',
                           f'<limit {limit}/>{mimic}')
    assert text != GRIPPER
    return read_urdf_tree(text)


@pytest.mark.parametrize('multiplier, offset', [(1., 0.), (.5, 0.), (-.5, .015), (2., -.01)])
def test_a_commanded_mimic_joint_keeps_its_limits_and_its_speed(multiplier, offset):
    line = f'<mimic joint="slide" multiplier="{multiplier}" offset="{offset}"/>'
    tree = gripper('lower="0" upper="0.015" velocity="0.02"', line)
    model = robot_model(tree, ('slide', 'other'))
    for position in np.linspace(model.lower, model.upper, 9):
        slide, other = model.joint_positions(position)
        assert -1e-12 < slide < .04 + 1e-12 and -1e-12 < other < .015 + 1e-12
    assert model.lower < model.upper
    np.testing.assert_allclose(model.velocity, min(.2, .02 / abs(multiplier)))


def test_a_mimic_joint_that_is_not_commanded_leaves_half_of_the_range():
    model = robot_model(gripper('lower="0" upper="0.015" velocity="0.02"'))
    assert (model.upper, model.velocity) == (.04, .2)
    assert model.notes == ("'other' follows 'slide' from 0 to 0.04, against its limits 0 to 0.015, "
                           'which are not kept',)


@pytest.mark.parametrize('line', ['', 'multiplier="-1"', 'multiplier="0" offset="-1"',
                                  'offset="0.5"'])
def test_an_order_against_the_limits_of_a_mimic_joint_is_refused(line):
    limit = 'lower="-0.04" upper="0"' if not line else 'lower="0" upper="0.04"'
    tree = gripper(limit, f'<mimic joint="slide" {line}/>')
    assert robot_model(tree).upper == .04
    with pytest.raises(InvalidRobot, match="order: 'other' follows 'slide' from .* its limits"):
        robot_model(tree, ('slide', 'other'))


def test_a_commanded_mimic_joint_without_limits_narrows_none():
    tree = gripper('', '<mimic joint="slide" multiplier="3"/>')
    model = robot_model(tree, ('other',))
    assert (model.lower, model.upper, model.velocity) == (0., .04, .2)
