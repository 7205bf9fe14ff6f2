"""Track a hand or both: replay or live driver, tracker, robot_state_publisher, RViz if asked."""

import atexit
import shutil
import sys
import tempfile
from contextlib import suppress
from difflib import get_close_matches
from math import inf
from pathlib import Path
from typing import NamedTuple

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, Shutdown
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hand_tracker.adapters.marker_messages import DEFAULT_MESSAGE, SERVED, direct_input
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import BOTH, SIDES, Hand
from hand_tracker.core.numerics.quaternion import quaternion
from hand_tracker.files.keystore import enclave_of, security_environment
from hand_tracker.files.parameter_file import node_parameters
from hand_tracker.files.urdf_file import urdf
from hand_tracker.nodes.tracker_parameters import (
    AUTO,
    SEPARATE,
    START,
    start_of_hand,
    starting_hand,
    values_of_hand,
)
from hand_tracker.package_data import packaged_recording
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.robot_paths import with_file_addresses
from launch import LaunchDescription

# Systems of which the tracker, or else a source node, takes the messages or packets.
SYSTEMS = 'point_cloud', 'mocap4r2', *SERVED, 'landmarks'
ARGUMENTS = (
    DeclareLaunchArgument(
        'source', default_value='recording', choices=['recording', 'markers', 'live', *SYSTEMS],
        description='Where markers come from: a recording that is replayed, a driver that '
                    'publishes MarkerArrays (markers or live), or another system'),
    DeclareLaunchArgument(
        'topic', default_value='',
        description="Topic of a source's messages; empty: the system's usual one"),
    DeclareLaunchArgument(
        'message', default_value='',
        description='Of mocap4r2: markers or rigid_bodies; of landmarks: pose_array, '
                    'named_pose_array or marker_array; empty: the first of these'),
    DeclareLaunchArgument(
        'server', default_value='',
        description='Address of the computer with Motive (natnet) or QTM (qualisys)'),
    DeclareLaunchArgument(
        'subject', default_value='',
        description='Rigid body, marker set or subject of the hand; empty: whatever there is'),
    DeclareLaunchArgument(
        'source_process', default_value='auto', choices=['auto', 'own', 'tracker'],
        description="Process of the client of natnet or qualisys: the tracker's, which answers "
                    "sooner, or its own; auto: the tracker's, but its own with lifecycle:=true or "
                    "use_security:=true"),
    DeclareLaunchArgument(
        'recording', default_value='',
        description='recording to replay (rosbag2, C3D, TRC, TSV, CSV, BVH, npz), but for what the '
                    'nodes here publish; empty: the packaged one of the side'),
    DeclareLaunchArgument(
        'rate', default_value='1.0', description='Speed of the replay'),
    DeclareLaunchArgument(
        'loop', default_value='true', choices=['true', 'false'],
        description='Replay for ever; with false all ends after the recording'),
    DeclareLaunchArgument(
        'markers', default_value='markers',
        description='Topic of the MarkerArrays; another one than markers has a source node '
                    'publish them there'),
    DeclareLaunchArgument(
        'hand', default_value='', description='Hand file (YAML); empty: the mean hand'),
    DeclareLaunchArgument(
        'layout', default_value='',
        description="Markers that are worn: a preset's name (docs/layouts.md) or a layout file "
                    "(YAML); empty: the hand file's, else the paper's eight"),
    DeclareLaunchArgument(
        'side', default_value='auto', choices=['auto', 'right', 'left', 'both'],
        description="Side of the hand, or both hands in one tracker; auto: the hand file's, else "
                    "right"),
    DeclareLaunchArgument(
        'left_hand', default_value='',
        description='Hand file (YAML) of the left one of both hands; empty: that of the right one, '
                    'mirrored'),
    DeclareLaunchArgument(
        'limits', default_value='auto', choices=['auto', 'paper', 'wide', 'wearer'],
        description="Joint limits: Table 1 of the paper, wider ranges of motion, or Table 1 "
                    "widened to what the hand file's calibration has seen; "
                    "auto: the hand file's, else paper"),
    DeclareLaunchArgument(
        'coupling', default_value='auto', choices=['auto', 'natural', 'paper'],
        description="How the fingers' DIP follows the PIP: as in hands that handle objects, or by "
                    "0.8 as in the paper; auto: the hand file's, else natural"),
    DeclareLaunchArgument(
        'thumb', default_value='saddle', choices=['saddle', 'index_mcp'],
        description="Plane of the thumb: the hand's saddle joint, or the paper's through the "
                    "index MCP"),
    DeclareLaunchArgument(
        'prefix', default_value='auto',
        description='Before all joint and frame names; auto: right_ or left_; none: no prefix'),
    DeclareLaunchArgument(
        'namespace', default_value='',
        description='Namespace of nodes and topics, for a second hand; frames have the prefix'),
    DeclareLaunchArgument(
        'parameters', default_value='',
        description='Parameter file (YAML) for the tracker; it may set what arguments here set, '
                    'but an argument that differs is refused'),
    DeclareLaunchArgument(
        'publish_frequency', default_value='1000.0',
        description='Most transforms a second of robot_state_publisher [Hz]; '
                    'not below the rate of the markers'),
    DeclareLaunchArgument(
        'rviz', default_value='false', choices=['true', 'false'],
        description='Show the hand in RViz'),
    DeclareLaunchArgument(
        'skin', default_value='auto', choices=['auto', 'true', 'false'],
        description='Publish the skin of the hand for RViz; auto: when RViz is shown'),
    DeclareLaunchArgument(
        'robot', default_value='',
        description='Robot hand to drive: a preset such as allegro, a robot file, a '
                    'dex-retargeting file or a URDF; empty: none. It moves only once engaged. '
                    'Of both hands each drives one'),
    DeclareLaunchArgument(
        'robot_description', default_value='',
        description="The robot's URDF: path, package:// path or XML; empty: the robot file's"),
    DeclareLaunchArgument(
        'left_robot', default_value='',
        description='Robot hand that the left one of both hands drives; empty: the same as robot'),
    DeclareLaunchArgument(
        'left_robot_description', default_value='',
        description="The left robot's URDF, where robot_description is the right one's"),
    DeclareLaunchArgument(
        'show_robot', default_value='auto', choices=['auto', 'true', 'false'],
        description='Broadcast the frames of the robots beside the hands for RViz: as they are, '
                    'once engaged as they are commanded; auto: when RViz is shown. Needs '
                    'robot_state_publisher and tf2_ros'),
    DeclareLaunchArgument(
        'robot_process', default_value='own', choices=['own', 'tracker'],
        description="Process that drives the robot: its own, which holds the robot when the "
                    "tracker dies, or the tracker's, which answers faster"),
    DeclareLaunchArgument(
        'body_frame', default_value='',
        description="Frame of a body's TF that the hand hangs on, as another system captures it; "
                    "empty: the hand stays where its markers are"),
    DeclareLaunchArgument(
        'mount', default_value='',
        description='Parameter file with the offset of the wrist in that frame, as the service '
                    'mount/calibrate writes it'),
    DeclareLaunchArgument(
        'left_body_frame', default_value='',
        description='Frame that the left one of both hands hangs on; both hang on a body, or '
                    'neither'),
    DeclareLaunchArgument(
        'left_mount', default_value='',
        description='Parameter file with the offset of the left one of both hands'),
    DeclareLaunchArgument(
        'fixed_frame', default_value='mocap', description='Fixed frame of RViz'),
    DeclareLaunchArgument(
        'use_sim_time', default_value='false', choices=['true', 'false'],
        description='Follow /clock'),
    DeclareLaunchArgument(
        'lifecycle', default_value='false', choices=['true', 'false'],
        description='Run the tracker as a managed node, which activates itself; its states are '
                    'those of ros2 lifecycle'),
    DeclareLaunchArgument(
        'use_security', default_value='false', choices=['true', 'false'],
        description='Start every node in its enclave of an SROS 2 keystore, enforced '
                    '(docs/security.md)'),
    DeclareLaunchArgument(
        'keystore', default_value='',
        description='Keystore of use_security; empty: that of ROS_SECURITY_KEYSTORE'),
)

