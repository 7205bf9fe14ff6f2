"""Validity of measurements: non-finite, out-of-range and frozen markers count as hidden.

So do the palm's markers where no hand has such a triangle. What is left is recorded as a frame's
evidence: its measured rows, of any layout, and the digits whose evidence changed.
"""

import math

import numpy as np

from ..filtering.tracks import Tracks
from ..model.marker_rows import PRINCIPALS, MarkerRows, RowState
from ..model.palm_triangle import PalmLimits, Wrist, complete_palm, palm_fault, palm_places
from ..model.states import TRACKED
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import distance, is_equal, store, vector

COORDINATE_LIMIT = 1e3  # [m] greatest valid coordinate
ORIGIN_RADIUS = 1e-6    # [m] within which a marker is its source's origin, as a wrist may be
SKIN_STRETCH = .003     # [m] by which skin lets distances of palm markers vary; ours


@jit
def find_valid(markers: np.ndarray, seen: np.ndarray) -> None:
    """Set `seen` for the rows whose coordinates are finite and within `COORDINATE_LIMIT`.

    Parameters
    ----------
    markers : ndarray, shape (n, 3)
        [m]
    seen : ndarray of bool, shape (n,)
        Replaced.
    """
    for i in range(markers.shape[0]):
        good = True
        for k in range(3):
            good = good and abs(markers[i, k]) <= COORDINATE_LIMIT  # false for NaN
        seen[i] = good


@jit
def reject_frozen(markers: np.ndarray, seen: np.ndarray, last: np.ndarray, repeats: np.ndarray,
                  repeated_distances: np.ndarray, patience: int) -> None:
    """Reject frozen markers: lost ones whose last position the driver repeats.

    A marker is frozen if its position repeats bit for bit while the hand moves: two palm markers,
    or, as two may freeze at once, one and a digit's. A palm marker may rest on a table while the
    hand turns about it, so it is frozen only once its distance from another has changed. One at
    the origin is never frozen: whether it is lost is decided where messages are decoded.

    Parameters
    ----------
    markers : ndarray, shape (n, 3)
        [m]
    seen : ndarray of bool, shape (n,)
        Cleared where frozen.
    last : ndarray, shape (n, 3) or more
        Markers of the last frame, replaced [m].
    repeats : ndarray of int, shape (n,) or more
        Frames for which each marker has repeated its position, updated.
    repeated_distances : ndarray, shape (3, 3)
        Distances from each palm marker (rows) to the others (columns) when it began to repeat
        its position; NaN if not seen then, updated [m].
    patience : int
        Frames after which a marker counts as frozen; 0 for never.
    """
    palm_moved = digits_moved = 0
    for i in range(markers.shape[0]):
        if seen[i] and not is_equal(markers[i], last[i]):
            if i < 3:
                palm_moved += 1
            else:
                digits_moved += 1
    hand_moved = palm_moved >= 2 or palm_moved == 1 and digits_moved > 0
    for i in range(markers.shape[0]):
        if not seen[i]:
            continue
        if (not is_equal(markers[i], last[i])
                or distance(vector(markers[i]), (0., 0., 0.)) < ORIGIN_RADIUS):
            repeats[i] = 0
            for j in range(3 if i < 3 else 0):
                repeated_distances[i, j] = _gap(markers, seen, i, j)
        elif hand_moved and (i >= 3 or repeats[i] + 1 != patience
                             or _has_moved_in_palm(markers, seen, repeated_distances, i)):
            repeats[i] += 1
        for k in range(3):
            last[i, k] = markers[i, k]
    for i in range(markers.shape[0]):
        if 0 < patience <= repeats[i]:
            seen[i] = False


@jit
def _gap(markers: np.ndarray, seen: np.ndarray, i: int, j: int) -> float:
    """Return the distance of two markers, NaN unless both are seen [m]."""
    return distance(vector(markers[i]), vector(markers[j])) if seen[i] and seen[j] else math.nan


