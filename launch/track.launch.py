"""Track a hand: replay or live driver, tracker, robot_state_publisher and, if asked, RViz."""

import atexit
import shutil
import sys
import tempfile
from difflib import get_close_matches
from math import inf
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, Shutdown
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.files.parameter_file import node_parameters
from hand_tracker.files.urdf_file import urdf
from hand_tracker.nodes.tracker_parameters import AUTO, START, starting_hand
from hand_tracker.package_data import packaged_recording
from launch import LaunchDescription

ARGUMENTS = (
    DeclareLaunchArgument(
        'source', default_value='recording', choices=['recording', 'live'],
        description='Where markers come from: a recording that is replayed, or a live driver'),
    DeclareLaunchArgument(
        'recording', default_value='',
        description='rosbag2 recording to replay (.mcap, .db3 or folder), but for what the nodes '
                    'here publish; empty: the packaged one of the side'),
    DeclareLaunchArgument(
        'rate', default_value='1.0', description='Speed of the replay'),
    DeclareLaunchArgument(
        'loop', default_value='true', choices=['true', 'false'],
        description='Replay for ever; with false all ends after the recording'),
    DeclareLaunchArgument(
        'markers', default_value='markers', description='Topic of the MarkerArrays'),
    DeclareLaunchArgument(
        'hand', default_value='', description='Hand file (YAML); empty: the mean hand'),
    DeclareLaunchArgument(
        'side', default_value='auto', choices=['auto', 'right', 'left'],
        description="Side of the hand; auto: the hand file's, else right"),
    DeclareLaunchArgument(
        'limits', default_value='auto', choices=['auto', 'paper', 'wide'],
        description="Joint limits: Table 1 of the paper, or wider ranges of motion; "
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
        'fixed_frame', default_value='mocap', description='Fixed frame of RViz'),
    DeclareLaunchArgument(
        'use_sim_time', default_value='false', choices=['true', 'false'],
        description='Follow /clock'),
)

NONE = 'none'  # as `ros2 launch` takes no empty value
START_DEFAULTS = {row.name: row.default for row in START}
TRACKER_NAME = 'hand_tracker'
# Parameters of the tracker that the URDF depends on, and the arguments that set them too.
ARGUMENT_OF = {
    'hand_file': 'hand', 'side': 'side', 'limits.preset': 'limits', 'coupling.preset': 'coupling',
    'thumb': 'thumb', 'prefix': 'prefix', 'hand_length': None, 'hand_breadth': None}
SKIN_TAKES = 'hand_file', 'side', 'hand_length', 'hand_breadth', 'thumb', 'prefix'
FOLLOWED = 'Target Frame: {}middle_knuckle'  # by RViz's view: amid the hand, still in the palm
# A recording may hold these from an earlier run; two publishers of a frame fight.
PUBLISHED_HERE = ('tf tf_static joint_states joint_confidence hand_markers hand_skin '
                  'robot_description diagnostics')


def start(context):
    """Return the nodes for the arguments given."""
    given = context.launch_configurations
    check_names()
    if given['rviz'] == 'true' and not installed('rviz2'):
        # Found out later, nodes that have been started are left behind.
        raise RuntimeError('rviz: rviz2 is not installed')
    publishes_links = installed('robot_state_publisher')
    in_file = file_parameters(given)
    hand_parameters = shared_parameters(given, in_file)
    hand, _ = starting_hand({**START_DEFAULTS, **hand_parameters})
    prefix = hand_parameters['prefix']
    if prefix == AUTO:
        prefix = f'{hand.side}_'
    broadcast = 'wrist' if publishes_links else 'all'
    check_frames(in_file, broadcast, f'{prefix}wrist')
    common = {'use_sim_time': agreed(
        'use_sim_time', given['use_sim_time'] == 'true', False, in_file)}

    def node(executable, parameters, package='hand_tracker', files=(), **more):
        return Node(
            package=package, executable=executable, namespace=given['namespace'],
            parameters=[*files, common, *map(texts_kept, parameters)], output='screen', **more)

    actions = [node(
        'tracker', [{**hand_parameters, 'broadcast': broadcast}], name=TRACKER_NAME,
        files=[given['parameters']] if given['parameters'] else [],
        remappings=[('markers', given['markers'])], on_exit=ended('tracker'))]
    if publishes_links:
        actions.append(node(
            'robot_state_publisher',
            [{'robot_description': urdf(hand, prefix),
              'publish_frequency': number(given, 'publish_frequency')}],
            package='robot_state_publisher', on_exit=ended('robot_state_publisher')))
    else:
        actions.append(LogInfo(msg='robot_state_publisher is not installed: '
                                   'the tracker broadcasts every frame itself'))
    if given['source'] == 'recording':
        # The launch ends with the tracker, so nothing is waited for in vain.
        actions.append(node(
            'replay',
            [{'recording': given['recording'] or str(packaged_recording(hand.side)),
              'exclude_topics': PUBLISHED_HERE, 'rate': number(given, 'rate'),
              'loop': given['loop'] == 'true', 'wait_for_subscriber': inf}],
            remappings=[('markers', given['markers'])],
            on_exit=ended('replay')))
    if given['skin'] == 'true' or given['skin'] == 'auto' and given['rviz'] == 'true':
        # Without its libraries it says so and ends, and all else goes on.
        actions.append(node('skin', [{
            **{name: hand_parameters[name] for name in SKIN_TAKES},
            'wrist_frame': in_file.get('wrist_frame', AUTO)}]))
    if given['rviz'] == 'true':
        actions.append(node(
            'rviz2', [], package='rviz2',
            arguments=['-d', str(rviz_config(prefix)), '-f', given['fixed_frame']]))
    return actions


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
    """Return what the parameter file sets for the tracker."""
    if not given['parameters']:
        return {}
    parts = [part for part in given['namespace'].split('/') if part]
    try:
        return node_parameters(given['parameters'], '/'.join(('', *parts, TRACKER_NAME)))
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


def rviz_config(prefix):
    """Return RViz's configuration, which follows the hand: for other frame names a copy."""
    path = Path(get_package_share_directory('hand_tracker')) / 'config' / 'hand_tracker.rviz'
    packaged = path.read_text(encoding='utf-8')
    config = packaged.replace(FOLLOWED.format('right_'), FOLLOWED.format(prefix))
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
    """Return what ends the launch when a node has ended, with an error when it had one."""
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