NONE = 'none'  # as `ros2 launch` takes no empty value
START_DEFAULTS = {row.name: row.default for row in START}
TRACKER_NAME = 'hand_tracker'
SOURCE_NAME = 'source'
# Parameters of the tracker that the URDF depends on, and the arguments that set them too.
ARGUMENT_OF = {
    'hand_file': 'hand', 'layout': 'layout', 'side': 'side', 'limits.preset': 'limits',
    'coupling.preset': 'coupling', 'thumb': 'thumb', 'prefix': 'prefix', 'hand_length': None,
    'hand_breadth': None}
ROBOT_TAKES = 'hand_file', 'hand_length', 'hand_breadth', 'limits.preset', 'thumb', 'prefix'
MOUNT_TAKES = 'hand_file', 'side', 'prefix'
SKIN_TAKES = 'hand_file', 'side', 'hand_length', 'hand_breadth', 'thumb', 'prefix'
SHOWN_TOPICS = 'robot_description', 'hand_markers', 'hand_skin'
ROBOT_DISTANCE = .25    # [m] from the wrist to the robot's palm
PLACE_OPTIONS = '--x', '--y', '--z', '--qx', '--qy', '--qz', '--qw'
SHOWN_ROBOT = 'Name: Robot of the {} hand\n      Enabled: {}\n'
VIEW_DISTANCE = 'Distance: {:g}\n'  # [m] of RViz's view from what it follows
ONE_HAND, SECOND_HAND, ROBOTS_BESIDE = .6, .7, .35  # [m] for one hand, more for what is beside
FOLLOWED = 'Target Frame: {}middle_knuckle'  # by RViz's view: amid the hand, still in the palm
# A recording may hold these from an earlier run; two publishers of a frame fight.
PUBLISHED_HERE = ('tf tf_static joint_states joint_confidence hand_markers hand_skin '
                  'robot_description hand_description diagnostics')


