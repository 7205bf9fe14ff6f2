"""Find palm, digits, finger tips, thumb, side and axes of a robot hand by geometry.

Nothing is read from names but to report where they contradict the geometry. The palm's frame is
that of the human hand: x distal, z dorsal, y = z × x, towards the thumb of a right hand.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.model.hand import FINGERS, SIDES
from .robot_model import RobotModel
from .robot_urdf import InvalidRobot

ROLES = ('thumb', *FINGERS)  # of a robot's digits
LEAST_ARM = 1e-6             # [m] of a digit about the axis that bends it
MIN_BONE = .008              # [m] between joints that bound a bone
FLEXION_COSINE = .7          # of a joint's axis to the digit's flexion axis
MISSING_TIP_SHARE = .8       # [1] of the last bone but one, where a URDF has no tip frame
CLEAR_MARGIN = .1            # of the best thumb's score over the next
GRIPPER_SAMPLES = 21         # positions of a gripper from one end of its range to the other
LEAST_STROKE = .001          # [m] by which the last links of a gripper come nearer as it closes
NAME_HINTS = {'thumb': ('thumb', 'thtip', 'thdistal'), 'index': ('index', 'fftip', 'ffdistal'),
              'middle': ('middle', 'mftip', 'mfdistal'), 'ring': ('ring', 'rftip', 'rfdistal'),
              'little': ('little', 'pinky', 'lftip', 'lfdistal')}


class Bone(NamedTuple):
    """Segment of a digit between two flexion joints, or to the tip.

    Attributes
    ----------
    joint : int
        That carries it.
    direction : ndarray, shape (3,)
        Unit vector in that joint's frame, distal.
    """

    joint: int
    direction: np.ndarray


class Digit(NamedTuple):
    """A finger or the thumb of a robot.

    Attributes
    ----------
    joints : tuple of int
        From the palm to the tip.
    base : int
        The first flexion joint of a finger (its MCP); the first joint of a thumb.
    tip_link : str
        Frame at the tip; the last link where there is none.
    tip : ndarray, shape (3,)
        The tip in the last joint's frame [m].
    bones : tuple of Bone
        From the base to the tip.
    flexion_axis : ndarray, shape (3,)
        Of the last joint with the hand open, in the robot's base frame; closing is positive.
    length : float
        From the base to the tip along the bones [m].
    """

    joints: tuple[int, ...]
    base: int
    tip_link: str
    tip: np.ndarray
    bones: tuple[Bone, ...]
    flexion_axis: np.ndarray
    length: float


class RobotAnatomy(NamedTuple):
    """Palm, digits, side and axes of a robot hand.

    Attributes
    ----------
    palm_joint : int
        Joint that moves the palm; -1 where the palm is the base.
    palm_link : str
    axes : ndarray, shape (3, 3)
        Columns: x distal, y, z dorsal of the palm, in the frame of what `palm_joint` moves.
    side : {'right', 'left'}
    digits : dict of str to Digit
        By role, a subset of `ROLES`.
    is_gripper : bool
        Two digits that only open and close: at most two variables move them.
    unsure : tuple of str
        Findings that a person should look at.
    """

    palm_joint: int
    palm_link: str
    axes: np.ndarray
    side: str
    digits: dict[str, Digit]
    is_gripper: bool
    unsure: tuple[str, ...]


def find_anatomy(model: RobotModel, tips: dict[str, str] | None = None,
                 side: str | None = None) -> RobotAnatomy:
    """Return palm, digits, side and axes of a robot hand.

    Parameters
    ----------
    model : RobotModel
    tips : dict of str to str, optional
        Tip link of each role; found by geometry when left out.
    side : {'right', 'left'}, optional
        Found by geometry when left out.

    Raises
    ------
    InvalidRobot
        If there are no two digits, or a link does not exist.
    """
    unsure: list[str] = []
    children = _children(model)
    if tips:
        leaves = [_link_joint(model, link, role) for role, link in tips.items()]
    else:
        leaves = [joint for joint in range(len(model.joint_names)) if not children[joint]]
    if len(leaves) < 2:
        raise InvalidRobot(f'{len(leaves)} movable chain found; a hand has at least two digits')
    frames = model.frames(model.open_position())
    palm = _common_ancestor(model, leaves)
    links = list(tips.values()) if tips else ['' for _ in leaves]
    if not tips and len(model.variables) == 1 and len(leaves) > 2:
        leaves, links = _gripper_leaves(model, leaves, frames)
    meeting = _meeting(model, leaves, palm)
    digits = [_digit(model, leaf, palm, link, frames, pad, unsure)
              for leaf, link, pad in zip(leaves, links, meeting)]
    if len(digits) > len(ROLES):
        raise InvalidRobot(f'{len(digits)} digits found; at most {len(ROLES)} are supported: '
                           'name their tips in the robot file (digits)')
    if _is_gripper(model, leaves, palm):
        return _gripper(model, palm, digits, tips, side, frames, unsure)
    if tips:
        if 'thumb' not in tips:
            raise InvalidRobot('digits: none of them is the thumb')
        number = list(tips).index('thumb')
    else:
        number = _find_thumb(digits, frames, unsure)
    digits[number] = thumb = _as_thumb(digits[number], model, frames)
    fingers = [digit for digit in digits if digit is not thumb]
    axes = _axes(fingers, frames)
    places = np.array([frames[1][finger.base] for finger in fingers]) @ axes[:, 1]
    found = _find_side(_thumb_points(thumb, frames) @ axes[:, 1], places, unsure)
    if side is not None and side != found:
        unsure.append(f'side: {side} as given; the geometry says {found}')
    if tips:
        by_role = dict(zip(tips, digits))
        _compare_order([role for role in tips if role != 'thumb'],
                       places if found == 'right' else -places, unsure)
    else:
        order = np.argsort(-places if (side or found) == 'right' else places, kind='stable')
        by_role = {'thumb': thumb, **{role: fingers[i] for role, i in zip(FINGERS, order)}}
        _compare_names(by_role, unsure)
    return _in_palm(model, palm, axes, frames, side or found, by_role, False, unsure)


def _find_side(thumb: float, fingers: np.ndarray, unsure: list[str]) -> str:
    """Return the side by where the thumb and the fingers' bases, (n,), are across the palm [m]."""
    across = thumb - np.mean(fingers)
    found = 'right' if across > 0. else 'left'
    # The base of one finger alone has no breadth.
    if abs(across) < max(.2 * np.ptp(fingers), 0. if len(fingers) > 1 else MIN_BONE):
        unsure.append(f'side: {found}, but the thumb is only {1e3 * abs(across):.0f} mm beside the '
                      "middle of the fingers' bases")
    return found


