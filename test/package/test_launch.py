"""The launch file as a user starts it, and RViz's configuration."""

import json
import os
import random
import re
import signal
import sys
import time
from contextlib import ExitStack
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from helpers.hands import hand_at
from helpers.launching import DEMO_RATE, FIRST_START, LACK, LAUNCH, installed, named

from benchmarks.repository import REPOSITORY
from hand_tracker.calibration.landmarks import LANDMARKS
from hand_tracker.core.model.hand import (
    COUPLING_PRESETS,
    DIGITS,
    JOINTS,
    LEFT_HAND_MIRROR,
    LIMIT_PRESETS,
    LINKS,
    SIDES,
    Hand,
    preset_limits,
)
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from hand_tracker.files.bags import bag_message, joint_state_message, open_bag, write_bag
from hand_tracker.files.hand_file import save_hand
from hand_tracker.files.urdf_file import urdf
from hand_tracker.messages.landmark_kinds import OPENXR
from hand_tracker.package_data import packaged_recording
from hand_tracker.retargeting.robot_file import load_robot

RVIZ = REPOSITORY / 'config' / 'hand_tracker.rviz'
RECORDING = REPOSITORY / 'recordings' / 'demo.mcap'
FEW = 40  # frames

CHOICES = {
    'source': ['recording', 'markers', 'live', 'point_cloud', 'mocap4r2', 'natnet', 'qualisys',
               'landmarks'],
    'loop': ['true', 'false'],
    'side': ['auto', *SIDES, 'both'],
    'limits': ['auto', *LIMIT_PRESETS],
    'coupling': ['auto', *COUPLING_PRESETS],
    'thumb': ['saddle', 'index_mcp'],
    'rviz': ['true', 'false'],
    'skin': ['auto', 'true', 'false'],
    'robot_process': ['own', 'tracker'],
    'source_process': ['auto', 'own', 'tracker'],
    'show_robot': ['auto', 'true', 'false'],
    'use_sim_time': ['true', 'false'],
    'respawn': ['auto', 'true', 'false'],
    'lifecycle': ['true', 'false'],
    'use_security': ['true', 'false'],
}
FREE = {'recording', 'rate', 'markers', 'hand', 'layout', 'prefix', 'namespace', 'parameters',
        'publish_frequency', 'fixed_frame', 'robot', 'robot_description', 'topic', 'message',
        'server', 'subject', 'up', 'latency', 'left_hand', 'left_robot',
        'left_robot_description', 'keystore', 'body_frame', 'mount', 'left_body_frame',
        'left_mount', 'outputs'}

# Those that RViz of humble (11.2.27), jazzy (14.1.22) and lyrical (15.2.4) share, from
# plugins_description.xml in the releases of rviz_default_plugins, github.com/ros2-gbp/rviz-release;
# Group and the panels are built into rviz_common (display_factory.cpp, panel_factory.cpp).
DISPLAYS = {f'rviz_default_plugins/{name}' for name in (
    'AccelStamped', 'Axes', 'Camera', 'DepthCloud', 'Effort', 'FluidPressure', 'Grid',
    'GridCells', 'Illuminance', 'Image', 'InteractiveMarkers', 'LaserScan', 'Map', 'Marker',
    'MarkerArray', 'Odometry', 'Path', 'PointCloud', 'PointCloud2', 'PointStamped', 'Polygon',
    'Pose', 'PoseArray', 'PoseWithCovariance', 'Range', 'RelativeHumidity', 'RobotModel', 'TF',
    'Temperature', 'TwistStamped', 'Wrench')} | {
    'rviz_common/Group'}
TOOLS = {f'rviz_default_plugins/{name}' for name in (
    'FocusCamera', 'Interact', 'Measure', 'MoveCamera', 'PublishPoint', 'Select', 'SetGoal',
    'SetInitialPose')}
VIEWS = {f'rviz_default_plugins/{name}' for name in (
    'FPS', 'FrameAligned', 'Orbit', 'ThirdPersonFollower', 'TopDownOrtho', 'XYOrbit')}
# Properties of the classes in use, from the same releases: RViz ignores others without a word.
TOPIC = {'Value', 'Depth', 'Durability Policy', 'Reliability Policy'}
PROPERTIES = {
    'rviz_common/Group': {'Displays'},
    'rviz_default_plugins/Grid': {'Cell Size', 'Plane Cell Count', 'Color', 'Alpha'},
    'rviz_default_plugins/Marker': {'Topic'},
    'rviz_default_plugins/MarkerArray': {'Topic'},
    'rviz_default_plugins/Orbit': {'Distance', 'Focal Point', 'Pitch', 'Yaw', 'Target Frame'},
    'rviz_default_plugins/RobotModel': {'Description Source', 'Description Topic',
                                        'TF Prefix', 'Visual Enabled', 'Collision Enabled'},
    'rviz_default_plugins/TF': {'Marker Scale', 'Show Arrows', 'Show Names'},
}
PANELS = {f'rviz_common/{name}' for name in (
    'Displays', 'Help', 'Selection', 'Time', 'Tool Properties', 'Transformation', 'Views')}

# Says what it was given, and waits for its end. As nodes do it takes a moment to end: launch, about
# to signal a process that has just ended, may take its exit code for 255.
FAKE_PROGRAM = """#!{python}
import json, os, signal, sys, time, yaml
signal.signal(signal.SIGINT, lambda *_: (time.sleep(1.), os._exit(0)))
given = {{}}
for option, file in zip(sys.argv, sys.argv[1:]):
    if option == '--params-file':
        for node in yaml.safe_load(open(file)).values():
            given.update(node['ros__parameters'])
print('GIVEN ' + json.dumps(
    {{'arguments': sys.argv[1:], 'process': os.getpid(), **given}}), flush=True)
signal.pause()
"""


launches = pytest.mark.skipif(LACK is not None, reason=f'{LACK}')

if LACK is None:
    from geometry_msgs.msg import Point, Pose, PoseArray
    from helpers.natnet_server import NatNetServer
    from helpers.qtm_server import QtmServer, data_packet
    from helpers.ros_process import Process, watching_node
    from launch.launch_description_sources import get_launch_description_from_python_launch_file
    from launch.launch_description_sources.python_launch_file_utilities import (
        load_python_launch_file_as_module,
    )
    from rcl_interfaces.srv import GetParameters
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import JointState, PointCloud2, PointField
    from std_msgs.msg import Bool
    from tf2_msgs.msg import TFMessage
    from visualization_msgs.msg import Marker, MarkerArray

    STARTED = {'tracker', 'replay'}
    if installed('robot_state_publisher'):
        STARTED.add('robot_state_publisher')
    LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    class Launch(Process):
        """`ros2 launch` in a process group of its own, which interrupts its nodes itself."""

        def __init__(self, environment=None, file=LAUNCH, **arguments):
            # In a terminal Ctrl-C interrupts each node once. Interrupted by both the group and
            # launch, robot_state_publisher often ends with -2.
            super().__init__(
                ['ros2', 'launch', '--noninteractive', str(file),
                 *(f'{name}:={value}' for name, value in arguments.items())],
                environment, start_new_session=True)

        def __exit__(self, *error):
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            super().__exit__(*error)


