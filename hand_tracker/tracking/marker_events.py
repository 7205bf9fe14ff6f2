"""What there is to say about single markers: lost for long, rejected, swapped, back. No ROS."""

from collections import deque

import numpy as np

from ..core.model.marker_layout import MARKERS
from ..core.model.states import MarkerState

BACK = 1.     # [s] as expected before that is said
WINDOW = 10.  # [s] in which at most
CHANGES = 6   # changes of a kind are said, however the input flickers

NEWS = {
    MarkerState.STALE: 'no longer seen, its part of the hand is a guess',
    MarkerState.REJECTED: 'seen where it cannot be, and not used',
    MarkerState.SWAPPED: 'seen under the label of another, and put right',
}
IS_NEWS = np.array([state in NEWS for state in MarkerState])
SEEN = int(MarkerState.SEEN)


class Budget:
    """So much to say, and no more, in any window of time."""

    def __init__(self):
        self._spent = deque(maxlen=CHANGES)

    def spend(self, now):
        """Take one, unless all are spent; return whether there was one.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        bool
        """
        if len(self._spent) == CHANGES and now - self._spent[0] < WINDOW:
            return False
        self._spent.append(now)
        return True


class MarkerNews:
    """Follow the states of the markers; each change is news once, flickering or not."""

    def __init__(self):
        self._noted = np.full(len(MARKERS), SEEN)
        self._said = np.full(len(MARKERS), SEEN)
        self._unseen_at = np.zeros(len(MARKERS))
        self._now = 0.
        self._budget = Budget()

    def tracked(self, now, state, is_placed):
        """Note what the tracker made of a frame.

        Parameters
        ----------
        now : float
            [s]
        state : HandState
        is_placed : bool
            Whether the palm is found; while it is not, that alone is news.
        """
        self._now = now
        if not is_placed:
            self._unseen_at[:] = now
            return
        states = state.marker_states
        unseen = states != SEEN
        if unseen.any():
            self._unseen_at[unseen] = now
            news = IS_NEWS[states]
            self._noted[news] = states[news]

    def report(self, now):
        """Return what is new since the last report.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        list of (bool, str, ndarray)
            Whether it is a warning, what happened, and to which markers.
        """
        news = []
        for kind, text in NEWS.items():
            slots = np.flatnonzero((self._noted == kind) & (self._said != kind))
            if slots.size and self._budget.spend(now):
                self._said[slots] = kind
                news.append((True, text, slots))
        self._noted[:] = SEEN
        slots = np.flatnonzero((self._said != SEEN)
                               & (self._now - self._unseen_at >= BACK))
        if slots.size and self._budget.spend(now):
            self._said[slots] = SEEN
            news.append((False, 'seen again as expected', slots))
        return news