def gripper_positions(model: RobotModel) -> np.ndarray:
    """Return positions of a gripper over its range, shape (GRIPPER_SAMPLES, n) [rad or m].

    Parameters
    ----------
    model : RobotModel
    """
    shares = np.linspace(0., 1., GRIPPER_SAMPLES)[:, None]
    return model.lower + shares * (model.upper - model.lower)


def _is_gripper(model: RobotModel, leaves: list[int], palm: int) -> bool:
    """Return whether there are two digits, which at most two variables move."""
    moving = {int(model.joints.variable[joint]) for leaf in leaves
              for joint in joints_before(model, leaf) if joint > palm}
    return len(leaves) == 2 and len(moving) <= 2


def _meeting(model: RobotModel, leaves: list[int], palm: int) -> list[np.ndarray | None]:
    """Return where the last links of a gripper meet as it closes, in the frame of each [m].

    None for other hands, and where the links' origins do not come nearer.
    """
    unknown: list[np.ndarray | None] = [None for _ in leaves]
    if not _is_gripper(model, leaves, palm):
        return unknown
    places = [model.frames(position) for position in gripper_positions(model)]
    apart = [float(np.linalg.norm(origins[leaves[0]] - origins[leaves[1]]))
             for _, origins in places]
    if np.ptp(apart) < LEAST_STROKE:
        return unknown
    rotations, origins = places[int(np.argmin(apart))]
    middle = origins[leaves].mean(axis=0)
    return [rotations[leaf].T @ (middle - origins[leaf]) for leaf in leaves]


def _children(model: RobotModel) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in model.joint_names]
    for joint, parent in enumerate(model.joints.parent):
        if parent >= 0:
            children[parent].append(joint)
    return children


