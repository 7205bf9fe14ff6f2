"""How like a hand a labelling of a frame is: by the hand alone, whatever was before.

A labelling says which row belongs to which marker. Where the digits' markers go over their
whole ranges of motion is taken for normally distributed, in the palm's frame; together
with the palm's shape and the order of the fingers that gives each labelling a cost.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from ..inverse_kinematics.palm import rigid_palm
from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, preset_limits
from ..model.kinematics import forward, joint_table
from ..model.marker_layout import PALM_MARKERS, marker_positions
from ..numerics.jit import jit
from ..numerics.vectors import components, cross, distance, dot, scale, subtract, vector

SAMPLED_SHARES = (.1, .3, .5, .7, .9)  # of each joint's range that are sampled
# By how much a hand that nobody calibrated may differ from its template; ours
MARKER_SPREAD = .02     # [m] of a digit's marker
SIDE_RATIO_SPREAD = .1       # of a side of the palm, as a share of it
PALM_SIZE_RANGE = .3, 2.5  # of the palm, as a share of the template: those of hands, and of labels exchanged
MAX_DIGIT_COST = 50.     # cost of a digit at most: a marker of no hand tells nothing; ours
ORDER_TOLERANCE = .004  # [m] by which fingers lie on the wrong sides of each other; ours
DISORDER_COST = 9.    # its cost for two neighbours, in variances: fingers seldom cross; ours
# By how much two exchanged rows have to be more like a hand, with nothing else to go by, in
# variances: on captures right labels are never worse by more than 9.
EXCHANGE_MARGIN = 20.
EXCHANGES = np.array(list(itertools.combinations(range(8), 2)))


class TypicalPlaces(NamedTuple):
    """Where a hand has its markers, in the wrist's frame of a right hand.

    Attributes
    ----------
    template : ndarray, shape (3, 3)
        The palm's markers [m].
    center : ndarray, shape (5, 3)
        Mean places of the digits' markers [m].
    weight : ndarray, shape (5, 3, 3)
        Inverses of their covariances [1/m²].
    width : ndarray, shape (5,)
        Logarithms of the determinants of these covariances.
    """

    template: np.ndarray
    center: np.ndarray
    weight: np.ndarray
    width: np.ndarray


def typical_places(hand, mounting):
    """Return where a hand has its markers, over the widest ranges of motion.

    Parameters
    ----------
    hand : Hand
        Of the right side.
    mounting : Mounting
        Of the same hand.

    Returns
    -------
    Usual
    """
    lower, upper = preset_limits('wide').T
    moving = np.column_stack((ABDUCTION_JOINTS, FLEXION_JOINTS[:, :2]))
    share = np.array(list(itertools.product(SAMPLED_SHARES, repeat=3)))[:, None]
    angles = np.zeros((len(share), len(lower)))
    angles[:, moving] = lower[moving] + share * (upper - lower)[moving]
    last = FLEXION_JOINTS[:, 2]
    angles[:, last] = np.clip(
        angles[:, FLEXION_JOINTS[:, 1]] * hand.coupling[:, 0] + hand.coupling[:, 1],
        lower[last], upper[last])
    places = marker_positions(mounting, forward(joint_table(hand), angles))[:, len(PALM_MARKERS):]
    center = places.mean(axis=0)
    off = places - center
    covariance = np.einsum('nki,nkj->kij', off, off) / len(off) + MARKER_SPREAD ** 2 * np.eye(3)
    return TypicalPlaces(mounting.position[:len(PALM_MARKERS)].copy(), center,
                         np.linalg.inv(covariance), np.log(np.linalg.det(covariance)))


@jit
def spans_plane(r, p, q):
    """Return whether three points span a triangle that has a plane; not for NaN."""
    a = subtract(p, r)
    b = subtract(q, r)
    normal = cross(a, b)
    return dot(normal, normal) > 1e-3 * dot(a, a) * dot(b, b) > 1e-20


@jit
def label_cost(markers, seen, rows, usual):
    """Return how unlike a hand a labelling is.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
    rows : ndarray of int, shape (8,)
        Row of each marker.
    usual : Usual

    Returns
    -------
    float
        In variances, up to a constant of the frame; infinite without a whole palm of a size
        that hands have.
    """
    if not (seen[rows[0]] and seen[rows[1]] and seen[rows[2]]):
        return math.inf
    r, p, q = vector(markers[rows[0]]), vector(markers[rows[1]]), vector(markers[rows[2]])
    if not spans_plane(r, p, q):
        return math.inf
    template = usual.template
    ratio = (distance(r, p) / distance(vector(template[0]), vector(template[1])),
             distance(p, q) / distance(vector(template[1]), vector(template[2])),
             distance(q, r) / distance(vector(template[2]), vector(template[0])))
    size = (ratio[0] + ratio[1] + ratio[2]) / 3.0
    if not PALM_SIZE_RANGE[0] <= size <= PALM_SIZE_RANGE[1]:
        return math.inf
    grown = 1.0 / size  # the hand as large as the template
    axes, origin = rigid_palm(
        scale(r, grown), scale(p, grown), scale(q, grown),
        vector(template[0]), vector(template[1]), vector(template[2]))
    cost = 0.0
    for i in range(3):
        cost += ((ratio[i] / size - 1.0) / SIDE_RATIO_SPREAD) ** 2
    nearest = math.inf
    for i in range(5):
        row = rows[3 + i]
        if not seen[row]:
            nearest = math.inf
            continue
        place = components(axes, subtract(scale(vector(markers[row]), grown), origin))
        off = subtract(place, vector(usual.center[i]))
        far = 0.0
        for j in range(3):
            far += off[j] * dot(vector(usual.weight[i, j]), off)
        cost += usual.width[i] + min(far, MAX_DIGIT_COST)
        if i < 4:
            if place[1] > nearest + ORDER_TOLERANCE:
                cost += DISORDER_COST
            nearest = place[1]
    return cost


@jit
def apply_exchange(rows, n):
    """Exchange the rows of the n-th pair of markers."""
    one, other = EXCHANGES[n]
    rows[one], rows[other] = rows[other], rows[one]


@jit
def find_exchange(rows):
    """Return which pair of markers has its rows exchanged, -1 for none or for more."""
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
def correct_exchange(markers, seen, usual, rows):
    """Exchange the two rows that are clearly more like a hand exchanged, if there are two.

    Parameters
    ----------
    markers, seen, usual
        As for `label_cost`.
    rows : ndarray of int, shape (8,)
        Row of each marker; two are exchanged.
    """
    given = label_cost(markers, seen, rows, usual)
    if given == math.inf:
        return
    least = given - EXCHANGE_MARGIN
    best = -1
    for n in range(len(EXCHANGES)):
        apply_exchange(rows, n)
        cost = label_cost(markers, seen, rows, usual)
        apply_exchange(rows, n)
        if cost < least:
            least = cost
            best = n
    if best >= 0:
        apply_exchange(rows, best)
