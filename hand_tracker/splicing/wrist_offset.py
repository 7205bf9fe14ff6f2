"""Wrist offset: where a tracked wrist sits in a frame of a body, from what both captures saw."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from ..core.errors import HandTrackerError
from .frame_tree import FramePose
from .hand_mount import MAX_MOUNT_SPREAD, HandMount, fit_mount

LONGEST_GAP = .2           # [s] between two poses of the body that are interpolated
LEAST_POSES = 50
MOST_POSES = 2000          # that are fitted; of more every other one, or fewer
RATE_SPAN = .05             # [s] over which the wrist's rate of turn is taken
DELAY_ROUNDS = 10
DELAY_STEP = 1e-4           # [s] below which a delay is found
MIN_TURNING = .1           # [rad] rms across the axis about which the wrist turns most


class OffsetError(HandTrackerError):
    """An offset that cannot be fitted: the message says why, and what to do instead."""


class WristOffset(NamedTuple):
    """Constant pose of a tracked wrist in a frame of a body.

    Attributes
    ----------
    position : ndarray, shape (3,)
        [m]
    rotation : ndarray, shape (4,)
        Unit quaternion x, y, z, w.
    spread : float
        Median angle by which a frame differs [rad].
    distance : float
        Median distance by which a frame differs [m].
    delay : float
        By which the body's stamps are later than the wrist's [s].
    """

    position: np.ndarray
    rotation: np.ndarray
    spread: float
    distance: float
    delay: float


class PoseTrack:
    """Poses of a frame over time, all in one root, as they come."""

    def __init__(self) -> None:
        self._root = ''
        self._rows: list[tuple[float, ...]] = []

    def append(self, pose: FramePose) -> None:
        """Take a pose: in place of the last of the same time; left out if it is of an earlier one.

        Transforms of one time may come in several messages: the last one completes the pose. In
        another root than before the track begins anew.
        """
        if pose.root != self._root:
            self._root = pose.root
            self._rows.clear()
        last = self._rows[-1][0] if self._rows else -math.inf
        if pose.time < last:
            return
        if pose.time == last:
            self._rows.pop()
        self._rows.append((pose.time, *pose.position, *pose.rotation))

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def rows(self) -> np.ndarray:
        """Poses, shape (T, 8): time [s], x, y, z [m], unit quaternion x, y, z, w."""
        return np.array(self._rows).reshape(-1, 8)


def fit_wrist_offset(body: PoseTrack, wrist: PoseTrack) -> WristOffset:
    """Fit the offset of a wrist that both captures saw, each in a world of its own.

    The rotations are those of the hand's mount, by as much later as the wrist was seen to turn on;
    with them the places are linear in the offset's position and in the origin of the worlds.

    Parameters
    ----------
    body : PoseTrack
        Of the body's frame, in the body's world.
    wrist : PoseTrack
        Of the tracked wrist, in the markers' frame; by the same clock, but for a constant delay.

    Returns
    -------
    WristOffset

    Raises
    ------
    OffsetError
        If the captures share too little, the wrist moves or turns too little, or they disagree.
    """
    body_rows, delay, step = body.rows, 0., 0.
    for _ in range(DELAY_ROUNDS):
        body_rows[:, 0] -= step
        delay += step
        times, places, turns, body_places, body_turns = _together(body_rows, wrist.rows)
        mount = _mount(body_places, body_turns, places, turns)
        step = _delay(times, turns, body_turns, mount)
        if abs(step) < DELAY_STEP:
            break
    lever = mount.world @ body_turns                       # (T, 3, 3)
    left = places - body_places @ mount.world.T            # (T, 3)
    centred = (lever - lever.mean(axis=0)).reshape(-1, 3)  # (3 T, 3)
    if np.linalg.svd(centred, compute_uv=False)[-1] < MIN_TURNING * np.sqrt(len(times)):
        raise OffsetError('the wrist turned too little; expected it to be turned about two axes, '
                          'by 30 degrees and more')
    position = np.linalg.lstsq(centred, (left - left.mean(axis=0)).ravel(), rcond=None)[0]
    rest = (left - left.mean(axis=0)).reshape(-1, 3) - (centred @ position).reshape(-1, 3)
    offset = WristOffset(position, Rotation.from_matrix(mount.wrist).as_quat(), mount.spread,
                         float(np.median(np.linalg.norm(rest, axis=1))), delay)
    if not mount.is_fitted:
        raise OffsetError(
            f'the wrists turn apart, by {np.degrees(mount.spread):.0f} degrees in the middle; '
            f'expected less than {np.degrees(MAX_MOUNT_SPREAD):.0f}: is the frame that of this '
            'hand, and are the stamps of both of one clock?')
    return offset


def _mount(*motions: np.ndarray) -> HandMount:
    """Fit the mount to the common motion of both captures; raise if the wrist moved too little."""
    mount = fit_mount(*motions)
    if mount is None:
        raise OffsetError('the wrist moved too little; expected the arm to be moved to all sides, '
                          'by 10 cm and more')
    return mount


def _delay(times: np.ndarray, turns: np.ndarray, body_turns: np.ndarray,
           mount: HandMount) -> float:
    """Return the delay of the body: by how much later its stamps are than the wrist's [s].

    By then the wrist has turned on by its rate of turn times the delay (least squares).

    Parameters
    ----------
    times : ndarray, shape (T,)
        [s]
    turns, body_turns : ndarray, shape (T, 3, 3)
        Rotations of the wrist and of the body's frame, each in its own world.
    mount : HandMount
    """
    step = max(1, round(.5 * RATE_SPAN / float(np.median(np.diff(times)))))
    if len(times) <= 4 * step:
        raise OffsetError(f'both captures share {times[-1] - times[0]:.3g} s; expected more than '
                          f'{2. * RATE_SPAN:g} s: are the stamps in seconds, and of one clock?')
    late = (mount.world @ body_turns @ mount.wrist).swapaxes(1, 2) @ turns     # (T, 3, 3)
    before, after = slice(None, -2 * step), slice(2 * step, None)
    rate = Rotation.from_matrix(turns[before].swapaxes(1, 2) @ turns[after]).as_rotvec()
    rate /= (times[after] - times[before])[:, None]                            # (T', 3) [rad/s]
    turned_on = Rotation.from_matrix(late[step:-step]).as_rotvec()
    return float((turned_on * rate).sum() / max((rate * rate).sum(), 1e-12))


def _together(body: np.ndarray, wrist: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the poses of both captures at common times, the body's by interpolation.

    Parameters
    ----------
    body, wrist : ndarray, shapes (B, 8), (W, 8)
        Rows of a `PoseTrack`.

    Returns
    -------
    times : ndarray, shape (T,)
        Of poses of the wrist, `MOST_POSES` at most [s].
    places, turns : ndarray, shapes (T, 3), (T, 3, 3)
        Positions [m] and rotations of the wrist.
    body_places, body_turns : ndarray, shapes (T, 3), (T, 3, 3)
        Those of the body's frame.
    """
    inside = np.zeros(len(wrist), dtype=bool)
    if len(body) > 1 and len(wrist):
        after = np.searchsorted(body[:, 0], wrist[:, 0])
        within = np.clip(after, 1, len(body) - 1)
        gaps = body[within, 0] - body[within - 1, 0]
        inside = (wrist[:, 0] >= body[0, 0]) & (wrist[:, 0] <= body[-1, 0]) & (gaps < LONGEST_GAP)
    if inside.sum() < LEAST_POSES:
        raise OffsetError(
            f'{len(wrist)} poses of the tracked wrist and {len(body)} of the body\'s frame, of '
            f'which {inside.sum()} are of the same times; expected {LEAST_POSES} or more: do both '
            'run, with stamps of one clock?')
    seen = wrist[inside][::-(-int(inside.sum()) // MOST_POSES)]
    times = seen[:, 0]
    body_places = np.stack([np.interp(times, body[:, 0], axis) for axis in body[:, 1:4].T], axis=1)
    body_turns = Slerp(body[:, 0], Rotation.from_quat(body[:, 4:]))(times).as_matrix()
    return (times, seen[:, 1:4], Rotation.from_quat(seen[:, 4:]).as_matrix(), body_places,
            body_turns)
