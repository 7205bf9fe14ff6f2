"""Robot hands for tests: our own hand as a robot, small ones, and third-party URDFs by path."""

import pytest

from hand_tracker.core.model.hand import Hand, preset_limits
from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.robot_hand import robot_hand
from hand_tracker.retargeting.robot_urdf import load_urdf_tree, read_urdf_tree
from helpers.captures import capture_folder

# A gripper of one variable: two prismatic fingers, the second mimics the first.
GRIPPER = """<robot name="gripper">
<link name="base"/><link name="left"/><link name="right"/><link name="left_tip"/>
<link name="right_tip"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="left"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="0.2"/></joint>
<joint name="other" type="prismatic"><parent link="base"/><child link="right"/>
<axis xyz="0 -1 0"/><limit lower="0" upper="0.04" velocity="0.2"/><mimic joint="slide"/></joint>
<joint name="left_end" type="fixed"><parent link="left"/><child link="left_tip"/>
<origin xyz="0 0.006 0.1"/></joint>
<joint name="right_end" type="fixed"><parent link="right"/><child link="right_tip"/>
<origin xyz="0 -0.006 0.1"/></joint>
</robot>"""


def wide_hand(side='right'):
    """Return the mean hand with the wide limits."""
    return Hand.scaled(side=side, limits=preset_limits('wide'))


def human_robot(side='right'):
    """Return our own hand as a robot."""
    return robot_hand(read_urdf_tree(urdf(wide_hand(side))))


def third_party_robot(name):
    """Return a robot of the captures' folder; the test that asks is skipped where it is absent."""
    path = capture_folder() / 'robots' / f'{name}.urdf'
    if not path.exists():
        pytest.skip(f'no URDF {path}')
    return robot_hand(load_urdf_tree(path))
