"""SROS 2 policies of least privilege, made from the nodes as they run: what each one uses.

    python -m security.policies [--namespace /lab] [--all NODE ...] [--output POLICY.xml]

Each node is started in every arrangement that changes its topics or services, in a namespace of
its own, and the graph is asked what it has; the topics that the launch file may have the tracker
hear in place of `markers` are added. docs/security.md says how a keystore is made of them.
"""

import argparse
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import environ
from hand_tracker.adapters.marker_messages import USUAL_TOPICS
from hand_tracker.launching.launch_plan import SOURCE_NAME

POLICY = Path(__file__).with_name('hand_tracker.policy.xml')
VERSION = '0.2.0'       # of the format of policies
ENCLAVES = '/hand_tracker'
WAIT = 120.             # [s] for a node: kernels may have to be compiled, and other work run beside
SETTLED_TIME = 2.       # [s] in which the graph does not change any more
PAUSE = 15.             # [s] for which a busy node may pause before it has all that it uses
GRAPH_POLL = .2         # [s]

# Arguments of each node in the arrangements that change what it uses. Those that the launch file
# starts may have to follow /clock.
CLOCKED = 'use_sim_time:=true'
SEPARATED = 'side:=both', 'marker_topics:=separate', 'joint_state_topics:=separate'
ARRANGEMENTS = {
    'tracker': ([], ['side:=both'], SEPARATED, ['broadcast:=all', CLOCKED]),
    'managed_tracker': ([], ['side:=both'], SEPARATED, ['broadcast:=all', CLOCKED]),
    'replay': (['loop:=true', CLOCKED], ['loop:=true', 'clock:=10.', 'wait_for_subscriber:=0.']),
    'simulate': ([], ['truth:=true']),
    'source': (['source:=natnet'], ['source:=point_cloud', CLOCKED], ['source:=landmarks'],
               ['source:=landmarks', 'message:=named_pose_array'], ['source:=mocap4r2'],
               ['source:=mocap4r2', 'message:=rigid_bodies']),
    'retarget': (['robot:=plain', 'outputs:=joint_state joint_trajectory position_array'],
                 ['robot:=plain', 'wrist.outputs:=pose twist', 'show_robot:=true', CLOCKED]),
    'skin': ([CLOCKED],), 'landmarks': ([],), 'calibrate': ([],),
    'mount': (['body_frame:=body', 'duration:=600.', CLOCKED],),
    'viewer': ([], ['side:=both'], SEPARATED)}
# That the launch file has the tracker hear in place of `markers`, by its argument `source`.
MARKER_TOPICS = {f'{SOURCE_NAME}/markers', *USUAL_TOPICS.values()}
HEARD_AS_LAUNCHED = dict.fromkeys(('tracker', 'managed_tracker', 'teleoperate'), MARKER_TOPICS)
NODE_NAMES = {'tracker': 'hand_tracker', 'managed_tracker': 'hand_tracker',
              'skin': 'hand_skin'}  # of nodes, where not the program's
# An enclave is a process's; `all` runs these unless others are named.
SHARED_PROCESSES = {'teleoperate': ('tracker', 'retarget'), 'all': ('tracker', 'replay')}
# Of other packages, that the launch file starts.
OTHERS = {
    'robot_state_publisher': {
        ('topics', 'publish'): {'/rosout', '/tf', '/tf_static', '/parameter_events',
                                'robot_description'},
        ('topics', 'subscribe'): {'/clock', 'joint_states', '/parameter_events'}},
    'static_transform_publisher': {
        ('topics', 'publish'): {'/rosout', '/tf_static', '/parameter_events'},
        ('topics', 'subscribe'): {'/clock', '/parameter_events'}}}
# Namespaces of a program's nodes: of one hand, of each of both, and of the robots that are shown
# beside them.
HAND_NAMESPACES, ROBOT_NAMESPACES = ('', '/right', '/left'), ('/right_robot', '/left_robot')
NAMESPACES = {'retarget': HAND_NAMESPACES, 'skin': HAND_NAMESPACES, 'mount': HAND_NAMESPACES,
              'robot_state_publisher': HAND_NAMESPACES + ROBOT_NAMESPACES,
              'static_transform_publisher': ROBOT_NAMESPACES}
OF_BOTH_HANDS = {'joint_states', 'joint_confidence'}  # one message has those of both
PARAMETER_SERVICES = ('describe_parameters', 'get_parameter_types', 'get_parameters',
                      'get_type_description', 'list_parameters', 'set_parameters',
                      'set_parameters_atomically')


