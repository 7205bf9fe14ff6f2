"""Transdigital correlation: what the digits that are seen tell of one that is not.

How digits move together is learned while all are seen, as a weighted least squares with
forgetting that needs no past frames, about a prior that links neighbouring fingers. A hidden
digit then takes its learned share of every move of the others, beginning where it was: it
neither jumps when it vanishes nor when a neighbour does. Its flexion stays within a candidate
space about that of its neighbours.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import FLEXION_JOINTS
from ..numerics.jit import jit
from ..numerics.vectors import clamp

DIGITS = 5
SIZE = 3 * DIGITS
LEADERS = FLEXION_JOINTS[:4, 0].copy()
# Beyond a digit in the palm's frame, a captured one stays below .8 m/s: a marker has jumped, and
# one jump would drown the rest.
FARTHEST, FASTEST = 1., 1.  # [m], [m/s] on an axis


class Habits(NamedTuple):
    """What was learned of five markers in the palm's frame; weights are seconds.

    Attributes
    ----------
    weight : ndarray, shape (1,)
        [s]
    first : ndarray, shape (15,)
        Weighted sum of the places [m s].
    second, motion : ndarray, shape (15, 15)
        Weighted sums of the products of places [m^2 s] and of velocities [m^2 / s].
    """

    weight: np.ndarray
    first: np.ndarray
    second: np.ndarray
    motion: np.ndarray


def no_habits():
    """Return `Habits` before the first frame."""
    return Habits(np.zeros(1), np.zeros(SIZE), np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE)))


def prior_of(index_middle, middle_ring, ring_little):
    """Return how digits move together before anything is learned, shape (15, 15).

    Parameters
    ----------
    index_middle, middle_ring, ring_little : float
        Correlation of neighbouring fingers, from 0 to 1; that of others is the product of
        those between them, and the thumb is free (paper, transdigital correlation).
    """
    chain = np.eye(DIGITS)
    links = (index_middle, middle_ring, ring_little)
    for a in range(4):
        for b in range(a):
            chain[a, b] = chain[b, a] = math.prod(links[b:a])
    return np.kron(chain, np.eye(3))


@jit
def learn(habits, places, velocities, step, memory):
    """Add a frame in which all digits are seen.

    Parameters
    ----------
    habits : Habits
        Changed, unless a marker has jumped.
    places, velocities : ndarray, shape (5, 3)
        Of the markers in the palm's frame [m], [m/s].
    step : float
        Since the last frame [s].
    memory : float
        Time in which a frame loses two thirds of its weight [s].
    """
    kept = math.exp(-step / memory)
    x = np.empty(SIZE)
    v = np.empty(SIZE)
    for i in range(SIZE):
        x[i] = places[i // 3, i % 3]
        v[i] = velocities[i // 3, i % 3]
        # True for NaN
        if not (abs(x[i]) <= FARTHEST and abs(v[i]) <= FASTEST):
            return
    habits.weight[0] = kept * habits.weight[0] + step
    for i in range(SIZE):
        habits.first[i] = kept * habits.first[i] + step * x[i]
        for j in range(SIZE):
            habits.second[i, j] = kept * habits.second[i, j] + step * x[i] * x[j]
            habits.motion[i, j] = kept * habits.motion[i, j] + step * v[i] * v[j]


@jit
def shares_of(habits, prior, prior_spread, places, hidden, horizon, floor, shares):
    """Find the share that each hidden digit takes of the others' moves.

    Least squares of how far places were from those of now, and of velocities over a
    horizon, so that moves of short and of long count.

    Parameters
    ----------
    habits : Habits
    prior : ndarray, shape (15, 15)
        `prior_of`.
    prior_spread : float
        Size of the moves that the prior stands for, for a second [m].
    places : ndarray, shape (5, 3)
        Of the markers now [m].
    hidden : ndarray of bool, shape (5,)
    horizon : float
        [s]
    floor : float
        Moves of the others that are smaller than this tell little [m].
    shares : ndarray, shape (15, 15)
        Replaced: moves of hidden digits (rows) for moves of those seen (columns).
    """
    weight = habits.weight[0]
    x = np.empty(SIZE)
    for i in range(SIZE):
        x[i] = clamp(places[i // 3, i % 3], -FARTHEST, FARTHEST)
    moves = np.empty((SIZE, SIZE))
    for i in range(SIZE):
        for j in range(SIZE):
            moves[i, j] = prior_spread ** 2 * prior[i, j] + (
                habits.second[i, j] - x[i] * habits.first[j] - habits.first[i] * x[j]
                + weight * x[i] * x[j] + horizon ** 2 * habits.motion[i, j])
    # The seen rows are eliminated one by one: the floor keeps their pivots positive.
    shares[:] = 0.
    for i in range(SIZE):
        if not hidden[i // 3]:
            moves[i, i] += (weight + 1.) * floor ** 2
    for pivot in range(SIZE):
        if hidden[pivot // 3]:
            continue
        for i in range(SIZE):
            if i != pivot and not hidden[i // 3]:
                factor = moves[i, pivot] / moves[pivot, pivot]
                for j in range(SIZE):
                    if j > pivot or hidden[j // 3]:
                        moves[i, j] -= factor * moves[pivot, j]
    for i in range(SIZE):
        if not hidden[i // 3]:
            for j in range(SIZE):
                if hidden[j // 3]:
                    shares[j, i] = moves[i, j] / moves[i, i]


@jit
def keep_near_neighbours(angles, seen, bounds, apart, lower, upper):
    """Take the MCP flexion of hidden fingers to the nearest point of their candidate space.

    Neighbours flex by at most a bound more or less; where they were seen farther apart,
    that is the bound until they are seen again.

    Parameters
    ----------
    angles : ndarray, shape (25,)
        Those of hidden fingers are replaced [rad].
    seen : ndarray of bool, shape (5,)
        Markers of the digits.
    bounds : ndarray, shape (3,)
        Of index and middle, middle and ring, ring and little finger [rad].
    apart : ndarray, shape (3,)
        Difference of each pair when it was last seen, replaced [rad].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    """
    for pair in range(3):
        if seen[pair] and seen[pair + 1]:
            apart[pair] = abs(angles[LEADERS[pair]] - angles[LEADERS[pair + 1]])
    # From seen fingers outwards: to the right, then to the left.
    for pair in (0, 1, 2):
        if not seen[pair + 1]:
            _keep(angles, LEADERS[pair + 1], LEADERS[pair], max(bounds[pair], apart[pair]),
                  lower, upper)
    for pair in (2, 1, 0):
        if not seen[pair]:
            _keep(angles, LEADERS[pair], LEADERS[pair + 1], max(bounds[pair], apart[pair]),
                  lower, upper)


@jit
def _keep(angles, joint, neighbour, most, lower, upper):
    wanted = clamp(angles[joint], angles[neighbour] - most, angles[neighbour] + most)
    angles[joint] = clamp(wanted, lower[joint], upper[joint])
