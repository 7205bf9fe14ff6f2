"""Events of markers that are worth a log line: lost, rejected, swapped, or labels that change."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..core.model.marker_layout import MARKERS
from ..core.model.states import MarkerState
from ..messages.marker_array import MarkerFrame
from .rate_limit import LogRateLimiter

RECOVERED_AFTER = 1.  # [s] as expected before a marker counts as seen again
UNLABELLED_AFTER = 1.   # [s] of points without a label, before points are labelled
CHANGED_LABELS = 12     # frames with exchanged labels, within `UNLABELLED_AFTER`; ours
POINT_STEP = .005       # [m] largest motion of a point whose label changes; ours
LABEL_STEP = .015       # [m] least jump of that label; ours
MANY_EXCHANGED = 4      # labels of a frame, from which all may be of no use; ours

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

    Attributes
    ----------
    exchanges_many : bool
        Whether many labels are exchanged that were not a while ago: `LabelChanges` should see each
        frame, to find out whether labels are of any use.
    """

    def __init__(self, count: int = len(MARKERS)) -> None:
        self.exchanges_many = False
        self._exchanged, self._exchanged_since = b'', 0.
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
        exchanged = marker_states == MarkerState.SWAPPED
        is_many = exchanged.sum() >= MANY_EXCHANGED
        if is_many and (which := exchanged.tobytes()) != self._exchanged:
            self._exchanged, self._exchanged_since = which, now
        self.exchanges_many = bool(is_many and now - self._exchanged_since < UNLABELLED_AFTER)

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


class LabelChanges:
    """Judge whether the labels of a source are of no use, as none of them stays with its marker.

    Parameters
    ----------
    count : int
        Markers of the hand.
    not_of : str, optional
        Namespace of another hand's, as of `LabelMap`: such labels are of use.
    """

    def __init__(self, count: int, not_of: str = '') -> None:
        self._count, self._not_of = count, not_of
        self._last = np.full((count, 3), np.nan)
        self._missing_since: float | None = None
        self._changes: deque[float] = deque(maxlen=CHANGED_LABELS)

    def add(self, frame: MarkerFrame, received: float) -> str | None:
        """Note a frame; return why points are to be labelled by shape, None where they are not.

        Parameters
        ----------
        frame : MarkerFrame
        received : float
            On a clock that never jumps [s].
        """
        now, last = frame.positions, self._last
        seen = np.isfinite(now[:, 0])
        self._last = np.where(seen[:, None], now, last)
        # Reported are at most some labels of others; frames of fewer points say nothing.
        if seen.any():
            self._missing_since = None
        elif (sum(not self._not_of or label[0] != self._not_of for label in frame.unknown)
              >= min(self._count, len(MARKERS))):
            if self._missing_since is None:
                self._missing_since = received
            elif received - self._missing_since >= UNLABELLED_AFTER:
                return 'no marker has a label of labels.*'
        steps = now - last
        leapt = np.flatnonzero(np.einsum('ij,ij->i', steps, steps) > LABEL_STEP**2)
        if len(leapt) >= 2:
            gaps = np.linalg.norm(now[leapt, None] - last, axis=2)
            if (gaps < POINT_STEP).any(axis=1).sum() >= 2:
                self._changes.append(received)
        if (len(self._changes) == CHANGED_LABELS
                and received - self._changes[0] <= UNLABELLED_AFTER):
            return 'labels change from marker to marker'
        return None