@pytest.fixture
def watch():
    with watching_node() as node:
        yield node


def half_second(recording, folder):
    """Write the first half second of a recording; return its file."""
    path = folder / 'short.mcap'
    with open_bag(recording) as bag:
        write_bag(path, islice(bag.messages(['/markers']), round(DEMO_RATE / 2)))
    return path


@pytest.fixture(scope='module')
def short(tmp_path_factory):
    return half_second(RECORDING, tmp_path_factory.mktemp('recording'))


def stamps(headers):
    """Return the stamps of headers [ns]."""
    return np.array([header.stamp.sec * 10**9 + header.stamp.nanosec for header in headers])


def marker_stamps(messages):
    return stamps(message.markers[0].header for message in messages)


def joint_stamps(messages):
    return stamps(message.header for message in messages)


def frames(messages):
    """Return the names of all frames that were broadcast."""
    return {transform.child_frame_id for message in messages for transform in message.transforms}


def between(stamps, seen):
    """Return the stamps that are not before the first or after the last of others."""
    return stamps[(seen[0] <= stamps) & (stamps <= seen[-1])]


def check_rate(tracked):
    """Check that stamps are those of frames at the rate; a busy machine may leave some out."""
    steps = np.diff(tracked) * 1e-9 * DEMO_RATE
    assert (np.rint(steps) > 0).all()
    assert np.abs(steps - np.rint(steps)).max() < .02


def check_clean(process, code, *started):
    """Check that all nodes were started and ended without an error."""
    assert code == 0, process.output
    assert 'Traceback' not in process.output and 'process has died' not in process.output
    for name in started:
        assert re.search(rf'\[{name}-\d\]: process has finished cleanly', process.output)
    assert process.output.count('process started') == len(started)


@launches
def test_arguments_are_described():
    arguments = get_launch_description_from_python_launch_file(str(LAUNCH)).get_launch_arguments()
    assert {argument.name for argument in arguments} == FREE | CHOICES.keys()
    for argument in arguments:
        assert argument.choices == CHOICES.get(argument.name), argument.name
        assert argument.default_value is not None, argument.name
        assert argument.description not in ('', 'no description given'), argument.name


@launches
def test_tracks_the_packaged_recording(watch):
    markers = watch.collect(MarkerArray, 'markers')
    states = watch.collect(JointState, 'joint_states')
    transforms = watch.collect(TFMessage, '/tf')
    static = watch.collect(TFMessage, '/tf_static', LATCHED)
    with Launch() as process:
        watch.spin_until(lambda: states, FIRST_START)
        # From then on, all that is published is heard; robot_state_publisher may come later.
        watch.spin_until(lambda: markers and static and frames(transforms) >= {
            'right_wrist', *named('right_', LINKS)}, FIRST_START)
        states.clear()
        watch.spin_until(lambda: len(states) > FEW and len(
            between(joint_stamps(states), marker_stamps(markers))) > FEW, FIRST_START)
        check_clean(process, process.interrupt(), *STARTED)
    seen, tracked = marker_stamps(markers), joint_stamps(states)
    assert all(list(state.name) == named('right_', JOINTS) for state in states)
    assert all(len(state.position) == len(JOINTS) for state in states)
    assert (np.diff(tracked) > 0).all()
    check_rate(tracked)
    # The markers of the last few may be on their way.
    assert np.isin(between(tracked, seen), seen).all()
    wrist = [transform for message in transforms for transform in message.transforms
             if transform.child_frame_id == 'right_wrist']
    assert {transform.header.frame_id for transform in wrist} == {'mocap'}
    assert np.isin(between(stamps(each.header for each in wrist), seen), seen).all()
    assert frames(static) >= {f'right_{digit}_tip' for digit in DIGITS}


@launches
def test_a_left_hand_in_a_namespace_loops(watch, tmp_path):
    # A right hand would be left out.
    left = half_second(packaged_recording('left'), tmp_path)
    states = watch.collect(JointState, 'second/joint_states')
    with Launch(recording=left, side='left', namespace='second') as process:
        watch.spin_until(lambda: len(states) > FEW and np.ptp(joint_stamps(states)) > 1e9,
                         FIRST_START)
        check_clean(process, process.interrupt(), *STARTED)
    assert all(list(state.name) == named('left_', JOINTS) for state in states)
    check_rate(joint_stamps(states))


@launches
@pytest.mark.parametrize('arguments, said', [
    ({'parameters': 'absent.yaml'}, 'parameters: absent.yaml: No such file'),
    ({'parameters': RVIZ}, 'hand_tracker.rviz: for no node; expected'),
    ({'parameters': __file__}, 'test_launch.py:1:3: no YAML; expected YAML'),
    ({'sied': 'left'}, "there is no argument 'sied', did you mean 'side'?; expected are source"),
    ({'loops': 'true', 'side': 'left'}, "there is no argument 'loops', did you mean 'loop'?"),
    ({'labels': 'none'}, "there is no argument 'labels', but a parameter of the tracker"),
    ({'robot': 'absent'}, "robot: 'absent' is no file and no preset; presets are"),
    ({'robot': 'allegro'}, "no urdf: give the path of the robot's URDF")])
def test_what_would_be_left_out_silently_is_refused(arguments, said):
    with Launch(**arguments) as process:
        assert process.wait() == 1
        assert said in process.output
        assert 'process started' not in process.output


@launches
def test_another_file_that_includes_this_one_has_arguments_of_its_own(short, tmp_path):
    (tmp_path / 'mine.launch.py').write_text(f'''
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('arm'),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource({str(LAUNCH)!r}),
            launch_arguments=[('recording', {str(short)!r}), ('loop', 'false')])])
''')
    with Launch(file=tmp_path / 'mine.launch.py', arm='left') as process:
        check_clean(process, process.wait(FIRST_START), *STARTED)
        assert 'Played to the end' in process.output


@launches
def test_both_hands_in_one_tracker(watch):
    states = watch.collect(JointState, 'joint_states')
    transforms = watch.collect(TFMessage, '/tf')
    with Launch(side='both') as process:
        watch.spin_until(lambda: len(states) > FEW and frames(transforms) >= {
            *named('right_', LINKS), *named('left_', LINKS), 'right_wrist', 'left_wrist'},
            FIRST_START)
        assert process.interrupt() == 0
        assert '/demo_both.mcap' in process.output and 'Traceback' not in process.output
        assert process.output.count('process started') == len(STARTED) + (
            'robot_state_publisher' in STARTED)
    assert all(list(state.name) == named('right_', JOINTS) + named('left_', JOINTS)
               for state in states)


