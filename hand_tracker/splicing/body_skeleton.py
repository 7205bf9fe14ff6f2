"""Body skeletons of motion capture programs: which joints are the wrists and the fingers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from ..calibration.hand_axes import BODY_SIZE, likely_unit, nearest_unit
from ..core.errors import HandTrackerError
from ..core.model.hand import SIDES
from ..files.bvh_file import BvhJoint, depth_first, rest_size
from ..files.point_recording import UNIT_SPELLINGS, UNIT_WORDS
from ..files.skeleton_motion import joint_names

# 'RightHand', 'mixamorig:LeftHand', 'Skeleton_RHand', 'RightWrist', 'hand_l'.
WRIST_NAME = re.compile(
    r'(?P<prefix>.*[:_\s.-])?(?P<side>left|right|l|r)[_\s.-]?(hand|wrist)', re.IGNORECASE)
WRIST_NAME_REVERSED = re.compile(
    r'(?P<prefix>.*[:_\s.-])?(hand|wrist)[_\s.-](?P<side>left|right|l|r)', re.IGNORECASE)
DIGIT_NAME = re.compile(
    r'thumb|index|middle|mid\d|ring|pink[yi]|little|finger|(first|second|third|fourth|fifth)'
    r'(mc|pp|mp|dp)', re.IGNORECASE)
XSENS_NAMES = 'rightcollar', 'leftcollar', 'l5', 't8'
UNIT_TOLERANCE = .2        # by which a measured unit may differ from a usual one, of it


class SkeletonError(HandTrackerError):
    """A body skeleton whose wrists are not recognised; the message names its joints."""


class BodyHand(NamedTuple):
    """A hand of a body skeleton.

    Attributes
    ----------
    side : {'right', 'left'}
    wrist : int
        Joint that turns the hand.
    prefix : str
        Of its name and of those of the other joints, as 'mixamorig:'.
    digits : frozenset of int
        Joints and ends below it that are fingers, or that end the hand.
    """

    side: str
    wrist: int
    prefix: str
    digits: frozenset[int]


def body_hands(joints: Sequence[BvhJoint]) -> dict[str, BodyHand]:
    """Return the hands of a body skeleton, by side.

    Recognised are the names of HumanIK, Mixamo, Xsens, Rokoko and OptiTrack, and others that
    name a side and 'hand' or 'wrist'.

    Parameters
    ----------
    joints : sequence of BvhJoint

    Returns
    -------
    dict of str to BodyHand
    """
    found: dict[str, BodyHand] = {}
    for i, joint in enumerate(joints):
        named = _wrist_name(joint)
        if named is None or not joint.channels or joint.parent < 0:
            continue
        side = next(side for side in SIDES if side[0] == named['side'][0].lower())
        # The first is the wrist where a hand hangs from it.
        found.setdefault(side, BodyHand(side, i, named['prefix'] or '', _digits(joints, i)))
    return found


def _wrist_name(joint: BvhJoint) -> re.Match[str] | None:
    return WRIST_NAME.fullmatch(joint.name) or WRIST_NAME_REVERSED.fullmatch(joint.name)


def require_hand(joints: Sequence[BvhJoint], side: str, file: str) -> BodyHand:
    """Return the hand of a side.

    Raises
    ------
    SkeletonError
        If it is not recognised.
    """
    hands = body_hands(joints)
    if side not in hands:
        root = joints[0]
        if root.parent < 0 and _wrist_name(root) is not None:
            raise SkeletonError(f'{file}: {root.name} is its root: the skeleton of a hand alone; '
                                'expected that of a body, whose wrists hang on its arms')
        names = [joint.name for joint in joints if joint.channels]
        raise SkeletonError(
            f"{file}: no joint is a {side} wrist by its name; expected {side.title()}Hand, "
            f"{side.title()}Wrist, {side[0].upper()}Hand, as HumanIK, Mixamo, Xsens, Rokoko and "
            f"OptiTrack have; there are {', '.join(names[:40])}")
    return hands[side]


def _digits(joints: Sequence[BvhJoint], wrist: int) -> frozenset[int]:
    parents = [joint.parent for joint in joints]
    found: set[int] = set()
    for child, parent in enumerate(parents):
        if parent == wrist:
            below = depth_first(parents, child)
            if not joints[child].channels or any(DIGIT_NAME.search(joints[i].name)
                                                 for i in below):
                found.update(below)
    return frozenset(found)


def skeleton_naming(joints: Sequence[BvhJoint]) -> str:
    """Return whose names a body skeleton has: one of `NAMINGS`, 'humanik' where it is unclear.

    Parameters
    ----------
    joints : sequence of BvhJoint

    Returns
    -------
    str
    """
    own = [joint.name.rpartition(':')[2] for joint in joints]
    plain = {name.lower() for name in own}
    if any('mixamorig' in joint.name.lower() for joint in joints):
        return 'mixamo'
    if plain & set(XSENS_NAMES):
        return 'xsens'
    if any(re.search(r'(^|_)[LR](Hand|FArm|UArm)$', name) for name in own):
        return 'optitrack'
    if (any(re.fullmatch(r'(right|left)finger\d\w+', name) for name in plain)
            or 'spine1' in plain and 'spine' not in plain):
        return 'rokoko'
    return 'humanik'


def hand_joint_names(naming: str, hand: BodyHand) -> tuple[str, ...]:
    """Return names for the joints behind a wrist, with the prefix of the body's.

    Parameters
    ----------
    naming : str
        One of `NAMINGS`.
    hand : BodyHand

    Returns
    -------
    tuple of str, length 19
        Of `SKELETON_LINKS`.
    """
    return tuple(hand.prefix + name.rpartition(':')[2]
                 for name in joint_names(naming, hand.side)[1:])


def body_unit(joints: Sequence[BvhJoint], measured: float | None) -> tuple[float, str]:
    """Return the unit of a body skeleton, which no BVH file says.

    Parameters
    ----------
    joints : sequence of BvhJoint
    measured : float or None
        By how much the wrist moves in metres where it moves by one unit, if that is known.

    Returns
    -------
    unit : float
        [m]
    note : str
        How it was found.
    """
    guess = measured or BODY_SIZE / rest_size(joints)
    named = nearest_unit(1. / guess, UNIT_SPELLINGS) if measured else likely_unit(1. / guess)
    unit = UNIT_SPELLINGS[named][0]
    if measured and abs(unit / guess - 1.) > UNIT_TOLERANCE:
        return guess, f'unit of {guess:.4g} m, as the wrist moves'
    reason = 'the wrist moves' if measured else 'its size tells'
    return unit, f'in {UNIT_WORDS.get(named, named)}, as {reason}'
