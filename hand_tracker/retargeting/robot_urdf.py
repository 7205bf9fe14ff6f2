"""Read the kinematic tree of a robot from URDF: links, joints, limits, mimic joints."""

from __future__ import annotations

from collections import Counter, deque
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from ..core.errors import HandTrackerError
from ..files.plain_xml import NotPlainXml, parse_plain_xml

MAX_URDF_BYTES = 20_000_000
MOVABLE_JOINT_TYPES = ('revolute', 'continuous', 'prismatic')
JOINT_TYPES = (*MOVABLE_JOINT_TYPES, 'fixed')
DEFAULT_SHAPE_RGB = (.75, .78, .82)   # red, green, blue of shapes without a material
FARTHEST_LIMIT = 1e3                # [rad or m]
CONTINUOUS_RANGE = (-np.pi, np.pi)  # [rad] taken as limits of a continuous joint


class InvalidRobot(HandTrackerError, ValueError):
    """A robot's URDF or settings are invalid; the message says where, and what is expected."""


class Mimic(NamedTuple):
    """A joint that follows another: position = multiplier * other + offset."""

    joint: str
    multiplier: float
    offset: float


class UrdfJoint(NamedTuple):
    """One joint of a URDF.

    Attributes
    ----------
    name, kind : str
        `kind` is one of `JOINT_TYPES`.
    parent, child : str
        Links.
    rotation, translation : ndarray, shape (3, 3) and (3,)
        Of the joint's frame in the parent link's frame [m].
    axis : ndarray, shape (3,)
        Unit vector in the joint's frame.
    lower, upper : float
        Limits [rad] or [m], the soft ones of a `safety_controller` where these are narrower.
    velocity : float
        Limit [rad/s] or [m/s]; 0 where the URDF has none.
    mimic : Mimic or None
    """

    name: str
    kind: str
    parent: str
    child: str
    rotation: np.ndarray
    translation: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    velocity: float
    mimic: Mimic | None

    @property
    def is_movable(self) -> bool:
        """Whether the joint is not fixed."""
        return self.kind != 'fixed'


class UrdfShape(NamedTuple):
    """A primitive shape of a link, to be drawn.

    Attributes
    ----------
    link : str
    kind : str
        'box', 'cylinder' along z, or 'sphere'.
    size : tuple of float
        Three sides; radius and length; or radius [m].
    rotation, translation : ndarray, shape (3, 3) and (3,)
        In the link's frame [m].
    colour : tuple of float
        Red, green and blue, 0 to 1.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    rotation: np.ndarray
    translation: np.ndarray
    colour: tuple[float, ...]


class UrdfTree(NamedTuple):
    """Kinematic tree of a URDF.

    Attributes
    ----------
    name : str
    root : str
        The link without a parent.
    joints : tuple of UrdfJoint
        Parents before their children.
    spheres : dict of str to float
        Radius of the greatest sphere among the shapes of a link, for links that have one [m].
    shapes : tuple of UrdfShape
        Primitive visual shapes of the links, or, of a link without, its collision shapes.
    listed : tuple of str
        Names of the joints in the order of the document.
    """

    name: str
    root: str
    joints: tuple[UrdfJoint, ...]
    spheres: dict[str, float]
    shapes: tuple[UrdfShape, ...]
    listed: tuple[str, ...]

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, parents first."""
        return (self.root, *(joint.child for joint in self.joints))


def read_urdf_tree(text: str, source: str = 'URDF') -> UrdfTree:
    """Return the kinematic tree of a URDF.

    Parameters
    ----------
    text : str
        XML.
    source : str
        Put before the message of an error, such as the file's name.

    Raises
    ------
    InvalidRobot
        Naming the element, its value and what is expected.
    """
    try:
        robot = parse_plain_xml(text)
    except NotPlainXml as error:
        raise InvalidRobot(f'{source}: {error}') from None
    if robot.tag != 'robot':
        raise InvalidRobot(f'{source}: the root element is <{robot.tag}>; expected <robot> (a '
                           'xacro file must be converted first: xacro FILE > robot.urdf)')
    links = [_name(link, source) for link in robot.findall('link')]
    known = set(links)
    joints = {}
    for element in robot.findall('joint'):
        joint = _joint(element, source)
        for link in (joint.parent, joint.child):
            if link not in known:
                raise InvalidRobot(f"{source}: joint '{joint.name}': there is no link '{link}'")
        if joint.name in joints:
            raise InvalidRobot(f"{source}: two joints have the name '{joint.name}'")
        joints[joint.name] = joint
    _check_mimics(joints, source)
    root, ordered = _in_order(links, list(joints.values()), source)
    spheres = {}
    for element in robot.findall('link'):
        radii = [_number(sphere, 'radius', f'{source}: sphere of {element.get("name")}', 0.)
                 for sphere in element.iterfind('.//geometry/sphere')]
        if radii:
            spheres[_name(element, source)] = max(radii)
    return UrdfTree(robot.get('name', ''), root, ordered, spheres, _all_shapes(robot, source),
                    tuple(joints))


