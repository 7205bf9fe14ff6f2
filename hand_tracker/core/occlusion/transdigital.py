"""Transdigital correlation: hidden digits predicted by the seen ones, and their candidate space.

How digits move together is learned while all are seen: exponentially weighted sums of places and
velocities, about a prior that correlates neighbouring fingers (paper, transdigital correlation).
Linear regression on them predicts the move of a hidden digit from the moves of the seen ones. As
moves are predicted, and not places, nothing jumps when a digit vanishes or a neighbour does. The
candidate space limits how far the MCP flexion of a hidden finger may differ from its neighbours'.
"""

import math
from typing import NamedTuple

import numpy as np

from ..filtering.tracks import PRIOR_MOTION
from ..model.hand import DIGITS, FLEXION_JOINTS
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import clamp

COORDINATES = 3 * len(DIGITS)
MCP_FLEXION = FLEXION_JOINTS[:4, 0].copy()  # joints, index to little finger
# Limits of what is learned, on an axis in the wrist's frame: captured digits stay below .8 m/s, so
# a faster marker has jumped, and a single jump would outweigh all true motion.
MAX_LEARNED_PLACE = 1.  # [m]
MAX_LEARNED_SPEED = 1.  # [m/s]
# Of the regression, tuned on captured hands.
PRIOR_MOVE = .03        # [m] size of the moves that the prior stands for, for one second
VELOCITY_HORIZON = .3   # [s] over which a velocity counts as a move
MOVE_FLOOR = .003       # [m] moves of seen digits below this predict little


class MotionStatistics(NamedTuple):
    """Exponentially weighted sums over the frames with all five digits' markers seen.

    Each frame weighs as many seconds as it lasted; places are in the wrist's frame.

    Attributes
    ----------
    weight : ndarray, shape (1,)
        [s]
    first : ndarray, shape (15,)
        Sum of the places [m s].
    second, motion : ndarray, shape (15, 15)
        Sums of the outer products of places [m² s] and of velocities [m²/s].
    """

    weight: np.ndarray
    first: np.ndarray
    second: np.ndarray
    motion: np.ndarray


class Transdigital(NamedTuple):
    """Learned transdigital correlation.

    Attributes
    ----------
    statistics : MotionStatistics
    coefficients : ndarray, shape (15, 15)
        Of `regress_hidden`: moves of hidden digits (rows) by those of seen ones (columns).
    """

    statistics: MotionStatistics
    coefficients: np.ndarray


class DigitPrior(NamedTuple):
    """Knowledge of the digits before any is learned.

    Attributes
    ----------
    rest : ndarray, shape (5, 3)
        Markers of the relaxed hand in the wrist's frame [m].
    correlation : ndarray, shape (15, 15)
        Of `prior_correlation`.
    """

    rest: np.ndarray
    correlation: np.ndarray


def nothing_learned() -> Transdigital:
    """Return `Transdigital` before the first frame."""
    size = COORDINATES
    return Transdigital(
        MotionStatistics(np.zeros(1), np.zeros(size), np.zeros((size, size)),
                         np.zeros((size, size))), np.zeros((size, size)))


def prior_correlation(index_middle: float, middle_ring: float, ring_little: float) -> np.ndarray:
    """Return the correlation of the digits' moves before any is learned.

    Parameters
    ----------
    index_middle, middle_ring, ring_little : float
        Correlation of neighbouring fingers, 0 to 1 [1]; that of other fingers is the product
        of those between them, and the thumb is free (paper, transdigital correlation).

    Returns
    -------
    ndarray, shape (15, 15)
    """
    chain = np.eye(len(DIGITS))
    links = (index_middle, middle_ring, ring_little)
    for a in range(4):
        for b in range(a):
            chain[a, b] = chain[b, a] = math.prod(links[b:a])
    return np.kron(chain, np.eye(3))


