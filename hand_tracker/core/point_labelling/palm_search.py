"""Detection of hands in a single frame: palms by triangles, digits by optimal assignment.

Three points with the side lengths of a triangle of palm markers are a palm candidate. The
candidates with points nearest to the mean places of the other markers are labelled in full: by an
optimal assignment of points to markers, refined by the joint distribution of all markers.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.assignment import assign_rows
from ..numerics.jit import labelling_jit
from ..numerics.rigid_fit import fit_rigid
from ..numerics.stack_memory import local_floats
from .links import links_cost
from .posture import (
    HIDDEN_COST,
    SEEN_COST,
    chain_labels,
    complete_labels,
    count_seen,
    label_costs,
    quadratic,
)
from .prototypes import Prototype

# Budget of a hand's search in a frame, in distances of points from markers; ours.
SEARCH_BUDGET = 240_000
CANDIDATES = 16         # palm candidates of a search that are labelled in full; ours
CHAIN_ROUNDS = 4        # at most
LEAST_SHARE = .55       # least share of seen markers of a hand that is found; ours


class Candidates(NamedTuple):
    """Palm candidates, the cheapest first.

    Attributes
    ----------
    corners : ndarray of int, shape (C, 4)
        Index of the triangle, and its three points; of `search_pairs`: pair, two points, rotation.
    cost : ndarray, shape (C,)
        Infinite where there is none.
    """

    corners: np.ndarray
    cost: np.ndarray


class Finding(NamedTuple):
    """A hand found among points: labels, pose of the palm, cost.

    Attributes
    ----------
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    rotation : ndarray, shape (3, 3)
        From the palm's frame to that of the points.
    position : ndarray, shape (3,)
        Origin of the palm's frame [m].
    size : ndarray, shape (1,)
        Of the palm relative to the prototype's.
    cost : ndarray, shape (1,)
        Infinite where nothing is found [variances].
    distance : ndarray, shape (1,)
        Squared Mahalanobis distance per coordinate.
    """

    rows: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    size: np.ndarray
    cost: np.ndarray
    distance: np.ndarray


@labelling_jit
def blank_candidates() -> Candidates:
    """Return a list of candidates without any: all costs are infinite."""
    return Candidates(np.zeros((CANDIDATES, 4), dtype=np.int64), np.full(CANDIDATES, math.inf))


@labelling_jit
def blank_finding(count: int) -> Finding:
    """Return a `Finding` without a hand, for `count` markers: all hidden, at infinite cost."""
    return Finding(np.full(count, -1), np.eye(3), np.zeros(3), np.ones(1),
                   np.full(1, math.inf), np.full(1, math.inf))


@labelling_jit
def to_palm_frame(points: np.ndarray, rotation: np.ndarray, position: np.ndarray, size: float,
                  local: np.ndarray) -> None:
    """Transform points to the palm's frame, scaled to the prototype's size, shape (n, 3) [m]."""
    for j in range(len(points)):
        x = (points[j, 0] - position[0]) / size
        y = (points[j, 1] - position[1]) / size
        z = (points[j, 2] - position[2]) / size
        for k in range(3):
            local[j, k] = rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z


@labelling_jit
def palms_within(budget: int, prototype: Prototype, points: np.ndarray) -> int:
    """Return how many palms a budget allows: each takes all distances of points from markers."""
    return max(budget // max(len(prototype.template) * len(points), 1), 1)


@labelling_jit
def search_palms(prototype: Prototype, points: np.ndarray, free: np.ndarray, first: int,
                 budget: int, candidates: Candidates) -> int:
    """Collect palm candidates: three points that match a triangle of palm markers.

    Parameters
    ----------
    prototype : Prototype
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
        Points that may be taken.
    first : int
        First corner to begin with.
    budget : int
        Distances of points from markers to compute, see `palms_within`; checked before each first
        corner.
    candidates : Candidates
        Updated.

    Returns
    -------
    int
        Number of first corners that were tried.
    """
    count, markers = len(points), len(prototype.template)
    tried, most = 0, palms_within(budget, prototype, points)
    rest, local = local_floats((3, 3)), np.empty((count, 3))
    place = np.empty((markers, 3))
    for i in range(markers):
        for k in range(3):
            place[i, k] = prototype.template[i, k]
    gap = np.empty((count, count))
    for a in range(count):
        for b in range(a + 1):
            gap[a, b] = gap[b, a] = math.sqrt(
                (points[a, 0] - points[b, 0]) ** 2 + (points[a, 1] - points[b, 1]) ** 2
                + (points[a, 2] - points[b, 2]) ** 2)
    for offset in range(count):
        a = (first + offset) % count
        if tried >= most:
            return offset
        if not free[a]:
            continue
        for base in range(len(prototype.bases)):
            for k in range(3):
                for i in range(3):
                    rest[i, k] = place[prototype.bases[base, i], k]
            side = (math.sqrt((rest[0, 0] - rest[1, 0]) ** 2 + (rest[0, 1] - rest[1, 1]) ** 2
                              + (rest[0, 2] - rest[1, 2]) ** 2),
                    math.sqrt((rest[1, 0] - rest[2, 0]) ** 2 + (rest[1, 1] - rest[2, 1]) ** 2
                              + (rest[1, 2] - rest[2, 2]) ** 2),
                    math.sqrt((rest[2, 0] - rest[0, 0]) ** 2 + (rest[2, 1] - rest[0, 1]) ** 2
                              + (rest[2, 2] - rest[0, 2]) ** 2))
            allowed = prototype.sides[base]
            for b in range(count):
                grown = gap[a, b] / side[0]
                if b == a or not free[b] or not (
                        prototype.sizes[0] - allowed[0] <= grown
                        <= prototype.sizes[1] + allowed[0]):
                    continue
                # The first side may be too short and the others too long, or the reverse.
                second, third = (allowed[1] + allowed[0]) * side[1], (
                    allowed[2] + allowed[0]) * side[2]
                for c in range(count):
                    if c == a or c == b or not free[c] or (
                            abs(gap[c, a] / grown - side[2]) > third) or (
                            abs(gap[b, c] / grown - side[1]) > second):
                        continue
                    if _try_palm(
                            prototype, points, free, rest, base, a, b, c, local, candidates):
                        tried += 1
    return count


@labelling_jit
def _try_palm(prototype: Prototype, points: np.ndarray, free: np.ndarray, rest: np.ndarray,
              base: int, a: int, b: int, c: int, local: np.ndarray,
              candidates: Candidates) -> bool:
    """Place a palm by three points and insert it as a candidate; return whether its size is one.

    Parameters
    ----------
    prototype, points, free, candidates
        As for `search_palms`.
    rest : ndarray, shape (3, 3)
        The triangle's markers in the palm's frame [m].
    base, a, b, c : int
        The triangle, and its points.
    local : ndarray, shape (n, 3)
        Replaced.
    """
    corners, weights = local_floats((3, 3)), local_floats(3)
    rotation, position = local_floats((3, 3)), local_floats(3)
    for k in range(3):
        corners[0, k], corners[1, k], corners[2, k] = points[a, k], points[b, k], points[c, k]
        weights[k] = 1.
    size = fit_rigid(rest, corners, weights, rotation, position)
    if not prototype.sizes[0] <= size <= prototype.sizes[1]:
        return False
    _scaled_origin(rest, corners, size, rotation, position)
    to_palm_frame(points, rotation, position, size, local)
    cost = quick_cost(prototype, local, free, candidates.cost[len(candidates.cost) - 1])
    insert_candidate(candidates, cost, base, a, b, c)
    return True


@labelling_jit
def complete_palms(prototype: Prototype, points: np.ndarray, free: np.ndarray, rows: np.ndarray,
                   candidates: Candidates) -> None:
    """Collect palm candidates: two labelled palm markers, and each free point as a third.

    A palm of which two markers are seen may be turned about their line, far off the third's point.

    Parameters
    ----------
    prototype : Prototype
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
        Points that may be the third.
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none; with other than two of the palm there are no candidates.
    candidates : Candidates
        Updated.
    """
    if count_seen_palm(prototype, rows) != 2:
        return
    rest, corners = local_floats((3, 3)), np.empty(3, np.int64)
    local, usable = np.empty((len(points), 3)), free.copy()
    for row in rows:
        if row >= 0:
            usable[row] = True
    for base in range(len(prototype.bases)):
        lacking = -1
        for i in range(3):
            marker = prototype.bases[base, i]
            corners[i] = rows[marker]
            lacking = i if corners[i] < 0 else lacking
            for k in range(3):
                rest[i, k] = prototype.template[marker, k]
        if (corners >= 0).sum() != 2:
            continue
        for j in range(len(points)):
            if free[j]:
                corners[lacking] = j
                _try_palm(prototype, points, usable, rest, base, corners[0], corners[1], corners[2],
                          local, candidates)


@labelling_jit
def _scaled_origin(rest: np.ndarray, corners: np.ndarray, size: float, rotation: np.ndarray,
                   position: np.ndarray) -> None:
    """Set the palm's origin so that the centroids of scaled template and corners coincide."""
    for k in range(3):
        position[k] = 0.
        for i in range(len(corners)):
            position[k] += corners[i, k] - size * (
                rotation[k, 0] * rest[i, 0] + rotation[k, 1] * rest[i, 1]
                + rotation[k, 2] * rest[i, 2])
        position[k] /= len(corners)


