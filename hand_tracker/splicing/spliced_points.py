"""Points of a body with the joints of tracked hands: for full-body capture in markers alone."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..calibration.hand_axes import SAMPLED_FRAMES
from ..calibration.known_layouts import HAND_SPAN
from ..core.numerics.rigid_fit import nearest_rotation
from ..core.numerics.sampling import every_few
from ..files.point_recording import PointRecording, unique_labels
from ..files.skeleton_motion import HandAngles, joint_centres, resampled_hand
from .body_skeleton import SkeletonError
from .clock_alignment import ClockAlignment, Trajectory
from .spliced_body import overlapping

# 'RWRA', 'Anna:LWristOut', 'right_wrist': all of one side are about its wrist.
WRIST_MARKER = re.compile(r'(?P<side>left|right|l|r)[_\s.-]?(wr[a-z]?|wrist\w*)', re.IGNORECASE)
ASSUMED_BODY_RATE = 100.   # [Hz] of files that say none
LEAST_WRIST_FRAMES = 3     # with the body's wrist seen, to place a hand in its world
SAME_WORLD = .08           # [m] median distance of the wrists up to which the worlds are one


class World(NamedTuple):
    """Transform from the hand's world to the body's.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
    origin : ndarray, shape (3,)
        [m]
    is_same : bool
        Whether both are one world, in which the hand stays where it was measured.
    distance : float
        Median distance of the two wrists in it [m].
    """

    rotation: np.ndarray
    origin: np.ndarray
    is_same: bool
    distance: float


def is_body_of_markers(recording: PointRecording) -> bool:
    """Return whether markers are named after a wrist, and most are farther from it than a hand's.

    Parameters
    ----------
    recording : PointRecording
    """
    wrists = [i for i, label in enumerate(recording.labels) if _wrist_of(label)]
    if not wrists:
        return False
    some = every_few(recording.points, SAMPLED_FRAMES)
    apart = np.linalg.norm(some[:, :, None] - some[:, None, wrists], axis=3)
    nearest = np.where(np.isfinite(apart), apart, np.inf).min(axis=2)
    is_seen = np.isfinite(nearest)
    return 2 * int((nearest[is_seen] > HAND_SPAN).sum()) > int(is_seen.sum())


def _wrist_of(label: str) -> str:
    """Return the side, as 'r', of a wrist's marker by its label; empty for others."""
    named = WRIST_MARKER.fullmatch(label.rpartition(':')[2].strip())
    return named['side'][0].lower() if named else ''


def marker_wrist(body: PointRecording, side: str) -> Trajectory:
    """Return the middle of a wrist's markers, in metres.

    Parameters
    ----------
    body : PointRecording
    side : {'right', 'left'}

    Returns
    -------
    Trajectory
        NaN where one of them is missing.

    Raises
    ------
    SkeletonError
        If no label names the wrist.
    """
    columns = [i for i, label in enumerate(body.labels) if _wrist_of(label) == side[0]]
    if not columns:
        raise SkeletonError(
            f"{body.name}: no marker is at the {side} wrist by its name; expected "
            f'{side[0].upper()}WRA and {side[0].upper()}WRB, {side[0].upper()}WristIn, '
            f'{side}_wrist or alike; there are {", ".join(body.labels[:60])}')
    points = body.points[:, columns].astype(float).mean(axis=1)
    return Trajectory(body.times(ASSUMED_BODY_RATE), points)


def hand_world(wrist: Trajectory, tracked: HandAngles, alignment: ClockAlignment) -> World:
    """Return the pose of the hand's world in the body's, by the wrist's path in both.

    Parameters
    ----------
    wrist : Trajectory
        Of the body.
    tracked : HandAngles
    alignment : ClockAlignment

    Returns
    -------
    World

    Raises
    ------
    SkeletonError
        If the body's wrist is seen in too few of the hand's frames.
    """
    own = tracked.times - tracked.times[0]
    times = alignment.hand_times(wrist.times)
    seen = overlapping(own, times) & np.isfinite(wrist.positions).all(axis=1)
    if seen.sum() < LEAST_WRIST_FRAMES:
        raise SkeletonError(f"{tracked.hand.side} wrist: its markers are seen in {seen.sum()} of "
                            f"the hand's frames; expected {LEAST_WRIST_FRAMES} or more")
    body = wrist.positions[seen]
    hand = np.stack([np.interp(times[seen], own, axis) for axis in tracked.wrist_position.T],
                    axis=1)
    apart = float(np.median(np.linalg.norm(body - hand, axis=1)))
    if apart < SAME_WORLD:
        return World(np.eye(3), np.zeros(3), True, apart)
    middle, own_middle = body.mean(axis=0), hand.mean(axis=0)
    turn = nearest_rotation((body - middle).T @ (hand - own_middle))
    origin = middle - turn @ own_middle
    left = np.linalg.norm(body - hand @ turn.T - origin, axis=1)
    return World(turn, origin, False, float(np.median(left)))


def splice_points(body: PointRecording, hands: Sequence[tuple[HandAngles, ClockAlignment, World]]
                  ) -> PointRecording:
    """Return a body's points, untouched, and behind them the joint centres and tips of hands.

    Parameters
    ----------
    body : PointRecording
    hands : sequence of (HandAngles, ClockAlignment, World)

    Returns
    -------
    PointRecording
        Joints are NaN in frames that the hand's recording does not cover.
    """
    labels, points = list(body.labels), [body.points]
    for tracked, alignment, world in hands:
        own = tracked.times - tracked.times[0]
        times = alignment.hand_times(body.times(ASSUMED_BODY_RATE))
        inside = overlapping(own, times)
        joints = joint_centres(resampled_hand(tracked, own, times[inside]), body.name)
        found = np.full((len(times), len(joints.labels), 3), np.nan, dtype=body.points.dtype)
        found[inside] = joints.points @ world.rotation.T + world.origin
        labels += joints.labels
        points.append(found)
    unique, _ = unique_labels(labels)
    return body._replace(labels=unique, points=np.concatenate(points, axis=1))
