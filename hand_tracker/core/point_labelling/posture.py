"""Posture cost of a labelling: likelihood of all its markers under the joint distribution.

Costs are in variances: twice the negative logarithm of the likelihood ratio to clutter, points that
are no marker of the hand, which is taken as evenly spread.
"""

import math

import numpy as np

from ..numerics.jit import labelling_jit
from ..numerics.stack_memory import local_floats
from .prototypes import Prototype

CLUTTER_DENSITY = 200.  # [1/m³] of points that are no marker of the hand; ours
# Cost of a seen marker besides its Mahalanobis distance and the logarithm of its determinant.
SEEN_COST = 3. * math.log(2. * math.pi) + 2. * math.log(CLUTTER_DENSITY)
HIDDEN_COST = 16.              # of an occluded marker, without a point; ours
# Degrees of freedom of the posture's multivariate Student distribution: postures far from the
# learned ones are rare, not impossible; ours.
FREEDOM = 6.
EXCHANGE_ROUNDS = 40    # at most
SMALLEST_GAIN = 1e-6    # below which costs are equal
CHAIN = 5               # markers of an alternating chain, at most


@labelling_jit
def sweep(matrix: np.ndarray, k: int) -> float:
    """Sweep a symmetric matrix on its diagonal element k (Beaton 1964); return that pivot.

    Sweeping an inverse covariance on hidden coordinates marginalises them: it leaves the inverse
    covariance of the others, the regression of the hidden ones on them, and minus the hidden ones'
    conditional covariance.
    """
    pivot = matrix[k, k]
    size = len(matrix)
    for i in range(size):
        if i == k:
            continue
        share = matrix[i, k] / pivot
        if share != 0.:
            for j in range(size):
                if j != k:
                    matrix[i, j] -= share * matrix[k, j]
    for i in range(size):
        if i != k:
            matrix[i, k] /= pivot
            matrix[k, i] = matrix[i, k]
    matrix[k, k] = -1. / pivot
    return pivot


@labelling_jit
def quadratic(matrix: np.ndarray, x: float, y: float, z: float) -> float:
    """Return vᵀ A v of a symmetric (3, 3) matrix."""
    return (matrix[0, 0] * x * x + matrix[1, 1] * y * y + matrix[2, 2] * z * z
            + 2. * (matrix[0, 1] * x * y + matrix[0, 2] * x * z + matrix[1, 2] * y * z))


@labelling_jit
def hide(matrix: np.ndarray, marker: int) -> float:
    """Marginalise a marker by sweeping its coordinates; return the log of the pivots' product."""
    return (math.log(sweep(matrix, 3 * marker)) + math.log(sweep(matrix, 3 * marker + 1))
            + math.log(sweep(matrix, 3 * marker + 2)))


@labelling_jit
def posture_distance(matrix: np.ndarray, mean: np.ndarray, local: np.ndarray, rows: np.ndarray,
                     residual: np.ndarray, gradient: np.ndarray) -> float:
    """Return the squared Mahalanobis distance of the seen markers from their mean places.

    Parameters
    ----------
    matrix : ndarray, shape (3 M, 3 M)
        Inverse covariance, swept on hidden markers.
    mean : ndarray, shape (M, 3)
    local : ndarray, shape (n, 3)
        Points in the palm's frame [m].
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    residual, gradient : ndarray, shape (3 M,)
        Of the places, 0 where hidden, and the matrix times it; replaced.
    """
    for i in range(len(rows)):
        for k in range(3):
            residual[3 * i + k] = (
                local[rows[i], k] - mean[i, k] if rows[i] >= 0 else 0.)
    total = 0.
    for a in range(len(residual)):
        value = 0.
        for b in range(len(residual)):
            value += matrix[a, b] * residual[b]
        gradient[a] = value
        total += residual[a] * value
    return total


@labelling_jit
def tail_cost(distance: float, dimensions: int) -> float:
    """Return the cost of a squared Mahalanobis distance by a multivariate Student distribution.

    Twice the negative logarithm of its density, without the determinant and with `SEEN_COST` for
    each three of the dimensions.
    """
    return ((FREEDOM + dimensions) * math.log1p(distance / FREEDOM)
            + 2. * (math.lgamma(.5 * FREEDOM) - math.lgamma(.5 * (FREEDOM + dimensions)))
            + dimensions * (math.log(.5 * FREEDOM) + SEEN_COST / 3.))