def start(context):
    """Return the nodes for the arguments given."""
    check_names()
    launch = HandLaunch(context.launch_configurations)
    return [
        launch.tracker(), *launch.hand_publishers(), *launch.source(), *launch.replay(),
        *launch.mounts(), *launch.skins(), *launch.retargets(), *launch.robots_beside(),
        *launch.rviz()]


class HandLaunch:
    """Nodes of one launch, by what they do, from its arguments and its parameter file."""

    def __init__(self, given):
        self.given = given
        if given['rviz'] == 'true' and not installed('rviz2'):
            # Found out later, nodes that have been started are left behind.
            raise RuntimeError('rviz: rviz2 is not installed')
        self.publishes_links = installed('robot_state_publisher')
        shows_frames = self.publishes_links and installed('tf2_ros')
        self.broadcast = 'wrist' if self.publishes_links else 'all'
        self.in_file = file_parameters(given)
        self.hand_parameters = shared_parameters(given, self.in_file)
        self.hands = hands_of(given, self.in_file, self.hand_parameters)
        check_frames(self.in_file, self.broadcast, f'{self.hands[0].prefix}wrist')
        self.common = {'use_sim_time': agreed(
            'use_sim_time', given['use_sim_time'] == 'true', False, self.in_file)}
        self.environment = (security_environment(given['keystore'])
                            if given['use_security'] == 'true' else {})
        self.direct = direct_source(given)
        self.hand_mounts = mounts_of(given, self.hands)
        self.on_body = agreed('on_body', any(map(any, self.hand_mounts)), False, self.in_file)
        self.should_show_robots = is_on(given, 'show_robot') and any(
            (given['robot'], given['left_robot']))
        self.shows_robots = self.should_show_robots and shows_frames
        self.robots = [robot_parameters(given, self.in_file, hand, self.on_body)
                       | {'show_robot': self.shows_robots} for hand in self.hands]
        self.has_robot = drives_robot_in_tracker(given, self.hands, self.robots)
        self.has_source = takes_packets_in_tracker(given)

    def node(self, executable, parameters, package='hand_tracker', file='', namespace='', **more):
        """Return a node with what all have: namespace, parameters, enclave."""
        if self.environment:
            more.update(additional_env=self.environment, ros_arguments=[
                '--enclave', enclave_of(self.environment, executable)])
        return Node(
            package=package, executable=executable,
            namespace='/'.join(filter(None, (self.given['namespace'], namespace))),
            parameters=[*filter(None, [file]), self.common, *map(texts_kept, parameters)],
            output='screen', **more)

    def tracker(self):
        """Return the tracker of the hand or hands, with what shares its process."""
        # A name would be that of all nodes of a process.
        executable, name, programs = 'tracker', None, []
        if self.has_source:
            executable, programs = 'all', [
                'tracker', 'source', *(['retarget'] if self.has_robot else [])]
        elif self.has_robot:
            executable = 'teleoperate'
        else:
            name = TRACKER_NAME
            if self.given['lifecycle'] == 'true':
                executable = 'managed_tracker'
        parameters = {
            **self.hand_parameters, 'broadcast': self.broadcast, 'on_body': self.on_body,
            'marker_message': agreed(
                'marker_message', self.direct.message if self.direct else DEFAULT_MESSAGE,
                DEFAULT_MESSAGE, self.in_file)}
        if len(self.hands) > 1:
            parameters |= {f'{hand.hand.side}.hand_file': hand.parameters['hand_file']
                           for hand in self.hands}
        if self.has_robot:
            parameters |= self.robots[0]
        if self.has_source:
            parameters |= source_arguments(self.given)
        topic = self.direct.topic if self.direct else topic_of_markers(self.given)
        return self.node(
            executable, [parameters], file=self.given['parameters'], name=name,
            arguments=programs, on_exit=ended('tracker'),
            remappings=[(markers, topic) for markers in ('markers', '~/markers')])

    def hand_publishers(self):
        """Return robot_state_publisher for each hand, or a line that it is missing."""
        if not self.publishes_links:
            return [LogInfo(msg='robot_state_publisher is not installed: '
                                'the tracker broadcasts every frame itself')]
        return [self.state_publisher(
            'robot_state_publisher', urdf(hand.hand, hand.prefix), hand.namespace,
            joints_of(self.given, hand.namespace, self.in_file)) for hand in self.hands]

    def state_publisher(self, name, description, namespace, remappings, **parameters):
        """Return robot_state_publisher of a URDF, without which the launch ends."""
        return self.node(
            'robot_state_publisher',
            [{'robot_description': description, **parameters,
              'publish_frequency': number(self.given, 'publish_frequency')}],
            package='robot_state_publisher', namespace=namespace, remappings=remappings,
            on_exit=ended(name))

    def source(self):
        """Return the node of another system, where the tracker's process does not serve it."""
        if self.given['source'] not in SYSTEMS or self.direct or self.has_source:
            return []
        return [self.node(
            'source', [{'side': self.hands[0].hand.side, **source_arguments(self.given)}],
            file=self.given['parameters'], name=SOURCE_NAME,
            remappings=[('~/markers', topic_of_markers(self.given))], on_exit=ended('source'))]

    def replay(self):
        """Return the replay of a recording, where that is the source."""
        if self.given['source'] != 'recording':
            return []
        recording = self.given['recording'] or str(packaged_recording(
            BOTH if len(self.hands) > 1 else self.hands[0].hand.side))
        # The launch ends with the tracker, so nothing is waited for in vain.
        return [self.node(
            'replay',
            [{'recording': recording, 'layout': self.hand_parameters['layout'],
              'exclude_topics': PUBLISHED_HERE, 'rate': number(self.given, 'rate'),
              'loop': self.given['loop'] == 'true', 'wait_for_subscriber': inf}],
            remappings=[('markers', self.given['markers'])], on_exit=ended('replay'))]

    def mounts(self):
        """Return a mount for each hand that hangs on a body."""
        return [self.node(
            'mount',
            [{name: hand.parameters[name] for name in MOUNT_TAKES} | self.wrist_frame()
             | ({'body_frame': frame} if frame else {})
             | ({'mount_file': f'my_{hand.namespace}_mount.yaml'} if hand.namespace else {})],
            file=file, name='mount', namespace=hand.namespace, on_exit=ended('mount'))
            for hand, (frame, file) in zip(self.hands, self.hand_mounts) if frame or file]

    def wrist_frame(self):
        """Return the parameter of nodes that look up the wrist: its frame by the file."""
        return {'wrist_frame': self.in_file.get('wrist_frame', AUTO)}

    def skins(self):
        """Return the skin of each hand; without its libraries it says so, and all else goes on."""
        if not is_on(self.given, 'skin'):
            return []
        return [self.node(
            'skin',
            [{name: hand.parameters[name] for name in SKIN_TAKES} | self.wrist_frame()],
            namespace=hand.namespace,
            remappings=joints_of(self.given, hand.namespace, self.in_file))
            for hand in self.hands]

    def retargets(self):
        """Return the drivers of robots; one that is not of the hand's side refuses by name."""
        if self.has_robot:
            return []
        return [self.node('retarget', [robot], namespace=hand.namespace,
                          remappings=joints_of(self.given, hand.namespace, self.in_file))
                for robot, hand in zip(self.robots, self.hands) if robot['robot']]

    def robots_beside(self):
        """Return the nodes that broadcast the frames of each shown robot beside its hand."""
        if self.should_show_robots and not self.shows_robots:
            return [LogInfo(msg='robot_state_publisher or tf2_ros is not installed: '
                                'robots are not shown')]
        actions = []
        for hand, robot in self.shown_robots():
            description, missing, place, root = robot_beside(hand, robot)
            name = f'{hand.prefix}robot'
            positions = full_name(self.given, '/'.join(
                filter(None, (hand.namespace, 'robot/shown'))))
            if missing:
                actions.append(LogInfo(msg=f'{name}: RViz will not show what of the URDF is not '
                                           f"found: {', '.join(missing)}"))
            actions += [
                self.state_publisher(
                    'robot_state_publisher of the robot', description, name,
                    [('joint_states', positions)], frame_prefix=f'{name}/'),
                self.node(
                    'static_transform_publisher', [], package='tf2_ros', namespace=name,
                    name='static_transform_publisher',  # else a random one, unknown to a policy
                    arguments=[
                        *(word for pair in zip(PLACE_OPTIONS, map(str, place)) for word in pair),
                        '--frame-id', f'{hand.prefix}wrist', '--child-frame-id', f'{name}/{root}'],
                    on_exit=ended('static_transform_publisher of the robot'))]
        return actions

    def shown_robots(self):
        """Return each hand with the robot that is to be shown beside it."""
        if not self.shows_robots:
            return []
        return [(hand, robot) for hand, robot in zip(self.hands, self.robots) if robot['robot']]

    def rviz(self):
        """Return RViz where it is asked for, which follows the first hand."""
        if self.given['rviz'] != 'true':
            return []
        first = self.hands[0]
        robots_of = [hand for hand, _ in self.shown_robots()]
        return [self.node('rviz2', [], package='rviz2', arguments=[
            '-d', str(rviz_config(first.prefix, first.namespace, len(self.hands), robots_of)),
            '-f', self.given['fixed_frame']])]


