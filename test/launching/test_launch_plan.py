"""What a launch starts by its arguments: the plan, and what of them contradicts."""

import ast

import pytest
from helpers.launching import LAUNCH, LAUNCH_DEFAULTS, plan_of

from benchmarks.repository import REPOSITORY
from hand_tracker.launching.launch_plan import (
    InvalidLaunch,
    names_launch_file,
    refuse_unknown_arguments,
)


def test_a_hand_has_names_of_its_side():
    plan = plan_of(side='left', namespace='second')
    hand, = plan.hands
    assert (hand.prefix, hand.namespace, hand.hand.side) == ('left_', '', 'left')
    assert plan.joint_remappings(hand) == []
    assert plan.full_name('hand_tracker') == '/second/hand_tracker'
    assert plan.tracker_parameters['broadcast'] == 'wrist'
    assert plan_of(is_installed=False).tracker_parameters['broadcast'] == 'all'
    assert plan_of(prefix='none').hands[0].prefix == ''


def test_each_of_both_hands_has_a_namespace_and_a_robot():
    plan = plan_of(side='both', robot='allegro', left_robot='plain', rviz='true')
    assert [(hand.prefix, hand.namespace) for hand in plan.hands] == [
        ('right_', 'right'), ('left_', 'left')]
    assert [(robot['robot'], robot['side']) for robot in plan.robots] == [
        ('allegro', 'right'), ('plain', 'left')]
    assert [hand.namespace for hand, _ in plan.shown_robots] == ['right', 'left']
    assert plan.joint_remappings(plan.hands[1])[0] == ('joint_states', '/joint_states')


@pytest.mark.parametrize('given, topic, direct, has_source', [
    ({}, 'markers', None, False),
    ({'markers': 'mine'}, 'mine', None, False),
    ({'source': 'point_cloud'}, '/pointCloud', 'point_cloud', False),
    ({'source': 'point_cloud', 'markers': 'mine'}, 'mine', None, False),
    ({'source': 'landmarks', 'message': 'named_pose_array', 'side': 'both'}, '/xr_teleop/hand',
     'named_pose_array', False),
    ({'source': 'natnet'}, 'source/markers', None, True),
    ({'source': 'natnet', 'lifecycle': 'true'}, 'source/markers', None, False)])
def test_markers_come_from_where_the_source_sends_them(given, topic, direct, has_source):
    plan = plan_of(**given)
    assert (plan.marker_topic, plan.has_source) == (topic, has_source)
    assert (plan.direct and plan.direct.message) == direct


def test_a_source_knows_the_markers_that_are_worn():
    plan = plan_of(source='mocap4r2', subject='RHand', side='left', layout='kyutech23')
    assert plan.direct is None
    assert plan.own_source_parameters == {
        'source': 'mocap4r2', 'subject': 'RHand', 'side': 'left', 'layout': 'kyutech23',
        'hand_file': ''}
    # Names tell the side of the markers of both.
    assert plan_of(source='natnet', side='both').own_source_parameters['side'] == 'both'


def test_a_source_is_told_its_upward_axis_and_its_latency():
    plan = plan_of(source='qualisys', up='y', latency='0.004')
    assert plan.has_source
    assert {name: plan.tracker_parameters[name] for name in ('up', 'latency')} == {
        'up': '+y', 'latency': .004}
    # Points that are turned need a source node.
    assert plan_of(source='point_cloud', up='z').direct
    assert not plan_of(source='point_cloud', up='y').direct
    for given, fault in (
            ({'source': 'qualisys', 'latency': 'much'}, "latency: 'much'; expected a number"),
            ({'source': 'natnet', 'latency': '0.1'}, 'expected for source:=qualisys only'),
            ({'source': 'natnet', 'up': 'x'}, "up: 'x'; expected z or y"),
            ({'up': 'y'}, 'expected for source:=point_cloud, mocap4r2, natnet, qualisys, ')):
        with pytest.raises(InvalidLaunch, match=fault):
            plan_of(**given)


