"""Further markers of the digits: refused where the digit cannot have brought them.

Between two frames a marker stays within a few millimetres of the way from standing still to going
on evenly, unless the digit as a whole goes otherwise: then so does its principal marker, which the
association has judged. One that leaps off that way is refused for as long as it goes on from
there, up to the association's patience. One that comes back is judged by where the digit's other
markers have taken it. Ours; no source.
"""

import math

import numpy as np

from ..model.marker_rows import PRINCIPALS, MarkerRows, RowState
from ..model.palm_triangle import Wrist
from ..model.states import REJECTED, SEEN
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import (
    Vector,
    add,
    components,
    frame,
    length,
    off_way,
    scale,
    store,
    subtract,
    vector,
)
from .digit import Chains
from .digit_angles import lay_flat, local_digit_workspace, place_on_digit

# Greatest distance from that way, beyond STRAY_RATIO times that of the principal marker: simulated
# hands stay within 3 mm from 30 Hz on, captured ones within 5 mm in 996 to 1000 of 1000 frames.
FURTHER_GATE_BASE = .0045   # [m]
FURTHER_GATE_NOISE = 4.     # [1] of the marker noise, beyond that
STRAY_RATIO = 2.            # [1] by which a marker strays farther than the principal one
LONE_GATE_BEND = 60.        # [m/s²] as the principal marker is hidden: BEND step² / 2 beyond
MOST_GATE_TIME = .1         # [s] a longer step widens that no further
LEAST_GATE_TIME = 1e-4      # [s] a shorter step counts as this
AWAY_SPEED, AWAY_SHARE = .08, .5    # [m/s, 1] of a marker while away, and of its last speed
VELOCITY_TIME = .01         # [s] that velocities are averaged over


@jit
def lay_digits_flat(chains: Chains, rows: MarkerRows, state: RowState, wrist: Wrist,
                    changed: np.ndarray, noise: np.ndarray, step: float, gated: bool,
                    patience: float) -> None:
    """Write the digits' measured markers in the wrist's frame, the palm laid flat, to be fitted.

    Further markers that are not where they can be are refused.

    Parameters
    ----------
    chains : Chains
    rows : MarkerRows
    state : RowState
        Its `local` and `is_fitted` are replaced; `is_measured` is cleared where refused.
    wrist : Wrist
    changed : ndarray of bool, shape (5,)
        Digits whose evidence changed, by the palm's; set where a marker of several came or went.
    noise : ndarray, shape (8,)
        Of the principal markers, standard deviation on an axis [m].
    step : float
        Since the last frame [s].
    gated : bool
        Whether markers may be refused.
    patience : float
        Time after which a refused marker is believed; 0 for never [s].
    """
    axes, origin = frame(wrist.rotation), vector(wrist.position)
    longest = patience if patience > 0. else math.inf
    bases, gates = local_floats(5), local_floats(5)
    _open_gates(changed, noise, step, gated, bases, gates)
    for row in range(rows.used[0]):
        digit = rows.digit[row]
        if digit >= 0:
            was_refused = state.verdict[row] == REJECTED
            if was_refused:
                state.verdict[row] = SEEN
            if state.is_measured[row]:
                local = lay_flat(rows, state, row, components(
                    axes, subtract(vector(state.points[row]), origin)))
                _judge_marker(
                    chains, rows, state, row, local, was_refused, step, longest, bases, gates)
            state.away_for[row] = 0. if state.is_measured[row] else state.away_for[row] + step
            if rows.has_several[digit] and state.is_measured[row] != state.was_measured[row]:
                changed[digit] = True
        state.is_fitted[row] = state.is_measured[row]


@jit
def _open_gates(changed: np.ndarray, noise: np.ndarray, step: float, gated: bool,
                bases: np.ndarray, gates: np.ndarray) -> None:
    """Write how far further markers of each digit may be off their way, beside no other marker.

    Parameters
    ----------
    changed, noise, step, gated
        As for `lay_digits_flat`.
    bases : ndarray, shape (5,)
        Replaced: of a marker that comes back [m].
    gates : ndarray, shape (5,)
        Replaced: of one that was there, while the principal marker is hidden [m].
    """
    bases[:] = gates[:] = math.inf
    bend = .5 * LONE_GATE_BEND * min(max(step, LEAST_GATE_TIME), MOST_GATE_TIME) ** 2
    for digit in range(5 if gated else 0):
        bases[digit] = FURTHER_GATE_BASE + FURTHER_GATE_NOISE * noise[3 + digit]
        # As the palm gains or loses a marker it may leap, and all digits with it.
        if not changed[digit]:
            gates[digit] = bases[digit] + bend


@jit
def _judge_marker(chains: Chains, rows: MarkerRows, state: RowState, row: int, local: Vector,
                  was_refused: bool, step: float, longest: float, bases: np.ndarray,
                  gates: np.ndarray) -> None:
    """Take a measured marker, or refuse it where it is off its way.

    Parameters
    ----------
    chains, rows, state, step, bases
        As for `lay_digits_flat`.
    row : int
        Principal markers come first: one sets its digit's gate.
    local : Vector
        Where it is in the wrist's frame, the palm laid flat [m].
    was_refused : bool
        In the last frame.
    longest : float
        Time for which it may be refused [s].
    gates : ndarray, shape (5,)
        Distance from its way up to which a digit's marker is taken [m].
    """
    digit, away_for, time = rows.digit[row], state.away_for[row], max(step, LEAST_GATE_TIME)
    velocity = vector(state.velocity[row])
    ahead = scale(velocity, time)
    moved = subtract(local, vector(state.refused_at[row] if was_refused else state.local[row]))
    off = off_way(moved, ahead)
    stays_refused = was_refused and off <= gates[digit] and away_for < longest
    stray = 0.
    if not state.was_measured[row] and away_for < math.inf:
        back = subtract(local, place_on_digit(
            chains, rows, state, row, local_digit_workspace()))
        usual = math.sqrt(state.misfit[digit] * rows.variance[row])
        # A refused marker that is in place again need not have leapt there.
        stays_refused = stays_refused and length(back) > bases[digit] + usual
        if not stays_refused:
            moved, off = back, off_way(back, ahead)
            stray = usual + away_for * (AWAY_SPEED + AWAY_SHARE * max(
                length(velocity), length(vector(state.velocity[3 + digit]))))
    is_taken = True
    if row < PRINCIPALS:
        if away_for < math.inf:
            gates[digit] = bases[digit] + STRAY_RATIO * off
    elif stays_refused or off > gates[digit] + stray and away_for < longest:
        is_taken = False
        state.verdict[row] = REJECTED
        state.is_measured[row] = False
        state.hidden_for[row] = away_for + step
        store(state.refused_at, row, local)
    # A leap tells no velocity.
    if away_for < math.inf and (is_taken or stays_refused):
        store(state.velocity, row, add(velocity, scale(
            subtract(moved, ahead), min(time / VELOCITY_TIME, 1.) / time)))
    if is_taken:
        store(state.local, row, local)