def is_on(given, name):
    """Return whether something is shown: by its argument, or with RViz when that is auto."""
    return given[name] == 'true' or given[name] == 'auto' and given['rviz'] == 'true'


def takes_packets_in_tracker(given):
    """Return whether the tracker's process is a system's client; refuse it where it cannot."""
    alone = [f'{name}:=true' for name in ('lifecycle', 'use_security') if given[name] == 'true']
    if given['source_process'] == 'tracker' and alone:
        raise RuntimeError(f"source_process: 'tracker'; expected own with {alone[0]}")
    return given['source'] in SERVED and given['source_process'] != 'own' and not alone


def drives_robot_in_tracker(given, hands, robots):
    """Return whether the tracker's process drives the robot too; refuse it where it cannot."""
    shared = given['robot_process'] == 'tracker' and any(robot['robot'] for robot in robots)
    for alone, what, why in (
            (given['lifecycle'] == 'true', 'lifecycle:=true', 'that process is not managed'),
            (len(hands) > 1, 'side:=both', 'it drives one robot')):
        if shared and alone:
            raise RuntimeError(f"robot_process: 'tracker'; expected own with {what}: {why}")
    return shared


def source_arguments(given):
    """Return the parameters of the source node that arguments set."""
    return {name: given[name] for name in ('source', 'topic', 'message', 'server', 'subject')
            if given[name]}