def load_urdf_tree(path: str | Path) -> UrdfTree:
    """Return the kinematic tree of a URDF file.

    Raises
    ------
    InvalidRobot
        As `read_urdf_tree`, or if the file cannot be read.
    """
    try:
        with open(path, encoding='utf-8') as file:
            text = file.read(MAX_URDF_BYTES + 1)
    except UnicodeDecodeError:
        raise InvalidRobot(f'{path}: not a text in UTF-8') from None
    except (OSError, ValueError) as error:  # ValueError: no path has a NUL
        reason = getattr(error, 'strerror', None) or error
        raise InvalidRobot(f'{path}: {reason}') from None
    if len(text) > MAX_URDF_BYTES:
        raise InvalidRobot(f'{path}: larger than {MAX_URDF_BYTES} bytes')
    return read_urdf_tree(text, str(path))


def _name(element: Element, source: str) -> str:
    name = element.get('name')
    if not name:
        raise InvalidRobot(f'{source}: a <{element.tag}> has no name')
    return name


def _number(element: Element | None, key: str, place: str, default: float) -> float:
    text = None if element is None else element.get(key)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InvalidRobot(f"{place}: {key} is '{text}'; expected a number")
    return value


def _vector(element: Element | None, key: str, place: str,
            default: tuple[float, float, float]) -> np.ndarray:
    text = None if element is None else element.get(key)
    if not text or text == 'None':
        return np.array(default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array(())
    if values.shape != (3,) or not np.isfinite(values).all():
        raise InvalidRobot(f"{place}: {key} is '{text}'; expected three numbers")
    return values


def _joint(element: Element, source: str) -> UrdfJoint:
    name = _name(element, source)
    place = f"{source}: joint '{name}'"
    kind = element.get('type', '')
    if kind not in JOINT_TYPES:
        raise InvalidRobot(f"{place}: its type is '{kind}'; supported are {', '.join(JOINT_TYPES)}")
    parent, child = element.find('parent'), element.find('child')
    if parent is None or child is None:
        raise InvalidRobot(f'{place}: has no parent or no child link')
    origin, limit = element.find('origin'), element.find('limit')
    axis = _vector(element.find('axis'), 'xyz', place, (1., 0., 0.))
    if kind == 'fixed':
        axis = np.array((1., 0., 0.))
    elif np.linalg.norm(axis) < 1e-9:
        raise InvalidRobot(f'{place}: its axis has no direction')
    lower, upper = _limits(element, kind, place)
    follows = element.find('mimic')
    mimic = None if follows is None else Mimic(
        follows.get('joint', ''), _number(follows, 'multiplier', place, 1.),
        _number(follows, 'offset', place, 0.))
    joint = UrdfJoint(
        name, kind, parent.get('link', ''), child.get('link', ''),
        rotation_from_rpy(_vector(origin, 'rpy', place, (0., 0., 0.))),
        _vector(origin, 'xyz', place, (0., 0., 0.)), axis / np.linalg.norm(axis), lower, upper,
        max(0., _number(limit, 'velocity', place, 0.)), mimic)
    if limit is None and mimic is None and kind in ('revolute', 'prismatic'):
        raise InvalidRobot(f'{place}: no <limit>; expected the range of a {kind} joint')
    return joint


def _limits(joint: Element, kind: str, place: str) -> tuple[float, float]:
    """Return a joint's limits, narrowed by the soft ones of its controller [rad or m]."""
    if kind == 'continuous':
        return CONTINUOUS_RANGE
    limit, soft = joint.find('limit'), joint.find('safety_controller')
    lower, upper = _number(limit, 'lower', place, 0.), _number(limit, 'upper', place, 0.)
    if lower > upper:
        raise InvalidRobot(f'{place}: lower limit {lower:g} exceeds upper limit {upper:g}')
    if max(-lower, upper) > FARTHEST_LIMIT:
        raise InvalidRobot(f'{place}: limits {lower:g} to {upper:g}; expected radians or metres')
    if limit is None:
        return lower, upper
    # One that is left out counts as none, not as URDF's 0, which few mean.
    softly = (_number(soft, 'soft_lower_limit', place, lower),
              _number(soft, 'soft_upper_limit', place, upper))
    kept = max(lower, softly[0]), min(upper, softly[1])
    if kept[0] > kept[1]:
        raise InvalidRobot(f'{place}: soft limits {softly[0]:g} to {softly[1]:g} of its '
                           f'safety_controller; expected a range within {lower:g} to {upper:g}')
    return kept


def _all_shapes(robot: Element, source: str) -> tuple[UrdfShape, ...]:
    """Return the shapes to draw of all links."""
    colours = {material.get('name'): _colour(material, source)
               for material in robot.findall('material')}
    found: list[UrdfShape] = []
    for link in robot.findall('link'):
        for kind in ('visual', 'collision'):
            shapes = [_shape(part, link.get('name', ''), colours, source)
                      for part in link.findall(kind)]
            drawn = [shape for shape in shapes if shape is not None]
            if drawn:
                found += drawn
                break
    return tuple(found)


def _shape(part: Element, link: str, colours: dict, source: str) -> UrdfShape | None:
    """Return the shape of a <visual> or <collision>; None of a mesh."""
    place = f"{source}: shape of link '{link}'"
    geometry = part.find('geometry')
    shape = None if geometry is None else next(iter(geometry), None)
    size: tuple[float, ...]
    if shape is None:
        return None
    if shape.tag == 'box':
        size = tuple(_vector(shape, 'size', place, (0., 0., 0.)).tolist())
    elif shape.tag in ('cylinder', 'sphere'):
        keys = ('radius', 'length') if shape.tag == 'cylinder' else ('radius',)
        size = tuple(_number(shape, key, place, 0.) for key in keys)
    else:
        return None
    origin, material = part.find('origin'), part.find('material')
    colour = None
    if material is not None:
        colour = _colour(material, source) or colours.get(material.get('name'))
    return UrdfShape(link, shape.tag, size,
                     rotation_from_rpy(_vector(origin, 'rpy', place, (0., 0., 0.))),
                     _vector(origin, 'xyz', place, (0., 0., 0.)), colour or DEFAULT_SHAPE_RGB)


def _colour(material: Element, source: str) -> tuple[float, ...] | None:
    """Return red, green and blue of a material; None where it has no colour of its own."""
    colour = material.find('color')
    words = (colour.get('rgba', '') if colour is not None else '').split()
    try:
        values = tuple(float(word) for word in words)
    except ValueError:
        values = ()
    if words and (len(values) != 4 or not np.isfinite(values).all()):
        raise InvalidRobot(f"{source}: material '{material.get('name')}': rgba is "
                           f"'{' '.join(words)}'; expected four numbers")
    return values[:3] or None


def _check_mimics(joints: dict[str, UrdfJoint], source: str) -> None:
    checked: set[str] = set()
    for joint in joints.values():
        seen = {joint.name}
        while joint.mimic is not None and joint.name not in checked:
            target = joints.get(joint.mimic.joint)
            if target is None or not target.is_movable or target.name in seen:
                raise InvalidRobot(f"{source}: joint '{joint.name}' mimics "
                                   f"'{joint.mimic.joint}'; expected another, movable joint")
            seen.add(target.name)
            joint = target
        checked |= seen


def _in_order(links: list[str], joints: list[UrdfJoint],
              source: str) -> tuple[str, tuple[UrdfJoint, ...]]:
    """Return the root and the joints, parents first."""
    children = Counter(joint.child for joint in joints)
    twice = [child for child, parents in children.items() if parents > 1]
    if twice:
        raise InvalidRobot(f'{source}: {", ".join(sorted(twice))}: more than one parent joint')
    if not links:
        raise InvalidRobot(f'{source}: no link; expected those of a robot')
    roots = [link for link in links if link not in children]
    if len(roots) != 1:
        raise InvalidRobot(f'{source}: {len(roots)} links have no parent '
                           f'({", ".join(roots[:5])}); expected one root')
    below: dict[str, list[UrdfJoint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    ordered: list[UrdfJoint] = []
    waiting = deque(roots)
    while waiting:
        found = below.get(waiting.popleft(), [])
        ordered += found
        waiting += [joint.child for joint in found]
    if len(ordered) != len(joints):
        raise InvalidRobot(f'{source}: joints form a loop; expected a tree')
    return roots[0], tuple(ordered)


def rotation_from_rpy(rpy: np.ndarray) -> np.ndarray:
    """Return the rotation of roll, pitch, yaw: about fixed x, then y, then z; shape (3, 3)."""
    (a, b, c), (u, v, w) = np.cos(rpy), np.sin(rpy)
    return np.array(((c * b, c * v * u - w * a, c * v * a + w * u),
                     (w * b, w * v * u + c * a, w * v * a - c * u),
                     (-v, b * u, b * a)))
