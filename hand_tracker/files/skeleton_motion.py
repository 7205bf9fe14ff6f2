"""A tracked hand as a skeleton in motion, for animation files: joints, offsets, rotations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS, JOINTS, LINKS, Hand
from ..core.model.kinematics import Pose, forward, joint_table, tip_offsets
from .point_recording import ROTATIONS, Axes, PointRecording, even_rows, nominal_rate, usual_rate
from .written_kinds import NAMINGS

# Joints behind the wrist: the link that each turns, parents first. Abduction and flexion of a
# knuckle are one joint.
SKELETON_LINKS = tuple(
    f'{digit}_{link}' for digit in DIGITS for link in (
        ('metacarpal', 'proximal', 'distal') if digit == 'thumb' else
        ('metacarpal', 'proximal', 'middle', 'distal')))
LANDMARK_AT_LINK = {
    f'{digit}_{link}': f'{digit}_{landmark}' for digit in DIGITS for link, landmark in zip(
        ('metacarpal', 'proximal', 'distal') if digit == 'thumb' else
        ('metacarpal', 'proximal', 'middle', 'distal'),
        ('cmc', 'mcp', 'ip') if digit == 'thumb' else ('cmc', 'mcp', 'pip', 'dip'))}
PINKY_NAMINGS = 'humanik', 'mixamo', 'optitrack'    # others say little
ORDINALS = {'thumb': 'First', 'index': 'Second', 'middle': 'Third', 'ring': 'Fourth',
            'little': 'Fifth'}
# A hand of a T-pose has its fingers along x on the left and against x on the right, the back up.
T_POSE_TURN = {'left': np.eye(3), 'right': np.diag((-1., 1., -1.))}
POSES_AT_ONCE = 2**12
SINGLE_FRAME = .01         # [s] that a motion of one frame lasts
HANDS_ROOT = 'hands'       # above the wrists of both hands


class SkeletonMotion(NamedTuple):
    """A skeleton whose joints have the axes of the world, y up, in the T-pose, and its motion.

    Attributes
    ----------
    names : tuple of str, length J
        Of the joints, the root (of a hand: the wrist) first, each after its parent.
    parents : tuple of int, length J
        -1 for the root.
    offsets : ndarray, shape (J, 3)
        From the parent, in the T-pose [m].
    ends : mapping of int to ndarray, shape (3,)
        End of each chain from its last joint: a finger's tip [m].
    root_position : ndarray, shape (T, 3)
        [m]
    rotation : ndarray, shape (T, J, 4)
        From each joint's axes to those of its parent: quaternions x, y, z, w.
    times : ndarray, shape (T,)
        The first is 0 [s].
    translations : mapping of int to ndarray, shape (T, 3)
        From the parent, of other joints than the root that move in it [m].
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    ends: Mapping[int, np.ndarray]
    root_position: np.ndarray
    rotation: np.ndarray
    times: np.ndarray
    translations: Mapping[int, np.ndarray] = {}

    @property
    def period(self) -> float:
        """The usual time between two frames [s]."""
        return usual_step(self.times)

    @property
    def origins(self) -> np.ndarray:
        """Where the joints are in the T-pose, from the root, shape (J, 3) [m]."""
        origins = np.zeros((len(self.parents), 3))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                origins[joint] = origins[parent] + self.offsets[joint]
        return origins


class HandAngles(NamedTuple):
    """Angles and wrist of one hand over time.

    Attributes
    ----------
    hand : Hand
    angles : ndarray, shape (T, 25)
        [rad]
    wrist_position : ndarray, shape (T, 3)
        [m]
    wrist_rotation : ndarray, shape (T, 3, 3)
    times : ndarray, shape (T,)
        [s]
    """

    hand: Hand
    angles: np.ndarray
    wrist_position: np.ndarray
    wrist_rotation: np.ndarray
    times: np.ndarray


class TrackedHands(NamedTuple):
    """Both hands of a recording: each in those of its frames in which it was tracked.

    Attributes
    ----------
    hands : tuple of HandAngles
        Each of them may have no frame.
    rows : tuple of ndarray of int
        Of each hand the place of its frames among all frames.
    times : ndarray, shape (T,)
        Of the frames that have one hand or more [s].
    start : int
        Stamp of the first of them [ns].
    """

    hands: tuple[HandAngles, ...]
    rows: tuple[np.ndarray, ...]
    times: np.ndarray
    start: int = 0


