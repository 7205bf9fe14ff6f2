"""The example of ros2_control: hardware, controllers and launch file name the same joints."""

import ast
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from benchmarks.repository import REPOSITORY
from hand_tracker.files.ros2_control import MOCK_PLUGIN, UnknownJoints, with_mock_hardware
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.robot_model import robot_model
from hand_tracker.retargeting.robot_urdf import read_urdf_tree

CONFIG = REPOSITORY / 'config' / 'plain_hand_controllers.yaml'
LAUNCHED = REPOSITORY / 'launch' / 'plain_hand_control.launch.py'
# As of ros2_controllers' own documents.
TYPES = {'hand_positions': 'forward_command_controller/ForwardCommandController',
         'hand_trajectory': 'joint_trajectory_controller/JointTrajectoryController',
         'joint_state_broadcaster': 'joint_state_broadcaster/JointStateBroadcaster'}


def constant(name):
    """Return a constant of the launch file, which cannot be imported without launch."""
    for node in ast.parse(LAUNCHED.read_text(encoding='utf-8')).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == name:
            return ast.literal_eval(node.value)
    raise LookupError(name)


@pytest.mark.parametrize('side', ['right', 'left'])
def test_the_plain_hand_is_mocked_with_all_its_joints(side):
    robot = load_robot('plain', preferred_side=side)
    text = Path(robot.urdf).read_text(encoding='utf-8')
    section = ElementTree.fromstring(with_mock_hardware(text, robot.order)).find('ros2_control')
    assert section.get('type') == 'system'
    assert section.find('hardware/plugin').text == MOCK_PLUGIN
    interfaces = {
        joint.get('name'): [kind.get('name') for kind in joint.findall('command_interface')]
        for joint in section.findall('joint')}
    model = robot.hand.model
    # Mimic joints move along by the URDF: a command would be refused.
    assert interfaces == {
        name: ['position'] if name in model.variables else [] for name in model.joint_names}
    for joint in section.findall('joint'):
        assert [kind.get('name') for kind in joint.findall('state_interface')] == [
            'position', 'velocity']
    # Zero, where the mock starts, is within the limits.
    assert (model.lower <= 0.).all() and (model.upper >= 0.).all()


def test_the_robot_itself_stays_as_it_is():
    robot = load_robot('plain')
    text = Path(robot.urdf).read_text(encoding='utf-8')
    again = robot_model(read_urdf_tree(with_mock_hardware(text, robot.order)))
    assert again.joint_names == robot.hand.model.joint_names
    for one, other in zip(again.joints, robot.hand.model.joints):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize('name', ['knee', 'index_dip'])
def test_joints_that_cannot_be_commanded_are_named(name):
    text = Path(load_robot('plain').urdf).read_text(encoding='utf-8')
    with pytest.raises(UnknownJoints, match=f"joint: '{name}'; expected of index_spread"):
        with_mock_hardware(text, [name])


def test_launch_file_and_controllers_agree():
    settings = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    manager = settings['/**/controller_manager']['ros__parameters']
    assert {name: manager[name]['type'] for name in TYPES} == TYPES
    controllers, order = constant('CONTROLLERS'), load_robot(constant('DRIVEN_ROBOT')).order
    assert set(controllers) | {'joint_state_broadcaster'} == set(TYPES)
    for name in controllers:
        assert tuple(settings[f'/**/{name}']['ros__parameters']['joints']) == order
    # What the retarget node reads is what the broadcaster in that namespace publishes.
    assert f"{constant('ROBOT_NAMESPACE')}/joint_states" == 'robot/joint_states'


def test_each_controller_gets_the_message_that_it_takes():
    pytest.importorskip('trajectory_msgs')
    from hand_tracker.nodes.command_messages import OUTPUTS
    kinds = {controller: OUTPUTS[output][1].__name__
             for controller, (output, _) in constant('CONTROLLERS').items()}
    assert kinds == {'hand_positions': 'Float64MultiArray', 'hand_trajectory': 'JointTrajectory'}
    assert all(OUTPUTS[output][0] == f'robot/{output}'
               for output, _ in constant('CONTROLLERS').values())