class Use(NamedTuple):
    """What a node uses: expressions by ('topics', 'publish') and so on."""

    program: str
    node: str
    rules: dict


def rules_of(watcher, node, namespace):
    """Return what a running node uses, with names relative to its namespace.

    Parameters
    ----------
    watcher : rclpy.node.Node
    node, namespace : str

    Returns
    -------
    dict of (str, str) to set of str
        Expressions by kind and permission.
    """
    asked = {('topics', 'publish'): watcher.get_publisher_names_and_types_by_node,
             ('topics', 'subscribe'): watcher.get_subscriber_names_and_types_by_node,
             ('services', 'reply'): watcher.get_service_names_and_types_by_node,
             ('services', 'request'): watcher.get_client_names_and_types_by_node}
    return {rule: {name.removeprefix(f'{namespace}/') for name, _ in ask(node, namespace)}
            for rule, ask in asked.items()}


def merged(rules):
    """Return the union of what arrangements of one node use."""
    found = {}
    for one in rules:
        for rule, names in one.items():
            if names:
                found.setdefault(rule, set()).update(names)
    return found


def settled_rules(watcher, node, namespace, process):
    """Return what a node uses, once that does not change any more."""
    from rclpy.node import NodeNameNonExistentError
    until, last, since = time.monotonic() + WAIT, None, 0.
    while time.monotonic() < until:
        if process.poll() is not None:
            raise RuntimeError(f'{node} in {namespace} has ended with {process.returncode}')
        try:
            now = rules_of(watcher, node, namespace)
        except NodeNameNonExistentError:
            now = None
        if now != last:
            last, since = now, time.monotonic()
        # What every node has comes before what it is for.
        elif now is not None and time.monotonic() - since > SETTLED_TIME and any(
                name not in ('/rosout', 'parameter_events', '/parameter_events')
                for kind in ('publish', 'subscribe') for name in now['topics', kind]):
            return now
        time.sleep(GRAPH_POLL)
    raise RuntimeError(f'{node} in {namespace} is not there')


def uses(programs, expected, patience=WAIT):
    """Return what each of our nodes uses, by its program.

    Parameters
    ----------
    programs : collection of str
    expected : mapping of str to Use
        By program; where a node uses something else it is waited for, as on a busy machine a
        node may pause before it has all.
    patience : float, optional
        For which it is waited [s].

    Returns
    -------
    list of Use
    """
    import rclpy
    from visualization_msgs.msg import Marker

    found = []
    context = rclpy.Context()
    rclpy.init(context=context)
    watcher = rclpy.create_node('policies', context=context)
    try:
        for program in programs:
            with ExitStack() as stack:
                started, heard = [], []
                for number, parameters in enumerate(ARRANGEMENTS[program]):
                    namespace = f'/{program}_{number}'
                    if program == 'viewer':
                        # Of what it hears it asks the tracker.
                        start(stack, 'tracker', namespace, parameters, HAND_TRACKER_JIT='0')
                        started.append((namespace, start(
                            stack, program, namespace, [], 'security.viewer_in_use',
                            HAND_TRACKER_JIT='0')))
                    else:
                        started.append((namespace, start(stack, program, namespace, parameters)))
                if program == 'skin':
                    # It listens while somebody listens to it.
                    heard = [watcher.create_subscription(
                        Marker, f'{namespace}/hand_skin', print, 1) for namespace, _ in started]
                if program == 'mount':
                    # It listens while it calibrates.
                    for namespace, _ in started:
                        calibrate(watcher, f'{namespace}/mount/calibrate')
                node = NODE_NAMES.get(program, program)
                until = time.monotonic() + patience
                while True:
                    use = Use(program, node, merged([
                        {('topics', 'subscribe'): HEARD_AS_LAUNCHED.get(program)},
                        *(settled_rules(watcher, node, *one) for one in started)]))
                    if use == expected.get(program) or time.monotonic() > until:
                        break
                found.append(use)
                for subscription in heard:
                    watcher.destroy_subscription(subscription)
    finally:
        watcher.destroy_node()
        context.try_shutdown()
    return found


def calibrate(watcher, service):
    """Have a node begin a calibration, without waiting for its answer."""
    from std_srvs.srv import Trigger
    client = watcher.create_client(Trigger, service)
    if not client.wait_for_service(WAIT):
        raise RuntimeError(f'{service} is not there')
    client.call_async(Trigger.Request())


