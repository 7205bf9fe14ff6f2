"""Kinematics of robots against another library's."""

import numpy as np
import pytest
from helpers.robots import GRIPPER, wide_hand

from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.robot_model import robot_model
from hand_tracker.retargeting.robot_urdf import read_urdf_tree

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