def usual_step(times: np.ndarray) -> float:
    """Return the usual time between two frames [s]."""
    if len(times) < 2:
        return SINGLE_FRAME
    rate = nominal_rate(times)
    return 1. / rate if rate else float(np.median(np.diff(times)))


def resampled_hand(tracked: HandAngles, own: np.ndarray, times: np.ndarray) -> HandAngles:
    """Return a tracked hand at other times within its own, those of one frame everywhere."""
    if len(own) == 1:
        rest = np.zeros(len(times), dtype=int)
        return tracked._replace(
            angles=tracked.angles[rest], wrist_rotation=tracked.wrist_rotation[rest],
            wrist_position=tracked.wrist_position[rest], times=times)
    # Here, as it takes a while, and few files need it.
    from scipy.spatial.transform import Rotation, Slerp

    own, first = np.unique(own, return_index=True)

    def interpolated(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, own, column) for column in values[first].T], axis=1)

    turns = Slerp(own, Rotation.from_matrix(tracked.wrist_rotation[first]))(times)
    return tracked._replace(
        angles=interpolated(tracked.angles), wrist_rotation=turns.as_matrix(),
        wrist_position=interpolated(tracked.wrist_position), times=times)


def evenly_timed(tracked: HandAngles) -> HandAngles:
    """Return a tracked hand with frames between those that were not tracked, as times say."""
    if len(tracked.times) < 2:
        return tracked
    rows = even_rows(tracked.times)
    count = int(rows[-1]) + 1
    if count == len(rows):
        return tracked
    return resampled_hand(tracked, tracked.times, np.interp(np.arange(count), rows, tracked.times))


def completed_hands(tracked: TrackedHands, evenly: bool = False) -> list[HandAngles]:
    """Return the hands that were tracked at all, each with a pose in every frame.

    A hand that a frame has not is between its poses before and after; in front of the first and
    behind the last it rests.

    Parameters
    ----------
    tracked : TrackedHands
    evenly : bool, optional
        Whether there are frames between those that have no hand, too, see `evenly_timed`.

    Returns
    -------
    list of HandAngles
    """
    steps = even_rows(tracked.times) if len(tracked.times) > 1 else np.zeros(1, dtype=int)
    frames = np.arange(int(steps[-1]) + 1) if evenly else steps
    times = np.interp(frames, steps, tracked.times)
    found = []
    for hand, rows in zip(tracked.hands, tracked.rows):
        if len(rows):
            # By frames and not by times, which may jump back.
            own = steps[rows]
            inside = np.clip(frames, own[0], own[-1])
            found.append(resampled_hand(hand, own, inside)._replace(times=times))
    return found


def t_pose_turn(side: str) -> np.ndarray:
    """Return the turn from the wrist's frame to the axes of the T-pose, shape (3, 3)."""
    return T_POSE_TURN[side] @ np.array(ROTATIONS['y'], dtype=float).T


def joint_names(naming: str, side: str) -> tuple[str, ...]:
    """Return the names of the wrist and of `SKELETON_LINKS` as a program knows them.

    HumanIK, Mixamo, Unity and OptiTrack have no names for all metacarpals: they get ones that
    retargeting leaves alone.

    Parameters
    ----------
    naming : str
        One of `NAMINGS`.
    side : {'right', 'left'}

    Returns
    -------
    tuple of str, length 20
    """
    hand = side[:1].upper() if naming == 'optitrack' else side.title()
    prefix = f'mixamorig:{hand}' if naming == 'mixamo' else hand
    names = [f'{prefix}Hand']
    for link in SKELETON_LINKS:
        digit, _, bone = link.partition('_')
        finger = 'Pinky' if digit == 'little' and naming in PINKY_NAMINGS else digit.title()
        is_thumb = digit == 'thumb'
        if naming == 'xsens':
            short = {'metacarpal': 'MC', 'proximal': 'PP', 'middle': 'MP', 'distal': 'DP'}[bone]
            names.append(f'{hand}{ORDINALS[digit]}{short}')
        elif naming == 'unity':
            part = {'metacarpal': 'Proximal', 'proximal': 'Intermediate', 'distal': 'Distal'}[
                bone] if is_thumb else {'metacarpal': 'Metacarpal', 'proximal': 'Proximal',
                                        'middle': 'Intermediate', 'distal': 'Distal'}[bone]
            names.append(f'{hand}{finger}{part}')
        elif naming == 'rokoko':
            part = 'Medial' if bone == 'middle' else bone.title()
            names.append(f'{hand}Finger{1 + list(ORDINALS).index(digit)}{part}')
        else:
            number = ('metacarpal', 'proximal', 'middle', 'distal').index(bone)
            number = {0: 1, 1: 2, 3: 3}[number] if is_thumb else number
            if not number and naming in ('humanik', 'optitrack'):
                names.append(f'{hand}InHand{finger}')
            elif naming == 'optitrack':
                names.append(f'{hand}{finger}{number}')
            else:
                names.append(f'{prefix}Hand{finger}{number}')
    return tuple(names)


