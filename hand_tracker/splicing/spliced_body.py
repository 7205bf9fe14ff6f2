"""A body's motion with tracked hands on it: the body's numbers as they are, fingers added."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..core.errors import HandTrackerError
from ..files.bvh_file import (
    EULER_ORDERS,
    BvhJoint,
    BvhMotion,
    channel_columns,
    depth_first,
    euler_degrees,
    joint_poses,
    rotation_channels,
)
from ..files.skeleton_motion import SkeletonMotion
from ..files.written_kinds import WRISTS
from .body_skeleton import BodyHand, hand_joint_names, skeleton_naming
from .clock_alignment import ClockAlignment, Trajectory
from .hand_mount import HandMount, fit_mount, rest_mount


class SplicedHand(NamedTuple):
    """A tracked hand and where it belongs on a body.

    Attributes
    ----------
    place : BodyHand
    motion : SkeletonMotion
        Of the hand.
    alignment : ClockAlignment
    mount : HandMount
    """

    place: BodyHand
    motion: SkeletonMotion
    alignment: ClockAlignment
    mount: HandMount


def body_times(body: BvhMotion) -> np.ndarray:
    """Return the time of each frame, the first 0 [s]."""
    return np.arange(len(body.values)) * body.period


def wrist_motion(body: BvhMotion, joint: int) -> tuple[Trajectory, np.ndarray]:
    """Return the path of a joint in the file's unit, and its rotations (T, 3, 3)."""
    chain = [joint]
    while body.joints[chain[0]].parent >= 0:
        chain.insert(0, body.joints[chain[0]].parent)
    columns = channel_columns(body.joints)
    values = np.concatenate([body.values[:, columns[i]] for i in chain], axis=1)
    joints = [body.joints[i]._replace(parent=above) for above, i in enumerate(chain, -1)]
    places, turns = joint_poses(joints, values)
    return Trajectory(body_times(body), places[:, -1]), turns[-1]


