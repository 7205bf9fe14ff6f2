"""Cost of a labelling by its links: distances of markers on a digit.

Lengths of links hardly change as a digit bends. They tell touching digits apart, and which marker
of a digit is hidden, where the joint distribution is too wide.
"""

import math

import numpy as np

from ..numerics.jit import labelling_jit
from .prototypes import Prototype

LINK_FREEDOM = 4.           # degrees of freedom of a length's Student distribution; ours
LINK_MEAN = 1.              # mean cost of a correct link, which is subtracted


@labelling_jit
def _length_cost(prototype: Prototype, link: int, one: np.ndarray, other: np.ndarray) -> float:
    """Return the cost of a link's length between two places, shape (3,), in the palm's frame."""
    square = 0.
    for k in range(3):
        square += (one[k] - other[k]) ** 2
    off = (math.sqrt(square) - prototype.lengths[link, 0]) / prototype.lengths[link, 1]
    return (LINK_FREEDOM + 1.) * math.log1p(off * off / LINK_FREEDOM) - LINK_MEAN


@labelling_jit
def _link_counts(prototype: Prototype, link: int, rows: np.ndarray) -> bool:
    """Return whether both markers of a link are seen, and the one between them is not."""
    between = prototype.between[link]
    return (rows[prototype.links[link, 0]] >= 0 and rows[prototype.links[link, 1]] >= 0
            and (between < 0 or rows[between] < 0))


@labelling_jit
def links_cost(prototype: Prototype, local: np.ndarray, rows: np.ndarray) -> float:
    """Return the cost of a labelling by the lengths of its links that count.

    Parameters
    ----------
    prototype : Prototype
    local : ndarray, shape (n, 3)
        Points in the palm's frame [m].
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    """
    total = 0.
    for link in range(len(prototype.links)):
        if _link_counts(prototype, link, rows):
            one, other = prototype.links[link, 0], prototype.links[link, 1]
            total += _length_cost(prototype, link, local[rows[one]], local[rows[other]])
    return total


@labelling_jit
def marker_links_cost(prototype: Prototype, local: np.ndarray, hidden_for: np.ndarray,
                      marker: int, place: np.ndarray) -> float:
    """Return the cost of a marker at a place by its links to seen neighbours.

    Parameters
    ----------
    prototype : Prototype
    local : ndarray, shape (M, 3)
        Places of the markers in the palm's frame [m].
    hidden_for : ndarray, shape (M,)
        Time for which each has been hidden, 0 for those that are seen [s].
    marker : int
    place : ndarray, shape (3,)
        In the palm's frame [m].
    """
    total = 0.
    for link in range(len(prototype.links)):
        one, other = prototype.links[link, 0], prototype.links[link, 1]
        if other == marker:
            one, other = other, one
        if one == marker and hidden_for[other] <= 0. and prototype.between[link] < 0:
            total += _length_cost(prototype, link, place, local[other])
    return total


@labelling_jit
def exchange_gain(prototype: Prototype, local: np.ndarray, rows: np.ndarray, i: int,
                  j: int) -> float:
    """Return the reduction of the links' cost when two seen markers exchange their points.

    Parameters are those of `links_cost`; `rows` is as before on return.
    """
    gain = 0.
    for turn in range(2):
        for link in range(len(prototype.links)):
            a, b = prototype.links[link, 0], prototype.links[link, 1]
            if (a == i or a == j or b == i or b == j) and _link_counts(prototype, link, rows):
                cost = _length_cost(prototype, link, local[rows[a]], local[rows[b]])
                gain += cost if turn == 0 else -cost
        rows[i], rows[j] = rows[j], rows[i]
    return gain
