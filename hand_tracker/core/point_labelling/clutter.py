"""Clutter: points of no hand, followed from frame to frame, and the history of their paths."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import labelling_jit
from .posture import SEEN_COST

UNFORESEEN = 25.            # [m/s²] standard deviation of a point's acceleration; ours
FIRST_DEVIATION = .01       # [m] of the first predictions, and at most by acceleration; ours
# Clutter moves at constant velocity: standard deviation of its prediction, and of the speed of a
# new point; cost of labelling a clutter point, reached at CLUTTER_AGE; ours.
CLUTTER_DEVIATION = .002    # [m]
CLUTTER_SPEED = .5          # [m/s]
CLUTTER_COST = 16.
CLUTTER_AGE = .08           # [s]
STRETCH = .04               # [s] length of a stretch: a path is judged stretch by stretch; ours


class PointHistory(NamedTuple):
    """Path history of points, by slot, and their costs as each of the M markers of all hands.

    Attributes
    ----------
    age : ndarray, shape (S,)
        Time since the point appeared [s].
    stretch : ndarray, shape (S,)
        Age of the current stretch, a path segment of `STRETCH` [s].
    came : ndarray, shape (S, 3)
        Start of the current stretch [m].
    pace : ndarray, shape (S, 3)
        Mean velocity over the previous stretch, NaN in the first [m/s].
    cost : ndarray, shape (S, M)
        Cost as each marker when the point appeared; infinite where the marker was not hidden.
    motion : ndarray, shape (S, M)
        Motion term of that cost, from earlier stretches.
    offset : ndarray, shape (S, M, 3)
        Offset from the marker's expected place at the start of the stretch, palm's frame [m].
    shift : ndarray, shape (S, M, 3)
        Change of the offset over the previous stretch [m].
    taken : ndarray of bool, shape (S,)
        Whether the point is assigned to a hand.
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
    """Points of the present frame, by slot; a point of no hand keeps its slot over frames.

    Attributes
    ----------
    used : ndarray of bool, shape (S,)
        Whether there is a point in a slot.
    place, speed : ndarray, shape (S, 3)
        Last position and velocity of the points of no hand in earlier frames [m, m/s].
    history : PointHistory
    """

    used: np.ndarray
    place: np.ndarray
    speed: np.ndarray
    history: PointHistory


class Cloud(NamedTuple):
    """Points of a frame, with their state as clutter.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        [m]
    ids : ndarray of int, shape (n,)
        Point ids of the source; negative for none.
    free : ndarray of bool, shape (n,)
        Points not assigned to a hand.
    slots : ndarray of int, shape (n,)
        Slot of each in `Clutter`.
    cost : ndarray, shape (n,)
        Cost of labelling it, as it was clutter before; `-inf` for a new point.
    """

    points: np.ndarray
    ids: np.ndarray
    free: np.ndarray
    slots: np.ndarray
    cost: np.ndarray


def no_clutter(markers: int, slots: int = 64) -> Clutter:
    """Return an empty `Clutter` for the number of markers of all hands, with a number of slots."""
    return Clutter(
        np.zeros(slots, dtype=bool), np.zeros((slots, 3)), np.zeros((slots, 3)), PointHistory(
            np.zeros(slots), np.zeros(slots), np.zeros((slots, 3)), np.zeros((slots, 3)),
            np.zeros((slots, markers)), np.zeros((slots, markers)),
            np.zeros((slots, markers, 3)), np.zeros((slots, markers, 3)),
            np.zeros(slots, dtype=bool)))


def with_slots(clutter: Clutter, slots: int) -> Clutter:
    """Return a copy of the clutter with more slots."""
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
    """Return an empty `Cloud`: the frame before the first."""
    return new_cloud(np.empty((0, 3)), np.empty(0, dtype=np.int64))


@labelling_jit
def continue_clutter(clutter: Clutter, last: Cloud, last_step: float, cloud: Cloud,
                     step: float) -> None:
    """Match points to the clutter of the last frame: nearest neighbour of each prediction, gated.

    Parameters
    ----------
    clutter : Clutter
        Updated; at least as many slots as points.
    last : Cloud
        The last frame.
    last_step : float
        Time between the frame before and the last frame [s].
    cloud : Cloud
        This frame; `free` (all True), `slots` and `cost` are replaced.
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
    """Begin the history of a new point, shape (3,) [m]."""
    history.age[slot] = history.stretch[slot] = 0.
    history.taken[slot] = False
    for k in range(3):
        history.came[slot, k], history.pace[slot, k] = point[k], math.nan
    for i in range(history.cost.shape[1]):
        history.cost[slot, i], history.motion[slot, i] = math.inf, 0.


@labelling_jit
def _remember_clutter(clutter: Clutter, last: Cloud, step: float) -> None:
    """Store position and velocity of a frame's unassigned points; release the slots of the others.

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