@labelling_jit
def posture_cost(constant: float, distance: float, seen: int, hidden: int) -> float:
    """Return the posture cost of a labelling: of its seen and its hidden markers.

    Parameters
    ----------
    constant : float
        Log-determinant of the seen markers' covariance, by `reset_matrix`.
    distance : float
        Their squared Mahalanobis distance.
    seen, hidden : int
        Numbers of markers.
    """
    return constant + tail_cost(distance, 3 * seen) + hidden * HIDDEN_COST


@labelling_jit
def count_seen(rows: np.ndarray) -> int:
    """Return the number of markers with a point, of labels (M,)."""
    seen = 0
    for i in range(len(rows)):
        seen += 1 if rows[i] >= 0 else 0
    return seen


@labelling_jit
def label_costs(prototype: Prototype, local: np.ndarray, free: np.ndarray,
                cost: np.ndarray) -> None:
    """Write the cost of each free point as each marker by its marginal distribution, (M, n)."""
    for i in range(len(cost)):
        base = SEEN_COST + prototype.marginal_constant[i]
        for j in range(cost.shape[1]):
            cost[i, j] = base + quadratic(
                prototype.marginal[i], local[j, 0] - prototype.template[i, 0],
                local[j, 1] - prototype.template[i, 1],
                local[j, 2] - prototype.template[i, 2]) if free[j] else math.inf


@labelling_jit
def _step(local: np.ndarray, rows: np.ndarray, marker: int, point: int,
          step: np.ndarray) -> None:
    """Write a marker's displacement when it takes another point, shape (3,) [m]."""
    for k in range(3):
        step[k] = local[point, k] - local[rows[marker], k]


@labelling_jit
def _change(matrix: np.ndarray, gradient: np.ndarray, marker: int, step: np.ndarray) -> float:
    """Return the change of the squared Mahalanobis distance as a marker moves by `step` [m]."""
    a = 3 * marker
    total = 0.
    for k in range(3):
        total += 2. * step[k] * gradient[a + k]
    return total + quadratic(matrix[a:a + 3, a:a + 3], step[0], step[1], step[2])


@labelling_jit
def exchange_change(matrix: np.ndarray, gradient: np.ndarray, local: np.ndarray,
                    rows: np.ndarray, i: int, j: int) -> float:
    """Return the change of the squared Mahalanobis distance as two labels are exchanged."""
    one, other = local_floats(3), local_floats(3)
    _step(local, rows, i, rows[j], one)
    change = _change(matrix, gradient, i, one)
    for k in range(3):
        other[k] = -one[k]
    change += _change(matrix, gradient, j, other)
    for a in range(3):
        for b in range(3):
            change += 2. * one[a] * matrix[3 * i + a, 3 * j + b] * other[b]
    return change


@labelling_jit
def refine_labels(matrix: np.ndarray, mean: np.ndarray, local: np.ndarray, free: np.ndarray,
                  rows: np.ndarray, residual: np.ndarray, gradient: np.ndarray) -> float:
    """Refine labels by exchanges and free points, while the Mahalanobis distance falls.

    Parameters
    ----------
    matrix, mean, local, residual, gradient
        As for `posture_distance`.
    free : ndarray of bool, shape (n,)
        Points that may be taken.
    rows : ndarray of int, shape (M,)
        Point of each marker, updated; which are hidden stays.

    Returns
    -------
    float
        Squared Mahalanobis distance.
    """
    count = len(rows)
    taken = ~free
    for i in range(count):
        if rows[i] >= 0:
            taken[rows[i]] = True
    one = local_floats(3)
    total = posture_distance(matrix, mean, local, rows, residual, gradient)
    for _ in range(EXCHANGE_ROUNDS):
        least = -SMALLEST_GAIN
        marker, partner, point = -1, -1, -1
        for i in range(count):
            if rows[i] < 0:
                continue
            for j in range(i):
                if rows[j] < 0:
                    continue
                change = exchange_change(matrix, gradient, local, rows, i, j)
                if change < least:
                    least, marker, partner = change, i, j
            for j in range(len(local)):
                if not taken[j]:
                    _step(local, rows, i, j, one)
                    change = _change(matrix, gradient, i, one)
                    if change < least:
                        least, marker, partner, point = change, i, -1, j
        if marker < 0:
            break
        if partner >= 0:
            rows[marker], rows[partner] = rows[partner], rows[marker]
        else:
            taken[rows[marker]], taken[point] = False, True
            rows[marker] = point
        total = posture_distance(matrix, mean, local, rows, residual, gradient)
    return total


