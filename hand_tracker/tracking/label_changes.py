"""Labels of a source that are of no use: none comes, or none stays with its marker."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..core.model.marker_layout import MARKERS
from ..messages.marker_array import MarkerFrame

UNLABELLED_AFTER = 1.   # [s] of points without a label, before points are labelled
CHANGED_LABELS = 12     # frames with exchanged labels, within `UNLABELLED_AFTER`; ours
POINT_STEP = .005       # [m] largest motion of a point whose label changes; ours
LABEL_STEP = .015       # [m] least jump of that label; ours


class LabelChanges:
    """Judge whether the labels of a source are of no use, as none of them stays with its marker.

    Parameters
    ----------
    count : int
        Markers of the hand.
    """

    def __init__(self, count: int) -> None:
        self._count = count
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
        elif len(frame.unknown) >= min(self._count, len(MARKERS)):
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