@jit
def learn(statistics: MotionStatistics, places: np.ndarray, velocities: np.ndarray, step: float,
          memory: float) -> None:
    """Add a frame with all digits seen to the statistics; skip it when a marker has jumped.

    Parameters
    ----------
    statistics : MotionStatistics
        Changed.
    places, velocities : ndarray, shape (5, >= 3)
        Of the digits' markers in the wrist's frame [m], [m/s].
    step : float
        Since the last frame [s].
    memory : float
        Time constant of the weights [s].
    """
    kept = math.exp(-step / memory)
    x = local_floats(COORDINATES)
    v = local_floats(COORDINATES)
    for i in range(COORDINATES):
        x[i] = places[i // 3, i % 3]
        v[i] = velocities[i // 3, i % 3]
        # True for NaN
        if not (abs(x[i]) <= MAX_LEARNED_PLACE and abs(v[i]) <= MAX_LEARNED_SPEED):
            return
    statistics.weight[0] = kept * statistics.weight[0] + step
    for i in range(COORDINATES):
        statistics.first[i] = kept * statistics.first[i] + step * x[i]
        for j in range(COORDINATES):
            statistics.second[i, j] = kept * statistics.second[i, j] + step * x[i] * x[j]
            statistics.motion[i, j] = kept * statistics.motion[i, j] + step * v[i] * v[j]


@jit
def write_own_motion(statistics: MotionStatistics, correlation: np.ndarray,
                     motion: np.ndarray) -> None:
    """Write the covariance of the digits' motion in the palm, as learned beside a prior.

    Parameters
    ----------
    statistics : MotionStatistics
    correlation : ndarray, shape (15, 15)
        Of `DigitPrior`.
    motion : ndarray, shape (15, 15)
        Replaced [m²/s].
    """
    for i in range(COORDINATES):
        for j in range(COORDINATES):
            motion[i, j] = statistics.motion[i, j] + PRIOR_MOTION * correlation[i, j]


@jit
def regress_hidden(statistics: MotionStatistics, correlation: np.ndarray, places: np.ndarray,
                   hidden: np.ndarray, coefficients: np.ndarray) -> None:
    """Regress the moves of the hidden digits on those of the seen ones (ridge regression).

    The sample is every past place as seen from the present one, and every past velocity over
    `VELOCITY_HORIZON`, so that long and short moves both count.

    Parameters
    ----------
    statistics : MotionStatistics
    correlation : ndarray, shape (15, 15)
        Of `DigitPrior`.
    places : ndarray, shape (5, 3)
        Present places of the markers in the wrist's frame [m].
    hidden : ndarray of bool, shape (5,)
    coefficients : ndarray, shape (15, 15)
        Replaced: moves of hidden digits (rows) for moves of seen ones (columns); else 0.
    """
    weight = statistics.weight[0]
    x = local_floats(COORDINATES)
    for i in range(COORDINATES):
        x[i] = clamp(places[i // 3, i % 3], -MAX_LEARNED_PLACE, MAX_LEARNED_PLACE)
    moments = local_floats((COORDINATES, COORDINATES))
    for i in range(COORDINATES):
        for j in range(COORDINATES):
            moments[i, j] = PRIOR_MOVE ** 2 * correlation[i, j] + (
                statistics.second[i, j] - x[i] * statistics.first[j] - statistics.first[i] * x[j]
                + weight * x[i] * x[j] + VELOCITY_HORIZON ** 2 * statistics.motion[i, j])
    # Gauss-Jordan elimination of the seen rows: the floor keeps their pivots positive.
    coefficients[:] = 0.
    for i in range(COORDINATES):
        if not hidden[i // 3]:
            moments[i, i] += (weight + 1.) * MOVE_FLOOR ** 2
    for pivot in range(COORDINATES):
        if hidden[pivot // 3]:
            continue
        for i in range(COORDINATES):
            if i != pivot and not hidden[i // 3]:
                factor = moments[i, pivot] / moments[pivot, pivot]
                for j in range(COORDINATES):
                    if j > pivot or hidden[j // 3]:
                        moments[i, j] -= factor * moments[pivot, j]
    for i in range(COORDINATES):
        if not hidden[i // 3]:
            for j in range(COORDINATES):
                if hidden[j // 3]:
                    coefficients[j, i] = moments[i, j] / moments[i, i]


@jit
def limit_neighbour_difference(angles: np.ndarray, seen: np.ndarray, bounds: np.ndarray,
                               seen_difference: np.ndarray, lower: np.ndarray,
                               upper: np.ndarray) -> None:
    """Move the MCP flexion of hidden fingers to the nearest point of their candidate space.

    Neighbours differ by at most a bound; where they were seen farther apart, by at most that
    difference, until both are seen again.

    Parameters
    ----------
    angles : ndarray, shape (25,)
        Those of hidden fingers are replaced [rad].
    seen : ndarray of bool, shape (5,)
        Markers of the digits.
    bounds : ndarray, shape (3,)
        Of index and middle, middle and ring, ring and little finger [rad].
    seen_difference : ndarray, shape (3,)
        Difference of each pair when both were last seen, replaced [rad].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    """
    for pair in range(3):
        if seen[pair] and seen[pair + 1]:
            seen_difference[pair] = abs(
                angles[MCP_FLEXION[pair]] - angles[MCP_FLEXION[pair + 1]])
    # From seen fingers outwards: towards the little finger, then towards the index finger.
    for pair in (0, 1, 2):
        if not seen[pair + 1]:
            _limit_difference(angles, MCP_FLEXION[pair + 1], MCP_FLEXION[pair],
                              max(bounds[pair], seen_difference[pair]), lower, upper)
    for pair in (2, 1, 0):
        if not seen[pair]:
            _limit_difference(angles, MCP_FLEXION[pair], MCP_FLEXION[pair + 1],
                              max(bounds[pair], seen_difference[pair]), lower, upper)


@jit
def _limit_difference(angles: np.ndarray, joint: int, neighbour: int, bound: float,
                      lower: np.ndarray, upper: np.ndarray) -> None:
    """Move a joint to within a bound of its neighbour, and within its own limits [rad]."""
    wanted = clamp(angles[joint], angles[neighbour] - bound, angles[neighbour] + bound)
    angles[joint] = clamp(wanted, lower[joint], upper[joint])