@labelling_jit
def quick_cost(prototype: Prototype, local: np.ndarray, free: np.ndarray,
               limit: float) -> float:
    """Return a palm's cost, each marker at its cheapest point, shared or not; inf above `limit`."""
    total = 0.
    best = len(prototype.template) * HIDDEN_COST
    for i in range(len(prototype.template)):
        base = SEEN_COST + prototype.marginal_constant[i]
        best += min(base - HIDDEN_COST, 0.)
    for i in range(len(prototype.template)):
        base = SEEN_COST + prototype.marginal_constant[i]
        least = HIDDEN_COST
        for j in range(len(local)):
            if free[j]:
                least = min(least, base + quadratic(
                    prototype.marginal[i], local[j, 0] - prototype.template[i, 0],
                    local[j, 1] - prototype.template[i, 1],
                    local[j, 2] - prototype.template[i, 2]))
        total += least
        # A lower bound: the excess cost of the markers so far cannot be regained.
        best += least - min(base, HIDDEN_COST)
        if best > limit:
            return math.inf
    return total


@labelling_jit
def insert_candidate(candidates: Candidates, cost: float, base: int, a: int, b: int,
                     c: int) -> None:
    """Insert a candidate in the order of costs; drop the most expensive one."""
    last = len(candidates.cost) - 1
    if not cost < candidates.cost[last]:
        return
    while last > 0 and candidates.cost[last - 1] > cost:
        candidates.cost[last] = candidates.cost[last - 1]
        candidates.corners[last] = candidates.corners[last - 1]
        last -= 1
    candidates.cost[last] = cost
    candidates.corners[last, 0] = base
    candidates.corners[last, 1] = a
    candidates.corners[last, 2] = b
    candidates.corners[last, 3] = c


