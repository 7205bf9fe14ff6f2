"""How well the markers fit the hand, over seconds. No ROS."""

STEP = .1  # [s] that a frame counts for at most: a pause tells nothing of the fit


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
            step = min(now - self._last, STEP)
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
