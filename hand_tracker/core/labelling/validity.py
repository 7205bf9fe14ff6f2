"""Which markers are seen: what is no measurement counts as hidden."""

import math

from ..numerics.jit import jit
from ..numerics.vectors import distance, vector

COORDINATE_LIMIT = 1e3  # [m] a coordinate beyond this is no measurement
SKIN_STRETCH = .003   # [m] more than skin lets the palm's markers part; ours


@jit
def find_valid(markers, seen):
    """Mark in `seen` which rows are measurements.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Replaced.
    """
    for i in range(markers.shape[0]):
        good = True
        for k in range(3):
            good = good and abs(markers[i, k]) <= COORDINATE_LIMIT  # false for NaN
        seen[i] = good


@jit
def reject_frozen(markers, seen, last, still, stood, patience):
    """Take markers that some drivers repeat when they lost them for not seen.

    A marker is frozen when it stays in place to the last bit while at least two markers of the
    palm move. The palm's own may rest on a table while the hand turns about them: they are
    frozen once another has come nearer or gone away. One at the origin is left to whoever
    reads the messages.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Cleared where frozen.
    last : ndarray, shape (8, 3)
        The markers of the last frame, replaced [m].
    still : ndarray of int, shape (8,)
        Frames for which each marker has repeated its place, replaced.
    stood : ndarray, shape (3, 3)
        Distances of the palm's markers (columns) from each when it began to repeat its
        place, NaN of those not seen then, replaced [m].
    patience : int
        Frames after which it counts as frozen; 0 is never.
    """
    moved = 0
    for i in range(3):
        if seen[i] and not _is_equal(markers[i], last[i]):
            moved += 1
    for i in range(markers.shape[0]):
        if not seen[i]:
            continue
        if not _is_equal(markers[i], last[i]) or _is_equal(markers[i], (0., 0., 0.)):
            still[i] = 0
            for j in range(3 if i < 3 else 0):
                stood[i, j] = _gap(markers, seen, i, j)
        elif moved >= 2 and (
                i >= 3 or still[i] + 1 != patience or _has_moved_in_palm(markers, seen, stood, i)):
            still[i] += 1
        for k in range(3):
            last[i, k] = markers[i, k]
    for i in range(markers.shape[0]):
        if 0 < patience <= still[i]:
            seen[i] = False


@jit
def _gap(markers, seen, i, j):
    return distance(vector(markers[i]), vector(markers[j])) if seen[i] and seen[j] else math.nan


@jit
def _has_moved_in_palm(markers, seen, stood, i):
    """Return whether a marker of the palm is no longer where it stood among the others."""
    parted = False
    for j in range(3):
        # False where one was not seen
        parted = parted or abs(_gap(markers, seen, i, j) - stood[i, j]) > SKIN_STRETCH
    return parted


@jit
def _is_equal(a, b):
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]
