"""Time between frames, whatever their stamps say."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import jit

DEFAULT_STEP = 1. / 120.  # [s] before two frames have told
PAUSE_LIMIT = 1.            # [s] between frames after which motion is not carried on
MIN_STEP = 1e-6         # [s] between frames; less is none, and makes no velocity
MAX_STEP = 1e6          # [s] that a gap counts at most
REORDER_LIMIT = .5           # [s] that frames of one recording may be out of order
MAX_REPEATS = 2             # frames in a row that take no time; more are of a clock that stands
STEP_GAIN = .1              # of a new step in the usual one


class FrameClock(NamedTuple):
    """What is kept of time, shape (1,) each; NaN where there is none.

    Attributes
    ----------
    last : ndarray
        Time that was believed [s].
    doubted : ndarray
        Time of the last frame, when it jumped [s].
    ahead : ndarray
        Since the last time, given to frames without one that is believed [s].
    usual : ndarray
        Step [s].
    repeats : ndarray of int
        Frames in a row that took no time.
    """

    last: np.ndarray
    doubted: np.ndarray
    ahead: np.ndarray
    usual: np.ndarray
    repeats: np.ndarray


def initial_clock():
    """Return the `FrameClock` before the first frame."""
    return FrameClock(np.full(1, np.nan), np.full(1, np.nan), np.zeros(1), np.full(1, DEFAULT_STEP),
                      np.zeros(1, dtype=np.int64))


@jit
def advance_clock(clock, time):
    """Return the time since the last frame, and whether all begins anew.

    A frame without a time comes one usual step after the last; one that repeats the last
    time, but for rounding, or is a little older comes with it, unless time seems to stand. A
    time that jumps is believed when the next one goes on from there, and until then is none: a
    single stray stamp, past or future, is forgotten.

    Parameters
    ----------
    clock : Clock
        Changed.
    time : float
        Of the frame; a number that is not finite is not known [s].

    Returns
    -------
    step : float
        0, or from `MIN_STEP` [s] to `MAX_STEP`.
    paused : bool
        Whether frames were missing for longer: motion is not to be carried on.
    restarted : bool
        Whether time jumped back, as where a recording begins again.
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
    # No comparison with NaN is true.
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
def _assumed_step(clock):
    clock.ahead[0] += clock.usual[0]
    return clock.usual[0]
