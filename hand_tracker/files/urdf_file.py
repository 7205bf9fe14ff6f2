"""The URDF of a hand: 25 revolute joints and five fixed tips, from the hand's own tables.

Command: ``hand_tracker urdf --side left --prefix left_ -o hand_left.urdf``.
"""

from xml.etree import ElementTree

import numpy as np

from ..core.model.capsules import capsule_lengths
from ..core.model.hand import DIGITS, FINGERS, JOINTS, LINKS, ROOT
from ..core.model.kinematics import joint_table, tip_offsets

# Unsourced: URDF demands both numbers; a brisk finger stays below them.
EFFORT = 1.     # [N m]
VELOCITY = 20.  # [rad/s]
# Red, green, blue, opacity: neighbouring segments differ, so that a joint shows in RViz.
MATERIALS = {
    'palm': (.87, .68, .56, 1.), 'bone': (.93, .75, .63, 1.), 'tip': (.80, .52, .45, 1.)}
DECIMALS = 9
SHORTEST = 1e-6  # [m] below which a capsule is a sphere
UNTURNED = (0., 0., 0.)


def urdf(hand, prefix=''):
    """Return the URDF of a hand, of its own side.

    There are no inertial elements: the hand is measured, not simulated, and KDL
    warns of an inertia at the root.

    Parameters
    ----------
    hand : Hand
    prefix : str
        Put before every joint and link, so that two hands share one TF tree.

    Returns
    -------
    str
        The same text for the same hand.
    """
    robot = ElementTree.Element('robot', name=f'{hand.side}_hand')
    for name, colour in MATERIALS.items():
        material = ElementTree.SubElement(robot, 'material', name=prefix + name)
        ElementTree.SubElement(material, 'color', rgba=_numbers(colour))
    table = joint_table(hand)
    capsules = _capsules(hand, table)
    _add_link(robot, prefix, ROOT, capsules[ROOT])
    for i, name in enumerate(LINKS):
        _add_link(robot, prefix, name, capsules.get(name, ()))
        joint = _add_joint(
            robot, prefix, JOINTS[i], 'revolute', ROOT if table.parent[i] < 0
            else LINKS[table.parent[i]], name, table.translation[i],
            _roll_pitch_yaw(table.rotation[i]))
        ElementTree.SubElement(joint, 'axis', xyz=_numbers(table.axis[i]))
        lower, upper = hand.limits[i]
        ElementTree.SubElement(
            joint, 'limit', lower=_numbers([lower]), upper=_numbers([upper]),
            effort=_numbers([EFFORT]), velocity=_numbers([VELOCITY]))
    for digit, offset in zip(DIGITS, tip_offsets(hand)):
        _add_link(robot, prefix, f'{digit}_tip', ())
        _add_joint(robot, prefix, f'{digit}_tip_fixed', 'fixed', f'{digit}_distal',
                   f'{digit}_tip', offset)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _capsules(hand, table):
    """Return for each link that has flesh its (start, end, radius, material)."""
    roots = {name: table.translation[LINKS.index(name)] for name in (
        *(f'{finger}_metacarpal' for finger in FINGERS), 'thumb_saddle')}
    # Side by side from the wrist's crease, for a wrist as broad as the carpus.
    capsules = {ROOT: [
        (root * (0., 1., 0.), root, hand.palm_radius, 'palm') for root in roots.values()]}
    lengths = capsule_lengths(hand)
    for i, finger in enumerate(FINGERS):
        knuckle = table.translation[LINKS.index(f'{finger}_knuckle')]
        capsules[f'{finger}_metacarpal'] = [(np.zeros(3), knuckle, hand.palm_radius, 'palm')]
        _add_bones(capsules, finger, ('proximal', 'middle', 'distal'), lengths[i], hand.radii[i])
    _add_bones(capsules, 'thumb', ('metacarpal', 'proximal', 'distal'), lengths[4], hand.radii[4])
    return capsules


def _add_bones(capsules, digit, links, lengths, radii):
    for link, length, radius in zip(links, lengths, radii):
        material = 'tip' if link == 'distal' else 'bone'
        capsules[f'{digit}_{link}'] = [(np.zeros(3), np.array((length, 0., 0.)), radius, material)]


def _add_link(robot, prefix, name, capsules):
    link = ElementTree.SubElement(robot, 'link', name=prefix + name)
    for kind in ('visual', 'collision'):
        for shape, centre, rpy, size, material in _shapes(capsules):
            part = ElementTree.SubElement(link, kind)
            _add_origin(part, centre, rpy)
            geometry = ElementTree.SubElement(part, 'geometry')
            ElementTree.SubElement(geometry, shape, size)
            if kind == 'visual':
                ElementTree.SubElement(part, 'material', name=prefix + material)


def _shapes(capsules):
    """Yield (shape, centre, roll-pitch-yaw, size, material): URDF knows no capsule."""
    balls = set()
    for start, end, radius, material in capsules:
        for centre in (start, end):
            if tuple(centre) not in balls:
                balls.add(tuple(centre))
                yield 'sphere', centre, UNTURNED, {'radius': _numbers([radius])}, material
        length = np.linalg.norm(end - start)
        if length > SHORTEST:
            size = {'radius': _numbers([radius]), 'length': _numbers([length])}
            yield 'cylinder', (start + end) / 2., _turn_z_to(end - start), size, material


def _add_joint(robot, prefix, name, kind, parent, child, xyz, rpy=UNTURNED):
    joint = ElementTree.SubElement(robot, 'joint', name=prefix + name, type=kind)
    _add_origin(joint, xyz, rpy)
    ElementTree.SubElement(joint, 'parent', link=prefix + parent)
    ElementTree.SubElement(joint, 'child', link=prefix + child)
    return joint


def _add_origin(element, xyz, rpy):
    ElementTree.SubElement(element, 'origin', xyz=_numbers(xyz), rpy=_numbers(rpy))


def _roll_pitch_yaw(rotation):
    """Return URDF's angles: about x, then y, then z, all fixed axes [rad]."""
    level = np.hypot(rotation[0, 0], rotation[1, 0])
    pitch = np.arctan2(-rotation[2, 0], level)
    # Looking along z, roll and yaw turn about the same line: give it all to yaw.
    if level < 1e-9:
        return 0., pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])
    return (np.arctan2(rotation[2, 1], rotation[2, 2]), pitch,
            np.arctan2(rotation[1, 0], rotation[0, 0]))


def _turn_z_to(direction):
    """Return the angles that carry z to `direction`; URDF's cylinders lie along z."""
    x, y, z = direction
    return 0., np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _numbers(values):
    # Adding zero turns -0 into 0.
    return ' '.join(f'{round(float(value), DECIMALS) + 0.:.{DECIMALS}f}'.rstrip('0').rstrip('.')
                    for value in values)
