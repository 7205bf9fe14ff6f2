"""Time between frames, whatever their stamps say."""

import math

USUAL_STEP = 1. / 120.  # [s] before two frames have told
LONGEST = 1.            # [s] between frames after which motion is not carried on
SHORTEST = 1e-6         # [s] between frames; less is none, and makes no velocity
FARTHEST = 1e6          # [s] that a gap counts at most
BACKWARD = .5           # [s] that frames of one recording may be out of order
SHARE = .1              # of a new step in the usual one


class Clock:
    """The owner of time: turns stamps into steps.

    A frame without a time comes one usual step after the last; one that repeats the last
    time, but for rounding, or is a little older comes with it.
    """

    def __init__(self):
        self._last = None
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
            return self._usual, False, False
        last, self._last = self._last, time
        if last is None:
            return self._usual, False, False
        step = time - last
        if step < -BACKWARD:
            return self._usual, False, True
        if step < SHORTEST:
            self._last = last
            return 0., False, False
        if step > LONGEST:
            return min(step, FARTHEST), True, False
        self._usual += SHARE * (step - self._usual)
        return step, False, False
