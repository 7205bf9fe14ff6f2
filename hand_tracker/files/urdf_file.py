"""Generate the URDF of a hand: 25 revolute joints and five fixed tips.

Command: ``hand_tracker urdf --side left --prefix left_ -o hand_left.urdf``.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from ..core.model.capsules import capsule_ends
from ..core.model.hand import DIGITS, FINGERS, JOINTS, LEFT_HAND_MIRROR, LINKS, ROOT, Hand
from ..core.model.kinematics import JointTable, joint_table, tip_offsets

# Required by URDF; unsourced, above those of a fast finger.
MAX_EFFORT = 1.     # [N m]
MAX_VELOCITY = 20.  # [rad/s]
# Red, green, blue, opacity; adjacent segments differ, so that joints are visible in RViz.
MATERIALS = {
    'palm': (.87, .68, .56, 1.), 'bone': (.93, .75, .63, 1.), 'tip': (.80, .52, .45, 1.)}
URDF_DECIMALS = 9
MIN_CYLINDER_LENGTH = 1e-6  # [m] below which a capsule is a sphere
NO_ROTATION = (0., 0., 0.)


class LinkCapsule(NamedTuple):
    """Collision and visual shape of a link: a capsule in the link's frame.

    Attributes
    ----------
    start, end : ndarray, shape (3,)
        Centres of its ends [m].
    radius : float
        [m]
    material : str
        One of `MATERIALS`.
    """

    start: np.ndarray
    end: np.ndarray
    radius: float
    material: str


def urdf(hand: Hand, prefix: str = '') -> str:
    """Return the URDF of a hand.

    Without inertial elements: the hand is measured, not simulated, and KDL warns of an inertia
    at the root.

    Parameters
    ----------
    hand : Hand
    prefix : str
        Of every joint and link, so that two hands can share one TF tree.

    Returns
    -------
    str
        XML; equal for equal hands.
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
            effort=_numbers([MAX_EFFORT]), velocity=_numbers([MAX_VELOCITY]))
    for digit, offset in zip(DIGITS, tip_offsets(hand)):
        _add_link(robot, prefix, f'{digit}_tip', ())
        _add_joint(robot, prefix, f'{digit}_tip_fixed', 'fixed', f'{digit}_distal',
                   f'{digit}_tip', offset)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _capsules(hand: Hand, table: JointTable) -> dict[str, list[LinkCapsule]]:
    """Return the capsules of each link with a shape."""
    roots = {name: table.translation[LINKS.index(name)] for name in (
        *(f'{finger}_metacarpal' for finger in FINGERS), 'thumb_saddle')}
    # Parallel from the wrist crease, so that the wrist is as broad as the carpus.
    capsules = {ROOT: [LinkCapsule(root * (0., 1., 0.), root, hand.palm_radius, 'palm')
                       for root in roots.values()]}
    ends = capsule_ends(hand)
    if hand.side == 'left':
        ends = ends * LEFT_HAND_MIRROR
    cmc = table.translation[LINKS.index('thumb_metacarpal')]
    if cmc.any():
        capsules['thumb_saddle'] = [LinkCapsule(np.zeros(3), cmc, hand.palm_radius, 'palm')]
    for i, finger in enumerate(FINGERS):
        knuckle = table.translation[LINKS.index(f'{finger}_knuckle')]
        capsules[f'{finger}_metacarpal'] = [
            LinkCapsule(np.zeros(3), knuckle, hand.palm_radius, 'palm')]
        _add_bones(capsules, finger, ('proximal', 'middle', 'distal'), ends[i], hand.radii[i])
    _add_bones(capsules, 'thumb', ('metacarpal', 'proximal', 'distal'), ends[4], hand.radii[4])
    return capsules


def _add_bones(capsules: dict[str, list[LinkCapsule]], digit: str, links: tuple[str, ...],
               ends: np.ndarray, radii: np.ndarray) -> None:
    for link, end, radius in zip(links, ends, radii):
        material = 'tip' if link == 'distal' else 'bone'
        capsules[f'{digit}_{link}'] = [
            LinkCapsule(np.zeros(3), end, radius, material)]


def _add_link(robot: Element, prefix: str, name: str, capsules: Iterable[LinkCapsule]) -> None:
    link = ElementTree.SubElement(robot, 'link', name=prefix + name)
    for kind in ('visual', 'collision'):
        for shape, centre, rpy, size, material in _shapes(capsules):
            part = ElementTree.SubElement(link, kind)
            _add_origin(part, centre, rpy)
            geometry = ElementTree.SubElement(part, 'geometry')
            ElementTree.SubElement(geometry, shape, size)
            if kind == 'visual':
                ElementTree.SubElement(part, 'material', name=prefix + material)


def _shapes(capsules: Iterable[LinkCapsule]) -> Iterator[tuple]:
    """Yield (shape, centre, roll-pitch-yaw, size, material), as URDF has no capsules."""
    spheres: set[tuple] = set()
    for start, end, radius, material in capsules:
        for centre in (start, end):
            if tuple(centre) not in spheres:
                spheres.add(tuple(centre))
                yield 'sphere', centre, NO_ROTATION, {'radius': _numbers([radius])}, material
        length = float(np.linalg.norm(end - start))
        if length > MIN_CYLINDER_LENGTH:
            size = {'radius': _numbers([radius]), 'length': _numbers([length])}
            yield 'cylinder', (start + end) / 2., _turn_z_to(end - start), size, material


def _add_joint(robot: Element, prefix: str, name: str, kind: str, parent: str, child: str,
               xyz: Iterable[float], rpy: Iterable[float] = NO_ROTATION) -> Element:
    joint = ElementTree.SubElement(robot, 'joint', name=prefix + name, type=kind)
    _add_origin(joint, xyz, rpy)
    ElementTree.SubElement(joint, 'parent', link=prefix + parent)
    ElementTree.SubElement(joint, 'child', link=prefix + child)
    return joint


def _add_origin(element: Element, xyz: Iterable[float], rpy: Iterable[float]) -> None:
    ElementTree.SubElement(element, 'origin', xyz=_numbers(xyz), rpy=_numbers(rpy))


def _roll_pitch_yaw(rotation: np.ndarray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation (3, 3): about fixed x, then y, then z [rad]."""
    level = np.hypot(rotation[0, 0], rotation[1, 0])
    pitch = np.arctan2(-rotation[2, 0], level)
    # Gimbal lock: roll and yaw share an axis, so that all rotation goes into yaw.
    if level < 1e-9:
        return 0., pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])
    return (np.arctan2(rotation[2, 1], rotation[2, 2]), pitch,
            np.arctan2(rotation[1, 0], rotation[0, 0]))


def _turn_z_to(direction: np.ndarray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw that rotate z, the axis of URDF's cylinders, to `direction`."""
    x, y, z = direction
    return 0., np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _numbers(values: Iterable[float]) -> str:
    # + 0. turns -0 into 0.
    rounded = (round(float(value), URDF_DECIMALS) + 0. for value in values)
    return ' '.join(f'{value:.{URDF_DECIMALS}f}'.rstrip('0').rstrip('.') for value in rounded)