def skeleton_motion(tracked: HandAngles, naming: str = NAMINGS[0]) -> SkeletonMotion:
    """Return a tracked hand as a skeleton in motion.

    Parameters
    ----------
    tracked : HandAngles
    naming : str, optional
        One of `NAMINGS`.

    Returns
    -------
    SkeletonMotion
    """
    from scipy.spatial.transform import Rotation

    hand = tracked.hand
    rest = _skeleton_pose(forward(joint_table(hand), np.zeros(len(JOINTS))))
    parents = _parents()
    to_y_up = np.array(ROTATIONS['y'], dtype=float).T
    to_t_pose = t_pose_turn(hand.side)
    origins = np.concatenate((np.zeros((1, 3)), rest.position))
    offsets = origins - origins[np.maximum(parents, 0)]
    rotation = np.empty((len(tracked.angles), len(parents), 4))
    rotation[:, 0] = Rotation.from_matrix(
        to_y_up @ tracked.wrist_rotation @ to_t_pose.T).as_quat()
    for first in range(0, len(rotation), POSES_AT_ONCE):
        frames = slice(first, first + POSES_AT_ONCE)
        pose = _skeleton_pose(forward(joint_table(hand), tracked.angles[frames]))
        # From the T-pose, in axes of the wrist.
        turned = pose.rotation @ rest.rotation.swapaxes(1, 2)
        for joint in range(1, len(parents)):
            local = turned[:, joint - 1]
            if parents[joint]:
                local = turned[:, parents[joint] - 1].swapaxes(1, 2) @ local
            rotation[frames, joint] = Rotation.from_matrix(
                to_t_pose @ local @ to_t_pose.T).as_quat()
    _make_continuous(rotation)
    last = [1 + SKELETON_LINKS.index(f'{digit}_distal') for digit in DIGITS]
    tips = np.einsum('dij,dj->di', rest.rotation[np.array(last) - 1], tip_offsets(hand))
    return SkeletonMotion(
        joint_names(naming, hand.side), tuple(parents), offsets @ to_t_pose.T,
        dict(zip(last, tips @ to_t_pose.T)), tracked.wrist_position @ to_y_up.T, rotation,
        tracked.times - tracked.times[:1])


def joined_skeletons(body: SkeletonMotion, others: Sequence[SkeletonMotion]) -> SkeletonMotion:
    """Return skeletons below the root of another one, which rests, as one skeleton.

    Parameters
    ----------
    body : SkeletonMotion
        Its joints come first.
    others : sequence of SkeletonMotion
        At the same times. Their roots move in that of the body, and stand in its T-pose in the
        middle of where they go.

    Returns
    -------
    SkeletonMotion
    """
    names, parents = list(body.names), list(body.parents)
    offsets, turns = [body.offsets], [body.rotation]
    ends, translations = dict(body.ends), dict(body.translations)
    for motion in others:
        first = len(names)
        names += motion.names
        parents += [0, *(first + parent for parent in motion.parents[1:])]
        translations[first] = motion.root_position
        offsets += [np.median(motion.root_position, axis=0, keepdims=True), motion.offsets[1:]]
        ends |= {first + joint: end for joint, end in motion.ends.items()}
        turns.append(motion.rotation)
    return body._replace(
        names=tuple(names), parents=tuple(parents), offsets=np.concatenate(offsets), ends=ends,
        rotation=np.concatenate(turns, axis=1), translations=translations)