def direct_source(given):
    """Return how the tracker takes the messages of a source itself; None with a source node."""
    if given['source'] not in SYSTEMS or given['markers'] != 'markers':
        return None
    in_file = {}
    if given['parameters']:
        with suppress(HandTrackerError):  # there is nothing for the source node in it
            in_file = node_parameters(given['parameters'], full_name(given, SOURCE_NAME))
    return direct_input({**in_file, **source_arguments(given)})


def topic_of_markers(given):
    """Return the topic of the tracker's markers; drivers of mocap4r2 have their own /markers."""
    if given['source'] in SYSTEMS and given['markers'] == 'markers':
        return f'{SOURCE_NAME}/markers'
    return given['markers']


class LaunchedHand(NamedTuple):
    """A hand of the launch: prefix of its names, namespace of what is its alone, parameters."""

    hand: Hand
    prefix: str
    namespace: str
    parameters: dict


def hands_of(given, in_file, parameters):
    """Return each hand that is tracked, the right one of both first."""
    if parameters['side'] != BOTH:
        for name, instead in (('left_hand', 'hand is the hand file'),
                              ('left_robot', 'robot is the robot'),
                              ('left_body_frame', 'body_frame is the frame'),
                              ('left_mount', 'mount is the file'),
                              ('left_robot_description', "robot_description is the robot's")):
            if given[name]:
                raise RuntimeError(f"{name}: '{given[name]}'; expected none but for side:=both: "
                                   f'{instead}')
        hand, _ = starting_hand({**START_DEFAULTS, **parameters})
        prefix = parameters['prefix']
        return [LaunchedHand(hand, f'{hand.side}_' if prefix == AUTO else prefix, '', parameters)]
    for name, one_hand in (('source', given['source'] == 'landmarks'),
                           ('subject', bool(given['subject']))):
        if one_hand:
            raise RuntimeError(f"{name}: '{given[name]}'; expected another or none for "
                               'side:=both: it is of one hand')
    files = {f'{side}.hand_file': agreed(
        f'{side}.hand_file', given['left_hand'] if side == 'left' else '', '', in_file)
        for side in SIDES}
    own = {row.name: row.default for side in SIDES for row in start_of_hand(side)}
    hands = []
    for side in SIDES:
        values = values_of_hand({**START_DEFAULTS, **own, **parameters, **files}, side)
        hand, _ = starting_hand(values)
        hands.append(LaunchedHand(hand, f'{side}_', side, values))
    return hands


