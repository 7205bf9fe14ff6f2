"""Limit how often something is done: displays to a rate, log lines to a number in a window."""

from collections import deque
from collections.abc import Hashable

LOG_WINDOW = 10.  # [s] sliding window for `LOG_LINES`
LOG_LINES = 6     # lines logged within that window, at most
KEYS_LOGGED = 32    # keys with a line each, at most


class RateLimiter:
    """Say when something is due that happens at a given rate at most."""

    def __init__(self) -> None:
        self._next = 0.

    def due(self, now: float, rate: float) -> bool:
        """Return whether it is due, and if so count it as done.

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


class LogRateLimiter:
    """Allow `LOG_LINES` lines in any window of `LOG_WINDOW`."""

    def __init__(self) -> None:
        self._logged: deque[float] = deque(maxlen=LOG_LINES)

    def allows(self, now: float) -> bool:
        """Return whether one more line may be logged, and if so count it.

        Parameters
        ----------
        now : float
            [s]
        """
        if len(self._logged) == LOG_LINES and now - self._logged[0] < LOG_WINDOW:
            return False
        self._logged.append(now)
        return True


class OncePerKey:
    """Allow one line for each key, for `KEYS_LOGGED` keys."""

    def __init__(self) -> None:
        self._keys: set[Hashable] = set()

    def allows(self, key: Hashable) -> bool:
        """Return whether nothing was logged for a key yet, and if so note that it is."""
        if key in self._keys or len(self._keys) == KEYS_LOGGED:
            return False
        self._keys.add(key)
        return True


def period_ns(rate: float) -> int:
    """Return the period of a rate [Hz] in nanoseconds."""
    return round(1e9 / rate)
