"""Search for hands by pairs of palm markers, over rotations about the line through them.

The best candidates are labelled, and placed by the joint distribution of all markers: the digits
fix the rotation, as far as it allows.
"""

import math

import numpy as np

from ..numerics.assignment import assign_rows
from ..numerics.jit import labelling_jit
from ..numerics.stack_memory import local_floats
from .hand_track import turn_rotation
from .palm_search import (
    Candidates,
    Finding,
    blank_finding,
    chain_palm,
    copy_finding,
    drop_sparse,
    insert_candidate,
    palms_within,
    quick_cost,
    to_palm_frame,
    write_cost,
)
from .posture import (
    HIDDEN_COST,
    complete_labels,
    label_costs,
    posture_distance,
    reset_matrix,
    sweep,
)
from .prototypes import Prototype

TURNS = 16              # tried rotations of a palm about the line of a pair; ours
PLACING_ROUNDS = 3      # Gauss-Newton steps of `place_by_all`; ours
LABELLING_ROUNDS = 3    # of placing a candidate and labelling it again; ours


@labelling_jit
def search_pairs(prototype: Prototype, points: np.ndarray, free: np.ndarray, first: int,
                 budget: int, candidates: Candidates) -> int:
    """Collect palm candidates by pairs of palm markers, as `search_palms` does by triangles.

    Parameters are those of `search_palms`. Corners of the candidates: the pair, its two points, and
    the index of the rotation.
    """
    count, tried, most = len(points), 0, palms_within(budget, prototype, points)
    rotation, position = local_floats((3, 3)), local_floats(3)
    local = np.empty((count, 3))
    for offset in range(count):
        a = (first + offset) % count
        if tried >= most:
            return offset
        if not free[a]:
            continue
        for b in range(count):
            if b == a or not free[b]:
                continue
            for pair in range(len(prototype.pairs)):
                if not pair_fits(prototype, points, pair, a, b):
                    continue
                least, best = math.inf, -1
                for turn in range(TURNS):
                    tried += 1
                    size = place_by_pair(
                        prototype, points, pair, a, b, turn, rotation, position)
                    to_palm_frame(points, rotation, position, size, local)
                    cost = quick_cost(prototype, local, free, min(
                        least, candidates.cost[len(candidates.cost) - 1]))
                    if cost < least:
                        least, best = cost, turn
                if best >= 0:
                    insert_candidate(candidates, least, pair, a, b, best)
    return count


@labelling_jit
def pair_fits(prototype: Prototype, points: np.ndarray, pair: int, a: int, b: int) -> bool:
    """Return whether two points' distance is within the tolerance of a pair of palm markers."""
    gap, length = 0., 0.
    for k in range(3):
        gap += (points[a, k] - points[b, k]) ** 2
        length += (prototype.template[prototype.pairs[pair, 0], k]
                   - prototype.template[prototype.pairs[pair, 1], k]) ** 2
    grown, allowed = math.sqrt(gap / length), prototype.pair_sides[pair]
    return prototype.sizes[0] - allowed <= grown <= prototype.sizes[1] + allowed


@labelling_jit
def place_by_pair(prototype: Prototype, points: np.ndarray, pair: int, a: int, b: int,
                  turn: int, rotation: np.ndarray, position: np.ndarray) -> float:
    """Place a palm by two points and a rotation about their line; return its size.

    Parameters
    ----------
    prototype : Prototype
    points : ndarray, shape (n, 3)
        [m]
    pair, a, b : int
        Pair of palm markers, and their points.
    turn : int
        Index of the rotation, of `TURNS`.
    rotation, position : ndarray, shape (3, 3), (3,)
        Replaced [m].
    """
    one, other = prototype.pairs[pair, 0], prototype.pairs[pair, 1]
    rest, there = local_floats((3, 3)), local_floats((3, 3))
    for k in range(3):
        rest[0, k] = prototype.template[other, k] - prototype.template[one, k]
        there[0, k] = points[b, k] - points[a, k]
    size = _axes_along(there) / _axes_along(rest)
    size = min(max(size, prototype.sizes[0]), prototype.sizes[1])
    c, s = math.cos(2. * math.pi * turn / TURNS), math.sin(2. * math.pi * turn / TURNS)
    for k in range(3):
        across, up = there[1, k], there[2, k]
        there[1, k], there[2, k] = c * across + s * up, c * up - s * across
    for m in range(3):
        for n in range(3):
            rotation[m, n] = (there[0, m] * rest[0, n] + there[1, m] * rest[1, n]
                              + there[2, m] * rest[2, n])
    for m in range(3):
        position[m] = .5 * (points[a, m] + points[b, m])
        for n in range(3):
            position[m] -= .5 * size * rotation[m, n] * (
                prototype.template[one, n] + prototype.template[other, n])
    return size


