"""Whether the hand fits the markers: their distance from it, frame by frame and over seconds."""

from __future__ import annotations

import math

OFF_HAND_DISTANCE = .015    # [m] that the seen markers may be off the hand on average
OFF_HAND_AFTER = 2.  # [s] after which a hand with more in most frames is left out
FAR_OFF_AFTER = .5   # [s] after which that is warned of; ours
# Fitted hands: 0 to 2.4 mm; 5 % too long or short: up to 3.3; markers on the skin: 5 to 8.
BAD_FIT_RESIDUAL = .005  # [m] that seen markers are off a hand which fits badly, on average over
FIT_AFTER = 10.  # [s] of tracking, or in a recording that ends at least
FIT_AFTER_AT_END = 2.  # [s]
# A hand far off on average is tracked again once it is nearer than FITS_AGAIN for REFIT_AFTER.
REFIT_AFTER, FITS_AGAIN = 2., .010     # [s, m]; ours
RECENT_TIME = .5        # [s] time constant of what a hand far off on average is of late; ours
FIT_STEP = .1          # [s] that a frame counts for at most: a pause tells nothing of the fit


class FitCheck:
    """Judge a hand by the mean residual of its seen markers.

    Attributes
    ----------
    residual : float
        Of the last frame, 0 without a marker [m].
    mean : float
        Of all tracked frames, 0 without one [m].
    misfit : float
        Mean over the last `FIT_AFTER` of tracking [m].
    far_off_for : float
        Time of tracking with frames far off the hand, less that with nearer ones, since one that
        fitted; at most `OFF_HAND_AFTER` [s].
    is_off : bool
        Whether that has reached `OFF_HAND_AFTER`, until it is 0 again.
    is_misfit : bool
        Whether frames are far off on average, though not each one, and of late, too.
    has_fitted : bool
        Whether any tracked frame was not far off the hand.
    """

    def __init__(self) -> None:
        self.residual = 0.
        self.forget()

    def forget(self) -> None:
        """Begin the mean anew, as of another hand or by other labels."""
        self.misfit, self.is_misfit = 0., False
        self.mean, self.has_fitted = 0., False
        self.far_off_for, self.is_off = 0., False
        self._was_far_off = False
        self._judged: float | None = None
        self._frames = 0
        self._last: float | None = None
        self._seconds = self._total = self._recent = 0.
        self._near_seconds = self._near_total = self._near_mean = 0.

    def add(self, now: float, residual: float, is_tracked: bool, is_of_side: bool) -> None:
        """Add a frame.

        Parameters
        ----------
        now : float
            [s]
        residual : float
            Mean distance of its seen markers from the hand, NaN without one [m].
        is_tracked : bool
            Whether the palm is tracked; else the frame says nothing of the fit.
        is_of_side : bool
            Whether the hand is of this side; frames of the other do not count in the mean.
        """
        is_seen = not math.isnan(residual)
        self.residual = residual if is_seen else 0.
        if not (is_tracked and is_seen):
            # It says nothing, and its time does not count.
            self._judged = now
            return
        self._frames += 1
        self.mean += (residual - self.mean) / self._frames
        self.has_fitted |= residual <= OFF_HAND_DISTANCE
        step = 0. if self._judged is None else now - self._judged
        # Rounded, as sums of steps miss the limit by as little.
        self.far_off_for = min(max(round(
            self.far_off_for + (step if self._was_far_off else -step), 9), 0.), OFF_HAND_AFTER)
        if residual <= BAD_FIT_RESIDUAL:
            self.far_off_for = 0.
        if self.far_off_for in (0., OFF_HAND_AFTER):
            self.is_off = self.far_off_for > 0.
        self._was_far_off, self._judged = residual > OFF_HAND_DISTANCE, now
        if not is_of_side or self.is_off:
            return
        if self._last is not None:
            step = min(now - self._last, FIT_STEP)
            self._seconds += step
            self._total += step * residual
            if residual <= OFF_HAND_DISTANCE:   # else of other labels, or of no such hand
                self._near_seconds += step
                self._near_total += step * residual
            self._recent += (1. - math.exp(-step / RECENT_TIME)) * (residual - self._recent)
        self._last = now

    def leave_out(self) -> None:
        """Count the hand as far off for long enough, as when another one tells so, too."""
        self.far_off_for, self.is_off = OFF_HAND_AFTER, True

    def judge(self) -> float | None:
        """Judge the mean once enough was tracked; return it, None too early or of a misfit [m].

        Frames far off do not count in it, unless it is far off with them.
        """
        miss = self._mean(REFIT_AFTER if self.is_misfit else FIT_AFTER)
        if miss is None:
            return None
        if self.is_misfit:
            if miss <= FITS_AGAIN:
                self.forget()   # frames of before count in this mean
            else:
                self.misfit = miss
            return None
        if miss > OFF_HAND_DISTANCE and self._recent <= FITS_AGAIN:
            self.forget()   # that was another hand, or wrong labels, and is over
            return None
        self.misfit, self.is_misfit = miss, miss > OFF_HAND_DISTANCE
        return miss if self.is_misfit else self._near_mean

    def end(self) -> float | None:
        """Return the mean as the input ends, None where too little was tracked [m]."""
        miss = self._mean(FIT_AFTER_AT_END)
        if miss is not None:
            self.misfit = miss
        return miss

    def _mean(self, least: float) -> float | None:
        """Return the mean residual once so much [s] was tracked, and begin it anew."""
        if self._seconds < least:
            return None
        mean = self._total / self._seconds
        self._near_mean = self._near_total / self._near_seconds if self._near_seconds else mean
        self._seconds = self._total = self._near_seconds = self._near_total = 0.
        return mean
