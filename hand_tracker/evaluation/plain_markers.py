"""Unseen markers by the plain hand: its joints are taken for the markers at them."""

from typing import NamedTuple

import numpy as np

from ..calibration import LANDMARKS
from ..calibration.takes import InvalidTake
from ..core.model.hand import FINGERS, Hand
from .plain_hand import PlainHand, fit_plain, into_palm, palm_poses, plain_joints

WORN_PALM_ROWS = [LANDMARKS.index(name) for name in ('wrist', 'index_mcp', 'little_mcp')]


class PlainMarkers(NamedTuple):
    """A plain hand whose joints are markers.

    Attributes
    ----------
    corners, worn_palm : ndarray, shape (3, 3)
        Wrist, index and little knuckle of `hand`, and the worn palm markers, in one frame [m].
    hand : PlainHand
    palm : dict of str to ndarray, shape (3,)
        Markers that are no joint of it, in the frame of `hand` [m].
    tips : tuple of str
        Digits whose worn marker is at the tip instead of the DIP: that stands for the DIP.
    """

    corners: np.ndarray
    worn_palm: np.ndarray
    hand: PlainHand
    palm: dict[str, np.ndarray]
    tips: tuple[str, ...]


def fit_plain_markers(names: tuple[str, ...], points: np.ndarray,
                      worn: tuple[str, ...]) -> PlainMarkers:
    """Fit a plain hand to markers.

    Parameters
    ----------
    names : tuple of str
        Canonical.
    points : ndarray, shape (n, m, 3)
        Of a right hand, all seen [m].
    worn : tuple of str
        Names in the order of `MARKERS`.

    Returns
    -------
    PlainMarkers

    Raises
    ------
    InvalidTake
        Without markers on the knuckles of index and little finger, or at all joints.
    """
    columns = {name: points[:, i] for i, name in enumerate(names)}
    tips = tuple(finger for finger, name in zip(FINGERS, worn[3:]) if name.endswith('_tip'))
    for finger in tips:
        columns[f'{finger}_dip'] = columns[f'{finger}_tip']
    # The wrist's and knuckles' usual places beside the worn palm markers stand for them.
    worn_points = np.stack([columns[name] for name in worn[:3]], axis=1)
    size = np.linalg.norm(worn_points[:, (1, 2, 0)] - worn_points, axis=2)
    worn_palm = worn_points[int(np.argmin(np.abs(size - np.median(size, axis=0)).sum(axis=1)))]
    rotation, position = palm_poses(worn_points, worn_palm)
    wanted = ('wrist' if 'wrist' in columns else worn[0], 'index_mcp', 'little_mcp')
    if missing := [name for name in wanted if name not in columns]:
        raise InvalidTake(f'no marker {" or ".join(missing)}: a plain hand needs its knuckles')
    corners = np.median(into_palm(
        np.stack([columns[name] for name in wanted], axis=1), rotation, position), axis=0)
    for row, corner in zip(WORN_PALM_ROWS, corners):
        columns[LANDMARKS[row]] = rotation @ corner + position
    # What no marker shows is where the mean hand has it.
    mean = Hand.scaled(breadth=float(np.linalg.norm(corners[1] - corners[2])))
    turn, origin = palm_poses(
        corners[None], np.array((np.zeros(3), mean.finger_mcp[0], mean.finger_mcp[3])))
    absent = {'thumb_cmc': mean.thumb_cmc}
    absent.update((f'{finger}_mcp', place) for finger, place in zip(FINGERS, mean.finger_mcp))
    for name, place in absent.items():
        columns.setdefault(name, rotation @ (turn[0] @ place + origin[0]) + position)
    if missing := [name for name in LANDMARKS if name not in columns]:
        raise InvalidTake(f'no marker {", ".join(missing)}: a plain hand is fitted to all joints')
    hand = fit_plain(np.stack([columns[name] for name in LANDMARKS], axis=1))
    corner_names = [LANDMARKS[row] for row in WORN_PALM_ROWS]
    others = [name for name in names if name not in LANDMARKS or name in corner_names]
    measured = dict(zip(names, np.moveaxis(points, 1, 0)))
    local = into_palm(np.stack([measured[name] for name in others], axis=1), rotation, position)
    return PlainMarkers(corners, worn_palm, hand, dict(zip(others, np.median(local, axis=0))), tips)


def plain_markers(plain: PlainMarkers, names: tuple[str, ...], worn: np.ndarray) -> np.ndarray:
    """Return markers of a right hand by its worn ones.

    Parameters
    ----------
    plain : PlainMarkers
    names : tuple of str
        Of the markers wanted.
    worn : ndarray, shape (n, 8, 3)
        All seen [m].

    Returns
    -------
    ndarray, shape (n, k, 3)
        [m]
    """
    rotation, position = palm_poses(worn[:, :3], plain.worn_palm)
    worn = np.concatenate((plain.corners @ np.swapaxes(rotation, 1, 2) + position[:, None],
                           worn[:, 3:]), axis=1)
    joints = plain_joints(plain.hand, worn)
    return np.stack([
        rotation @ plain.palm[name] + position if name in plain.palm
        else joints[:, LANDMARKS.index(name)] for name in names], axis=1)
