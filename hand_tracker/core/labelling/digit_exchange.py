"""Labels exchanged within a digit of several markers: put right as they turn about.

Two markers of a digit that exchange their labels turn the way from one to the other about at once,
which no digit does, and each is near where the other should be. They are put right for as long as
that lasts, where the digit met its markers before: else they may rather have been exchanged until
then. Ours; no source.
"""

import numpy as np

from ..model.marker_rows import PRINCIPALS, MarkerRows, RowState
from ..model.palm_triangle import Wrist
from ..model.states import SEEN, SWAPPED
from ..numerics.jit import jit
from ..numerics.vectors import (
    add,
    components,
    dot,
    frame,
    off_way,
    scale,
    store,
    subtract,
    vector,
)

EXCHANGE_GAP = .1   # [s] since either marker was seen
# Distance from their expected places exchanged, over that as labelled [1]: of a ghost beyond its
# neighbour, which turns that way about too, it is 1.
MOST_OFF = .6
MET_MISFIT = 20.    # [1] below which a digit meets its markers: exchanged ones reach the most, 25


@jit
def undo_exchanges(rows: MarkerRows, state: RowState, wrist: Wrist, markers: np.ndarray,
                   seen: np.ndarray, step: float, is_on: bool) -> None:
    """Exchange two markers of a digit whose labels were exchanged, those that fit that best.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Of the last frame; its `verdict` is changed.
    wrist : Wrist
        Of the last frame.
    markers : ndarray, shape (n, 3)
        Changed [m].
    seen : ndarray of bool, shape (n,)
    step : float
        Since the last frame [s].
    is_on : bool
        Whether labels may be exchanged.
    """
    axes, used, palm = frame(wrist.rotation), min(rows.used[0], len(seen)), -1
    for row in range(used):
        if state.verdict[row] == SWAPPED:
            state.verdict[row] = SEEN
        if palm < 0 and row < 3 and seen[row]:
            palm = row
    if palm < 0 or not is_on:
        return
    longest = EXCHANGE_GAP - step
    place = add(vector(rows.end[palm]), vector(rows.offset[palm]))
    for digit in range(5):
        if not rows.has_several[digit] or state.misfit[digit] >= MET_MISFIT:
            continue
        least, one, other = MOST_OFF, -1, -1
        for i in range(PRINCIPALS, used):
            if rows.digit[i] != digit or not seen[i] or state.away_for[i] >= longest:
                continue
            for j in range(3 + digit, i):
                if rows.digit[j] != digit or not seen[j] or state.away_for[j] >= longest:
                    continue
                way = components(axes, subtract(vector(markers[i]), vector(markers[j])))
                a, b = vector(state.local[i]), vector(state.local[j])
                if dot(way, subtract(a, b)) < 0.:
                    first = add(place, components(
                        axes, subtract(vector(markers[i]), vector(markers[palm]))))
                    second = subtract(first, way)
                    by_i = scale(vector(state.velocity[i]), step)
                    by_j = scale(vector(state.velocity[j]), step)
                    exchanged = (off_way(subtract(first, b), by_j)
                                 + off_way(subtract(second, a), by_i))
                    off = exchanged / (off_way(subtract(first, a), by_i)
                                       + off_way(subtract(second, b), by_j))
                    if off < least:
                        least, one, other = off, i, j
        if one >= 0:
            swapped = vector(markers[one])
            store(markers, one, vector(markers[other]))
            store(markers, other, swapped)
            state.verdict[one] = state.verdict[other] = SWAPPED