def _link_joint(model: RobotModel, link: str, role: str) -> int:
    if link not in model.links:
        raise InvalidRobot(f"digits: {role}: there is no link '{link}'; there are "
                           f'{", ".join(model.links)}')
    return model.links[link].joint


def joints_before(model: RobotModel, joint: int) -> list[int]:
    """Return the joints from the base to a joint, itself included."""
    found = []
    while joint >= 0:
        found.append(joint)
        joint = int(model.joints.parent[joint])
    return found[::-1]


def _common_ancestor(model: RobotModel, leaves: list[int]) -> int:
    palm = -1
    for steps in zip(*(joints_before(model, leaf) for leaf in leaves)):
        if len(set(steps)) > 1:
            break
        palm = steps[0]
    return palm


def _can_move(model: RobotModel, joint: int) -> bool:
    """Return whether a joint's limits differ."""
    variable = model.joints.variable[joint]
    return bool(model.upper[variable] > model.lower[variable])


def _closing_sign(model: RobotModel, joint: int) -> float:
    """Return the sign of a joint's movement as its variable goes to its far limit."""
    variable = model.joints.variable[joint]
    far = model.upper[variable] if (
        abs(model.upper[variable]) >= abs(model.lower[variable])) else model.lower[variable]
    return float(np.sign(far) * np.sign(model.joints.multiplier[joint])) or 1.


def _digit(model: RobotModel, leaf: int, palm: int, link: str,
           frames: tuple[np.ndarray, np.ndarray], pad: np.ndarray | None,
           unsure: list[str]) -> Digit:
    chain = [joint for joint in joints_before(model, leaf) if joint > palm]
    if palm >= 0:
        chain = [joint for joint in chain if palm in joints_before(model, joint)]
    if not chain:
        raise InvalidRobot(f"digits: link '{link}' does not move against the palm")
    tip_link, tip = _tip(model, chain, link, pad, unsure)
    rotations, origins = frames
    axis = rotations[leaf] @ model.joints.axis[leaf] * _closing_sign(model, leaf)
    flexing = [joint for joint in chain if abs(
        rotations[joint] @ model.joints.axis[joint] @ axis) > FLEXION_COSINE
        and not model.joints.is_prismatic[joint] and _can_move(model, joint)] or chain[-1:]
    bones, length = _bones(chain, flexing, tip, axis, frames)
    return Digit(tuple(chain), flexing[0], tip_link, tip, bones, axis, length)


def _as_thumb(digit: Digit, model: RobotModel, frames: tuple[np.ndarray, np.ndarray]) -> Digit:
    """Return a digit with its first joint as base, as a thumb's."""
    rotations = frames[0]
    flexing = [joint for joint in digit.joints if joint == digit.joints[0] or abs(
        rotations[joint] @ model.joints.axis[joint] @ digit.flexion_axis) > FLEXION_COSINE
        and _can_move(model, joint)]
    bones, length = _bones(list(digit.joints), flexing, digit.tip, None, frames)
    return digit._replace(base=digit.joints[0], bones=bones, length=length)


def _tip(model: RobotModel, chain: list[int], link: str, pad: np.ndarray | None,
         unsure: list[str]) -> tuple[str, np.ndarray]:
    leaf = chain[-1]
    if link:
        place = model.links[link]
        if np.linalg.norm(place.translation) >= MIN_BONE:
            return link, place.translation
    else:
        rigid = {name: place for name, place in model.links.items() if place.joint == leaf}
        link = max(rigid, key=lambda name: float(np.linalg.norm(rigid[name].translation)))
        if np.linalg.norm(rigid[link].translation) >= MIN_BONE:
            return link, rigid[link].translation
    if pad is not None:
        unsure.append(f"tip of '{link}': no frame at the tip; taken where the two meet as the "
                      'gripper closes')
        return link, pad
    if len(chain) < 2:
        unsure.append(f"tip of '{link}': no frame at the tip; taken at the link's origin")
        return link, np.zeros(3)
    # Straight on from the bone before, in the last joint's frame at zero.
    bone = model.joints.rotation[leaf].T @ model.joints.translation[leaf]
    unsure.append(f"tip of '{link}': no frame at the tip; guessed {100. * MISSING_TIP_SHARE:.0f} % "
                  'of the bone before, straight on: set tip_offset_mm')
    return link, MISSING_TIP_SHARE * bone


