"""Add a ros2_control section with mock hardware to a URDF: joints reach their command at once."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from ..core.errors import HandTrackerError
from .plain_xml import parse_plain_xml

MOCK_PLUGIN = 'mock_components/GenericSystem'
STATE_INTERFACES = 'position', 'velocity'


class UnknownJoints(HandTrackerError, ValueError):
    """Joints are to be commanded that the URDF does not have."""


def with_mock_hardware(urdf: str, commanded: Sequence[str]) -> str:
    """Return a URDF with a `ros2_control` section, as of Jazzy.

    Joints that mimic others have states but no command there: ros2_control finds in the URDF what
    they follow.

    Parameters
    ----------
    urdf : str
        Its text.
    commanded : sequence of str
        Joints that controllers command.

    Returns
    -------
    str

    Raises
    ------
    NotPlainXml
    UnknownJoints
        Naming the first of the joints that the URDF does not have, or that follows another.
    """
    robot = parse_plain_xml(urdf)
    movable = [joint for joint in robot.findall('joint') if joint.get('type') != 'fixed']
    free = [joint.get('name') for joint in movable if joint.find('mimic') is None]
    for name in commanded:
        if name not in free:
            raise UnknownJoints(f"joint: '{name}'; expected of {', '.join(map(str, free))}")
    section = ElementTree.SubElement(
        robot, 'ros2_control', {'name': f"{robot.get('name')}_mock", 'type': 'system'})
    hardware = ElementTree.SubElement(section, 'hardware')
    ElementTree.SubElement(hardware, 'plugin').text = MOCK_PLUGIN
    # Without it there are no velocities.
    dynamics = ElementTree.SubElement(hardware, 'param', {'name': 'calculate_dynamics'})
    dynamics.text = 'true'
    for joint in movable:
        entry = ElementTree.SubElement(section, 'joint', {'name': str(joint.get('name'))})
        if joint.get('name') in commanded:
            ElementTree.SubElement(entry, 'command_interface', {'name': 'position'})
        for name in STATE_INTERFACES:
            state = ElementTree.SubElement(entry, 'state_interface', {'name': name})
            ElementTree.SubElement(state, 'param', {'name': 'initial_value'}).text = '0.0'
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')