@launches
def test_ends_with_the_recording(short):
    with Launch(recording=short, loop='false', rate='2') as process:
        check_clean(process, process.wait(FIRST_START), *STARTED)
        assert 'Played to the end' in process.output


@launches
def test_a_left_hand_has_a_recording_of_its_own(watch, tmp_path):
    save_hand(tmp_path / 'hand.yaml', Hand.scaled(side='left'), MarkerLayout())
    states = watch.collect(JointState, 'joint_states')
    with Launch(hand=tmp_path / 'hand.yaml') as process:
        watch.spin_until(lambda: len(states) > FEW, FIRST_START)
        check_clean(process, process.interrupt(), *STARTED)
        assert '/demo_left.mcap' in process.output
        assert 'off the hand' not in process.output
    assert list(states[0].name) == named('left_', JOINTS)


@launches
@pytest.mark.parametrize(('namespace', 'node'), [
    ('', '/**'), ('', 'hand_tracker'), ('/second', '/second/hand_tracker')])
def test_the_urdf_has_the_hand_of_the_parameter_file(watch, tmp_path, namespace, node):
    worn = Hand.scaled(.2, .095, limits=.5 * preset_limits('wide'))
    save_hand(tmp_path / 'worn.yaml', worn, MarkerLayout())
    given = {'hand_file': str(tmp_path / 'worn.yaml'), 'side': 'left', 'thumb': 'index_mcp',
             'prefix': 'my_', 'limits.preset': 'wide', 'coupling.preset': 'paper',
             'broadcast': 'wrist', 'stale': 'hold'}
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump({
        '/**': {'ros__parameters': {'thumb': 'saddle'}}, node: {'ros__parameters': given}},
        sort_keys=False))
    with Launch(fake_package(tmp_path, 'robot_state_publisher'), source='live', side='left',
                parameters=tmp_path / 'mine.yaml',
                **{'namespace': namespace} if namespace else {}) as process:
        process.wait_for_line('GIVEN')
        values = watch.call(
            GetParameters, f'{namespace}/hand_tracker/get_parameters',
            GetParameters.Request(names=list(given))).values
        check_clean(process, process.interrupt(), 'tracker', 'robot_state_publisher')
    assert dict(zip(given, (value.string_value for value in values))) == given
    expected = Hand.scaled(.2, .095, side='left', limits=preset_limits('wide')).with_paper_thumb()
    described = json.loads(re.search('GIVEN (.*)', process.output)[1])['robot_description']
    assert canonical(described) == canonical(urdf(expected, 'my_'))


@launches
@pytest.mark.parametrize(('text', 'arguments', 'said'), [
    ('hand_tracker: {ros__parameters: {side: left}}', {'namespace': 'second'},
     "mine.yaml: for hand_tracker; expected '/**' or '/second/hand_tracker'"),
    ('{/**: {ros__parameters: {thumb: saddle}}, hand_tracker: {ros__parameters: {side: left}}}',
     {'namespace': '/second'}, 'of which none names the node /second/hand_tracker'),
    ('/**: {ros__parameters: {side: left}}', {'side': 'right'},
     "parameters: side: 'left', but by the argument side it is 'right'; leave out one"),
    ('/**: {ros__parameters: {hand_file: mine}}', {'hand': 'other.yaml'},
     "hand_file: 'mine', but by the argument hand it is 'other.yaml'"),
    ('/**: {ros__parameters: {use_sim_time: false}}', {'use_sim_time': 'true'},
     'use_sim_time: False, but by the argument use_sim_time it is True'),
    ('/**: {ros__parameters: {prefix: 5}}', {}, "prefix: 5; expected a value like 'auto'"),
    ('/**: {ros__parameters: {broadcast: none}}', {}, "broadcast: 'none'; here it is")])
def test_what_of_the_parameter_file_would_not_count_is_refused(tmp_path, text, arguments, said):
    (tmp_path / 'mine.yaml').write_text(text)
    with Launch(parameters=tmp_path / 'mine.yaml', **arguments) as process:
        assert process.wait() == 1
        assert said in process.output
        assert 'process started' not in process.output


@launches
def test_what_an_earlier_run_recorded_is_not_replayed(watch, tmp_path):
    def earlier_run():
        for message in messages:
            yield message
            stamp = message.time
            yield bag_message('/joint_states', stamp, joint_state_message(
                stamp, named('right_', JOINTS), np.full(len(JOINTS), 9.)))
            yield message._replace(topic='/hand_markers')

    with open_bag(RECORDING) as bag:
        messages = list(islice(bag.messages(['/markers']), round(DEMO_RATE / 2)))
    write_bag(tmp_path / 'run.mcap', earlier_run())
    states = watch.collect(JointState, 'joint_states')
    with Launch(recording=tmp_path / 'run.mcap') as process:
        watch.spin_until(lambda: len(states) > FEW, FIRST_START)
        check_clean(process, process.interrupt(), *STARTED)
        assert process.output.count('Not played') == 1
    assert (np.array([state.position for state in states]) < 9.).all()


@launches
def test_live_markers(watch):
    with open_bag(RECORDING) as bag:
        data = next(iter(bag.messages(['/markers']))).data
    states = watch.collect(JointState, 'joint_states')
    publisher = watch.create_publisher(MarkerArray, 'vicon/markers', 10)
    with Launch(source='live', markers='vicon/markers', prefix='none') as process:
        process.wait_for_line('listening for markers on /vicon/markers', FIRST_START)
        watch.create_timer(.01, lambda: publisher.publish(bytes(data)))
        watch.spin_until(lambda: len(states) > 20)
        check_clean(process, process.interrupt(), *STARTED - {'replay'})
    assert list(states[0].name) == list(JOINTS)