def _bones(chain: list[int], flexing: list[int], tip: np.ndarray, axis: np.ndarray | None,
           frames: tuple[np.ndarray, np.ndarray]) -> tuple[tuple[Bone, ...], float]:
    """Return the bones between flexion joints and to the tip, and the sum of their lengths."""
    rotations, origins = frames
    points = [origins[joint] for joint in flexing]
    points.append(origins[chain[-1]] + rotations[chain[-1]] @ tip)
    bones, total, start = [], 0., points[0]
    for k, joint in enumerate(flexing):
        step = points[k + 1] - start
        # A joint's origin may be anywhere along its axis.
        if axis is not None:
            step = step - (step @ axis) * axis
        size = float(np.linalg.norm(step))
        if size < MIN_BONE:
            continue
        following = flexing[k + 1] if k + 1 < len(flexing) else None
        carrier = chain[-1] if following is None else chain[chain.index(following) - 1]
        bones.append(Bone(max(carrier, joint), rotations[max(carrier, joint)].T @ step / size))
        total, start = total + size, points[k + 1]
    return tuple(bones), total


def _find_thumb(digits: list[Digit], frames: tuple[np.ndarray, np.ndarray],
                unsure: list[str]) -> int:
    """Return the digit without which the others' flexion axes are most alike."""
    bases = np.array([frames[1][digit.base] for digit in digits])
    scores = []
    for i in range(len(digits)):
        others = [digit for j, digit in enumerate(digits) if j != i]
        alike = np.linalg.norm(np.mean([digit.flexion_axis for digit in others], axis=0))
        rest = np.delete(bases, i, axis=0)
        # The others' bases lie beside each other along that axis.
        spread = np.linalg.norm(rest - rest.mean(axis=0), axis=1).mean()
        away = np.linalg.norm(bases[i] - rest.mean(axis=0))
        scores.append(alike + .1 * min(2., away / max(spread, 1e-6)))
    order = np.argsort(scores)[::-1]
    if scores[order[0]] - scores[order[1]] < CLEAR_MARGIN:
        unsure.append(f"thumb: taken is the digit of '{digits[order[0]].tip_link}'; that of "
                      f"'{digits[order[1]].tip_link}' is nearly as likely")
    return int(order[0])


