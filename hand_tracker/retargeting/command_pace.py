"""Pace of a robot's commands while no frame of the hand comes."""

from __future__ import annotations

import math


class CommandPace:
    """When commands are due while no frame of the hand comes.

    Parameters
    ----------
    period : float
        Of commands [s].
    tick : float
        Of a timer that asks, now and then a little early or late [s].
    """

    def __init__(self, period: float, tick: float) -> None:
        self._period, self._tick = period, tick
        self._last = -math.inf

    def is_due(self, now: float, sent: float) -> bool:
        """Return whether a command is due now; it is taken as sent.

        Parameters
        ----------
        now : float
            [s]
        sent : float
            When the last command was sent [s].
        """
        # An early tick would else wait for the next, and half of the commands be left out.
        early = .5 * self._tick if sent == self._last else 0.
        if now - sent < self._period - early:
            return False
        self._last = now
        return True