def resting_root(name: str, times: np.ndarray) -> SkeletonMotion:
    """Return a skeleton of one joint that stays at the origin."""
    return SkeletonMotion((name,), (-1,), np.zeros((1, 3)), {}, np.zeros((len(times), 3)),
                          np.tile((0., 0., 0., 1.), (len(times), 1, 1)), times - times[:1])


def hands_motion(tracked: TrackedHands, naming: str = NAMINGS[0],
                 evenly: bool = False) -> SkeletonMotion:
    """Return both hands as one skeleton in motion: their wrists below a root in the origin.

    Parameters
    ----------
    tracked : TrackedHands
        A hand that was never tracked is left out.
    naming : str, optional
        One of `NAMINGS`.
    evenly : bool, optional
        See `completed_hands`.

    Returns
    -------
    SkeletonMotion
    """
    hands = completed_hands(tracked, evenly)
    return joined_skeletons(resting_root(HANDS_ROOT, hands[0].times),
                            [skeleton_motion(hand, naming) for hand in hands])


def joint_centres(tracked: HandAngles, name: str) -> PointRecording:
    """Return the joint centres and tips of a tracked hand as a recording of points.

    Parameters
    ----------
    tracked : HandAngles
    name : str
        Of the recording.

    Returns
    -------
    PointRecording
        Labels such as 'right_index_pip'.
    """
    hand = tracked.hand
    labels = ['wrist', *(LANDMARK_AT_LINK[link] for link in SKELETON_LINKS),
              *(f'{digit}_tip' for digit in DIGITS)]
    points = np.empty((len(tracked.angles), len(labels), 3), dtype=np.float32)
    distal = [SKELETON_LINKS.index(f'{digit}_distal') for digit in DIGITS]
    for first in range(0, len(points), POSES_AT_ONCE):
        frames = slice(first, first + POSES_AT_ONCE)
        pose = _skeleton_pose(forward(
            joint_table(hand), tracked.angles[frames], tracked.wrist_rotation[frames],
            tracked.wrist_position[frames]))
        tips = pose.position[:, distal] + np.einsum(
            'tdij,dj->tdi', pose.rotation[:, distal], tip_offsets(hand))
        points[frames] = np.concatenate(
            (tracked.wrist_position[frames, None], pose.position, tips), axis=1)
    stamps = tracked.times - tracked.times[0] if len(points) else None
    return PointRecording(name, 'tracked hand', tuple(f'{hand.side}_{label}' for label in labels),
                          points, _rate(tracked.times), stamps, Axes('m', 'z'), (), True)


def hands_centres(tracked: TrackedHands, name: str) -> PointRecording:
    """Return the joint centres and tips of both hands as a recording of points.

    Parameters
    ----------
    tracked : TrackedHands
    name : str
        Of the recording.

    Returns
    -------
    PointRecording
        NaN in frames in which a hand was not tracked.
    """
    labels: list[str] = []
    points = []
    for hand, rows in zip(tracked.hands, tracked.rows):
        one = joint_centres(hand, name)
        found = np.full((len(tracked.times), *one.points.shape[1:]), np.nan, dtype=np.float32)
        found[rows] = one.points
        labels += one.labels
        points.append(found)
    return PointRecording(
        name, 'tracked hands', tuple(labels), np.concatenate(points, axis=1),
        _rate(tracked.times), tracked.times - tracked.times[0], Axes('m', 'z'), (), True)


def _rate(times: np.ndarray) -> float:
    """Return the rate of frames [Hz]."""
    return usual_rate(times) if len(times) > 1 else 1. / SINGLE_FRAME


def _skeleton_pose(pose: Pose) -> Pose:
    rows = [LINKS.index(link) for link in SKELETON_LINKS]
    return Pose(pose.rotation[..., rows, :, :], pose.position[..., rows, :])


def _parents() -> np.ndarray:
    """Return the parent of the wrist, -1, and of each of `SKELETON_LINKS`, 0 being the wrist."""
    digits = [link.partition('_')[0] for link in SKELETON_LINKS]
    return np.array([-1, *(i if i and digits[i] == digits[i - 1] else 0
                           for i in range(len(digits)))])


def _make_continuous(rotation: np.ndarray) -> None:
    """Choose of q and -q the one nearer to the frame before, in place, (T, J, 4)."""
    steps = np.einsum('tji,tji->tj', rotation[1:], rotation[:-1])
    signs = np.cumprod(np.where(steps < 0., -1., 1.), axis=0)
    rotation[1:] *= signs[..., None]