def _axes(fingers: list[Digit], frames: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    rotations, origins = frames
    distal, palmar = np.zeros(3), np.zeros(3)
    for finger in fingers:
        along = origins[finger.joints[-1]] - origins[finger.base]
        if np.linalg.norm(along) < MIN_BONE:
            along = rotations[finger.joints[-1]] @ finger.tip
        along = along - (along @ finger.flexion_axis) * finger.flexion_axis
        length = np.linalg.norm(along)
        if length < LEAST_ARM:
            raise InvalidRobot(f"'{finger.tip_link}': its digit lies along the axis that bends it; "
                               'expected a digit that the axis moves')
        along /= length
        distal += along
        palmar += np.cross(finger.flexion_axis, along)
    return _frame(distal, -palmar)


def _frame(distal: np.ndarray, dorsal: np.ndarray) -> np.ndarray:
    """Return the columns x, y, z of the frame nearest to two directions."""
    x = distal / np.linalg.norm(distal)
    z = dorsal - (dorsal @ x) * x
    if np.linalg.norm(z) < 1e-3:
        raise InvalidRobot('the fingers bend in no common direction: name in the robot file '
                           '(digits) as fingers those that bend alike, as thumb one against them')
    z /= np.linalg.norm(z)
    return np.column_stack((x, np.cross(z, x), z))


def _thumb_points(thumb: Digit, frames: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    rotations, origins = frames
    tip = origins[thumb.joints[-1]] + rotations[thumb.joints[-1]] @ thumb.tip
    return np.mean([*(origins[joint] for joint in thumb.joints), tip], axis=0)


def _gripper_leaves(model: RobotModel, leaves: list[int], frames: tuple[np.ndarray, np.ndarray]
                    ) -> tuple[list[int], list[str]]:
    """Return the two farthest moving links of a one-variable gripper."""
    reach = []
    for leaf in leaves:
        rigid = {name: frames[1][leaf] + frames[0][leaf] @ place.translation
                 for name, place in model.links.items() if place.joint == leaf}
        link = max(rigid, key=lambda name: float(np.linalg.norm(rigid[name])))
        reach.append((float(np.linalg.norm(rigid[link])), leaf, link))
    chosen = sorted(reach, reverse=True)[:2]
    return [leaf for _, leaf, _ in chosen], [link for _, _, link in chosen]


def _gripper(model: RobotModel, palm: int, digits: list[Digit], tips: dict[str, str] | None,
             side: str | None, frames: tuple[np.ndarray, np.ndarray],
             unsure: list[str]) -> RobotAnatomy:
    """Return a gripper: y from the finger to the thumb, x from the palm to both."""
    roles = list(tips) if tips else ['thumb', 'index']
    if 'thumb' not in roles:
        raise InvalidRobot('digits: one of the two of a gripper is the thumb')
    by_role = dict(zip(roles, digits))
    rotations, origins = frames
    ends = {role: origins[digit.joints[-1]] + rotations[digit.joints[-1]] @ digit.tip
            for role, digit in by_role.items()}
    start = origins[palm] if palm >= 0 else np.zeros(3)
    finger = next(role for role in roles if role != 'thumb')
    across = ends['thumb'] - ends[finger]
    if np.linalg.norm(across) < 1e-6:
        across = _opening(model, by_role, finger)
    distal = .5 * (ends['thumb'] + ends[finger]) - start
    across = across / np.linalg.norm(across)
    distal = distal - (distal @ across) * across
    if np.linalg.norm(distal) < 1e-6:
        raise InvalidRobot('gripper: its tips are not in front of its palm')
    x = distal / np.linalg.norm(distal)
    axes = np.column_stack((x, across, np.cross(x, across)))
    return _in_palm(model, palm, axes, frames, side or SIDES[0], by_role, True, unsure)


def _opening(model: RobotModel, by_role: dict[str, Digit], finger: str) -> np.ndarray:
    """Return the thumb's tip from the finger's at the far limits."""
    far = np.where(np.abs(model.upper) >= np.abs(model.lower), model.upper, model.lower)
    rotations, origins = model.frames(far)
    ends = [origins[digit.joints[-1]] + rotations[digit.joints[-1]] @ digit.tip
            for digit in (by_role['thumb'], by_role[finger])]
    if np.linalg.norm(ends[0] - ends[1]) < 1e-6:
        raise InvalidRobot('gripper: its tips coincide')
    return ends[0] - ends[1]


def _in_palm(model: RobotModel, palm: int, axes: np.ndarray,
             frames: tuple[np.ndarray, np.ndarray], side: str, digits: dict[str, Digit],
             is_gripper: bool, unsure: list[str]) -> RobotAnatomy:
    rotation = frames[0][palm] if palm >= 0 else np.eye(3)
    links = [name for name, place in model.links.items() if place.joint == palm]
    return RobotAnatomy(palm, links[0], rotation.T @ axes, side, digits, is_gripper,
                        tuple(unsure))


def _compare_order(roles: list[str], from_thumb: np.ndarray, unsure: list[str]) -> None:
    """Note given fingers that lie in another order beside each other, `from_thumb` on [m]."""
    place = dict(zip(roles, from_thumb))
    given = sorted(roles, key=FINGERS.index)
    if any(place[after] - place[one] > MIN_BONE for one, after in zip(given, given[1:])):
        found = sorted(roles, key=lambda role: -place[role])
        unsure.append(f"digits: from the thumb's side on they lie as {', '.join(found)}: is the "
                      "file of the other hand's side, or are their tips exchanged?")


def _compare_names(digits: dict[str, Digit], unsure: list[str]) -> None:
    for role, digit in digits.items():
        name = digit.tip_link.lower()
        named = [other for other, hints in NAME_HINTS.items() if any(hint in name
                                                                     for hint in hints)]
        if named and role not in named:
            unsure.append(f"{role}: by geometry the digit of '{digit.tip_link}', whose name says "
                          f'{" or ".join(named)}')
