"""How long frames take in the node, and how many never came to it. No ROS."""

from collections import deque
from typing import NamedTuple

import numpy as np

LONGEST = 10_000  # frames that are kept between two summaries
FIT_STEP = .1     # [s] that a frame counts for at most in a fit: a pause tells nothing of it
PAUSE = 1.        # [s] between two stamps that is no loss of frames


class Timing(NamedTuple):
    """How the frames of some time fared.

    Attributes
    ----------
    p50, p99, longest : float
        From receipt to published, NaN where there was none [s].
    late : int
        Frames since the start that took longer than the time between two.
    dropped : int
        Frames since the start that are missing by the stamps of the others.
    """

    p50: float
    p99: float
    longest: float
    late: int
    dropped: int


class Latency:
    """Note the times of frames; all arithmetic waits for the summary."""

    def __init__(self):
        self._taken, self._stamps = deque(maxlen=LONGEST), deque(maxlen=LONGEST)
        self._late = self._dropped = 0

    def published(self, taken, stamp):
        """Note a frame.

        Parameters
        ----------
        taken : float
            From receipt to published [s].
        stamp : float or None
            [s]
        """
        self._taken.append(taken)
        if stamp is not None:
            self._stamps.append(stamp)

    def summary(self):
        """Return how the frames since the last summary fared.

        Returns
        -------
        Timing
        """
        taken = np.array(self._taken)
        steps = np.diff(np.array(self._stamps))
        forward = steps[steps > 0.]
        if forward.size:
            step = np.median(forward)
            self._late += int((taken > step).sum())
            self._dropped += int((np.round(forward[forward < PAUSE] / step) - 1.).clip(0).sum())
        self._taken.clear()
        # The last stamp stays, as frames may be lost after it.
        for _ in range(len(self._stamps) - 1):
            self._stamps.popleft()
        p50, p99, longest = (np.percentile(taken, (50, 99, 100)).tolist() if taken.size
                             else (np.nan,) * 3)
        return Timing(p50, p99, longest, self._late, self._dropped)


class Fit:
    """The mean distance of the seen markers from the hand."""

    def __init__(self):
        self._last = None
        self._begin()

    def _begin(self):
        self._seconds = self._total = 0.

    def tracked(self, now, miss):
        """Note a frame.

        Parameters
        ----------
        now : float
            [s]
        miss : float
            Mean distance of its markers from the hand [m].
        """
        if self._last is not None:
            step = min(now - self._last, FIT_STEP)
            self._seconds += step
            self._total += step * miss
        self._last = now

    def mean(self, least):
        """Return the mean once so much was tracked, and begin anew.

        Parameters
        ----------
        least : float
            [s]

        Returns
        -------
        float or None
            [m]
        """
        if self._seconds < least:
            return None
        mean = self._total / self._seconds
        self._begin()
        return mean
