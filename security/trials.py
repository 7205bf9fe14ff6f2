"""Keystores to try enforcement with: the shipped policy, and enclaves of those who try it.

The driver may do what somebody who drives a robot has to; the stranger has a certificate of the
same keystore and may do what every node does, nothing of it with the hand.
"""

import os
from pathlib import Path
from xml.etree import ElementTree

from security.policies import ENCLAVES, PARAMETER_SERVICES, POLICY, Use, policy, shipped_uses

EVERY_NODE = '/rosout', '/parameter_events'
UNSECURED = {'ROS_SECURITY_ENABLE': 'false'}  # environment of a process that trusts everybody
DRIVER, STRANGER = (f'{ENCLAVES}/{program}' for program in ('driver', 'stranger'))
TRIERS = (
    Use('driver', 'driver', {
        ('topics', 'publish'): {*EVERY_NODE, 'markers', 'robot/joint_states', 'retarget/engage',
                                'retarget/deadman'},
        ('topics', 'subscribe'): {'joint_states', 'hand_skin', 'retarget/state',
                                  '/diagnostics'},
        ('services', 'request'): {'hand_tracker/get_parameters', 'retarget/engage',
                                  'hand_tracker/set_parameters_atomically'},
        ('services', 'reply'): {f'/{node}/{service}' for node in ('driver', 'enforced_driver')
                                for service in PARAMETER_SERVICES}}),
    Use('stranger', 'stranger', {('topics', 'publish'): {*EVERY_NODE}}))


def make_keystore(folder, namespace='/'):
    """Make a keystore of this ROS domain by the commands of docs/security.md; return its path.

    Parameters
    ----------
    folder : path-like
        To hold it.
    namespace : str, optional
        Of the nodes.
    """
    from ros2cli.cli import main

    def written(name, uses):
        path = Path(folder, f'{name}.policy.xml')
        ElementTree.ElementTree(policy(uses, namespace)).write(path, 'utf-8')
        return path

    keystore = Path(folder, 'keystore')
    nodes = POLICY if namespace == '/' else written('nodes', shipped_uses())
    mask = os.umask(0o077)
    try:
        for command in (['create_keystore', keystore], [
                'generate_artifacts', '-k', keystore, '-p', nodes, written('triers', TRIERS)]):
            if code := main(argv=['security', *map(str, command)]):
                raise RuntimeError(f'ros2 security {command[0]} has ended with {code}')
    finally:
        os.umask(mask)
    return keystore


def enforced(keystore, enclave):
    """Return the environment variables of a process that runs enforced in an enclave."""
    from hand_tracker.files.keystore import security_environment
    return {**security_environment(str(keystore)), 'ROS_SECURITY_ENCLAVE_OVERRIDE': enclave}
