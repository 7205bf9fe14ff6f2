"""Events of markers that are worth a log line: lost, rejected or swapped."""

from __future__ import annotations

import numpy as np

from ..core.model.marker_layout import MARKERS
from ..core.model.states import MarkerState
from .rate_limit import LogRateLimiter

RECOVERED_AFTER = 1.  # [s] as expected before a marker counts as seen again

EVENTS = {
    MarkerState.STALE: 'no longer seen, its part of the hand is a guess',
    MarkerState.REJECTED: 'seen where it cannot be, and not used',
    MarkerState.SWAPPED: 'seen under the label of another, and put right',
}
IS_EVENT = np.array([state in EVENTS for state in MarkerState])
AS_EXPECTED = int(MarkerState.SEEN)


class MarkerEvents:
    """Follow the states of the markers; report each change once, flickering or not.

    Parameters
    ----------
    count : int, optional
        Number of markers; the paper's eight when left out.
    """

    def __init__(self, count: int = len(MARKERS)) -> None:
        self._noted = np.full(count, AS_EXPECTED)
        self._reported = np.full(count, AS_EXPECTED)
        self._unseen_at = np.zeros(count)
        self._now = 0.
        self._limiter = LogRateLimiter()

    def update(self, now: float, marker_states: np.ndarray, palm_is_tracked: bool) -> None:
        """Note the states of a frame.

        Parameters
        ----------
        now : float
            [s]
        marker_states : ndarray of int, shape (n,)
            `MarkerState` of each marker.
        palm_is_tracked : bool
            While it is not, that alone is reported, elsewhere.
        """
        self._now = now
        if not palm_is_tracked:
            self._unseen_at[:] = now
            return
        unexpected = marker_states != AS_EXPECTED
        if unexpected.any():
            self._unseen_at[unexpected] = now
            events = IS_EVENT[marker_states]
            self._noted[events] = marker_states[events]

    def report(self, now: float) -> list[tuple[bool, str, np.ndarray]]:
        """Return the events since the last report.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        list of (bool, str, ndarray of int)
            Whether it is a warning, what happened, and to which markers.
        """
        events = []
        for state, text in EVENTS.items():
            slots = np.flatnonzero((self._noted == state) & (self._reported != state))
            if slots.size and self._limiter.allows(now):
                self._reported[slots] = state
                events.append((True, text, slots))
        self._noted[:] = AS_EXPECTED
        slots = np.flatnonzero((self._reported != AS_EXPECTED)
                               & (self._now - self._unseen_at >= RECOVERED_AFTER))
        if slots.size and self._limiter.allows(now):
            self._reported[slots] = AS_EXPECTED
            events.append((False, 'seen again as expected', slots))
        return events