class System:
    """What each system of the README sends, of a hand that rests."""

    def __init__(self, watch, stack):
        from mocap4r2_msgs import msg as mocap
        from teleop_ros2_interfaces.msg import NamedPoseArray
        self._mocap, self._named = mocap, NamedPoseArray
        self._watch, self._stack, self._number = watch, stack, 0
        self._places = hand_at()

    def sender(self, given):
        """Return what sends a frame for the arguments of a row, and the port of the server."""
        name = given.get('message', given['source'])
        if name in ('natnet', 'qualisys'):
            server = self._stack.enter_context(
                NatNetServer((4, 1), {'RHand': MARKERS}) if name == 'natnet' else
                QtmServer(MARKERS))
            return getattr(self, f'_send_{name}'), server
        topic = given.get('topic') or given['markers']
        kind = {'mocap4r2': self._mocap.Markers, 'rigid_bodies': self._mocap.RigidBodies,
                'landmarks': PoseArray, 'named_pose_array': self._named,
                'markers': MarkerArray}[name]
        publisher = self._watch.create_publisher(kind, topic, 10)

        def send(_):
            message = getattr(self, f'_{name}')()
            header = message.markers[0].header if name == 'markers' else message.header
            header.stamp, header.frame_id = self._watch.get_clock().now().to_msg(), 'mocap'
            publisher.publish(message)

        return send, None

    def _send_natnet(self, server):
        if server.is_connected:
            server.send_frame({'RHand': self._places}, time.monotonic())

    def _send_qualisys(self, server):
        self._number += 1
        server.send(data_packet(self._number, 10_000 * self._number, {'3d': 1e3 * self._places}))

    def _points(self):
        return [Point(**dict(zip('xyz', map(float, at)))) for at in self._places]

    def _mocap4r2(self):
        kind = self._mocap.Marker
        return self._mocap.Markers(markers=[
            kind(id_type=kind.USE_NAME, marker_name=name, translation=at)
            for name, at in zip(MARKERS, self._points())])

    def _rigid_bodies(self):
        return self._mocap.RigidBodies(rigidbodies=[
            self._mocap.RigidBody(rigid_body_name='RHand', markers=self._mocap4r2().markers)])

    def _markers(self):
        return MarkerArray(markers=[Marker(ns='leds', id=20 + row, type=Marker.SPHERE,
                                           pose=Pose(position=at))
                                    for row, at in enumerate(self._points())])

    def _landmarks(self):
        places = dict(zip(PAPER_PLACES, self._points()))
        missing = Point(x=np.nan, y=np.nan, z=np.nan)
        return PoseArray(poses=[Pose(position=places.get(name, missing)) for name in LANDMARKS])

    def _named_pose_array(self):
        places = dict(zip(PAPER_PLACES, self._points()))
        names = {landmark: name for name, landmark in OPENXR.items()}
        return self._named(name=[f'right_{names[place]}' for place in places],
                           pose=[Pose(position=at) for at in places.values()],
                           is_valid=[True] * len(places))


def rows_of_the_readme():
    """Return the arguments of each live system in the README, one text a row."""
    text = (REPOSITORY / 'README.md').read_text(encoding='utf-8')
    found = []
    for cell in re.findall(r'\| (`source:=[^|]*) \|$', text, re.MULTILINE):
        first, *others = re.findall('`([^`]+)`', cell)
        found.append(first)
        # Of several messages of one system only the message is named again.
        found += [f'{first.split()[0]} {other}' for other in others]
    return found


def test_the_readme_has_a_row_for_every_system():
    rows = rows_of_the_readme()
    assert len(rows) == 7
    assert {row.split()[0] for row in rows} == {
        'source:=natnet', 'source:=qualisys', 'source:=mocap4r2', 'source:=markers',
        'source:=landmarks'}


@launches
@pytest.mark.parametrize('row', [
    *rows_of_the_readme(), 'source:=natnet server:=ADDRESS source_process:=own',
    'source:=qualisys server:=ADDRESS markers:=/lab/markers'])
def test_the_launch_commands_of_the_readme_track_the_hand(watch, tmp_path, row):
    for needed in ('mocap4r2_msgs', 'teleop_ros2_interfaces', 'qtm_rt'):
        pytest.importorskip(needed, reason=f'needs {needed}')
    given = dict(word.split(':=') for word in row.split())
    states = watch.collect(JointState, 'joint_states')
    with ExitStack() as stack:
        send, server = System(watch, stack).sender(
            {'topic': '/xr_teleop/hand', **given} if 'named_pose_array' in row else given)
        parameters = {'hand_tracker': {'auto_size': False}}
        if server is not None:
            given['server'], parameters['source'] = '127.0.0.1', {'port': server.port}
        if given['source'] == 'markers':
            parameters['hand_tracker'].update(
                {f'labels.{name}': str(20 + number) for number, name in enumerate(MARKERS)})
        given['parameters'] = tmp_path / 'MINE.yaml'
        given['parameters'].write_text(yaml.safe_dump(
            {node: {'ros__parameters': values} for node, values in parameters.items()}))
        process = stack.enter_context(Launch(**given))
        process.wait_for_line('listening for markers on', FIRST_START)
        watch.create_timer(.01, lambda: send(server))
        watch.spin_until(lambda: len(states) > 20)
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output
    assert np.isfinite(states[-1].position).all() and len(states[-1].name) == 25


@launches
def test_the_hand_hangs_on_a_body(watch, tmp_path):
    resting, moving = watch.collect(TFMessage, '/tf_static', LATCHED), watch.collect(
        TFMessage, '/tf')
    mount = tmp_path / 'my_mount.yaml'
    mount.write_text('/**: {ros__parameters: {body_frame: forearm, x: 0.25}}')
    with Launch(mount=mount, body_frame='lower_arm') as process:
        process.wait_for_line('right_wrist rests in lower_arm, at the offset given', FIRST_START)
        watch.spin_until(lambda: 'right_wrist_tracked' in frames(moving)
                         and 'right_wrist' in frames(resting), FIRST_START)
        placed, = (one for message in resting for one in message.transforms
                   if one.child_frame_id == 'right_wrist')
        check_clean(process, process.interrupt(), *STARTED, 'mount')
    assert (placed.header.frame_id, placed.transform.translation.x) == ('lower_arm', .25)
    assert 'right_wrist' not in frames(moving)


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
@pytest.mark.parametrize('robot_process', ['own', 'tracker'])
def test_a_robot_follows_the_wrist_as_it_is_called_on_a_body(watch, tmp_path, robot_process):
    given = tmp_path / 'mine.yaml'
    given.write_text('hand_tracker: {ros__parameters: {wrist_frame: right_wrist}}')
    with Launch(body_frame='lower_arm', robot='plain', robot_process=robot_process,
                parameters=given) as process:
        process.wait_for_line('not engaged; listening for the right hand', FIRST_START)
        for node in 'hand_tracker', 'retarget':
            told = watch.call(GetParameters, f'{node}/get_parameters', GetParameters.Request(
                names=['wrist_frame', 'on_body']))
            frame, on_body = told.values
            assert (frame.string_value, on_body.bool_value) == ('right_wrist', True)
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output


@launches
def test_both_hands_hang_on_a_body(watch):
    resting, moving = watch.collect(TFMessage, '/tf_static', LATCHED), watch.collect(
        TFMessage, '/tf')
    with Launch(side='both', body_frame='right_arm', left_body_frame='left_arm') as process:
        for side in SIDES:
            process.wait_for_line(f'{side}_wrist rests in {side}_arm', FIRST_START)
        watch.spin_until(lambda: {f'{side}_wrist_tracked' for side in SIDES} <= frames(moving)
                         and {f'{side}_wrist' for side in SIDES} <= frames(resting), FIRST_START)
        parents = {one.child_frame_id: one.header.frame_id
                   for message in resting for one in message.transforms}
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output
    assert [parents[f'{side}_wrist'] for side in SIDES] == [f'{side}_arm' for side in SIDES]