@labelling_jit
def exchange_labels(prototype: Prototype, local: np.ndarray, free: np.ndarray, rows: np.ndarray,
                    matrix: np.ndarray, residual: np.ndarray,
                    gradient: np.ndarray) -> tuple[float, int, float]:
    """Refine labels, with points handed over to hidden markers; the number hidden stays.

    Parameters
    ----------
    prototype, local, free, rows, matrix
        As for `complete_labels`.
    residual, gradient
        As for `posture_distance`.

    Returns
    -------
    constant : float
        Of the cost, by `reset_matrix`.
    hidden : int
        Number of hidden markers.
    distance : float
        Squared Mahalanobis distance of the seen markers.
    """
    mean = prototype.template
    constant, hidden = reset_matrix(prototype, rows, matrix)
    distance = refine_labels(matrix, mean, local, free, rows, residual, gradient)
    for _ in range(len(rows)):
        giver, taker = _best_handover(matrix, mean, gradient, local, rows, distance)
        if giver < 0:
            break
        rows[taker], rows[giver] = rows[giver], -1
        constant, hidden = reset_matrix(prototype, rows, matrix)
        distance = refine_labels(matrix, mean, local, free, rows, residual, gradient)
    return constant, hidden, distance


@labelling_jit
def complete_labels(prototype: Prototype, local: np.ndarray, free: np.ndarray,
                    rows: np.ndarray, matrix: np.ndarray) -> tuple[float, float]:
    """Refine labels; hide seen markers and label hidden ones, as long as the cost falls.

    Parameters
    ----------
    prototype : Prototype
    local : ndarray, shape (n, 3)
        Points in the palm's frame [m].
    free : ndarray of bool, shape (n,)
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none; updated.
    matrix : ndarray, shape (3 M, 3 M)
        Replaced by the prototype's inverse covariance, swept on the hidden markers.

    Returns
    -------
    cost : float
        Of the labelling.
    distance : float
        Squared Mahalanobis distance of the seen markers.
    """
    count = len(rows)
    residual, gradient = np.empty(3 * count), np.empty(3 * count)
    constant, hidden, distance = exchange_labels(
        prototype, local, free, rows, matrix, residual, gradient)
    for _ in range(2 * count):
        # The least likely seen marker, given all others
        worst, most = -1, 0.
        for i in range(count):
            if rows[i] >= 0:
                gain = dropping_gain(matrix, gradient, i, distance, count - hidden)
                if gain > most:
                    most, worst = gain, i
        if worst >= 0:
            rows[worst] = -1
        else:
            marker, point = _best_addition(
                matrix, prototype.template, gradient, local, free, rows, distance)
            if marker < 0:
                break
            rows[marker] = point
        constant, hidden, distance = exchange_labels(
            prototype, local, free, rows, matrix, residual, gradient)
    return posture_cost(constant, distance, count - hidden, hidden), distance


@labelling_jit
def reset_matrix(prototype: Prototype, rows: np.ndarray,
                 matrix: np.ndarray) -> tuple[float, int]:
    """Write the inverse covariance, hidden markers swept; return `constant` and their number."""
    matrix[:] = prototype.precision
    constant, hidden = prototype.constant, 0
    for i in range(len(rows)):
        if rows[i] < 0:
            constant += hide(matrix, i)
            hidden += 1
    return constant, hidden


@labelling_jit
def block_inverse(block: np.ndarray, sign: float, inverse: np.ndarray) -> float:
    """Write the inverse of a symmetric (3, 3) block times `sign`; return their determinant."""
    xx, yy, zz = sign * block[0, 0], sign * block[1, 1], sign * block[2, 2]
    xy, xz, yz = sign * block[0, 1], sign * block[0, 2], sign * block[1, 2]
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = a / determinant, b / determinant, c / determinant
    inverse[1, 1] = (xx * zz - xz * xz) / determinant
    inverse[1, 2] = (xy * xz - xx * yz) / determinant
    inverse[2, 2] = (xx * yy - xy * xy) / determinant
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    return determinant


@labelling_jit
def dropping_gain(matrix: np.ndarray, gradient: np.ndarray, marker: int, distance: float,
                   seen: int) -> float:
    """Return the cost reduction of hiding a seen marker, one of `seen`."""
    covariance = local_floats((3, 3))
    a = 3 * marker
    determinant = block_inverse(matrix[a:a + 3, a:a + 3], 1., covariance)
    fall = quadratic(covariance, gradient[a], gradient[a + 1], gradient[a + 2])
    return (tail_cost(distance, 3 * seen) - tail_cost(max(distance - fall, 0.), 3 * seen - 3)
            - math.log(determinant) - HIDDEN_COST)