@labelling_jit
def label_candidates(prototype: Prototype, points: np.ndarray, free: np.ndarray,
                     candidates: Candidates, finding: Finding) -> None:
    """Label the candidates' markers, and keep the cheapest labelling.

    Parameters
    ----------
    prototype : Prototype
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
    candidates : Candidates
    finding : Finding
        Replaced where a labelling costs less.
    """
    count = len(prototype.template)
    rest, corners = local_floats((3, 3)), local_floats((3, 3))
    weights = np.ones(3)
    found = blank_finding(count)
    improved = False
    for n in range(len(candidates.cost)):
        if candidates.cost[n] == math.inf:
            break
        base = prototype.bases[candidates.corners[n, 0]]
        same = finding.cost[0] < math.inf
        for i in range(3):
            same = same and finding.rows[base[i]] == candidates.corners[n, 1 + i]
        if same:
            continue
        for i in range(3):
            for k in range(3):
                rest[i, k] = prototype.template[base[i], k]
                corners[i, k] = points[candidates.corners[n, 1 + i], k]
        size = fit_rigid(rest, corners, weights, found.rotation, found.position)
        _scaled_origin(rest, corners, size, found.rotation, found.position)
        found.size[0] = size
        label_palm(prototype, points, free, found)
        if found.cost[0] < finding.cost[0]:
            copy_finding(found, finding)
            improved = True
    if improved:
        chain_palm(prototype, points, free, finding)


@labelling_jit
def label_palm(prototype: Prototype, points: np.ndarray, free: np.ndarray,
               found: Finding) -> None:
    """Label all markers by optimal assignment at a rough palm pose, then refine labels and pose.

    Parameters
    ----------
    prototype : Prototype
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
    found : Finding
        With the palm's place and size; replaced.
    """
    count = len(prototype.template)
    local = np.empty((len(points), 3))
    cost = np.empty((count, len(points)))
    to_palm_frame(points, found.rotation, found.position, found.size[0], local)
    label_costs(prototype, local, free, cost)
    assign_rows(cost, HIDDEN_COST, found.rows)
    refine_palm(prototype, points, free, found)
    if not palm_is_seen(prototype, found.rows):
        found.cost[0] = math.inf


@labelling_jit
def palm_is_seen(prototype: Prototype, rows: np.ndarray) -> bool:
    """Return whether three or more markers of the palm are seen."""
    return count_seen_palm(prototype, rows) >= 3


