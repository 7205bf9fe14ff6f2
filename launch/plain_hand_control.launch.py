"""Drive the plain robot hand by ros2_control with mock hardware; an example for your own robot.

Tracker, source and the driver of the robot come from track.launch.py, which this includes with the
arguments that are given here. Needs ros2_control and ros2_controllers.
"""

import sys
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node, SetRemap

from hand_tracker.files.ros2_control import with_mock_hardware
from hand_tracker.launching.installed_packages import is_installed
from hand_tracker.launching.launch_plan import names_launch_file, refuse_unknown_arguments
from hand_tracker.retargeting.robot_file import load_robot
from launch import Action, LaunchContext, LaunchDescription

DRIVEN_ROBOT = 'plain'
# Nodes of the robot: `robot_description` and `joint_states` without it are the person's hand.
ROBOT_NAMESPACE = 'robot'
# By controller: the output of the retarget node, and its topic in that namespace.
CONTROLLERS = {
    'hand_positions': ('position_array', 'commands'),
    'hand_trajectory': ('joint_trajectory', 'joint_trajectory')}
# Packages of these nodes, and what brings them
NEEDED = {
    'robot_state_publisher': 'robot_state_publisher', 'controller_manager': 'ros2_control',
    'joint_state_broadcaster': 'ros2_controllers'}
CONTROL_ARGUMENTS = (
    DeclareLaunchArgument(
        'controller', default_value='hand_positions', choices=list(CONTROLLERS),
        description='Of config/plain_hand_controllers.yaml: hand_positions, a '
                    'forward_command_controller, or hand_trajectory, a '
                    'joint_trajectory_controller'),
    DeclareLaunchArgument(
        'side', default_value='right', choices=['right', 'left'], description='Of both hands'),
    # Without it controllers and hardware would end with the tracker.
    DeclareLaunchArgument(
        'respawn', default_value='true', choices=['true', 'false'],
        description='Start a tracker that dies anew; else all ends with it'),
)


def start(context: LaunchContext) -> list[Action]:
    """Return the nodes of the robot, and the launch of tracker and driver."""
    share = Path(get_package_share_directory('hand_tracker'))
    tracking = PythonLaunchDescriptionSource(str(share / 'launch' / 'track.launch.py'))
    words = sys.argv[1:]
    if names_launch_file(words, Path(__file__)):
        included = tracking.get_launch_description(context).get_launch_arguments()
        refuse_unknown_arguments(
            words, [argument.name for argument in (*CONTROL_ARGUMENTS, *included)])
    # Before anything starts: launch leaves running what was started before one is missed.
    if lacking := [source for package, source in NEEDED.items() if not is_installed(package)]:
        raise RuntimeError(f"not installed: {', '.join(lacking)}")
    given = context.launch_configurations
    controller, side = given['controller'], given['side']
    output, topic = CONTROLLERS[controller]
    of_example = {'robot': DRIVEN_ROBOT, 'robot_description': '', 'outputs': output}
    for name, value in of_example.items():
        if given.get(name, value) != value:
            raise RuntimeError(f"{name}: '{given[name]}'; expected none: this drives the robot "
                               f"'{DRIVEN_ROBOT}' by {output}, copy it for yours")
    robot = load_robot(DRIVEN_ROBOT, preferred_side=side)
    description = with_mock_hardware(Path(robot.urdf).read_text(encoding='utf-8'), robot.order)
    # In that of retarget, as its topics begin with it.
    namespace = '/'.join(filter(None, (given.get('namespace', '').strip('/'), ROBOT_NAMESPACE)))

    def of_robot(package: str, executable: str, **more: Any) -> Node:
        return Node(package=package, executable=executable, namespace=namespace,
                    output='screen', **more)

    return [
        # First, as it may refuse an argument: launch leaves behind what was started before.
        GroupAction([
            SetRemap(f'robot/{output}', f'{ROBOT_NAMESPACE}/{controller}/{topic}'),
            IncludeLaunchDescription(tracking, launch_arguments=of_example.items())]),
        of_robot('robot_state_publisher', 'robot_state_publisher',
                 parameters=[{'robot_description': description}]),
        of_robot('controller_manager', 'ros2_control_node',
                 parameters=[str(share / 'config' / 'plain_hand_controllers.yaml')]),
        of_robot('controller_manager', 'spawner', arguments=[
            'joint_state_broadcaster', controller,
            '--controller-manager', f'/{namespace}/controller_manager'])]


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` runs."""
    return LaunchDescription([*CONTROL_ARGUMENTS, OpaqueFunction(function=start)])