@labelling_jit
def _axes_along(axes: np.ndarray) -> float:
    """Complete a vector, `axes[0]`, to right-handed unit axes (3, 3); return its length."""
    length = math.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    least = 0
    for k in range(3):
        axes[0, k] /= max(length, 1e-12)
        least = k if abs(axes[0, k]) < abs(axes[0, least]) else least
    norm = math.sqrt(max(1. - axes[0, least] ** 2, 1e-12))
    for k in range(3):
        axes[1, k] = ((1. if k == least else 0.) - axes[0, least] * axes[0, k]) / norm
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        axes[2, k] = axes[0, m] * axes[1, n] - axes[0, n] * axes[1, m]
    return length


@labelling_jit
def label_pairs(prototype: Prototype, points: np.ndarray, free: np.ndarray,
                candidates: Candidates, finding: Finding) -> None:
    """Label the markers of candidates by pairs, and keep the cheapest labelling.

    Parameters are those of `label_candidates`.
    """
    count = len(prototype.template)
    found = blank_finding(count)
    local, cost = np.empty((len(points), 3)), np.empty((count, len(points)))
    improved = False
    for n in range(len(candidates.cost)):
        if candidates.cost[n] == math.inf:
            break
        corners = candidates.corners[n]
        found.size[0] = place_by_pair(
            prototype, points, corners[0], corners[1], corners[2], corners[3], found.rotation,
            found.position)
        to_palm_frame(points, found.rotation, found.position, found.size[0], local)
        label_costs(prototype, local, free, cost)
        assign_rows(cost, HIDDEN_COST, found.rows)
        for _ in range(LABELLING_ROUNDS):
            _relabel_placed(prototype, points, free, found)
        if found.cost[0] < finding.cost[0]:
            copy_finding(found, finding)
            improved = True
    if improved:
        chain_palm(prototype, points, free, finding)


@labelling_jit
def _relabel_placed(prototype: Prototype, points: np.ndarray, free: np.ndarray,
                    found: Finding) -> None:
    """Place a hand by all its markers, and complete its labels; write the cost."""
    count = len(prototype.template)
    local, matrix = np.empty((len(points), 3)), np.empty((3 * count, 3 * count))
    place_by_all(prototype, points, found)
    to_palm_frame(points, found.rotation, found.position, found.size[0], local)
    cost, distance = complete_labels(prototype, local, free, found.rows, matrix)
    write_cost(prototype, local, found, cost, distance)
    drop_sparse(found)


@labelling_jit
def place_by_all(prototype: Prototype, points: np.ndarray, found: Finding) -> None:
    """Place a labelled hand by maximum likelihood of all its markers (Gauss-Newton).

    Parameters
    ----------
    prototype : Prototype
    points : ndarray, shape (n, 3)
        [m]
    found : Finding
        Roughly placed; its place and size are replaced.
    """
    count = len(prototype.template)
    local, matrix = np.empty((len(points), 3)), np.empty((3 * count, 3 * count))
    residual, gradient = np.empty(3 * count), np.empty(3 * count)
    # Jacobian of the places by rotation vector, translation and size, in the palm's frame
    slope, weighed = np.empty((7, 3 * count)), np.empty(3 * count)
    normal = local_floats((8, 8))
    half = .5 * (prototype.sizes[1] - prototype.sizes[0])
    reset_matrix(prototype, found.rows, matrix)
    for _ in range(PLACING_ROUNDS):
        size = found.size[0]
        to_palm_frame(points, found.rotation, found.position, size, local)
        posture_distance(matrix, prototype.template, local, found.rows, residual, gradient)
        slope[:] = 0.
        for i in range(count):
            if found.rows[i] < 0:
                continue
            for k in range(3):
                m, n = (k + 1) % 3, (k + 2) % 3
                slope[k, 3 * i + n] = local[found.rows[i], m]
                slope[k, 3 * i + m] = -local[found.rows[i], n]
                slope[3 + k, 3 * i + k] = 1.
                slope[6, 3 * i + k] = local[found.rows[i], k]
        for p in range(7):
            for i in range(3 * count):
                weighed[i] = 0.
                for j in range(3 * count):
                    weighed[i] += matrix[i, j] * slope[p, j]
            for q in range(7):
                normal[p, q] = 0.
                for i in range(3 * count):
                    normal[p, q] += weighed[i] * slope[q, i]
            normal[p, 7] = 0.
            for i in range(3 * count):
                normal[p, 7] += slope[p, i] * gradient[i]
        normal[6, 6] += 4. * size * size / (half * half)
        normal[6, 7] -= 4. * size * (size - 1.) / (half * half)
        for p in range(7):
            normal[p, p] *= 1. + 1e-9
            normal[7, p] = normal[p, 7]
        normal[7, 7] = 0.
        for p in range(7):
            sweep(normal, p)
        spin = np.zeros(3)
        for m in range(3):
            for k in range(3):
                found.position[m] += size * found.rotation[m, k] * normal[3 + k, 7]
                spin[m] += found.rotation[m, k] * normal[k, 7]
        turn_rotation(found.rotation, spin[0], spin[1], spin[2])
        found.size[0] = min(
            max(size * (1. + normal[6, 7]), prototype.sizes[0]), prototype.sizes[1])