@labelling_jit
def contradiction(matrix: np.ndarray, gradient: np.ndarray, marker: int, distance: float,
                  seen: int) -> float:
    """Return the squared Mahalanobis distance of a seen marker, given the other markers.

    Its covariance is conditional, of Student's distribution: wider, the more unusual the posture of
    the others is.
    """
    covariance = local_floats((3, 3))
    a = 3 * marker
    block_inverse(matrix[a:a + 3, a:a + 3], 1., covariance)
    fall = quadratic(covariance, gradient[a], gradient[a + 1], gradient[a + 2])
    others = max(distance - fall, 0.)
    return fall * (FREEDOM + 3. * seen - 3.) / (FREEDOM + others)


@labelling_jit
def _best_addition(matrix: np.ndarray, mean: np.ndarray, gradient: np.ndarray,
                   local: np.ndarray, free: np.ndarray, rows: np.ndarray,
                   distance: float) -> tuple[int, int]:
    """Return the hidden marker and the free point whose assignment lowers the cost most, or -1."""
    best, chosen, least = -1, -1, -SMALLEST_GAIN
    for i in range(len(rows)):
        if rows[i] < 0:
            point, change = _best_point(matrix, mean, gradient, local, free, rows, i, distance)
            if change < least:
                best, chosen, least = i, point, change
    return best, chosen


@labelling_jit
def _best_point(matrix: np.ndarray, mean: np.ndarray, gradient: np.ndarray, local: np.ndarray,
                free: np.ndarray, rows: np.ndarray, marker: int,
                distance: float) -> tuple[int, float]:
    """Return the cheapest free point for a hidden marker, and the change of the cost."""
    taken = ~free
    seen = 0
    for i in range(len(rows)):
        if rows[i] >= 0:
            taken[rows[i]] = True
            seen += 1
    chosen, least = -1, math.inf
    precision = local_floats((3, 3))
    a = 3 * marker
    # Swept block: minus the conditional covariance; its gradient: minus the expected residual.
    determinant = block_inverse(matrix[a:a + 3, a:a + 3], -1., precision)
    base = math.log(determinant) - tail_cost(distance, 3 * seen) - HIDDEN_COST
    for j in range(len(local)):
        if not taken[j]:
            rise = quadratic(
                precision, local[j, 0] - mean[marker, 0] + gradient[a],
                local[j, 1] - mean[marker, 1] + gradient[a + 1],
                local[j, 2] - mean[marker, 2] + gradient[a + 2])
            change = base + tail_cost(distance + rise, 3 * seen + 3)
            if change < least:
                least, chosen = change, j
    return chosen, least


@labelling_jit
def _handover(matrix: np.ndarray, mean: np.ndarray, gradient: np.ndarray, place: np.ndarray,
              giver: int, taker: int, distance: float, seen: int) -> float:
    """Return the change of the cost if a hidden marker takes over the point of a seen one.

    `place` is that point, shape (3,), in the palm's frame [m]; others are as for `refine_labels`.
    """
    covariance, precision = local_floats((3, 3)), local_floats((3, 3))
    left, off = local_floats((3, 3)), local_floats(3)
    a, b = 3 * taker, 3 * giver
    dropped = math.log(block_inverse(matrix[b:b + 3, b:b + 3], 1., covariance))
    others = distance - quadratic(covariance, gradient[b], gradient[b + 1], gradient[b + 2])
    # As if the matrix were swept on the giver: see `sweep`.
    for m in range(3):
        off[m] = place[m] - mean[taker, m] + gradient[a + m]
        for n in range(3):
            left[m, n] = 0.
            for k in range(3):
                left[m, n] += matrix[a + m, b + k] * covariance[k, n]
            off[m] -= left[m, n] * gradient[b + n]
    for m in range(3):
        for n in range(3):
            precision[m, n] = matrix[a + m, a + n]
            for k in range(3):
                precision[m, n] -= left[m, k] * matrix[b + k, a + n]
    added = math.log(block_inverse(precision, -1., precision))
    rise = quadratic(precision, off[0], off[1], off[2])
    return (dropped + added + tail_cost(max(others, 0.) + rise, 3 * seen)
            - tail_cost(distance, 3 * seen))