def overlapping(hand_times: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the mask of the times that a hand's recording covers."""
    return (times >= hand_times[0]) & (times <= hand_times[-1])


def mount_hand(body: BvhMotion, place: BodyHand, motion: SkeletonMotion,
               alignment: ClockAlignment, unit: float) -> HandMount:
    """Return the mount of a hand on a body's wrist: fitted to both, else as in the T-pose.

    Parameters
    ----------
    body : BvhMotion
    place : BodyHand
    motion : SkeletonMotion
        Of the hand.
    alignment : ClockAlignment
    unit : float
        Of the body [m].

    Returns
    -------
    HandMount
    """
    path, turns = wrist_motion(body, place.wrist)
    times = alignment.hand_times(path.times)
    inside = overlapping(motion.times, times)
    if inside.sum() > 1:
        places = np.stack([np.interp(times[inside], motion.times, axis)
                           for axis in motion.root_position.T], axis=1)
        hand_turns = Rotation.from_quat(_resampled(motion, 0, times[inside])).as_matrix()
        fitted = fit_mount(unit * path.positions[inside], turns[inside], places, hand_turns)
        if fitted is not None and fitted.is_fitted:
            return fitted
    return rest_mount(place.side, np.array(body.joints[place.wrist].offset))


def splice(body: BvhMotion, hands: Sequence[SplicedHand], unit: float,
           wrist: str = WRISTS[0]) -> BvhMotion:
    """Return a body's motion with tracked hands in the place of its own.

    All joints but the fingers, and with `wrist='hand'` the wrists' rotations, keep their numbers
    to the bit. Hands are interpolated to the body's frames; before and after their recording
    they rest as they were first and last.

    Parameters
    ----------
    body : BvhMotion
    hands : sequence of SplicedHand
    unit : float
        Of the body [m].
    wrist : {'body', 'hand'}, optional
        Whose rotation the wrist has.

    Returns
    -------
    BvhMotion
    """
    naming = skeleton_naming(body.joints)
    by_wrist = {hand.place.wrist: hand for hand in hands}
    replaced = {joint for hand in hands for joint in hand.place.digits}
    columns = channel_columns(body.joints)
    joints: list[BvhJoint] = []
    values: list[np.ndarray] = []
    moved: dict[int, int] = {-1: -1}     # new place of each joint of the body
    for i, joint in enumerate(body.joints):
        if i in replaced:
            continue
        moved[i] = len(joints)
        joints.append(joint._replace(parent=moved[joint.parent]))
        own = body.values[:, columns[i]]
        if i not in by_wrist:
            values.append(own)
            continue
        hand = by_wrist[i]
        order = _euler_order(joint)
        if wrist == 'hand':
            own = _with_wrist_of_hand(body, hand, own, order)
        values.append(own)
        names = hand_joint_names(naming, hand.place)
        _append_hand(hand, unit, order, names, body_times(body), joints, values)
    return BvhMotion(tuple(joints), np.concatenate(values, axis=1), body.period)


def _euler_order(joint: BvhJoint) -> str:
    """Return the order of a joint's Euler angles, the usual one where it has not all three."""
    order = ''.join(channel[0] for channel in joint.channels if channel.endswith('rotation'))
    return order if order in EULER_ORDERS else EULER_ORDERS[0]


def _with_wrist_of_hand(body: BvhMotion, hand: SplicedHand, own: np.ndarray,
                        order: str) -> np.ndarray:
    """Return a wrist's numbers with the rotation of the tracked hand."""
    joint = body.joints[hand.place.wrist]
    columns = [i for i, name in enumerate(joint.channels) if name.endswith('rotation')]
    if len(columns) < len(order):
        raise HandTrackerError(f'{joint.name}: {len(columns)} rotations; expected three with '
                               '--wrist hand')
    if not hand.mount.is_fitted:
        raise HandTrackerError(
            f"{joint.name}: how the {hand.place.side} hand's world is turned to the body's cannot "
            'be told, as the wrist moves too little or otherwise; expected --wrist body')
    _, above = wrist_motion(body, joint.parent)
    times = hand.alignment.hand_times(body_times(body))
    turns = Rotation.from_quat(_resampled(hand.motion, 0, times)).as_matrix()
    turns = hand.mount.world.T @ turns @ hand.mount.wrist.T
    local = Rotation.from_matrix(above.swapaxes(1, 2) @ turns).as_quat()
    own = own.copy()
    own[:, columns] = euler_degrees(local, order)
    return own


def _append_hand(hand: SplicedHand, unit: float, order: str, names: Sequence[str],
                 times: np.ndarray, joints: list[BvhJoint], values: list[np.ndarray]) -> None:
    """Append the joints behind the wrist, which is the last of the joints, and their numbers."""
    motion, turn = hand.motion, hand.mount.wrist
    mount = Rotation.from_matrix(turn)
    hand_times = hand.alignment.hand_times(times)
    places = {0: len(joints) - 1}
    for joint in depth_first(motion.parents)[1:]:
        places[joint] = len(joints)
        joints.append(BvhJoint(names[joint - 1], places[motion.parents[joint]],
                               _offset(turn @ motion.offsets[joint], unit),
                               rotation_channels(order)))
        local = mount * Rotation.from_quat(_resampled(motion, joint, hand_times)) * mount.inv()
        values.append(euler_degrees(local.as_quat(), order))
        if joint in motion.ends:
            joints.append(BvhJoint('', places[joint], _offset(turn @ motion.ends[joint], unit),
                                   ()))


def _offset(vector: np.ndarray, unit: float) -> tuple[float, ...]:
    return tuple((vector / unit).tolist())


def _resampled(motion: SkeletonMotion, joint: int, times: np.ndarray) -> np.ndarray:
    """Return a joint's rotations at other times, on great circles between frames, (T, 4)."""
    own, first = np.unique(motion.times, return_index=True)
    rotations = Rotation.from_quat(motion.rotation[first, joint])
    if len(own) == 1:
        return np.repeat(motion.rotation[:1, joint], len(times), axis=0)
    return Slerp(own, rotations)(np.clip(times, own[0], own[-1])).as_quat()