def mounts_of(given, hands):
    """Return of each hand the body's frame that it hangs on, and the file of its offset."""
    mounts = []
    for hand in hands:
        which = 'left_' if hand.namespace == 'left' else ''
        mounts.append((given[f'{which}body_frame'], given[f'{which}mount']))
    if any(map(any, mounts)) and not all(map(any, mounts)):
        raise RuntimeError('body_frame, mount, left_body_frame, left_mount: of one hand alone; '
                           'expected that both hang on a body, or neither')
    return mounts


def robot_parameters(given, in_file, hand, on_body):
    """Return the parameters of the node by which a hand drives its robot."""
    robot, description = given['robot'], given['robot_description']
    if hand.namespace == 'left':
        # A robot file has the URDF of either side; a URDF is of one.
        robot, description = given['left_robot'] or robot, given['left_robot_description']
    return {**{name: hand.parameters[name] for name in ROBOT_TAKES}, 'side': hand.hand.side,
            'wrist_frame': in_file.get('wrist_frame', AUTO), 'on_body': on_body,
            'robot': robot, 'robot_description': description}


def robot_beside(hand, robot):
    """Return a robot's URDF, what it lacks, the pose beside the hand [m], and the root link."""
    try:
        loaded = load_robot(robot['robot'], robot['robot_description'],
                            preferred_side=hand.hand.side)
    except HandTrackerError as error:
        raise RuntimeError(str(error)) from None
    model = loaded.hand.model
    turned, at = loaded.hand.base_pose(model.frames(model.open_position()))
    # On the side of the little finger, which is -y of the right wrist.
    at = at + (0., ROBOT_DISTANCE if hand.hand.side == 'left' else -ROBOT_DISTANCE, 0.)
    description, missing = (
        with_file_addresses(Path(loaded.urdf).read_text(encoding='utf-8'),
                            Path(loaded.urdf).parent) if loaded.urdf
        else with_file_addresses(robot['robot_description'], None))
    return description, missing, (*at.tolist(), *quaternion(turned)), next(iter(model.links))


def joints_of(given, namespace, in_file):
    """Return the remappings by which a node of one of both hands finds its joint states."""
    if not namespace or in_file.get('joint_state_topics') == SEPARATE:
        return []
    return [(name, full_name(given, name)) for name in ('joint_states', 'joint_confidence')]


def full_name(given, name):
    """Return the name of a node or topic with the namespace before it."""
    return '/'.join(('', *filter(None, given['namespace'].split('/')), name))


def check_names():
    """Refuse arguments of the command line that there are none of: launch drops them."""
    words = sys.argv[1:]
    # Included by another file, what was given is that file's.
    if 'hand_tracker' not in words and Path(__file__).resolve() not in [
            Path(word).resolve() for word in words]:
        return
    known = [argument.name for argument in ARGUMENTS]
    given = [word.partition(':=')[0] for word in words if ':=' in word]
    for name in filter(str.isidentifier, given):
        if name not in known:
            alike = get_close_matches(name, known, 1)
            raise RuntimeError(f"there is no argument '{name}'"
                               + (f", did you mean '{alike[0]}'?" if alike else '')
                               + f'; expected are {", ".join(known)}')


