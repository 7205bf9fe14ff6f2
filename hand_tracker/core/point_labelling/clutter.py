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
    """Paths of points, by slot, and evidence for each of the M markers of all hands.

    Attributes
    ----------
    age : ndarray, shape (S,)
        Time since each came [s].
    stretch : ndarray, shape (S,)
        Time since the present stretch of its path began [s].
    came : ndarray, shape (S, 3)
        Where the stretch began [m].
    pace : ndarray, shape (S, 3)
        Velocity in the stretch before; not a number in the first [m/s].
    cost : ndarray, shape (S, M)
        Of each as each marker when it came; infinite where the marker was not hidden.
    motion : ndarray, shape (S, M)
        What earlier stretches change in that.
    offset : ndarray, shape (S, M, 3)
        From where the marker was expected, in its palm's frame, when the stretch began [m].
    shift : ndarray, shape (S, M, 3)
        By how much that changed in the stretch before [m].
    taken : ndarray of bool, shape (S,)
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


class Clutter(NamedTuple):
    """Points of the present frame, in slots that those keep that no hand has.

    Attributes
    ----------
    used : ndarray of bool, shape (S,)
        Whether there is a point in a slot.
    place, speed : ndarray, shape (S, 3)
        Of those that no hand had in the frames before, where they were last [m, m/s].
    history : PointHistory
    """

    used: np.ndarray
    place: np.ndarray
    speed: np.ndarray
    history: PointHistory


class Cloud(NamedTuple):
    """Points of a frame.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        [m]
    ids : ndarray of int, shape (n,)
        By which the source distinguishes them; negative where it does not.
    free : ndarray of bool, shape (n,)
        Points that no hand has.
    slots : ndarray of int, shape (n,)
        Slot of each in `Clutter`.
    cost : ndarray, shape (n,)
        Of taking it for a marker, relative to `CLUTTER_DENSITY`; `-inf` where it has just come.
    """

    points: np.ndarray
    ids: np.ndarray
    free: np.ndarray
    slots: np.ndarray
    cost: np.ndarray


def no_clutter(markers: int, slots: int = 64) -> Clutter:
    """Return no points, for hands with so many markers together, and slots for so many points."""
    return Clutter(
        np.zeros(slots, dtype=bool), np.zeros((slots, 3)), np.zeros((slots, 3)), PointHistory(
            np.zeros(slots), np.zeros(slots), np.zeros((slots, 3)), np.zeros((slots, 3)),
            np.zeros((slots, markers)), np.zeros((slots, markers)),
            np.zeros((slots, markers, 3)), np.zeros((slots, markers, 3)),
            np.zeros(slots, dtype=bool)))


def with_slots(clutter: Clutter, slots: int) -> Clutter:
    """Return the same points with more slots."""
    more = no_clutter(clutter.history.cost.shape[1], slots)
    for part, wider in zip((*clutter[:3], *clutter.history), (*more[:3], *more.history)):
        wider[:len(part)] = part
    return more


def new_cloud(points: np.ndarray, ids: np.ndarray) -> Cloud:
    """Return the points of a new frame, (n, 3) [m], for `continue_clutter`."""
    count = len(points)
    return Cloud(points, ids, np.empty(count, dtype=bool), np.empty(count, dtype=np.int64),
                 np.empty(count))


def no_points() -> Cloud:
    """Return the frame before the first one."""
    return new_cloud(np.empty((0, 3)), np.empty(0, dtype=np.int64))


@labelling_jit
def continue_clutter(clutter: Clutter, last: Cloud, last_step: float, cloud: Cloud,
                     step: float) -> None:
    """Find which points go on from those that no hand had in the last frame.

    Parameters
    ----------
    clutter : Clutter
        Updated; at least as many slots as points.
    last : Cloud
        The last frame.
    last_step : float
        Time from the one before to it [s].
    cloud : Cloud
        This frame; all is replaced but points and ids: the points are free.
    step : float
        Time since the last frame [s].
    """
    _remember_clutter(clutter, last, last_step)
    points, slots, cost, history = cloud.points, cloud.slots, cloud.cost, clutter.history
    cloud.free[:] = True
    slots[:] = -1
    cost[:] = -math.inf
    leap = min(UNFORESEEN * step * step, FIRST_DEVIATION)
    for slot in range(len(clutter.used)):
        if not clutter.used[slot]:
            continue
        clutter.used[slot] = False
        new = CLUTTER_SPEED * step if history.age[slot] <= 0. else 0.
        variance = CLUTTER_DEVIATION ** 2 + leap * leap + new * new
        x = clutter.place[slot, 0] + step * clutter.speed[slot, 0]
        y = clutter.place[slot, 1] + step * clutter.speed[slot, 1]
        z = clutter.place[slot, 2] + step * clutter.speed[slot, 2]
        nearest, least = -1, 16. * variance
        for j in range(len(points)):
            off = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2 + (points[j, 2] - z) ** 2
            if off < least:
                nearest, least = j, off
        if nearest < 0:
            continue
        value = min(-SEEN_COST - 3. * math.log(variance) - least / variance, CLUTTER_COST)
        value *= min((history.age[slot] + step) / CLUTTER_AGE, 1.)
        if value > cost[nearest]:
            slots[nearest], cost[nearest] = slot, value
    for j in range(len(points)):
        if slots[j] >= 0:
            clutter.used[slots[j]] = True
            history.age[slots[j]] += step
            history.stretch[slots[j]] += step
            history.taken[slots[j]] = False
    unused = 0
    for j in range(len(points)):
        if slots[j] >= 0:
            continue
        while clutter.used[unused]:
            unused += 1
        clutter.used[unused] = True
        slots[j] = unused
        _begin_history(history, unused, points[j])


@labelling_jit
def _begin_history(history: PointHistory, slot: int, point: np.ndarray) -> None:
    """Begin the path of a point, shape (3,) [m], that has just come."""
    history.age[slot] = history.stretch[slot] = 0.
    history.taken[slot] = False
    for k in range(3):
        history.came[slot, k], history.pace[slot, k] = point[k], math.nan
    for i in range(history.cost.shape[1]):
        history.cost[slot, i], history.motion[slot, i] = math.inf, 0.


@labelling_jit
def _remember_clutter(clutter: Clutter, last: Cloud, step: float) -> None:
    """Keep of a frame's points those that no hand got, with their places and speeds.

    Parameters
    ----------
    clutter : Clutter
        Updated.
    last : Cloud
    step : float
        Time from the frame before to it [s].
    """
    history = clutter.history
    for j in range(len(last.points)):
        slot = last.slots[j]
        clutter.used[slot] = last.free[j]
        if not last.free[j]:
            continue
        known = last.cost[j] > -math.inf and step > 0.
        is_second = history.age[slot] <= step
        for k in range(3):
            place = last.points[j, k]
            if known:
                speed = (place - clutter.place[slot, k]) / step
                clutter.speed[slot, k] = speed if is_second else (
                    .5 * (speed + clutter.speed[slot, k]))
            else:
                clutter.speed[slot, k] = (
                    (place - history.came[slot, k]) / history.stretch[slot]
                    if history.stretch[slot] > 0. else 0.)
            clutter.place[slot, k] = place
        if history.stretch[slot] >= STRETCH:
            for k in range(3):
                history.pace[slot, k] = (
                    last.points[j, k] - history.came[slot, k]) / history.stretch[slot]
                history.came[slot, k] = last.points[j, k]
            history.stretch[slot] = 0.