@jit
def _has_moved_in_palm(markers: np.ndarray, seen: np.ndarray, repeated_distances: np.ndarray,
                       i: int) -> bool:
    """Return whether a palm marker's distance from another differs from `repeated_distances`."""
    parted = False
    for j in range(3):
        # False if one was not seen
        parted = parted or abs(_gap(markers, seen, i, j) - repeated_distances[i, j]) > SKIN_STRETCH
    return parted


@jit
def check_palm(markers: np.ndarray, seen: np.ndarray, template: np.ndarray, wrist: Wrist,
               limits: PalmLimits) -> int:
    """Hide all palm markers when their triangle cannot be that of this hand.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Its first three are cleared where there is a fault.
    template : ndarray, shape (3, 3)
        Palm markers in the wrist's frame [m].
    wrist : Wrist
        Of the last frame.
    limits : PalmLimits

    Returns
    -------
    int
        TRACKED, or the `PalmState` that names the fault, as of `palm_fault`.
    """
    placed = wrist.placed[0] > 0
    if not (seen[0] or seen[1] or seen[2]) or not placed and not (
            seen[0] and seen[1] and seen[2]):
        return TRACKED
    points = complete_palm((vector(markers[0]), vector(markers[1]), vector(markers[2])),
                           palm_places(template, wrist),
                           (seen[0], seen[1], seen[2]))
    palm = local_floats((3, 3))
    for i in range(3):
        store(palm, i, points[i])
    fault = palm_fault(palm, template, limits)
    if fault != TRACKED:
        for i in range(3):
            seen[i] = False
    return fault


@jit
def note_changes(palm: Tracks, digits: Tracks, seen: np.ndarray, changed: np.ndarray) -> bool:
    """Mark the digits whose evidence changed: their marker, or one of the palm, came or went.

    Parameters
    ----------
    palm, digits : Tracks
        Of the last frame.
    seen : ndarray of bool, shape (8,)
    changed : ndarray of bool, shape (5,)
        Replaced.

    Returns
    -------
    bool
        Whether a marker of the palm came or went.
    """
    palm_changed = False
    for i in range(3):
        palm_changed = palm_changed or seen[i] != palm.seen[i]
    lost = not (seen[0] or seen[1] or seen[2])
    for i in range(5):
        changed[i] = palm_changed or (seen[3 + i] and not lost) != digits.seen[i]
    return palm_changed


@jit
def measure_rows(rows: MarkerRows, state: RowState, markers: np.ndarray, seen: np.ndarray,
                 step: float) -> None:
    """Write the measured markers of all rows.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Changed.
    markers : ndarray, shape (n, 3)
        [m]
    seen : ndarray of bool, shape (n,)
    step : float
        Since the last frame [s].
    """
    for row in range(rows.used[0]):
        state.was_measured[row] = state.is_measured[row]
        state.is_measured[row] = row < len(seen) and seen[row] and rows.order[row] >= 0
        state.hidden_for[row] += step
        if state.is_measured[row]:
            store(state.points, row, vector(markers[row]))


@jit
def associate_rows(rows: MarkerRows, state: RowState, markers: np.ndarray, seen: np.ndarray,
                   palm_changed: bool, changed: np.ndarray) -> None:
    """Carry the association of the principal markers over to the rows.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Changed.
    markers : ndarray, shape (8, 3)
        Principal markers, associated [m].
    seen : ndarray of bool, shape (8,)
    palm_changed : bool
        As of `note_changes`.
    changed : ndarray of bool, shape (5,)
        Digits whose evidence changed; that of the palm counts for those with several markers.
    """
    for row in range(3, PRINCIPALS):
        state.is_measured[row] = seen[row]
        if seen[row]:
            store(state.points, row, vector(markers[row]))
    for digit in range(5):
        if rows.has_several[digit]:
            changed[digit] = palm_changed
    for row in range(rows.used[0]):
        if state.is_measured[row]:
            state.is_known[row] = True
            state.hidden_for[row] = 0.
