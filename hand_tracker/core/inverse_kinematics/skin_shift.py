"""Skin shift: how far markers are off their places on the hand, kept when one of them vanishes.

Skin slides over the bones by millimetres (soft-tissue artefact). A marker of several on a digit, or
of more than three on the palm, that vanishes takes its pull with it, and the pose would jump.
From then on all are expected as far off their places as they last were together, which fades:
slowly, but at once when all are seen again. Ours; no source.
"""

from ..model.marker_rows import ON_WRIST, MarkerRows, RowState
from ..numerics.jit import jit
from ..numerics.vectors import Vector, add, length, scale, store, vector

SKIN_SHIFT_TIME = .1        # [s] that shifts are averaged over
SKIN_SHIFT_FADE_TIME = 2.   # [s] in which they fade once a marker has vanished
WHOLE_FADE_TIME = .2        # [s] once all are seen again, and tell more than the shifts
MOST_SKIN_SHIFT = .02       # [m] a marker that is farther off is another, and has none


@jit
def fade_skin_shifts(rows: MarkerRows, state: RowState, digit: int, step: float) -> None:
    """Take the shifts of a digit wholly into account as one of its markers vanishes, then less.

    They are learned while all markers are seen: by those that are left, what is expected of one
    that is hidden would drift with each other one that vanishes.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Its `skin_shift_share` and `learns_shift` are updated, its skin shifts where a marker
        vanishes.
    digit : int
        `ON_WRIST` for the palm.
    step : float
        Since the last frame [s].
    """
    is_whole, has_vanished = True, False
    for row in range(rows.used[0]):
        if rows.digit[row] == digit and not state.is_measured[row]:
            is_whole = is_whole and not state.is_known[row]
            has_vanished = has_vanished or state.was_measured[row]
    if not has_vanished:
        fade_time = WHOLE_FADE_TIME if is_whole else SKIN_SHIFT_FADE_TIME
        share = max(state.skin_shift_share[digit] - step / fade_time, 0.)
        state.skin_shift_share[digit] = share
        state.learns_shift[digit] = is_whole or share == 0.
        return
    state.skin_shift_share[digit] = 1.
    state.learns_shift[digit] = False
    for row in range(rows.used[0]):
        if rows.digit[row] == digit:
            store(state.skin_shift, row, vector(state.seen_shift[row]))
    for joint in range(25):
        if _digit_of(joint) == digit:
            state.skin_shift_angles[joint] = state.seen_shift_angles[joint]


@jit
def _digit_of(joint: int) -> int:
    """Return the digit whose shifts a joint belongs to: the fingers' CMC flexion to the palm's."""
    return ON_WRIST if joint < 20 and joint % 5 == 0 else joint // 5


@jit
def expected_shift(rows: MarkerRows, state: RowState, row: int) -> Vector:
    """Return how far off its place a marker is expected, in its link's frame [m]."""
    return scale(vector(state.skin_shift[row]), state.skin_shift_share[rows.digit[row]])


@jit
def learn_skin_shift(rows: MarkerRows, state: RowState, row: int, miss: Vector,
                     step: float) -> None:
    """Average the shift of a marker that is `miss` off where it is expected [m].

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Its `seen_shift` is updated.
    row : int
    miss : Vector
        In its link's frame [m].
    step : float
        Since the last frame [s].
    """
    gain = min(step / SKIN_SHIFT_TIME, 1.)
    shift = add(miss, expected_shift(rows, state, row))
    kept = 1. if length(shift) < MOST_SKIN_SHIFT else 0.
    for k in range(3):
        state.seen_shift[row, k] += gain * (kept * shift[k] - state.seen_shift[row, k])


@jit
def learn_shift_angle(state: RowState, joint: int, angle: float, step: float) -> None:
    """Average the angle [rad] of a joint with the shifts of its digit."""
    state.seen_shift_angles[joint] += min(step / SKIN_SHIFT_TIME, 1.) * (
        angle - state.seen_shift_angles[joint])