@launches
@pytest.mark.parametrize('arguments, topic, more', [
    ({}, 'landmarks', set()), ({'topic': '/hand', 'namespace': 'second'}, '/hand', set()),
    ({'markers': 'mine'}, 'landmarks', {'source'}),
    ({'parameters': 'z_up.yaml'}, 'landmarks', set()),
    ({'parameters': 'y_up.yaml'}, '/mine', {'source'})],
    ids=['alone', 'elsewhere', 'handed on', 'nothing for the source', 'turned'])
def test_landmarks_go_to_the_tracker_unless_they_are_changed(
        watch, tmp_path, arguments, topic, more):
    (tmp_path / 'z_up.yaml').write_text('hand_tracker: {ros__parameters: {auto_size: false}}')
    (tmp_path / 'y_up.yaml').write_text(
        'hand_tracker: {ros__parameters: {auto_size: false}}\n'
        'source: {ros__parameters: {up: "y", topic: /mine}}')
    if 'parameters' in arguments:
        arguments = {'parameters': tmp_path / arguments['parameters']}
    places = dict(zip(PAPER_PLACES, hand_at()))
    array = PoseArray(poses=[Pose(position=Point(**dict(zip('xyz', map(float, places.get(
        name, (np.nan,) * 3)))))) for name in LANDMARKS])
    states = watch.collect(JointState, f"{arguments.get('namespace', '')}/joint_states".lstrip('/'))
    publisher = watch.create_publisher(PoseArray, topic, 10)

    def publish():
        array.header.stamp = watch.get_clock().now().to_msg()
        publisher.publish(array)

    with Launch(source='landmarks', **arguments) as process:
        process.wait_for_line('listening for markers on', FIRST_START)
        watch.create_timer(.01, publish)
        watch.spin_until(lambda: len(states) > 20)
        check_clean(process, process.interrupt(), *STARTED - {'replay'}, *more)


@launches
def test_both_hands_are_found_in_a_cloud_of_points(watch, tmp_path):
    (tmp_path / 'points.yaml').write_text(
        "hand_tracker: {ros__parameters: {labels: 'none', auto_size: false}}")
    right = hand_at()
    points = np.concatenate([right, right * LEFT_HAND_MIRROR - (0., .4, 0.)]).astype('<f4')
    message = PointCloud2(
        height=1, width=len(points), point_step=12, row_step=12 * len(points),
        fields=[PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
                for i, name in enumerate('xyz')], data=points.tobytes())
    message.header.frame_id = 'mocap'
    states = watch.collect(JointState, 'joint_states')
    publisher = watch.create_publisher(PointCloud2, '/points', 10)

    def publish():
        message.header.stamp = watch.get_clock().now().to_msg()
        publisher.publish(message)

    with Launch(side='both', source='point_cloud', topic='/points',
                parameters=tmp_path / 'points.yaml') as process:
        process.wait_for_line('listening for markers on', FIRST_START)
        watch.create_timer(.01, publish)
        watch.spin_until(lambda: any(
            list(state.name) == named('right_', JOINTS) + named('left_', JOINTS)
            for state in states), FIRST_START)
        assert process.interrupt() == 0
        assert 'Traceback' not in process.output


@launches
@pytest.mark.skipif(find_spec('skimage') is None, reason='scikit-image is not installed')
def test_skin_is_published(watch, short):
    skins = watch.collect(Marker, 'hand_skin', 1)
    with Launch(recording=short, skin='true') as process:
        watch.spin_until(lambda: skins, FIRST_START)
        check_clean(process, process.interrupt(), *STARTED, 'skin')
    assert (skins[0].ns, skins[0].header.frame_id) == ('right_skin', 'right_wrist')


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
@pytest.mark.parametrize('robot_process', ['own', 'tracker'])
def test_a_robot_waits_to_be_engaged(robot_process, watch, short, tmp_path):
    started = (STARTED | {'retarget'} if robot_process == 'own'
               else STARTED - {'tracker'} | {'teleoperate'})
    (tmp_path / 'robot.urdf').write_text(urdf(Hand.scaled(limits=preset_limits('wide'))))
    with Launch(recording=short, robot=tmp_path / 'robot.urdf',
                robot_process=robot_process) as process:
        process.wait_for_line('not engaged; listening for the right hand', FIRST_START)
        process.wait_for_line('[hand_tracker]', FIRST_START)
        assert '[retarget]' in process.output
        check_clean(process, process.interrupt(), *started)


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
def test_each_of_both_hands_drives_a_robot_of_its_own(watch):
    commands = {side: watch.collect(JointState, f'{side}/robot/command') for side in SIDES}
    with Launch(side='both', robot='plain') as process:
        for side in SIDES:
            process.wait_for_line(f'not engaged; listening for the {side} hand on /joint_states',
                                  FIRST_START)
        engage = watch.create_publisher(Bool, 'left/retarget/engage', 10)
        robot = watch.create_publisher(JointState, 'left/robot/joint_states', 10)
        joints = load_robot('plain', preferred_side='left').order

        def move_the_left_one():
            robot.publish(JointState(name=joints, position=[0.] * len(joints)))
            engage.publish(Bool(data=True))

        watch.repeat(move_the_left_one, lambda: len(commands['left']) > FEW)
        assert not commands['right']
        assert process.interrupt() == 0 and 'Traceback' not in process.output


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
def test_each_robot_takes_its_section_of_the_parameter_file_and_its_remappings(watch, tmp_path):
    (tmp_path / 'mine.yaml').write_text('''
/*/retarget: {ros__parameters: {safety.max_speed: 2.0}}
/left/retarget: {ros__parameters: {outputs: position_array}}
''')
    (tmp_path / 'mine.launch.py').write_text(f'''
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import SetRemap


def generate_launch_description():
    return LaunchDescription([GroupAction([
        SetRemap('/left/robot/position_array', '/hand_positions/commands'),
        IncludeLaunchDescription(PythonLaunchDescriptionSource({str(LAUNCH)!r}))])])
''')
    with Launch(file=tmp_path / 'mine.launch.py', source='live', side='both', robot='plain',
                parameters=tmp_path / 'mine.yaml') as process:
        for side, outputs in (('right', 'joint_state'), ('left', 'position_array')):
            process.wait_for_line(f'not engaged; listening for the {side} hand', FIRST_START)
            speed, told = watch.call(
                GetParameters, f'{side}/retarget/get_parameters', GetParameters.Request(
                    names=['safety.max_speed', 'outputs'])).values
            assert (speed.double_value, told.string_value) == (2., outputs)
        watch.spin_until(lambda: watch.count_publishers('/hand_positions/commands')
                         and watch.count_publishers('/right/robot/command'))
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
def test_a_robot_is_held_when_the_tracker_is_killed(watch):
    commands = watch.collect(JointState, 'robot/command')
    joints = load_robot('plain').order
    with Launch(robot='plain') as process:
        process.wait_for_line('not engaged; listening for the right hand', FIRST_START)
        process.wait_for_line('listening for markers', FIRST_START)
        engage = watch.create_publisher(Bool, 'retarget/engage', 10)
        robot = watch.create_publisher(JointState, 'robot/joint_states', 10)

        def be_there():
            robot.publish(JointState(name=joints, position=[0.] * len(joints)))

        def engage_it():
            be_there()
            engage.publish(Bool(data=True))

        watch.repeat(engage_it, lambda: len(commands) > FEW)
        tracker = re.search(r'\[tracker-\d+\]: process started with pid \[(\d+)\]', process.output)
        lost, listening = 'disengaged: the hand was lost', 'listening for markers'
        times = process.output.count(lost)
        os.kill(int(tracker[1]), signal.SIGKILL)
        watch.repeat(be_there, lambda: process.output.count(lost) > times
                     and process.output.count(listening) > 1)
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
def test_the_example_of_ros2_control_takes_the_arguments_of_the_launch_file(watch, tmp_path):
    save_hand(tmp_path / 'mine.yaml', Hand.scaled(.17), MarkerLayout())
    (tmp_path / 'parameters.yaml').write_text(
        '/**/retarget: {ros__parameters: {safety.max_speed: 2.0}}')
    environment = {}
    for package, programs in (('robot_state_publisher', [None]),
                              ('controller_manager', ['ros2_control_node', 'spawner']),
                              ('joint_state_broadcaster', [None])):
        for program in programs:
            environment = fake_package(tmp_path, package, program)
    with Launch(environment, file=LAUNCH.with_name('plain_hand_control.launch.py'),
                hand=tmp_path / 'mine.yaml', prefix='none', namespace='mine', side='left',
                parameters=tmp_path / 'parameters.yaml') as process:
        process.wait_for_line('not engaged; listening for the left hand', FIRST_START)
        assert process.output.count('listening for the left hand') == 1
        values = watch.call(GetParameters, 'mine/retarget/get_parameters', GetParameters.Request(
            names=['hand_file', 'prefix', 'outputs', 'robot', 'safety.max_speed'])).values
        assert [value.string_value for value in values[:-1]] == [
            str(tmp_path / 'mine.yaml'), '', 'position_array', 'plain']
        assert values[-1].double_value == 2.
        watch.spin_until(lambda: watch.count_publishers('/mine/robot/hand_positions/commands')
                         and watch.count_subscribers('/mine/robot/joint_states'))
        assert "'/mine/robot/controller_manager'" in process.output.replace('"', "'")
        process.interrupt()
        assert 'Traceback' not in process.output, process.output


