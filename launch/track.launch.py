"""Track a hand or both: replay or live driver, tracker, robot_state_publisher, RViz if asked.

From top to bottom: the arguments, what is started, and each of its nodes. What the arguments mean
together, and which do not fit, is in `hand_tracker.launching.launch_plan`.
"""

import atexit
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hand_tracker.core.model.hand import BOTH
from hand_tracker.files.keystore import enclave_of
from hand_tracker.files.urdf_file import urdf
from hand_tracker.launching.installed_packages import is_installed
from hand_tracker.launching.launch_plan import (
    AUTO,
    SOURCE_NAME,
    SYSTEMS,
    TRACKER_NAME,
    LaunchPlan,
    names_launch_file,
    refuse_unknown_arguments,
)
from hand_tracker.launching.rviz_config import rviz_config
from hand_tracker.package_data import packaged_recording
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.shown_robot import shown_robot
from launch import Action, LaunchContext, LaunchDescription


class ArgumentRow(NamedTuple):
    """A row of `ARGUMENTS`."""

    name: str
    default: str
    description: str
    choices: tuple[str, ...] | None = None


RESPAWN_DELAY = 1.  # [s]
TRUE_FALSE = 'true', 'false'
AUTO_TRUE_FALSE = 'auto', *TRUE_FALSE
ARGUMENTS = (
    ArgumentRow('source', 'recording',
                'Where markers come from: a recording that is replayed, a driver that publishes '
                'MarkerArrays (markers or live), or another system',
                ('recording', 'markers', 'live', *SYSTEMS)),
    ArgumentRow('topic', '', "Topic of a source's messages; empty: the system's usual one"),
    ArgumentRow('message', '',
                'Of mocap4r2: markers or rigid_bodies; of landmarks: pose_array, named_pose_array '
                'or marker_array; empty: the first of these'),
    ArgumentRow('server', '', 'Address of the computer with Motive (natnet) or QTM (qualisys)'),
    ArgumentRow('subject', '',
                'Rigid body, marker set or subject of the hand; empty: whatever there is'),
    ArgumentRow('up', '',
                "Axis that is up in the system's data: z, or y, which is turned upright; empty: as "
                'Qualisys says, z of others'),
    ArgumentRow('latency', '',
                'Least time from exposure to receipt, for Qualisys: its stamps are earlier by it '
                '[s]; empty: 0'),
    ArgumentRow('source_process', 'auto',
                "Process of the client of natnet or qualisys: the tracker's, which answers "
                "sooner, or its own; auto: the tracker's, but its own with lifecycle:=true or "
                'use_security:=true', ('auto', 'own', 'tracker')),
    ArgumentRow('recording', '',
                'recording to replay (rosbag2, C3D, TRC, TSV, CSV, BVH, npz), but for what the '
                'nodes here publish; empty: the packaged one of the side'),
    ArgumentRow('rate', '1.0', 'Speed of the replay'),
    ArgumentRow('loop', 'true', 'Replay for ever; with false all ends after the recording',
                TRUE_FALSE),
    ArgumentRow('markers', 'markers',
                'Topic of the MarkerArrays; another one than markers has a source node publish '
                'them there'),
    ArgumentRow('hand', '', 'Hand file (YAML); empty: the mean hand'),
    ArgumentRow('layout', '',
                "Markers that are worn: a preset's name (docs/layouts.md) or a layout file "
                "(YAML); empty: the hand file's, else the paper's eight"),
    ArgumentRow('side', 'auto',
                "Side of the hand, or both hands in one tracker; auto: the hand file's, else right",
                ('auto', 'right', 'left', 'both')),
    ArgumentRow('left_hand', '',
                'Hand file (YAML) of the left one of both hands; empty: that of the right one, '
                'mirrored'),
    ArgumentRow('limits', 'auto',
                'Joint limits: Table 1 of the paper, wider ranges of motion, or Table 1 widened '
                "to what the hand file's calibration has seen; auto: the hand file's, else paper",
                ('auto', 'paper', 'wide', 'wearer')),
    ArgumentRow('coupling', 'auto',
                "How the fingers' DIP follows the PIP: as in hands that handle objects, or by 0.8 "
                "as in the paper; auto: the hand file's, else natural",
                ('auto', 'natural', 'paper')),
    ArgumentRow('thumb', 'saddle',
                "Plane of the thumb: the hand's saddle joint, or the paper's through the index MCP",
                ('saddle', 'index_mcp')),
    ArgumentRow('prefix', 'auto',
                'Before all joint and frame names; auto: right_ or left_; none: no prefix'),
    ArgumentRow('namespace', '',
                'Namespace of nodes and topics, for a second hand; frames have the prefix'),
    ArgumentRow('parameters', '',
                'Parameter file (YAML) for the nodes hand_tracker, source and retarget; it may set '
                'what arguments here set, but an argument that differs is refused'),
    ArgumentRow('publish_frequency', '1000.0',
                'Most transforms a second of robot_state_publisher [Hz]; not below the rate of '
                'the markers'),
    ArgumentRow('rviz', 'false', 'Show the hand in RViz', TRUE_FALSE),
    ArgumentRow('skin', 'auto',
                'Publish the skin of the hand for RViz; auto: when RViz is shown', AUTO_TRUE_FALSE),
    ArgumentRow('robot', '',
                'Robot hand to drive: a preset such as allegro, a robot file, a dex-retargeting '
                'file or a URDF; empty: none. It moves only once engaged. Of both hands each '
                'drives one'),
    ArgumentRow('robot_description', '',
                "The robot's URDF: path, package:// path or XML; empty: the robot file's"),
    ArgumentRow('left_robot', '',
                'Robot hand that the left one of both hands drives; empty: the same as robot'),
    ArgumentRow('left_robot_description', '',
                "The left robot's URDF, where robot_description is the right one's"),
    ArgumentRow('outputs', '',
                "What is sent to the robot, separated by spaces: joint_state, joint_trajectory, "
                "position_array; empty: the parameter file's, else joint_state"),
    ArgumentRow('show_robot', 'auto',
                'Broadcast the frames of the robots beside the hands for RViz: as they are, once '
                'engaged as they are commanded; auto: when RViz is shown. Needs '
                'robot_state_publisher and tf2_ros', AUTO_TRUE_FALSE),
    ArgumentRow('robot_process', 'own',
                'Process that drives the robot: its own, which holds the robot when the tracker '
                "dies, or the tracker's, which answers faster", ('own', 'tracker')),
    ArgumentRow('body_frame', '',
                "Frame of a body's TF that the hand hangs on, as another system captures it; "
                'empty: the hand stays where its markers are'),
    ArgumentRow('mount', '',
                'Parameter file with the offset of the wrist in that frame, as the service '
                'mount/calibrate writes it'),
    ArgumentRow('left_body_frame', '',
                'Frame that the left one of both hands hangs on; both hang on a body, or neither'),
    ArgumentRow('left_mount', '', 'Parameter file with the offset of the left one of both hands'),
    ArgumentRow('fixed_frame', 'mocap', 'Fixed frame of RViz: the frame_id of the markers, else '
                'it shows nothing'),
    ArgumentRow('use_sim_time', 'false',
                'Follow /clock, which another node publishes: the replay here does not',
                TRUE_FALSE),
    ArgumentRow('respawn', 'auto',
                'Start a tracker that dies anew; else all ends with it, the driving of a robot '
                'too; auto: true where a robot is driven by a process of its own, which holds it '
                'meanwhile. All ends when the driver of a robot dies', AUTO_TRUE_FALSE),
    ArgumentRow('lifecycle', 'false',
                'Run the tracker as a managed node, which activates itself; its states are those '
                'of ros2 lifecycle', TRUE_FALSE),
    ArgumentRow('use_security', 'false',
                'Start every node in its enclave of an SROS 2 keystore, enforced '
                '(docs/security.md)', TRUE_FALSE),
    ArgumentRow('keystore', '', 'Keystore of use_security; empty: that of ROS_SECURITY_KEYSTORE'),
)

