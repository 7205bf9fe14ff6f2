"""Tell a hand of the other side from its labelled markers: fingers bend to the palm. No ROS."""

from __future__ import annotations

import numpy as np

from ..core.model.hand import FINGERS
from ..core.model.marker_layout import PALM_MARKERS

# [m] that fingers are beyond the palm's plane: more than they bend back, MCP by 30 degrees; ours.
BEYOND_PALM = .035
LEAST_FINGERS = 3       # that are beyond it, of those that are seen
LEAST_BENT = .4         # [s] for which they are, before it is said
GREATEST_STEP = .05     # [s] that a frame counts for at most
MINOR_SHARE = .25       # of that time, for which they are beyond it on the other side at most


class SideCheck:
    """Tell whether markers are rather of the other hand, or mirrored.

    Parameters
    ----------
    side : {'right', 'left'}
        Of the hand that is tracked.

    Attributes
    ----------
    is_wrong, is_right : bool
        Whether fingers have bent away from the palm, or to it, for long: then it is settled.
    """

    def __init__(self, side: str) -> None:
        self.is_wrong = self.is_right = False
        self._sign = 1. if side == 'right' else -1.
        self._last: float | None = None
        self._palmar = self._dorsal = 0.

    @property
    def is_settled(self) -> bool:
        """Whether the side is known."""
        return self.is_wrong or self.is_right

    def add(self, markers: np.ndarray, time: float | None) -> bool:
        """Note a frame; return whether the side has been found wrong by this one.

        Parameters
        ----------
        markers : ndarray, shape (8, 3)
            The principal markers, by their labels, NaN where hidden [m].
        time : float or None
            Of the frame [s].
        """
        if time is None or self.is_settled:
            return False
        step = 0. if self._last is None else min(max(time - self._last, 0.), GREATEST_STEP)
        self._last = time
        r, p, q = markers[:len(PALM_MARKERS)]
        normal = self._sign * np.cross(p - r, q - r)  # to the palm's inner side
        length = float(np.sqrt(normal @ normal))
        if not length > 0.:  # a marker is hidden
            return False
        fingers = markers[len(PALM_MARKERS):len(PALM_MARKERS) + len(FINGERS)]
        depths = (fingers - p) @ (normal / length)
        if (depths > BEYOND_PALM).sum() >= LEAST_FINGERS:
            self._palmar += step
        elif (depths < -BEYOND_PALM).sum() >= LEAST_FINGERS:
            self._dorsal += step
        self.is_wrong = (self._dorsal >= LEAST_BENT
                         and self._palmar < MINOR_SHARE * self._dorsal)
        self.is_right = (self._palmar >= LEAST_BENT
                         and self._dorsal < MINOR_SHARE * self._palmar)
        return self.is_wrong
