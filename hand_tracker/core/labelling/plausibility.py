"""Plausibility of a labelling: its cost by the hand alone, without history.

A labelling assigns a row of the input to each marker. The digit markers' positions in the
palm's frame, over their whole range of motion, are taken as normally distributed; together
with the shape of the palm and the order of the fingers this gives each labelling a cost in
variances. Ours; no source.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, Hand, preset_limits
from ..model.kinematics import forward, joint_table
from ..model.marker_layout import PALM_MARKERS, Mounting, marker_positions
from ..model.palm_triangle import rigid_palm
from ..numerics.jit import jit
from ..numerics.vectors import components, distance, dot, scale, spans_plane, subtract, vector

RANGE_SAMPLES = (.1, .3, .5, .7, .9)  # shares of each joint's range at which digits are sampled
# Standard deviations of a hand that nobody calibrated from its model; ours.
PLACE_DEVIATION = .02        # [m] of a digit's marker
SIDE_RATIO_DEVIATION = .1    # of a side of the palm, relative to its length
PALM_SIZE_RANGE = .3, 2.5    # of the palm, relative to the model: of hands, and of swapped labels
MAX_DIGIT_COST = 50.         # of one digit: stray markers carry no more information; ours
ORDER_TOLERANCE = .004       # [m] by which neighbouring fingers may lie crossed; ours
DISORDER_COST = 9.           # of two neighbours that are crossed, in variances; ours
# Cost by which an exchange of two rows must be better, with nothing else to go by, in
# variances: on captures right labels are never worse by more than 9.
EXCHANGE_MARGIN = 20.
EXCHANGES = np.array(list(itertools.combinations(range(8), 2)))


class TypicalPlaces(NamedTuple):
    """Normal distributions of a hand's markers, in the wrist's frame of a right hand.

    Attributes
    ----------
    template : ndarray, shape (3, 3)
        Palm markers [m].
    mean : ndarray, shape (5, 3)
        Mean positions of the digit markers [m].
    precision : ndarray, shape (5, 3, 3)
        Inverse covariances of these positions [1/m²].
    log_determinant : ndarray, shape (5,)
        Of the covariances.
    """

    template: np.ndarray
    mean: np.ndarray
    precision: np.ndarray
    log_determinant: np.ndarray


def typical_places(hand: Hand, mounting: Mounting) -> TypicalPlaces:
    """Return the distributions of a hand's markers over the 'wide' ranges of motion.

    Parameters
    ----------
    hand : Hand
        Of the right side.
    mounting : Mounting
        Of the same hand.

    Returns
    -------
    TypicalPlaces
    """
    limits = preset_limits('wide')
    lower, upper = limits.T
    moving = np.column_stack((ABDUCTION_JOINTS, FLEXION_JOINTS[:, :2]))
    share = np.array(list(itertools.product(RANGE_SAMPLES, repeat=3)))[:, None]
    angles = np.zeros((len(share), len(lower)))
    angles[:, moving] = lower[moving] + share * (upper - lower)[moving]
    angles = hand.coupled(angles, limits)
    places = marker_positions(mounting, forward(joint_table(hand), angles))[:, len(PALM_MARKERS):]
    mean = places.mean(axis=0)
    off = places - mean
    covariance = np.einsum('nki,nkj->kij', off, off) / len(off) + PLACE_DEVIATION ** 2 * np.eye(3)
    return TypicalPlaces(mounting.position[:len(PALM_MARKERS)].copy(), mean,
                         np.linalg.inv(covariance), np.log(np.linalg.det(covariance)))


@jit
def label_cost(markers: np.ndarray, seen: np.ndarray, rows: np.ndarray,
               typical: TypicalPlaces) -> float:
    """Return the cost of a labelling: the less plausible for a hand, the higher.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
    rows : ndarray of int, shape (8,)
        Row of each marker.
    typical : TypicalPlaces

    Returns
    -------
    float
        In variances, up to a constant of the frame; infinite unless all palm markers are
        seen and their triangle has the size of a hand's.
    """
    if not (seen[rows[0]] and seen[rows[1]] and seen[rows[2]]):
        return math.inf
    r, p, q = vector(markers[rows[0]]), vector(markers[rows[1]]), vector(markers[rows[2]])
    if not spans_plane(r, p, q):
        return math.inf
    template = typical.template
    ratio = (distance(r, p) / distance(vector(template[0]), vector(template[1])),
             distance(p, q) / distance(vector(template[1]), vector(template[2])),
             distance(q, r) / distance(vector(template[2]), vector(template[0])))
    size = (ratio[0] + ratio[1] + ratio[2]) / 3.0
    if not PALM_SIZE_RANGE[0] <= size <= PALM_SIZE_RANGE[1]:
        return math.inf
    grown = 1.0 / size  # scales the hand to the template
    axes, origin = rigid_palm((scale(r, grown), scale(p, grown), scale(q, grown)), template)
    cost = 0.0
    for i in range(3):
        cost += ((ratio[i] / size - 1.0) / SIDE_RATIO_DEVIATION) ** 2
    nearest = math.inf
    for i in range(5):
        row = rows[3 + i]
        if not seen[row]:
            nearest = math.inf
            continue
        place = components(axes, subtract(scale(vector(markers[row]), grown), origin))
        off = subtract(place, vector(typical.mean[i]))
        far = 0.0
        for j in range(3):
            far += off[j] * dot(vector(typical.precision[i, j]), off)
        cost += typical.log_determinant[i] + min(far, MAX_DIGIT_COST)
        if i < 4:
            if place[1] > nearest + ORDER_TOLERANCE:
                cost += DISORDER_COST
            nearest = place[1]
    return cost


def permuted_costs(places: np.ndarray, permutations: np.ndarray,
                   typical: TypicalPlaces) -> np.ndarray:
    """Return the digits' share of `label_cost` for each order of their markers, all seen.

    Parameters
    ----------
    places : ndarray, shape (5, 3)
        Of the digits' markers, in the wrist's frame of a right hand of the model's size [m].
    permutations : ndarray of int, shape (n, 5)
        Rows of `places` for the digits.
    typical : TypicalPlaces

    Returns
    -------
    ndarray, shape (n,)
        In variances, up to a constant.
    """
    off = places - typical.mean[:, None]  # digits, rows
    far = np.einsum('ijk,ikl,ijl->ij', off, typical.precision, off)
    costs = np.minimum(far, MAX_DIGIT_COST)[np.arange(5), permutations].sum(axis=1)
    across = places[permutations[:, :4], 1]
    return costs + DISORDER_COST * (np.diff(across) > ORDER_TOLERANCE).sum(axis=1)


@jit
def _apply_exchange(rows: np.ndarray, n: int) -> None:
    """Exchange the rows of the n-th pair of markers, `EXCHANGES[n]`."""
    one, other = EXCHANGES[n]
    rows[one], rows[other] = rows[other], rows[one]


@jit
def find_exchange(rows: np.ndarray) -> int:
    """Return the index in `EXCHANGES` of the one exchanged pair; -1 for none or several.

    Parameters
    ----------
    rows : ndarray of int, shape (8,)
        Row of each marker.
    """
    found = -1
    moved = 0
    for i in range(8):
        moved += 1 if rows[i] != i else 0
    for n in range(len(EXCHANGES)):
        one, other = EXCHANGES[n]
        if moved == 2 and rows[one] == other and rows[other] == one:
            found = n
    return found


@jit
def correct_exchange(markers: np.ndarray, seen: np.ndarray, typical: TypicalPlaces,
                     rows: np.ndarray) -> None:
    """Exchange two rows if that is clearly more plausible, by `EXCHANGE_MARGIN`.

    Parameters
    ----------
    markers, seen, typical
        As for `label_cost`.
    rows : ndarray of int, shape (8,)
        Row of each marker, updated.
    """
    given = label_cost(markers, seen, rows, typical)
    if given == math.inf:
        return
    least = given - EXCHANGE_MARGIN
    best = -1
    for n in range(len(EXCHANGES)):
        _apply_exchange(rows, n)
        cost = label_cost(markers, seen, rows, typical)
        _apply_exchange(rows, n)
        if cost < least:
            least = cost
            best = n
    if best >= 0:
        _apply_exchange(rows, best)
