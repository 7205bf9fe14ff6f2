"""Data association costs: each point of a cloud as each marker of a followed hand.

A seen marker is expected at its prediction; a hidden digit marker as in `returns`; a hidden palm
marker at its prediction and its distances from the seen palm markers.
"""

import math

import numpy as np

from ..numerics.jit import labelling_jit
from .hand_track import HandTrack, coming_cost
from .links import marker_links_cost
from .palm_search import to_palm_frame
from .posture import CLUTTER_DENSITY, SEEN_COST
from .prototypes import Prototype
from .returns import RETURN_COST, PalmPoints, hidden_place, hidden_tail, return_cost

VANISHING_COST = 12.        # of not assigning a marker that was seen a frame before
RIGID_DEVIATION = .004      # [m] of the distance of two palm markers; ours
CIRCLE_COST = 8.            # of a palm marker placed by `circle_cost`, off its prediction
LEAST_RADIUS = .001         # [m] of the circle of `circle_cost`; ours
RIGID_GAIN = 30.            # most by which distances lower a palm marker's cost
HINT_GAIN = 4.              # cost reduction of a point with the source id of the marker
KEPT_ID_TIME = .1           # [s] of a kept id: some sources renumber each frame; ours


@labelling_jit
def match_costs(prototype: Prototype, track: HandTrack, seen: PalmPoints,
                cost: np.ndarray) -> None:
    """Write the cost of each point as each marker of a hand, relative to leaving it hidden.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Predicted.
    seen : PalmPoints
        `local` is replaced: points in the frame of the predicted palm.
    cost : ndarray, shape (H, n)
        Rows of this hand's markers are replaced; infinite where hiding the marker costs less.
    """
    come = coming_cost(track)
    finding, cloud = track.finding, seen.cloud
    points = cloud.points
    to_palm_frame(points, finding.rotation, finding.position, finding.size[0], seen.local)
    for i in range(len(track.place)):
        hidden = track.hidden_for[i] > 0.
        variance = track.deviation[i] ** 2
        base = SEEN_COST + 3. * math.log(variance)
        returns = hidden and prototype.rigid[i] <= 0.
        expected = hidden_place(track, i)
        for j in range(len(points)):
            if returns:
                value = come + return_cost(expected, seen, j, seen.first + i)
                if len(prototype.links):
                    value += marker_links_cost(
                        prototype, track.local, track.hidden_for, i, seen.local[j])
            else:
                off = ((points[j, 0] - track.place[i, 0]) ** 2
                       + (points[j, 1] - track.place[i, 1]) ** 2
                       + (points[j, 2] - track.place[i, 2]) ** 2)
                value = base + max(come, cloud.cost[j])
                if not hidden:
                    value += off / variance - VANISHING_COST
                else:
                    value += hidden_tail(off, variance) + RETURN_COST
                    # At best its distances in the palm lower the cost by that much.
                    if value < RIGID_GAIN:
                        value += rigid_cost(prototype, track, i, points[j])
                    value = min(value, RETURN_COST + max(come, cloud.cost[j]) + circle_cost(
                        prototype, track, i, points[j]))
            if (cloud.ids[j] >= 0 and cloud.ids[j] == track.ids[i]
                    and track.id_kept_for[i] >= KEPT_ID_TIME):
                value -= HINT_GAIN
            cost[seen.first + i, j] = value if value < 0. else math.inf


@labelling_jit
def _palm_gap(track: HandTrack, seen: int, marker: int, point: np.ndarray) -> float:
    """Return a point's distance from a seen palm marker, less that of `marker` from it [m]."""
    here = 0.
    for k in range(3):
        here += (track.place[seen, k] - point[k]) ** 2
    return math.sqrt(here) - track.palm_gaps[seen, marker]


@labelling_jit
def rigid_cost(prototype: Prototype, track: HandTrack, marker: int, point: np.ndarray) -> float:
    """Return the rigidity term of a palm marker's cost: its distances from seen palm markers."""
    total, count = 0., 0
    for i in range(len(prototype.rigid)):
        if i == marker or prototype.rigid[i] <= 0. or track.hidden_for[i] > 0.:
            continue
        gap = _palm_gap(track, i, marker, point)
        variance = RIGID_DEVIATION ** 2 + track.deviation[i] ** 2
        # Each distance constrains one of three coordinates.
        if count < 3:
            total += math.log(variance / max(track.deviation[marker] ** 2, variance))
        total += gap * gap / variance
        count += 1
    return total


@labelling_jit
def circle_cost(prototype: Prototype, track: HandTrack, marker: int,
                point: np.ndarray) -> float:
    """Return the cost of a point as a hidden palm marker by its distances from the two seen ones.

    Its rotation about their line is free: it is anywhere on a circle. Infinite unless two are seen.
    """
    first, second, count = -1, -1, 0
    for i in range(len(prototype.rigid)):
        if i != marker and prototype.rigid[i] > 0. and track.hidden_for[i] <= 0.:
            first, second = second, i
            count += 1
    if count != 2:
        return math.inf
    total = 0.
    length = track.palm_gaps[first, second] ** 2
    arm = track.palm_gaps[first, marker] ** 2
    along = .5 * (length + arm - track.palm_gaps[second, marker] ** 2)
    radius = math.sqrt(max(arm - along * along / length, LEAST_RADIUS ** 2))
    for i in (first, second):
        gap = _palm_gap(track, i, marker, point)
        variance = RIGID_DEVIATION ** 2 + track.deviation[i] ** 2
        total += math.log(variance) + gap * gap / variance
    # Twice the logarithm of the circle's length and of the plane normal distribution's peak.
    return (CIRCLE_COST + total + 2. * math.log(2. * math.pi * radius)
            + 2. * math.log(2. * math.pi) + 2. * math.log(CLUTTER_DENSITY))