@pytest.mark.parametrize('source, name, value, expected', [
    ('markers', 'topic', '/phasespace', 'point_cloud, mocap4r2, landmarks only; the topic of '
                                        'MarkerArrays is markers:='),
    ('recording', 'topic', '/leds', 'is markers:='), ('natnet', 'topic', '/leds', 'landmarks only'),
    ('markers', 'server', '10.0.0.5', 'natnet, qualisys only'),
    ('natnet', 'message', 'rigid_bodies', 'point_cloud, mocap4r2, landmarks only'),
    ('recording', 'subject', 'RHand', 'landmarks only'),
    ('markers', 'recording', 'take.mcap', 'source:=recording only')])
def test_an_argument_that_says_nothing_to_the_source_is_refused(source, name, value, expected):
    with pytest.raises(InvalidLaunch, match=f"{name}: '{value}'; .*{expected}"):
        plan_of(source=source, **{name: value})


@pytest.mark.parametrize('namespace, full', [
    ('', '/cell/joint_states'), ('arm', '/cell/arm/joint_states'), ('/arm', '/arm/joint_states')])
def test_a_launch_file_that_includes_this_one_may_push_a_namespace(namespace, full, tmp_path):
    plan = plan_of(side='both', namespace=namespace, ros_namespace='/cell')
    assert plan.joint_remappings(plan.hands[0])[0] == ('joint_states', full)
    file = tmp_path / 'mine.yaml'
    file.write_text('/hand_tracker: {ros__parameters: {smoothing: false}}')
    with pytest.raises(InvalidLaunch, match=full.replace('joint_states', 'hand_tracker')):
        plan_of(namespace=namespace, ros_namespace='/cell', parameters=str(file))


