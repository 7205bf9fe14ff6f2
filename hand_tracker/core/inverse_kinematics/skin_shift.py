"""Skin shift: how far markers are off their places on the hand, kept when one of them vanishes.

Skin slides over the bones by millimetres (soft-tissue artefact). A marker of several on a digit, or
of more than three on the palm, that vanishes takes its pull with it, and the pose would jump.
From then on all are expected as far off their places as they last were together, which fades.
Ours; no source.
"""

from ..model.marker_rows import MarkerRows, RowState
from ..numerics.jit import jit
from ..numerics.vectors import Vector, length, scale, vector

SKIN_SHIFT_TIME = .1        # [s] that shifts are averaged over
SKIN_SHIFT_FADE_TIME = 2.   # [s] in which they fade once a marker has vanished
MOST_SKIN_SHIFT = .02       # [m] a marker that is farther off is another, and has none


@jit
def fade_skin_shifts(rows: MarkerRows, state: RowState, digit: int, step: float) -> None:
    """Take the shifts of a digit wholly into account as one of its markers vanishes, then less.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Its `skin_shift_share` is updated.
    digit : int
        `ON_WRIST` for the palm.
    step : float
        Since the last frame [s].
    """
    share = max(state.skin_shift_share[digit] - step / SKIN_SHIFT_FADE_TIME, 0.)
    for row in range(rows.used[0]):
        if rows.digit[row] == digit and state.was_measured[row] and not state.is_measured[row]:
            share = 1.
    state.skin_shift_share[digit] = share


@jit
def expected_shift(rows: MarkerRows, state: RowState, row: int) -> Vector:
    """Return how far off its place a marker is expected, in its link's frame [m]."""
    return scale(vector(state.skin_shift[row]), state.skin_shift_share[rows.digit[row]])


@jit
def learn_skin_shift(state: RowState, row: int, miss: Vector, step: float) -> None:
    """Average the shift of a marker that is off its place by `miss`, in its link's frame [m]."""
    gain = min(step / SKIN_SHIFT_TIME, 1.)
    kept = 1. if length(miss) < MOST_SKIN_SHIFT else 0.
    for k in range(3):
        state.skin_shift[row, k] += gain * (kept * miss[k] - state.skin_shift[row, k])


@jit
def learn_shift_angle(state: RowState, joint: int, angle: float, step: float) -> None:
    """Average the angle [rad] of a joint with the shifts of its digit."""
    state.skin_shift_angles[joint] += min(step / SKIN_SHIFT_TIME, 1.) * (
        angle - state.skin_shift_angles[joint])
