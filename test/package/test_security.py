"""The shipped SROS 2 policies allow what the nodes use as they run, and nothing else."""

import os
from xml.etree import ElementTree

import helpers.ros_process  # noqa: F401, a DDS domain of its own
import pytest

from security.policies import (
    ARRANGEMENTS,
    ENCLAVES,
    OTHERS,
    PER_HAND,
    POLICY,
    SHARED_PROCESSES,
    VERSION,
    policy,
    shipped_uses,
    uses,
)

NEEDS = 'rclpy', 'tf2_msgs', 'trajectory_msgs', 'rosbag2_interfaces', 'lifecycle_msgs'
SHIPPED_USES = {use.program: use for use in shipped_uses()}


def test_there_is_a_policy_for_every_program():
    assert set(SHIPPED_USES) == {*ARRANGEMENTS, *OTHERS}


@pytest.mark.skipif(os.environ.get('ROS_DISTRO', 'jazzy') != 'jazzy',
                    reason='the policy is made with Jazzy, other releases have other services')
@pytest.mark.parametrize('program', sorted(ARRANGEMENTS))
def test_a_node_uses_what_its_policy_allows_and_nothing_else(program):
    if program == 'skin':
        pytest.importorskip('skimage', reason='needs scikit-image')
    found, = uses([program], SHIPPED_USES)
    assert found == SHIPPED_USES[program], 'python -m security.policies writes it anew'


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
        '/lab', '/lab/right', '/lab/left'}
    topics = {expression.text for expression in root.iter('topic')}
    assert {'markers', 'joint_states', '/tf', '/diagnostics', '/rosout'} <= topics
    assert {name for name in topics if name.startswith('/lab')} == {
        '/lab/joint_states', '/lab/joint_confidence'}


@pytest.mark.parametrize('program', [name for name in PER_HAND if name != 'mount'])
def test_nodes_of_one_of_both_hands_hear_the_joints_of_both(program):
    enclave, = (enclave for enclave in policy(shipped_uses()).iter('enclave')
                if enclave.get('path') == f'{ENCLAVES}/{program}')
    heard = {profile.get('ns'): {expression.text for expression in profile.find(
        "topics[@subscribe='ALLOW']")} for profile in enclave.iter('profile')}
    assert '/joint_states' not in heard['/']
    assert {'/joint_states', 'joint_states'} <= heard['/right'] & heard['/left']


def test_nothing_is_allowed_by_a_wildcard():
    assert VERSION in POLICY.read_text(encoding='utf-8')
    for use in SHIPPED_USES.values():
        for names in use.rules.values():
            assert names and not any(sign in name for name in names for sign in '*?[')