@launches
@pytest.mark.parametrize('name', ['robot', 'robot_description', 'outputs'])
def test_the_example_of_ros2_control_drives_the_plain_hand_alone(name, tmp_path):
    for package in 'robot_state_publisher', 'controller_manager', 'joint_state_broadcaster':
        environment = fake_package(tmp_path, package)
    with Launch(environment, file=LAUNCH.with_name('plain_hand_control.launch.py'),
                **{name: 'another'}) as process:
        assert process.wait() == 1
        assert f"{name}: 'another'; expected none" in process.output
        assert 'process started' not in process.output


@launches
@pytest.mark.skipif(not installed('controller_manager'), reason='no ros2_control')
@pytest.mark.parametrize('controller', ['hand_positions', 'hand_trajectory'])
def test_controllers_move_the_robot_and_hold_it_when_the_tracker_is_killed(watch, controller):
    states = watch.collect(JointState, 'robot/joint_states')
    with Launch(file=LAUNCH.with_name('plain_hand_control.launch.py'),
                controller=controller) as process:
        process.wait_for_line(f'Configured and activated {controller}', FIRST_START)
        process.wait_for_line('[hand_tracker]', FIRST_START)
        engage = watch.create_publisher(Bool, 'retarget/engage', 10)
        watch.repeat(lambda: engage.publish(Bool(data=True)),
                     lambda: states and np.ptp(states[-1].position) > .5)
        tracker = re.search(r'\[tracker-\d\]: process started with pid \[(\d+)\]', process.output)
        lost, listening = 'disengaged: the hand was lost', 'listening for markers'
        times = process.output.count(lost)
        os.kill(int(tracker[1]), signal.SIGKILL)
        watch.spin_until(lambda: process.output.count(lost) > times
                         and process.output.count(listening) > 1, FIRST_START)
        # Once it stands, for states that have come meanwhile.
        since = len(states)
        watch.spin_until(lambda: len(states) >= since + FEW and not np.ptp(
            [state.position for state in states[-FEW:]], axis=0).any())
        held, before = states[-1].position, len(states)
        watch.spin_until(lambda: len(states) > before + 10 * FEW)
        assert all(np.isfinite(state.position).all() for state in states)
        np.testing.assert_array_equal(states[-1].position, held)
        process.interrupt()


@launches
def test_the_example_with_ros2_control_refuses_unknown_arguments():
    with Launch(file=LAUNCH.with_name('plain_hand_control.launch.py'),
                contoller='hand_trajectory') as process:
        assert process.wait() == 1
        assert "there is no argument 'contoller', did you mean 'controller'?" in process.output
        assert 'process started' not in process.output


@launches
@pytest.mark.skipif(installed('controller_manager'), reason='ros2_control is installed')
def test_without_ros2_control_nothing_is_started():
    with Launch(file=LAUNCH.with_name('plain_hand_control.launch.py')) as process:
        assert process.wait() == 1
        assert 'ros2_control, ros2_controllers' in process.output
        assert 'process started' not in process.output


@launches
def test_all_else_goes_on_without_the_libraries_of_the_skin(watch, short, tmp_path):
    # Only a hand without a skin in the cache needs the libraries.
    save_hand(tmp_path / 'new.yaml', Hand.scaled(random.uniform(.15, .2)), MarkerLayout())
    (tmp_path / 'skimage.py').write_text('raise ImportError')
    path = os.pathsep.join((str(tmp_path), os.environ.get('PYTHONPATH', '')))
    states = watch.collect(JointState, 'joint_states')
    with Launch({'PYTHONPATH': path}, recording=short, skin='true',
                hand=tmp_path / 'new.yaml') as process:
        process.wait_for_line('process has died', FIRST_START)
        before = len(states)
        watch.spin_until(lambda: len(states) > before + FEW, FIRST_START)
        assert process.interrupt() == 0, process.output
    assert process.output.count('making the skin of a hand needs scikit-image') == 1
    assert 'Traceback' not in process.output