def test_the_parameter_file_counts_where_an_argument_was_left_out(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('/**: {ros__parameters: {side: left, wrist_frame: left_wrist}}')
    plan = plan_of(parameters=str(file))
    assert plan.hands[0].hand.side == 'left'
    assert plan.skin_parameters(plan.hands[0])['wrist_frame'] == 'left_wrist'
    with pytest.raises(InvalidLaunch, match="side: 'left', but by the argument side it is 'right'"):
        plan_of(parameters=str(file), side='right')


def test_a_keystore_that_nothing_uses_is_refused(tmp_path):
    with pytest.raises(InvalidLaunch, match='keystore: .*; expected with use_security:=true'):
        plan_of(keystore=str(tmp_path))


def test_a_mount_that_is_no_file_is_refused(tmp_path):
    for name, given in (('mount', {}), ('left_mount', {'side': 'both', 'body_frame': 'arm'})):
        with pytest.raises(InvalidLaunch, match=f"^{name}: '.*'; expected a parameter file"):
            plan_of(**given, **{name: str(tmp_path / 'none.yaml')})


def test_a_urdf_without_a_robot_is_refused():
    with pytest.raises(InvalidLaunch, match="robot_description: '/x.urdf'; expected with robot:="):
        plan_of(robot_description='/x.urdf')
    with pytest.raises(InvalidLaunch, match="left_robot_description: '/x.urdf'; expected with"):
        plan_of(side='both', left_robot_description='/x.urdf')


def test_the_parameter_file_may_choose_the_robot(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('retarget: {ros__parameters: {robot: plain, show_robot: true, rate: 50.0}}')
    plan = plan_of(parameters=str(file))
    robot, = plan.robots
    assert (robot['robot'], robot['show_robot'], robot['side']) == ('plain', True, 'right')
    assert plan.shown_robots == []
    assert plan_of(parameters=str(file), robot='plain', rviz='true').shown_robots
    assert plan_of(parameters=str(file), robot_process='tracker').has_robot
    file.write_text('retarget: {ros__parameters: {robot: plain, show_robot: false}}')
    assert plan_of(parameters=str(file), rviz='true').shown_robots == []
    with pytest.raises(InvalidLaunch, match="robot: 'plain', but by the argument robot it is 'a'"):
        plan_of(parameters=str(file), robot='a')


@pytest.mark.parametrize('given, respawns', [
    ({}, False), ({'robot': 'plain'}, True), ({'side': 'both', 'robot': 'plain'}, True),
    # What would hold the robot dies with it.
    ({'robot': 'plain', 'robot_process': 'tracker'}, False),
    ({'robot': 'plain', 'respawn': 'false'}, False), ({'respawn': 'true'}, True)])
def test_a_tracker_starts_anew_where_another_process_holds_the_robot(given, respawns):
    assert plan_of(**given).respawns_tracker == respawns


def test_a_robot_of_the_parameter_file_is_held_too(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('retarget: {ros__parameters: {robot: plain}}')
    assert plan_of(parameters=str(file)).respawns_tracker


def test_outputs_are_the_argument_s_else_the_parameter_file_s(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('retarget: {ros__parameters: {outputs: joint_trajectory}}')
    assert 'outputs' not in plan_of(robot='plain').robots[0]
    for given in {'outputs': 'joint_trajectory'}, {'parameters': str(file)}:
        assert plan_of(robot='plain', **given).robots[0]['outputs'] == 'joint_trajectory'
    with pytest.raises(InvalidLaunch, match="by the argument outputs it is 'position_array'"):
        plan_of(robot='plain', parameters=str(file), outputs='position_array')


def test_each_of_both_hands_has_its_section_of_the_parameter_file(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text("""
/**: {ros__parameters: {side: both, hand_file: '', prefix: auto, robot: plain}}
/mine/left/retarget: {ros__parameters: {robot: allegro, robot_description: a.urdf}}
""")
    plan = plan_of(parameters=str(file), namespace='mine')
    assert [(robot['side'], robot['robot'], robot['robot_description']) for robot in plan.robots
            ] == [('right', 'plain', ''), ('left', 'allegro', 'a.urdf')]
    with pytest.raises(InvalidLaunch, match="'allegro', but by the argument left_robot it is 'a'"):
        plan_of(parameters=str(file), namespace='mine', left_robot='a')
    with pytest.raises(InvalidLaunch, match='none names the node /right/retarget or /left/reta'):
        plan_of(parameters=str(file))


@pytest.mark.parametrize('section, given, said', [
    ('hand_file: b.yaml', {}, "hand_file: 'b.yaml' for /retarget; expected '', as the tracker"),
    ('limits.preset: wide', {'limits': 'paper'}, "limits.preset: 'wide' for /retarget; expected "
                                                 "'paper'"),
    ('side: left', {}, "side: 'left' for /retarget; expected 'right'"),
    ('prefix: my_', {'prefix': 'your_'}, "prefix: 'my_' for /retarget; expected 'your_'"),
    ('wrist_frame: arm', {}, "wrist_frame: 'arm' for /retarget; expected 'auto'"),
    ('on_body: false', {'body_frame': 'arm'}, 'on_body: False for /retarget; expected True'),
    ('use_sim_time: true', {}, 'use_sim_time: True for /retarget; expected False'),
    ('robot_description: b.urdf', {'robot_description': 'a.urdf'},
     "robot_description: 'b.urdf', but by the argument robot_description it is 'a.urdf'"),
    ('show_robot: false', {'show_robot': 'true'}, 'show_robot: False, but by the argument show_')])
def test_a_robot_is_driven_by_the_hand_that_is_tracked(tmp_path, section, given, said):
    file = tmp_path / 'mine.yaml'
    file.write_text(f'{{/**: {{ros__parameters: {{stale: hold}}}}, '
                    f'retarget: {{ros__parameters: {{{section}}}}}}}')
    for process in 'own', 'tracker':
        with pytest.raises(InvalidLaunch, match=said):
            plan_of(parameters=str(file), robot='plain', robot_process=process, **given)
    if 'robot_description' not in given:
        plan_of(parameters=str(file), **given)  # retarget is not started


def test_a_parameter_file_for_retarget_alone_asks_for_a_robot(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('retarget: {ros__parameters: {outputs: joint_trajectory}}')
    with pytest.raises(InvalidLaunch, match='there is a retarget node with robot:= alone'):
        plan_of(parameters=str(file))


def test_a_parameter_file_is_for_a_node_that_is_started(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('retarget: {ros__parameters: {outputs: joint_trajectory}}')
    plan_of(parameters=str(file), robot='plain')
    with pytest.raises(InvalidLaunch, match="for retarget; expected '/\\*\\*' or '/hand_tracker'"):
        plan_of(parameters=str(file))
    file.write_text('source: {ros__parameters: {port: 1}}')
    plan_of(parameters=str(file), source='natnet')
    with pytest.raises(InvalidLaunch, match='parameters: .*mine.yaml: for source; expected'):
        plan_of(parameters=str(file))


@pytest.mark.parametrize('given, said', [
    ({'left_robot': 'plain'}, "left_robot: 'plain'; expected none but for side:=both"),
    ({'side': 'both', 'source': 'landmarks'}, "source: 'landmarks'; expected another or none for"),
    ({'side': 'both', 'source': 'landmarks', 'message': 'marker_array'},
     "source: 'landmarks'; expected another or none for"),
    ({'side': 'both', 'body_frame': 'arm'}, 'expected that both hang on a body, or neither'),
    ({'robot': 'plain', 'robot_process': 'tracker', 'side': 'both'},
     "robot_process: 'tracker'; expected own with side:=both: it drives one robot"),
    ({'use_security': 'true'}, 'keystore: '),
    ({'source_process': 'tracker', 'lifecycle': 'true'},
     "source_process: 'tracker'; expected own with lifecycle:=true"),
    ({'parameters': 'absent.yaml'}, 'parameters: absent.yaml: No such file')])
def test_what_contradicts_is_refused(given, said, monkeypatch):
    monkeypatch.delenv('ROS_SECURITY_KEYSTORE', raising=False)
    with pytest.raises(ValueError, match=said):
        plan_of(**given)


def test_a_secured_source_has_a_process_of_its_own(tmp_path):
    (tmp_path / 'enclaves').mkdir()
    given = {'source': 'natnet', 'use_security': 'true', 'keystore': str(tmp_path)}
    assert not plan_of(**given).has_source
    with pytest.raises(InvalidLaunch, match="'tracker'; expected own with use_security:=true"):
        plan_of(source_process='tracker', **given)


def test_defaults_are_those_of_the_launch_file():
    rows = {call.args[0].value: call.args[1].value
            for call in ast.walk(ast.parse(LAUNCH.read_text(encoding='utf-8')))
            if isinstance(call, ast.Call) and getattr(call.func, 'id', '') == 'ArgumentRow'}
    assert {name: rows[name] for name in LAUNCH_DEFAULTS} == LAUNCH_DEFAULTS


def test_a_missing_rviz_is_named():
    with pytest.raises(InvalidLaunch, match='rviz: rviz2 is not installed'):
        plan_of(is_installed=False, rviz='true')


def test_what_is_no_number_is_named():
    with pytest.raises(InvalidLaunch, match="rate: 'fast'; expected a number"):
        plan_of(rate='fast').number('rate')


def test_an_unknown_argument_is_refused():
    refuse_unknown_arguments(['launch', 'side:=left', 'a/b:=x'], ['side'])
    with pytest.raises(InvalidLaunch, match="'sied', did you mean 'side'"):
        refuse_unknown_arguments(['sied:=left'], ['side', 'loop'])
    with pytest.raises(InvalidLaunch, match="'labels', but a parameter of the tracker for a file"):
        refuse_unknown_arguments(['labels:=none'], ['side', 'loop'])


@pytest.mark.parametrize('line, is_named', [
    ('launch hand_tracker track.launch.py side:=left', True),
    ('launch launch/track.launch.py', True),
    # These include it, and have arguments of their own.
    ('launch hand_tracker plain_hand_control.launch.py controller:=hand_trajectory', False),
    ('launch mine track.launch.py mine:=1', False),
])
def test_arguments_of_a_file_that_includes_another_are_its_own(line, is_named, monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    assert names_launch_file(line.split(), REPOSITORY / 'launch' / 'track.launch.py') == is_named