def file_parameters(given):
    """Return the tracker's parameters in the parameter file."""
    if not given['parameters']:
        return {}
    try:
        return node_parameters(given['parameters'], full_name(given, TRACKER_NAME))
    except HandTrackerError as error:
        raise RuntimeError(f'parameters: {error}') from None


def shared_parameters(given, in_file):
    """Return the parameters of the tracker that the URDF depends on."""
    values = {}
    for name, argument in ARGUMENT_OF.items():
        default = START_DEFAULTS[name]
        value = given[argument] if argument else default
        if argument == 'prefix' and value == NONE:
            value = ''
        values[name] = agreed(name, value, default, in_file)
    return values


def agreed(name, value, default, in_file):
    """Return a value from the parameter file, where its argument was left at the default."""
    if name not in in_file:
        return value
    if not isinstance(in_file[name], type(default)):
        raise RuntimeError(f'parameters: {name}: {in_file[name]!r}; expected a value like '
                           f'{default!r}')
    if value not in (default, in_file[name]):
        raise RuntimeError(f'parameters: {name}: {in_file[name]!r}, but by the argument '
                           f'{ARGUMENT_OF.get(name, name)} it is {value!r}; leave out one of them')
    return in_file[name]


def check_frames(in_file, broadcast, root):
    """Refuse a parameter file by which the tree of TF would fall apart."""
    if in_file.get('broadcast', broadcast) != broadcast:
        raise RuntimeError(
            f"parameters: broadcast: '{in_file['broadcast']}'; here it is '{broadcast}', as "
            f"robot_state_publisher is {'' if broadcast == 'wrist' else 'not '}installed")
    wrist = in_file.get('wrist_frame', AUTO)
    if broadcast == 'wrist' and wrist not in (AUTO, root):
        raise RuntimeError(
            f"parameters: wrist_frame: '{wrist}'; for robot_state_publisher it is '{root}'")


def rviz_config(prefix, namespace, n_hands=1, with_robots=()):
    """Return RViz's configuration, which follows the first hand and sees all that is shown."""
    path = Path(get_package_share_directory('hand_tracker')) / 'config' / 'hand_tracker.rviz'
    packaged = path.read_text(encoding='utf-8')
    config = packaged.replace(FOLLOWED.format('right_'), FOLLOWED.format(prefix))
    if namespace:
        for topic in SHOWN_TOPICS:
            config = config.replace(f'Value: {topic}\n', f'Value: {namespace}/{topic}\n')
    for hand in with_robots:
        side, own = hand.hand.side, f'{hand.prefix}robot'
        config = config.replace(SHOWN_ROBOT.format(side, 'false'), SHOWN_ROBOT.format(side, 'true'))
        config = config.replace(f'TF Prefix: {side}_robot', f'TF Prefix: {own}')
        config = config.replace(f'Value: {side}_robot/', f'Value: {own}/')
    distance = ONE_HAND + SECOND_HAND * (n_hands - 1) + ROBOTS_BESIDE * bool(with_robots)
    config = config.replace(VIEW_DISTANCE.format(ONE_HAND), VIEW_DISTANCE.format(distance))
    if config != packaged:
        folder = tempfile.mkdtemp(prefix='hand_tracker_')
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        path = Path(folder, path.name)
        path.write_text(config, encoding='utf-8')
    return path


def number(given, name):
    """Return the value of an argument that is a number."""
    try:
        return float(given[name])
    except ValueError:
        raise ValueError(f"{name}: '{given[name]}'; expected a number") from None


def ended(name):
    """Return the handler that ends the launch with a node, with its error if it had one."""
    def end(event, context):
        if event.returncode and not context.is_shutdown:
            raise RuntimeError(f'the {name} ended with exit code {event.returncode}')
        return Shutdown(reason=f'the {name} ended')
    return end


def texts_kept(parameters):
    """Return parameters whose texts launch does not read as YAML: '' is no null."""
    return {name: ParameterValue(value, value_type=str) if isinstance(value, str) else value
            for name, value in parameters.items()}


def installed(package):
    """Return whether a package is installed."""
    try:
        get_package_share_directory(package)
    except PackageNotFoundError:
        return False
    return True


def generate_launch_description():
    """Return the description that `ros2 launch` runs."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=start)])