@launches
def test_robot_state_publisher_is_used_where_installed(watch, short, tmp_path):
    transforms = watch.collect(TFMessage, '/tf')
    with Launch(fake_package(tmp_path, 'robot_state_publisher'), recording=short,
                publish_frequency='480.0', limits='wide') as process:
        process.wait_for_line('GIVEN')
        watch.spin_until(lambda: len(transforms) > 20, FIRST_START)
        check_clean(process, process.interrupt(),
                    'tracker', 'robot_state_publisher', 'replay')
        assert 'not installed' not in process.output
        given = json.loads(re.search('GIVEN (.*)', process.output)[1])
    assert frames(transforms) == {'right_wrist'}
    assert given['publish_frequency'] == 480.
    expected = urdf(Hand.scaled().replace(limits=preset_limits('wide')), 'right_')
    assert canonical(given['robot_description']) == canonical(expected)


@launches
def test_ends_with_robot_state_publisher(tmp_path, short):
    with Launch(fake_package(tmp_path, 'robot_state_publisher'), recording=short) as process:
        process.wait_for_line('GIVEN')
        os.kill(json.loads(re.search('GIVEN (.*)', process.output)[1])['process'], signal.SIGKILL)
        assert process.wait() == 1
        assert 'the robot_state_publisher ended with exit code -9' in process.output


@launches
def test_ends_with_the_driver_of_a_robot():
    with Launch(robot='plain') as process:
        process.wait_for_line('not engaged; listening for the right hand', FIRST_START)
        driver = re.search(r'\[retarget-\d+\]: process started with pid \[(\d+)\]', process.output)
        os.kill(int(driver[1]), signal.SIGKILL)
        assert process.wait() == 1
        assert 'the retarget ended with exit code -9' in process.output


@launches
@pytest.mark.parametrize('given, prefix', [('auto', 'right_'), ('none', ''), ('my_', 'my_')])
def test_the_view_of_rviz_follows_the_hand(watch, short, tmp_path, given, prefix):
    transforms = watch.collect(TFMessage, '/tf')
    (tmp_path / 'temporary').mkdir()
    environment = {**fake_package(tmp_path, 'rviz2'), 'TMPDIR': str(tmp_path / 'temporary')}
    with Launch(environment, recording=short, rviz='true', skin='false',
                fixed_frame='world', prefix=given) as process:
        process.wait_for_line('GIVEN')
        watch.spin_until(lambda: f'{prefix}middle_knuckle' in frames(transforms), FIRST_START)
        options = json.loads(re.search('GIVEN (.*)', process.output)[1])['arguments']
        config = Path(options[options.index('-d') + 1])
        configured = yaml.safe_load(config.read_text())
        check_clean(process, process.interrupt(), *STARTED, 'rviz2')
    assert options[options.index('-f') + 1] == 'world'
    expected = yaml.safe_load(RVIZ.read_text())
    view(expected)['Target Frame'] = f'{prefix}middle_knuckle'
    assert configured == expected
    assert not list((tmp_path / 'temporary').glob('hand_tracker_*'))


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
@pytest.mark.parametrize('side, prefix', [('right', 'auto'), ('left', 'my_')])
def test_a_robot_is_shown_beside_the_hand(short, tmp_path, side, prefix):
    for name, program in (('rviz2', None), ('robot_state_publisher', None),
                          ('tf2_ros', 'static_transform_publisher')):
        environment = fake_package(tmp_path, name, program)
    with Launch(environment, recording=short, side=side, prefix=prefix, rviz='true', skin='false',
                robot='plain') as process:
        process.wait_for_line('not engaged; listening for', FIRST_START)
        # RViz, the hand's, the robot's, and the transform between them.
        watched = time.monotonic() + FIRST_START
        while process.output.count('GIVEN') < 4 and time.monotonic() < watched:
            time.sleep(.1)
        assert process.output.count('GIVEN') == 4, process.output
        given = [json.loads(found) for found in re.findall('GIVEN (.*)', process.output)]
        config = next(one['arguments'] for one in given if '-d' in one['arguments'])
        shown = yaml.safe_load(Path(config[config.index('-d') + 1]).read_text())
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output
    # The robot is in the view, which one hand alone fills.
    assert view(shown)['Distance'] > 1.5 * view(yaml.safe_load(RVIZ.read_text()))['Distance']
    own = f"{f'{side}_' if prefix == 'auto' else prefix}robot"
    robot, = (one for one in given if 'frame_prefix' in one)
    assert robot['frame_prefix'] == f'{own}/'
    assert robot['robot_description'] == Path(load_robot('plain', preferred_side=side).urdf
                                              ).read_text()
    assert 'joint_states:=/robot/shown' in robot['arguments']
    place, = (one['arguments'] for one in given if '--child-frame-id' in one['arguments'])
    numbers = {key: float(value) for key, value in zip(place, place[1:]) if key in (
        '--x', '--y', '--z')}
    assert np.sign(numbers['--y']) == (-1. if side == 'right' else 1.)
    assert .1 < np.linalg.norm(list(numbers.values())) < .4
    assert place[place.index('--frame-id') + 1] == own.replace('robot', 'wrist')
    assert place[place.index('--child-frame-id') + 1].startswith(f'{own}/')
    displays = {one['Name']: one for one in shown['Visualization Manager']['Displays']}
    display = displays.pop(f'Robot of the {side} hand')
    assert display['Enabled'] and display['TF Prefix'] == own
    assert display['Description Topic']['Value'] == f'{own}/robot_description'
    assert not any(one['Enabled'] for name, one in displays.items() if name.startswith('Robot of'))


@launches
@pytest.mark.skipif(find_spec('trajectory_msgs') is None, reason='no trajectory_msgs')
def test_rviz_is_told_where_the_meshes_of_a_robot_are(short, tmp_path):
    for name, program in (('robot_state_publisher', None),
                          ('tf2_ros', 'static_transform_publisher')):
        environment = fake_package(tmp_path, name, program)
    mesh = tmp_path / 'my_robot' / 'meshes' / 'palm.stl'
    for folder in (mesh.parent, mesh.parents[1] / 'urdf'):
        folder.mkdir(parents=True)
    mesh.touch()
    plain = Path(load_robot('plain').urdf).read_text()
    links = ''.join(
        f'<link name="link{i}"><visual><geometry><mesh filename="{name}"/></geometry></visual>'
        f'</link><joint name="joint{i}" type="fixed"><parent link="palm"/><child link="link{i}"/>'
        '</joint>' for i, name in enumerate(('../meshes/palm.stl', 'lost.stl',
                                             'package://my_robot/meshes/palm.stl', 'lost.stl')))
    robot = mesh.parents[1] / 'urdf' / 'robot.urdf'
    robot.write_text(plain.replace('</robot>', f'{links}</robot>'))
    with Launch(environment, recording=short, robot=robot, show_robot='true') as process:
        process.wait_for_line('right_robot: RViz will not show what of the URDF is not found',
                              FIRST_START)
        watched = time.monotonic() + FIRST_START
        while process.output.count('GIVEN') < 3 and time.monotonic() < watched:
            time.sleep(.1)
        # Interrupted as it imports, a node would end with a traceback.
        process.wait_for_line('not engaged; listening for', FIRST_START)
        given = [json.loads(found) for found in re.findall('GIVEN (.*)', process.output)]
        assert process.interrupt() == 0 and 'Traceback' not in process.output, process.output
    shown, = (one['robot_description'] for one in given if 'frame_prefix' in one)
    files = [found.get('filename') for found in ElementTree.fromstring(shown).iter('mesh')]
    assert files == [mesh.as_uri(), 'lost.stl', mesh.as_uri(), 'lost.stl']
    assert re.findall('not found: (.*)', process.output) == ['lost.stl']


