"""Time step of each frame, robust to missing, repeated and jumping timestamps."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit

DEFAULT_STEP = 1. / 120.  # [s] until two frames have shown the true one
PAUSE_LIMIT = 1.          # [s] longest step over which motion is continued
MIN_STEP = 1e-6           # [s] shorter steps count as 0 and yield no velocity
MAX_STEP = 1e6            # [s] upper limit of a reported step
REORDER_LIMIT = .5        # [s] by which frames of one recording may be out of order
MAX_REPEATS = 2           # consecutive frames with equal time; with more the clock has stopped
STEP_GAIN = .1            # of the exponential mean of the step


class FrameClock(NamedTuple):
    """State of the frame clock; NaN where unset.

    Attributes
    ----------
    last : ndarray, shape (1,)
        Latest accepted timestamp [s].
    doubted : ndarray, shape (1,)
        Timestamp of the last frame if it jumped [s].
    ahead : ndarray, shape (1,)
        Time since `last` that was assumed for frames without an accepted timestamp [s].
    usual : ndarray, shape (1,)
        Exponential mean of the step [s].
    repeats : ndarray of int, shape (1,)
        Consecutive frames whose timestamp did not advance.
    """

    last: np.ndarray
    doubted: np.ndarray
    ahead: np.ndarray
    usual: np.ndarray
    repeats: np.ndarray


def initial_clock() -> FrameClock:
    """Return the `FrameClock` before the first frame."""
    return FrameClock(
        last=np.full(1, np.nan), doubted=np.full(1, np.nan), ahead=np.zeros(1),
        usual=np.full(1, DEFAULT_STEP), repeats=np.zeros(1, dtype=np.int64))


@jit
def advance_clock(clock: FrameClock, time: float) -> tuple[float, bool, bool]:
    """Advance the clock to a frame; return the time step and what became of the sequence.

    A frame without a timestamp counts as one mean step after the last. A timestamp equal to
    the last up to rounding, or slightly older, gives a step of 0 unless the clock has stopped.
    A timestamp that jumps is accepted only when the next one continues from it; a single
    stray stamp, past or future, is ignored.

    Parameters
    ----------
    clock : FrameClock
        Updated.
    time : float
        Timestamp of the frame; unknown if not finite [s].

    Returns
    -------
    step : float
        0, or from `MIN_STEP` to `MAX_STEP` [s].
    paused : bool
        Whether frames were missing for more than `PAUSE_LIMIT`: do not continue motion.
    restarted : bool
        Whether time jumped back, as when a recording starts again.
    """
    if not math.isfinite(time):
        return _assumed_step(clock), False, False
    last, doubted, ahead, usual = (
        clock.last[0], clock.doubted[0], clock.ahead[0], clock.usual[0])
    if math.isnan(last):
        clock.last[0], clock.ahead[0] = time, 0.
        return usual, False, False
    step = time - last
    clock.doubted[0] = math.nan
    # Comparisons with NaN are false.
    believed = time >= doubted - REORDER_LIMIT and abs(time - doubted) < abs(step)
    if believed and step < 0.:
        clock.last[0], clock.ahead[0] = time, 0.
        return usual, False, True
    if not believed and not -REORDER_LIMIT <= step <= PAUSE_LIMIT + ahead:
        clock.doubted[0] = time
        return _assumed_step(clock), False, False
    if step < MIN_STEP:
        clock.repeats[0] += 1
        return _assumed_step(clock) if clock.repeats[0] > MAX_REPEATS else 0., False, False
    clock.repeats[0] = 0
    clock.last[0], clock.ahead[0] = time, 0.
    if ahead == 0. and step <= PAUSE_LIMIT:
        usual += STEP_GAIN * (step - usual)
        clock.usual[0] = usual
    step = max(step - ahead, min(step, usual))
    return min(step, MAX_STEP), step > PAUSE_LIMIT, False


@jit
def _assumed_step(clock: FrameClock) -> float:
    """Advance by the mean step, for a frame without an accepted timestamp; return it [s]."""
    clock.ahead[0] += clock.usual[0]
    return clock.usual[0]