@labelling_jit
def count_seen_palm(prototype: Prototype, rows: np.ndarray) -> int:
    """Return the number of the palm's seen markers."""
    seen = 0
    for i in range(len(rows)):
        seen += 1 if rows[i] >= 0 and prototype.rigid[i] > 0. else 0
    return seen


@labelling_jit
def refine_palm(prototype: Prototype, points: np.ndarray, free: np.ndarray,
                found: Finding) -> None:
    """Refine a labelling: place the palm, relabel its points, place it again; write the cost."""
    count = len(prototype.template)
    local = np.empty((len(points), 3))
    matrix = np.empty((3 * count, 3 * count))
    place_by_palm(prototype, points, found.rows, found)
    to_palm_frame(points, found.rotation, found.position, found.size[0], local)
    cost, distance = complete_labels(prototype, local, free, found.rows, matrix)
    write_cost(prototype, local, found, cost, distance)
    drop_sparse(found)
    place_by_palm(prototype, points, found.rows, found)


@labelling_jit
def chain_palm(prototype: Prototype, points: np.ndarray, free: np.ndarray,
               finding: Finding) -> None:
    """Improve a finding's labels by `chain_labels`, as long as the cost falls."""
    count = len(prototype.template)
    local = np.empty((len(points), 3))
    matrix = np.empty((3 * count, 3 * count))
    found = blank_finding(count)
    copy_finding(finding, found)
    for _ in range(CHAIN_ROUNDS):
        to_palm_frame(points, found.rotation, found.position, found.size[0], local)
        cost = (found.cost[0] - size_cost(prototype, found.size[0])
                - links_cost(prototype, local, found.rows))
        if not chain_labels(prototype, local, free, found.rows, matrix, cost):
            break
        refine_palm(prototype, points, free, found)
        if not found.cost[0] < finding.cost[0]:
            break
        copy_finding(found, finding)


@labelling_jit
def copy_finding(source: Finding, target: Finding) -> None:
    """Copy a finding to another."""
    target.rows[:] = source.rows
    target.rotation[:] = source.rotation
    target.position[:] = source.position
    target.size[0], target.cost[0] = source.size[0], source.cost[0]
    target.distance[0] = source.distance[0]


@labelling_jit
def write_cost(prototype: Prototype, local: np.ndarray, found: Finding, cost: float,
               distance: float) -> None:
    """Write a labelled hand's cost, of posture, size and links, and its Mahalanobis distance.

    Parameters
    ----------
    prototype : Prototype
    local : ndarray, shape (n, 3)
        Points in the palm's frame [m].
    found : Finding
        With its labels and size; changed.
    cost, distance : float
        Of its posture: `posture_cost`, and squared Mahalanobis distance.
    """
    found.cost[0] = (cost + size_cost(prototype, found.size[0])
                     + links_cost(prototype, local, found.rows))
    found.distance[0] = distance / (3. * max(count_seen(found.rows), 1))


@labelling_jit
def drop_sparse(found: Finding) -> None:
    """Set the cost to infinity if less than `LEAST_SHARE` of the markers are seen."""
    if count_seen(found.rows) < LEAST_SHARE * len(found.rows):
        found.cost[0] = math.inf


@labelling_jit
def size_cost(prototype: Prototype, size: float) -> float:
    """Return the cost of a palm's size by its normal prior, with 95 % in the range of sizes."""
    half = .5 * (prototype.sizes[1] - prototype.sizes[0])
    return (2. * (size - 1.) / half) ** 2


@labelling_jit
def place_by_palm(prototype: Prototype, points: np.ndarray, rows: np.ndarray,
                  found: Finding) -> bool:
    """Fit a palm rigidly to its seen markers; return whether there were enough, three."""
    count = count_seen_palm(prototype, rows)
    if count < 3:
        return False
    rest, corners = np.empty((count, 3)), np.empty((count, 3))
    n = 0
    for i in range(len(rows)):
        if rows[i] >= 0 and prototype.rigid[i] > 0.:
            for k in range(3):
                rest[n, k] = prototype.template[i, k]
                corners[n, k] = points[rows[i], k]
            n += 1
    size = fit_rigid(rest, corners, np.ones(count), found.rotation, found.position)
    if size <= 0.:
        return False
    size = min(max(size, prototype.sizes[0]), prototype.sizes[1])
    _scaled_origin(rest, corners, size, found.rotation, found.position)
    found.size[0] = size
    return True