@launches
@pytest.mark.parametrize('lacking', ['', 'robot_state_publisher', 'tf2_ros'])
def test_robots_are_published_to_be_shown_only_where_something_can_show_them(lacking):
    file = load_python_launch_file_as_module(str(LAUNCH))
    given = {row.name: row.default for row in file.ARGUMENTS}
    plan = file.LaunchPlan({**given, 'side': 'both', 'left_robot': 'plain', 'rviz': 'true'},
                           lambda package: package != lacking)
    assert {robot['show_robot'] for robot in plan.robots} == {not lacking}
    assert [hand.hand.side for hand, _ in plan.shown_robots] == ['left'] * (not lacking)
    assert len(file.robots_beside(plan)) == (1 if lacking else 2)


def view(config):
    """Return the view of a configuration of RViz."""
    return config['Visualization Manager']['Views']['Current']


def fake_package(folder, name, program=None):
    """Install a package whose program says what it was given; return the environment."""
    index = folder / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True, exist_ok=True)
    (index / name).touch()
    program = folder / 'lib' / name / (program or name)
    program.parent.mkdir(parents=True, exist_ok=True)
    program.write_text(FAKE_PROGRAM.format(python=sys.executable))
    program.chmod(0o755)
    return {'AMENT_PREFIX_PATH': f"{folder}{os.pathsep}{os.environ['AMENT_PREFIX_PATH']}"}


def canonical(xml):
    return ElementTree.canonicalize(xml, strip_text=True)


@launches
@pytest.mark.parametrize(('arguments', 'line'), [
    ({'hand': '/nowhere/hand.yaml'}, 'hand_file: /nowhere/hand.yaml: No such file'),
    ({'recording': '/nowhere/bag'}, '/nowhere/bag: no such file or folder'),
    ({'rate': 'fast'}, "rate: 'fast'; expected a number"),
    ({'side': 'upper'}, '"upper" is not valid'),
    ({'left_hand': 'mine.yaml'}, "left_hand: 'mine.yaml'; expected none but for side:=both"),
    ({'side': 'both', 'prefix': 'my_'}, "prefix: 'my_'; expected auto for both hands"),
    ({'side': 'both', 'source': 'landmarks'}, "source: 'landmarks'; expected another or none for"),
    ({'side': 'both', 'source': 'natnet', 'subject': 'RHand'}, "subject: 'RHand'; expected"),
    ({'robot': 'plain', 'robot_process': 'tracker', 'lifecycle': 'true'},
     "robot_process: 'tracker'; expected own with lifecycle:=true"),
    ({'source': 'natnet', 'source_process': 'tracker', 'lifecycle': 'true'},
     "source_process: 'tracker'; expected own with lifecycle:=true"),
    ({'side': 'both', 'robot': 'plain', 'robot_process': 'tracker'},
     "robot_process: 'tracker'; expected own with side:=both"),
    ({'side': 'both', 'body_frame': 'arm'}, 'expected that both hang on a body, or neither'),
    ({'left_mount': 'm.yaml'}, "left_mount: 'm.yaml'; expected none but for side:=both"),
    ({'left_robot': 'plain'}, "left_robot: 'plain'; expected none but for side:=both"),
])
def test_errors_of_the_user(arguments, line):
    with Launch(**arguments) as process:
        assert process.wait() == 1
        assert line in process.output
        assert 'Traceback' not in process.output


@launches
@pytest.mark.skipif(installed('rviz2'), reason='rviz2 is installed')
def test_rviz_is_not_installed():
    with Launch(rviz='true') as process:
        assert process.wait() == 1
        assert 'rviz: rviz2 is not installed' in process.output
        assert 'process started' not in process.output


def test_rviz_configuration():
    config = yaml.safe_load(RVIZ.read_text())
    manager = config['Visualization Manager']

    def classes(entries):
        return {entry['Class'] for entry in entries}

    groups = [entry for entry in manager['Displays'] if entry['Class'] == 'rviz_common/Group']
    displays = manager['Displays'] + [shown for group in groups for shown in group['Displays']]
    assert classes(displays) <= DISPLAYS
    assert classes(manager['Tools']) <= TOOLS
    assert classes([view(config)]) <= VIEWS
    assert view(config)['Target Frame'] in named('right_', LINKS)
    assert set(view(config)['Focal Point'].values()) == {0.}
    assert classes(config['Panels']) <= PANELS
    for entry in (*displays, view(config)):
        assert set(entry) - {'Class', 'Name', 'Enabled'} <= PROPERTIES[entry['Class']]
        for key in {'Topic', 'Description Topic'} & set(entry):
            assert set(entry[key]) <= TOPIC
    topics = [[(shown['Class'], shown[key]['Value']) for shown in group['Displays']
               for key in ('Topic', 'Description Topic') if key in shown] for group in groups]
    kinds = {f'rviz_default_plugins/{kind}': topic for kind, topic in (
        ('RobotModel', 'robot_description'), ('MarkerArray', 'hand_markers'),
        ('Marker', 'hand_skin'))}
    assert topics == [[(kind, namespace + topic) for kind, topic in kinds.items()]
                      for namespace in ('', 'left/')]
    robots = [(shown['Name'], shown['TF Prefix'], shown['Description Topic']['Value'])
              for shown in displays if 'TF Prefix' in shown]
    assert robots == [(f'Robot of the {side} hand', f'{side}_robot',
                       f'{side}_robot/robot_description') for side in SIDES]


def test_topics_of_the_rviz_configuration_are_published():
    sources = '\n'.join(path.read_text() for path in
                        (REPOSITORY / 'hand_tracker/nodes').glob('*.py'))
    published = dict((topic, kind) for kind, topic in re.findall(
        r"create_publisher\(\s*(\w+), f?'(?:\{[\w.]+\})?(\w+)'", sources))
    assert published['hand_markers'] == 'MarkerArray'
    assert published['hand_skin'] == 'Marker'
