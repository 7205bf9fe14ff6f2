"""Unassigned points from frame to frame: where they go on, and how they came."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import labelling_jit
from .posture import SEEN_COST

UNFORESEEN = 25.            # [m/s²] standard deviation of a point's acceleration; ours
FIRST_DEVIATION = .01       # [m] in the first frames; ours
# Points of no hand go on as they moved: deviation of a predicted one, and of the speed of one that
# has just come; cost of taking one for a marker after it has been there for a time; ours.
CLUTTER_DEVIATION = .002    # [m]
CLUTTER_SPEED = .5          # [m/s]
CLUTTER_COST = 16.
CLUTTER_AGE = .08           # [s]
STRETCH = .04               # [s] of its path by which a point is judged at a time; ours


class PointHistory(NamedTuple):
    """History of unassigned points: path, and evidence for each of the M markers of all hands.

    Attributes
    ----------
    age : ndarray, shape (n,)
        Time since each came [s].
    stretch : ndarray, shape (n,)
        Time since the present stretch of its path began [s].
    came : ndarray, shape (n, 3)
        Where the stretch began [m].
    pace : ndarray, shape (n, 3)
        Velocity in the stretch before; not a number in the first [m/s].
    cost : ndarray, shape (n, M)
        Of each as each marker when it came; infinite where the marker was not hidden.
    motion : ndarray, shape (n, M)
        What earlier stretches change in that.
    offset : ndarray, shape (n, M, 3)
        From where the marker was expected, in its palm's frame, when the stretch began [m].
    shift : ndarray, shape (n, M, 3)
        By how much that changed in the stretch before [m].
    taken : ndarray of bool, shape (n,)
        Whether a hand has it.
    """

    age: np.ndarray
    stretch: np.ndarray
    came: np.ndarray
    pace: np.ndarray
    cost: np.ndarray
    motion: np.ndarray
    offset: np.ndarray
    shift: np.ndarray
    taken: np.ndarray


@labelling_jit
def _new_history(count: int, markers: int) -> PointHistory:
    """Return the history of points that have just come."""
    return PointHistory(
        np.zeros(count), np.zeros(count), np.zeros((count, 3)), np.full((count, 3), math.nan),
        np.full((count, markers), math.inf), np.zeros((count, markers)),
        np.zeros((count, markers, 3)), np.zeros((count, markers, 3)),
        np.zeros(count, dtype=np.bool_))


class Clutter(NamedTuple):
    """Unassigned points of a frame.

    Attributes
    ----------
    place : ndarray, shape (n, 3)
        [m]
    speed : ndarray, shape (n, 3)
        [m/s]
    history : PointHistory
    """

    place: np.ndarray
    speed: np.ndarray
    history: PointHistory


def no_clutter(markers: int) -> Clutter:
    """Return no points, for hands with so many markers together."""
    return Clutter(np.empty((0, 3)), np.empty((0, 3)), _new_history(0, markers))


@labelling_jit
def continue_clutter(clutter: Clutter, points: np.ndarray, step: float, before: np.ndarray,
                     cost: np.ndarray) -> PointHistory:
    """Find which points go on from those that no hand had in the last frame.

    Parameters
    ----------
    clutter : Clutter
        Of the last frame.
    points : ndarray, shape (n, 3)
        [m]
    step : float
        Time since then [s].
    before : ndarray of int, shape (n,)
        Row of each point in `clutter`, -1 for those that have just come; replaced.
    cost : ndarray, shape (n,)
        Of taking it for a marker, relative to `CLUTTER_DENSITY`; `-inf` where it has just come.

    Returns
    -------
    PointHistory
        Of the points.
    """
    before[:] = -1
    cost[:] = -math.inf
    leap = min(UNFORESEEN * step * step, FIRST_DEVIATION)
    old = clutter.history
    for c in range(len(old.age)):
        new = CLUTTER_SPEED * step if old.age[c] <= 0. else 0.
        variance = CLUTTER_DEVIATION ** 2 + leap * leap + new * new
        peak = -SEEN_COST - 3. * math.log(variance)
        nearest, least = -1, 16. * variance
        for j in range(len(points)):
            off = 0.
            for k in range(3):
                off += (points[j, k] - clutter.place[c, k] - step * clutter.speed[c, k]) ** 2
            if off < least:
                nearest, least = j, off
        if nearest >= 0:
            value = min(peak - least / variance, CLUTTER_COST)
            value *= min((old.age[c] + step) / CLUTTER_AGE, 1.)
            if value > cost[nearest]:
                before[nearest], cost[nearest] = c, value
    history = _new_history(len(points), old.cost.shape[1])
    for j in range(len(points)):
        c = before[j]
        if c >= 0:
            _copy_history(old, c, history, j)
            history.age[j] += step
            history.stretch[j] += step
        else:
            history.came[j] = points[j]
    return history


@labelling_jit
def _copy_history(source: PointHistory, row: int, target: PointHistory, to: int) -> None:
    """Copy the history of a point."""
    target.age[to], target.stretch[to] = source.age[row], source.stretch[row]
    for k in range(3):
        target.came[to, k], target.pace[to, k] = source.came[row, k], source.pace[row, k]
    for i in range(source.cost.shape[1]):
        target.cost[to, i], target.motion[to, i] = source.cost[row, i], source.motion[row, i]
        for k in range(3):
            target.offset[to, i, k] = source.offset[row, i, k]
            target.shift[to, i, k] = source.shift[row, i, k]


@labelling_jit
def remember_clutter(clutter: Clutter, points: np.ndarray, free: np.ndarray, before: np.ndarray,
                     history: PointHistory, step: float) -> Clutter:
    """Return the points that no hand has.

    Parameters
    ----------
    clutter : Clutter
        Of the last frame.
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
        Those that no hand has.
    before, history
        By `continue_clutter`.
    step : float
        Time since then [s].
    """
    count = 0
    for j in range(len(points)):
        count += 1 if free[j] else 0
    found = Clutter(np.empty((count, 3)), np.zeros((count, 3)),
                    _new_history(count, history.cost.shape[1]))
    n = 0
    for j in range(len(points)):
        if not free[j]:
            continue
        c = before[j]
        for k in range(3):
            found.place[n, k] = points[j, k]
            if c >= 0 and step > 0.:
                speed = (points[j, k] - clutter.place[c, k]) / step
                found.speed[n, k] = speed if clutter.history.age[c] <= 0. else (
                    .5 * (speed + clutter.speed[c, k]))
            elif history.stretch[j] > 0.:
                found.speed[n, k] = (
                    points[j, k] - history.came[j, k]) / history.stretch[j]
        _copy_history(history, j, found.history, n)
        if history.stretch[j] >= STRETCH:
            for k in range(3):
                found.history.pace[n, k] = (
                    points[j, k] - history.came[j, k]) / history.stretch[j]
                found.history.came[n, k] = points[j, k]
            found.history.stretch[n] = 0.
        n += 1
    return found