PLACE_OPTIONS = '--x', '--y', '--z', '--qx', '--qy', '--qz', '--qw'
# A recording may hold these from an earlier run; two publishers of a frame fight.
PUBLISHED_HERE = ('tf tf_static joint_states joint_confidence hand_markers hand_skin '
                  'robot_description hand_description diagnostics')


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` runs."""
    return LaunchDescription([
        *(DeclareLaunchArgument(row.name, default_value=row.default, description=row.description,
                                choices=row.choices and list(row.choices)) for row in ARGUMENTS),
        OpaqueFunction(function=start)])


def start(context: LaunchContext) -> list[Action]:
    """Return the nodes for the arguments given."""
    words = sys.argv[1:]
    # Included by another file, what was given is that file's.
    if names_launch_file(words, Path(__file__)):
        refuse_unknown_arguments(words, [row.name for row in ARGUMENTS])
    plan = LaunchPlan(context.launch_configurations, is_installed)
    return [
        tracker(plan), *hand_publishers(plan), *source(plan), *replay(plan), *mounts(plan),
        *skins(plan), *retargets(plan), *robots_beside(plan), *rviz(plan)]


def tracker(plan: LaunchPlan) -> Node:
    """Return the tracker of the hand or hands, with what shares its process."""
    # A name would be that of all nodes of a process.
    executable, name, programs = 'tracker', None, []
    if plan.has_source:
        executable, programs = 'all', [
            'tracker', 'source', *(['retarget'] if plan.has_robot else [])]
    elif plan.has_robot:
        executable = 'teleoperate'
    else:
        name = TRACKER_NAME
        if plan.given['lifecycle'] == 'true':
            executable = 'managed_tracker'
    # What goes on without it holds a robot meanwhile.
    then = ({'respawn': True, 'respawn_delay': RESPAWN_DELAY} if plan.respawns_tracker
            else {'on_exit': ended('tracker')})
    return node(
        plan, executable, plan.tracker_parameters, file=plan.given['parameters'], name=name,
        arguments=programs, **then,
        remappings=[(topic, plan.marker_topic) for topic in ('markers', '~/markers')])


def hand_publishers(plan: LaunchPlan) -> list[Action]:
    """Return robot_state_publisher for each hand, or a line that it is missing."""
    if not plan.publishes_links:
        return [LogInfo(msg='robot_state_publisher is not installed: '
                            'the tracker broadcasts every frame itself')]
    return [state_publisher(
        plan, 'robot_state_publisher', urdf(hand.hand, hand.prefix), hand.namespace,
        plan.joint_remappings(hand)) for hand in plan.hands]


def source(plan: LaunchPlan) -> list[Action]:
    """Return the node of another system, where the tracker's process does not serve it."""
    if plan.given['source'] not in SYSTEMS or plan.direct or plan.has_source:
        return []
    return [node(
        plan, 'source', plan.own_source_parameters,
        file=plan.given['parameters'], name=SOURCE_NAME,
        remappings=[('~/markers', plan.marker_topic)], on_exit=ended('source'))]


def replay(plan: LaunchPlan) -> list[Action]:
    """Return the replay of a recording, where that is the source."""
    if plan.given['source'] != 'recording':
        return []
    side = BOTH if len(plan.hands) > 1 else plan.hands[0].hand.side
    recording = plan.given['recording'] or str(packaged_recording(side))
    # The launch ends with the tracker, so nothing is waited for in vain.
    return [node(
        plan, 'replay',
        {'recording': recording, 'layout': plan.hand_parameters['layout'],
         # Where nothing says which hand it is, the recording does.
         'side': '' if plan.hand_parameters['side'] == AUTO else side,
         'exclude_topics': PUBLISHED_HERE, 'rate': plan.number('rate'),
         'loop': plan.given['loop'] == 'true', 'wait_for_subscriber': inf},
        remappings=[('markers', plan.given['markers'])], on_exit=ended('replay'))]


def mounts(plan: LaunchPlan) -> list[Action]:
    """Return a mount for each hand that hangs on a body."""
    return [node(
        plan, 'mount', plan.mount_parameters(hand, frame), file=file, name='mount',
        namespace=hand.namespace, on_exit=ended('mount'))
        for hand, (frame, file) in zip(plan.hands, plan.mounts) if frame or file]


def skins(plan: LaunchPlan) -> list[Action]:
    """Return the skin of each hand; without its libraries it says so, and all else goes on."""
    if not plan.is_on('skin'):
        return []
    return [node(plan, 'skin', plan.skin_parameters(hand), namespace=hand.namespace,
                 remappings=plan.joint_remappings(hand)) for hand in plan.hands]


def retargets(plan: LaunchPlan) -> list[Action]:
    """Return the drivers of robots; one that is not of the hand's side refuses by name."""
    driven = [(hand, robot) for hand, robot in zip(plan.hands, plan.robots) if robot['robot']]
    for hand, robot in driven:
        # One that is not there ends the launch before anything is started.
        load_robot(robot['robot'], robot['robot_description'], preferred_side=hand.hand.side)
    if plan.has_robot:
        return []
    return [node(plan, 'retarget', robot, file=plan.given['parameters'], namespace=hand.namespace,
                 remappings=plan.joint_remappings(hand), on_exit=ended('retarget'))
            for hand, robot in driven]


def robots_beside(plan: LaunchPlan) -> list[Action]:
    """Return the nodes that broadcast the frames of each shown robot beside its hand."""
    if plan.should_show_robots and not plan.shows_robots:
        return [LogInfo(msg='robot_state_publisher or tf2_ros is not installed: '
                            'robots are not shown')]
    actions: list[Action] = []
    for hand, robot in plan.shown_robots:
        shown = shown_robot(robot['robot'], robot['robot_description'], hand.hand.side)
        name = f'{hand.prefix}robot'
        if shown.missing:
            actions.append(LogInfo(msg=f'{name}: RViz will not show what of the URDF is not '
                                       f"found: {', '.join(shown.missing)}"))
        place = [word for pair in zip(PLACE_OPTIONS, map(str, shown.place)) for word in pair]
        actions += [
            state_publisher(
                plan, 'robot_state_publisher of the robot', shown.description, name,
                [('joint_states', plan.full_name(hand.namespace, 'robot/shown'))],
                frame_prefix=f'{name}/'),
            node(
                plan, 'static_transform_publisher', {}, package='tf2_ros', namespace=name,
                name='static_transform_publisher',  # else a random one, unknown to a policy
                arguments=[*place, '--frame-id', f'{hand.prefix}wrist',
                           '--child-frame-id', f'{name}/{shown.root}'],
                on_exit=ended('static_transform_publisher of the robot'))]
    return actions


def rviz(plan: LaunchPlan) -> list[Action]:
    """Return RViz where it is asked for, which follows the first hand."""
    if plan.given['rviz'] != 'true':
        return []
    path = Path(get_package_share_directory('hand_tracker'), 'config', 'hand_tracker.rviz')
    packaged = path.read_text(encoding='utf-8')
    config = rviz_config(
        packaged, plan.hands[0].prefix, plan.hands[0].namespace, len(plan.hands),
        {hand.hand.side: f'{hand.prefix}robot' for hand, _ in plan.shown_robots})
    if config != packaged:
        folder = tempfile.mkdtemp(prefix='hand_tracker_')
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        path = Path(folder, path.name)
        path.write_text(config, encoding='utf-8')
    return [node(plan, 'rviz2', {}, package='rviz2', arguments=[
        '-d', str(path), '-f', plan.given['fixed_frame']])]


def state_publisher(plan: LaunchPlan, name: str, description: str, namespace: str,
                    remappings: Sequence[tuple[str, str]], **parameters: str) -> Node:
    """Return robot_state_publisher of a URDF, without which the launch ends."""
    return node(
        plan, 'robot_state_publisher',
        {'robot_description': description, **parameters,
         'publish_frequency': plan.number('publish_frequency')},
        package='robot_state_publisher', namespace=namespace, remappings=remappings,
        on_exit=ended(name))


def node(plan: LaunchPlan, executable: str, parameters: Mapping[str, Any],
         package: str = 'hand_tracker', file: str = '', namespace: str = '', **more: Any) -> Node:
    """Return a node with what all have: namespace, parameters, enclave."""
    if plan.environment:
        more.update(additional_env=plan.environment, ros_arguments=[
            '--enclave', enclave_of(plan.environment, executable)])
    return Node(
        package=package, executable=executable,
        namespace='/'.join(filter(None, (plan.given['namespace'], namespace))),
        parameters=[*filter(None, [file]), plan.common,
                    *([texts_kept(parameters)] if parameters else [])],
        output='screen', **more)


def texts_kept(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters whose texts launch does not read as YAML: '' is no null."""
    return {name: ParameterValue(value, value_type=str) if isinstance(value, str) else value
            for name, value in parameters.items()}


def ended(name: str) -> Callable[[ProcessExited, LaunchContext], Shutdown]:
    """Return the handler that ends the launch with a node, with its error if it had one."""
    def end(event: ProcessExited, context: LaunchContext) -> Shutdown:
        if event.returncode and not context.is_shutdown:
            raise RuntimeError(f'the {name} ended with exit code {event.returncode}')
        return Shutdown(reason=f'the {name} ended')
    return end
