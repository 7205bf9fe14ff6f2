"""The shipped SROS 2 policies allow what the nodes use as they run, and nothing else."""

import os
import subprocess
from contextlib import ExitStack
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from helpers.launching import installed, plan_of
from helpers.ros_process import watching_node

from hand_tracker.adapters.marker_messages import MESSAGES_OF, SERVED, USUAL_TOPICS
from hand_tracker.core.model.hand import Hand
from hand_tracker.files.urdf_file import urdf
from security.policies import (
    ARRANGEMENTS,
    ENCLAVES,
    HAND_NAMESPACES,
    NAMESPACES,
    NODE_NAMES,
    OTHERS,
    POLICY,
    ROBOT_NAMESPACES,
    SHARED_PROCESSES,
    VERSION,
    merged,
    policy,
    settled_rules,
    shipped_uses,
    start,
    uses,
)

NEEDS = 'rclpy', 'tf2_msgs', 'trajectory_msgs', 'rosbag2_interfaces', 'lifecycle_msgs'
SOURCE_MESSAGES = 'mocap4r2_msgs', 'teleop_ros2_interfaces'
SHIPPED_USES = {use.program: use for use in shipped_uses()}


def test_there_is_a_policy_for_every_program():
    assert set(SHIPPED_USES) == {*ARRANGEMENTS, *OTHERS}


@pytest.mark.skipif(os.environ.get('ROS_DISTRO', 'jazzy') != 'jazzy',
                    reason='the policy is made with Jazzy, other releases have other services')
@pytest.mark.parametrize('program', sorted(ARRANGEMENTS))
def test_a_node_uses_what_its_policy_allows_and_nothing_else(program):
    for needed in {'skin': ['skimage'], 'source': SOURCE_MESSAGES}.get(program, ()):
        pytest.importorskip(needed, reason=f'needs {needed}')
    found, = uses([program], SHIPPED_USES)
    assert found == SHIPPED_USES[program], 'python -m security.policies writes it anew'


@pytest.mark.parametrize('program, package', [
    ('robot_state_publisher', 'robot_state_publisher'),
    ('static_transform_publisher', 'tf2_ros')])
def test_a_program_of_another_package_uses_what_its_policy_allows(tmp_path, program, package):
    if not installed(package):
        pytest.skip(f'{package} is not installed')
    path = next(path for prefix in os.environ['AMENT_PREFIX_PATH'].split(os.pathsep)
                if (path := Path(prefix, 'lib', package, program)).exists())
    described = tmp_path / 'described.yaml'
    described.write_text(yaml.safe_dump({'/**': {'ros__parameters': {
        'use_sim_time': True, 'robot_description': urdf(Hand.scaled())}}}))
    frames = (['--frame-id', 'a', '--child-frame-id', 'b'] if package == 'tf2_ros' else [])
    with watching_node() as node, subprocess.Popen([
            path, *frames, '--ros-args', '-r', f'__ns:=/{program}', '-r', f'__node:={program}',
            '--params-file', described], stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL) as process:
        try:
            found = settled_rules(node, program, f'/{program}', process)
        finally:
            process.kill()
    assert merged([found]) == SHIPPED_USES[program].rules


@pytest.mark.parametrize('below', ROBOT_NAMESPACES)
def test_a_shown_robot_is_heard_beside_one_hand_and_beside_one_of_both(below):
    profile, = (profile for profile in ElementTree.parse(POLICY).getroot().iter('profile')
                if (profile.get('ns'), profile.get('node')) == (below, 'robot_state_publisher'))
    side = below.removesuffix('_robot')
    assert {expression.text for expression in profile.find("topics[@subscribe='ALLOW']")} == {
        '/clock', '/parameter_events', '/robot/shown', f'{side}/robot/shown'}


def test_nodes_of_all_use_no_more_than_each_alone():
    with ExitStack() as stack, watching_node() as node:
        process = start(stack, 'all', '/all', [])
        for program in SHARED_PROCESSES['all']:
            found = merged([settled_rules(
                node, NODE_NAMES.get(program, program), '/all', process)])
            allowed = SHIPPED_USES[program].rules
            assert all(names <= allowed.get(rule, set()) for rule, names in found.items()), found


def test_a_policy_of_other_nodes_in_one_process_names_them_alone():
    nodes = 'tracker', 'source', 'retarget'
    enclave, = (enclave for enclave in policy(shipped_uses(), shared={'all': nodes}).iter('enclave')
                if enclave.get('path') == f'{ENCLAVES}/all')
    assert {profile.get('node') for profile in enclave.iter('profile')} == {
        'hand_tracker', 'source', 'retarget'}


def test_nodes_of_one_process_may_do_what_each_alone_may():
    nodes = {enclave.get('path'): [
        (profile.get('node'), ElementTree.tostring(profile).strip())
        for profile in enclave.iter('profile')] for enclave in ElementTree.parse(
            POLICY).getroot().iter('enclave')}
    for program, parts in SHARED_PROCESSES.items():
        assert nodes[f'{ENCLAVES}/{program}'] == [
            profile for part in parts for profile in nodes[f'{ENCLAVES}/{part}']]


def test_a_namespace_moves_relative_names_alone():
    root = policy(shipped_uses(), '/lab')
    assert {profile.get('ns') for profile in root.iter('profile')} == {
        f'/lab{below}' for below in HAND_NAMESPACES + ROBOT_NAMESPACES}
    topics = {expression.text for expression in root.iter('topic')}
    assert {'markers', 'joint_states', '/tf', '/diagnostics', '/rosout'} <= topics
    assert {name for name in topics if name.startswith('/lab')} == {
        '/lab/joint_states', '/lab/joint_confidence',
        *(f'/lab{hand}/robot/shown' for hand in HAND_NAMESPACES)}


@pytest.mark.parametrize('program', [
    name for name, below in NAMESPACES.items() if HAND_NAMESPACES[1] in below and name != 'mount'])
def test_nodes_of_one_of_both_hands_hear_the_joints_of_both(program):
    enclave, = (enclave for enclave in policy(shipped_uses()).iter('enclave')
                if enclave.get('path') == f'{ENCLAVES}/{program}')
    heard = {profile.get('ns'): {expression.text for expression in profile.find(
        "topics[@subscribe='ALLOW']")} for profile in enclave.iter('profile')}
    assert '/joint_states' not in heard['/']
    assert {'/joint_states', 'joint_states'} <= heard['/right'] & heard['/left']


@pytest.mark.parametrize('source, message', [
    *((source, message) for source, messages in MESSAGES_OF.items() for message in messages),
    *((source, '') for source in SERVED)])
@pytest.mark.parametrize('up', ['', 'y'])
def test_a_launched_tracker_may_hear_any_source(source, message, up):
    # A managed tracker has no source in its process, as a secured one has none.
    plan = plan_of(source=source, message=message, up=up, lifecycle='true')
    for program in ('tracker', 'managed_tracker'):
        assert plan.marker_topic in SHIPPED_USES[program].rules['topics', 'subscribe']
    if not plan.direct and source in MESSAGES_OF:
        assert USUAL_TOPICS[message] in SHIPPED_USES['source'].rules['topics', 'subscribe']


def test_nothing_is_allowed_by_a_wildcard():
    assert VERSION in POLICY.read_text(encoding='utf-8')
    for use in SHIPPED_USES.values():
        for names in use.rules.values():
            assert names and not any(sign in name for name in names for sign in '*?[')
