"""Time between frames, whatever their stamps say."""

import math

USUAL_STEP = 1. / 120.  # [s] before two frames have told
LONGEST = 1.            # [s] between frames after which motion is not carried on
SHORTEST = 1e-6         # [s] between frames; less is none, and makes no velocity
FARTHEST = 1e6          # [s] that a gap counts at most
BACKWARD = .5           # [s] that frames of one recording may be out of order
REPEATS = 2             # frames in a row that take no time; more are of a clock that stands
SHARE = .1              # of a new step in the usual one


class Clock:
    """The owner of time: turns stamps into steps.

    A frame without a time comes one usual step after the last; one that repeats the last
    time, but for rounding, or is a little older comes with it, unless time seems to stand. A
    time that jumps is believed when the next one goes on from there, and until then is none: a
    single stray stamp, past or future, is forgotten.
    """

    def __init__(self):
        self._last = None
        self._doubted = None
        self._ahead = 0.  # since the last time, given to frames without one that is believed
        self._repeats = 0
        self._usual = USUAL_STEP

    def step(self, time):
        """Return the time since the last frame, and whether all begins anew.

        Parameters
        ----------
        time : float or None
            Of the frame [s]; None, or a number that is not finite, is not known.

        Returns
        -------
        step : float
            0, or from `SHORTEST` [s] to `FARTHEST`.
        paused : bool
            Whether frames were missing for longer: motion is not to be carried on.
        restarted : bool
            Whether time jumped back, as where a recording begins again.
        """
        if time is None or not math.isfinite(time):
            return self._guess()
        if self._last is None:
            self._last, self._ahead = time, 0.
            return self._usual, False, False
        step = time - self._last
        doubted, self._doubted = self._doubted, None
        believed = doubted is not None and (
            time >= doubted - BACKWARD and abs(time - doubted) < abs(step))
        if believed and step < 0.:
            self._last, self._ahead = time, 0.
            return self._usual, False, True
        if not believed and not -BACKWARD <= step <= LONGEST + self._ahead:
            self._doubted = time
            return self._guess()
        if step < SHORTEST:
            self._repeats += 1
            return self._guess() if self._repeats > REPEATS else (0., False, False)
        self._repeats = 0
        ahead, self._last, self._ahead = self._ahead, time, 0.
        if ahead == 0. and step <= LONGEST:
            self._usual += SHARE * (step - self._usual)
        step = max(step - ahead, min(step, self._usual))
        return min(step, FARTHEST), step > LONGEST, False

    def _guess(self):
        self._ahead += self._usual
        return self._usual, False, False