def start(stack, program, namespace, parameters, module='hand_tracker.entry', **more):
    """Start a node, which is killed at the end; return its process.

    `more` are environment variables.
    """
    process = stack.enter_context(subprocess.Popen(
        [sys.executable, '-m', module, program, '--ros-args', '-r', f'__ns:={namespace}',
         *(word for each in parameters for word in ('-p', each))],
        env=environ(**more), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL))
    stack.callback(process.kill)
    return process


def heard_topics(names, namespace, below):
    """Return the topics that a node subscribes to, by the namespace that it is in.

    Parameters
    ----------
    names : set of str
        As it has them where there is one hand.
    namespace : str
        Of all nodes, without a slash at its end.
    below : str
        Namespace in it, of `HAND_NAMESPACES` or `ROBOT_NAMESPACES`.
    """
    if below in ROBOT_NAMESPACES and 'joint_states' in names:
        # Beside one hand, or beside one of both.
        return names - {'joint_states'} | {f'{namespace}{hand}/robot/shown'
                                           for hand in ('', below.removesuffix('_robot'))}
    if below not in HAND_NAMESPACES[1:]:
        return names
    return names | {f'{namespace}/{name}' for name in names & OF_BOTH_HANDS}


def policy(found, namespace='/', shared=SHARED_PROCESSES):
    """Return the policy as an XML tree, one enclave a program and one profile a node.

    Parameters
    ----------
    found : iterable of Use
    namespace : str, optional
        Of the nodes.
    shared : mapping of str to sequence of str, optional
        Programs whose nodes are in one process, by the program of that.
    """
    namespace = namespace.rstrip('/')
    root = ElementTree.Element('policy', version=VERSION)
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for program, node, rules in found:
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'{ENCLAVES}/{program}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        for below in NAMESPACES.get(program, ('',)):
            profile = ElementTree.SubElement(
                profiles, 'profile', ns=(namespace + below) or '/', node=node)
            for (kind, permission), names in sorted(rules.items()):
                if (kind, permission) == ('topics', 'subscribe'):
                    names = heard_topics(names, namespace, below)
                group = ElementTree.SubElement(profile, kind, {permission: 'ALLOW'})
                for name in sorted(names):
                    ElementTree.SubElement(group, kind[:-1]).text = name
    profiles_of = {enclave.get('path').rpartition('/')[2]: enclave.find('profiles')
                   for enclave in enclaves}
    for program, parts in shared.items():
        # Uses of other programs, as of those who try the policy, have no such process.
        if not profiles_of.keys() >= set(parts):
            continue
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'{ENCLAVES}/{program}')
        ElementTree.SubElement(enclave, 'profiles').extend(
            profile for part in parts for profile in profiles_of[part])
    ElementTree.indent(root)
    return root


def shipped_uses():
    """Return what the shipped policy allows each program of one node."""
    found = []
    for enclave in ElementTree.parse(POLICY).getroot().iter('enclave'):
        program = enclave.get('path').rpartition('/')[2]
        if program in SHARED_PROCESSES:
            continue
        profile = enclave.find('profiles/profile')
        rules = {}
        for group in profile:
            permission, = group.attrib
            rules[group.tag, permission] = {expression.text for expression in group}
        found.append(Use(program, profile.get('node'), rules))
    return found


def others():
    """Return what nodes of other packages use that the launch file starts."""
    return [Use(name, name, {**rules, ('services', 'reply'): {
        f'{name}/{service}' for service in PARAMETER_SERVICES}})
        for name, rules in OTHERS.items()]


def main():
    """Start the nodes and write what they use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--namespace', default='/', help='of the nodes (default: /)')
    parser.add_argument('--all', nargs='+', metavar='NODE', choices=ARRANGEMENTS,
                        help='nodes of ros2 run hand_tracker all (default: tracker replay)')
    parser.add_argument('--output', type=Path, default=POLICY)
    options = parser.parse_args()
    from benchmarks.round_trip import isolate
    isolate()
    shared = SHARED_PROCESSES | ({'all': options.all} if options.all else {})
    is_as_shipped = options.namespace == '/' and not options.all
    shipped = shipped_uses()
    found = shipped if not is_as_shipped else [
        *uses(ARRANGEMENTS, {use.program: use for use in shipped}, PAUSE), *others()]
    text = ElementTree.tostring(policy(found, options.namespace, shared), 'unicode')
    options.output.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n',
                              encoding='utf-8')
    print(f'{options.output}: {len(found)} enclaves')
    return 0


if __name__ == '__main__':
    sys.exit(main())
