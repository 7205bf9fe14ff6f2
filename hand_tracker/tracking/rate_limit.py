"""What is only looked at needs no more than the rate of a screen. No ROS."""


class Throttle:
    """Say when something is due that is to come at a rate at most."""

    def __init__(self):
        self._next = 0.

    def due(self, now, rate):
        """Return whether it is due, and if so take it as done.

        Parameters
        ----------
        now : float
            Of a clock that never jumps [s].
        rate : float
            [Hz]
        """
        if now < self._next:
            return False
        # From when it was due, not from now: else half of the rate may be lost.
        self._next = max(self._next, now - 1. / rate) + 1. / rate
        return True


def period_ns(rate):
    """Return the nanoseconds between things that come at a rate [Hz]."""
    return round(1e9 / rate)