@labelling_jit
def _best_handover(matrix: np.ndarray, mean: np.ndarray, gradient: np.ndarray,
                   local: np.ndarray, rows: np.ndarray, distance: float) -> tuple[int, int]:
    """Return the cheapest handover of a point: its seen giver and its hidden taker.

    Both are -1 where no handover lowers the cost.
    """
    giver, taker, least = -1, -1, -SMALLEST_GAIN
    seen = count_seen(rows)
    for i in range(len(rows)):
        if rows[i] >= 0:
            continue
        for j in range(len(rows)):
            if rows[j] >= 0:
                change = _handover(
                    matrix, mean, gradient, local[rows[j]], j, i, distance, seen)
                if change < least:
                    giver, taker, least = j, i, change
    return giver, taker


@labelling_jit
def _best_giver(matrix: np.ndarray, mean: np.ndarray, gradient: np.ndarray, local: np.ndarray,
                rows: np.ndarray, taker: int, moved: np.ndarray, distance: float) -> int:
    """Return the cheapest giver of a point to the hidden `taker`, none of those `moved`."""
    giver, least, seen = -1, math.inf, count_seen(rows)
    for j in range(len(rows)):
        if rows[j] >= 0 and not moved[j]:
            change = _handover(matrix, mean, gradient, local[rows[j]], j, taker, distance, seen)
            if change < least:
                giver, least = j, change
    return giver


@labelling_jit
def chain_labels(prototype: Prototype, local: np.ndarray, free: np.ndarray, rows: np.ndarray,
                 matrix: np.ndarray, cost: float) -> bool:
    """Improve labels by alternating chains: points passed on from marker to marker.

    A marker takes another's point, that one the next one's, and so on: exchanges of two markers
    cannot undo a finger that is labelled a joint too far (ejection chains, as of Lin and Kernighan,
    An effective heuristic algorithm for the traveling-salesman problem, 1973).

    Parameters
    ----------
    prototype : Prototype
    local : ndarray, shape (n, 3)
        Points in the palm's frame [m].
    free : ndarray of bool, shape (n,)
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none; replaced where others cost less.
    matrix : ndarray, shape (3 M, 3 M)
        Replaced.
    cost : float
        Of the present rows.

    Returns
    -------
    bool
        Whether others cost less.
    """
    count, mean = len(rows), prototype.template
    residual, gradient = np.empty(3 * count), np.empty(3 * count)
    trial, best = np.empty(count, dtype=np.int64), rows.copy()
    moved = np.empty(count, dtype=np.bool_)
    found = False
    least = cost - SMALLEST_GAIN
    for start in range(count):
        trial[:] = rows
        trial[start] = -1
        moved[:] = False
        moved[start] = True
        marker = start
        for _ in range(CHAIN):
            constant, hidden = reset_matrix(prototype, trial, matrix)
            seen = count - hidden
            if seen < 3:
                break
            distance = posture_distance(matrix, mean, local, trial, residual, gradient)
            total = posture_cost(constant, distance, seen, hidden)
            if total < least:
                least, found = total, True
                best[:] = trial
            # The end of the chain: a free point
            point, change = _best_point(
                matrix, mean, gradient, local, free, trial, marker, distance)
            if point >= 0 and total + change < least:
                least, found = total + change, True
                best[:] = trial
                best[marker] = point
            giver = _best_giver(matrix, mean, gradient, local, trial, marker, moved, distance)
            if giver < 0:
                break
            trial[marker], trial[giver] = trial[giver], -1
            moved[giver] = True
            marker = giver
    if found:
        rows[:] = best
    return found


@labelling_jit
def hidden_places(prototype: Prototype, local: np.ndarray, rows: np.ndarray, matrix: np.ndarray,
                  places: np.ndarray) -> None:
    """Write the conditional mean of each hidden marker, shape (M, 3), in the palm's frame [m].

    Parameters
    ----------
    prototype : Prototype
    local : ndarray, shape (n, 3)
        Points in the palm's frame [m].
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    matrix : ndarray, shape (3 M, 3 M)
        Of `reset_matrix`.
    places : ndarray, shape (M, 3)
        Replaced; rows of seen markers are of no use [m].
    """
    residual, gradient = np.empty(len(matrix)), np.empty(len(matrix))
    posture_distance(matrix, prototype.template, local, rows, residual, gradient)
    for i in range(len(rows)):
        for k in range(3):
            places[i, k] = prototype.template[i, k] - gradient[3 * i + k]
