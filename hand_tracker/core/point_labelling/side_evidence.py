"""Evidence on the side of a hand whose points have no names, over its last postures.

A flat hand may as well be one of the other side, seen from behind: fingers that are bent to the
palm tell its side, and the more postures do so, the surer it is.
"""

import numpy as np

from .hand_track import HandTrack
from .palm_search import Finding, palm_is_seen
from .prototypes import Prototype

# How much a posture adds at most, how far the sum may be in favour of the mirrored hand, and how
# much of it is remembered [variances]; ours.
POSTURE_LEAD, OTHER_SIDE_LEAD, SIDE_MEMORY = 20., 30., 200.
SIDE_PERIOD = .25           # [s] between two postures, and between two checks
ANOTHER_POSTURE = .010      # [m] by which markers move to another posture; ours
CLEAR_SHARE = .85           # of a hand's markers that are seen where a posture tells its side; ours
BENT_SHARE = .6             # of the mean depth of digits beyond the palm, where they are bent; ours


class SideEvidence:
    """Evidence on the side of a hand.

    Parameters
    ----------
    own, mirrored : Prototype
        Of the hand, and of the same of the other side.

    Attributes
    ----------
    lead : float
        By how much the mirrored hand costs less, over the last postures [variances].
    is_other_side : bool
        Whether the points are rather those of a hand of the other side.
    """

    def __init__(self, own: Prototype, mirrored: Prototype) -> None:
        self._own, self._mirrored = own, mirrored
        self._posture = np.full(own.template.shape, np.inf)     # that was counted last
        self._unchecked_for = SIDE_PERIOD   # [s]
        self.forget()

    def forget(self) -> None:
        """Forget all postures."""
        self.lead, self.is_other_side = 0., False

    def elapse(self, step: float) -> None:
        """Let a time pass [s]."""
        self._unchecked_for += step

    def is_due(self) -> bool:
        """Return whether a posture may be added: at most one in `SIDE_PERIOD`."""
        return self._unchecked_for >= SIDE_PERIOD

    def add(self, lead: float, track: HandTrack, found: Finding, points: np.ndarray) -> None:
        """Count a posture, if it tells the side and is another than the last.

        Parameters
        ----------
        lead : float
            By how much the mirrored hand costs less [variances].
        track : HandTrack
            Of the hand as it was found.
        found : Finding
            The mirrored hand.
        points : ndarray, shape (n, 3)
            [m]
        """
        if not self.is_due():
            return
        self._unchecked_for = 0.
        posture = track.local
        # By the nearest, as labels that change are no other posture.
        squares = ((posture[:, None] - self._posture) ** 2).sum(axis=2)
        moved = np.sqrt(squares.min(axis=1).mean())
        if moved < ANOTHER_POSTURE or not (
                _tells_side(self._mirrored, found, points) if lead > 0.
                else _tells_side(self._own, track.finding, points)):
            return
        self._posture = posture.copy()
        self.lead += min(max(lead, -POSTURE_LEAD), POSTURE_LEAD)
        self.lead = min(max(self.lead, -SIDE_MEMORY), SIDE_MEMORY)
        self.is_other_side = self.lead > (0. if self.is_other_side else OTHER_SIDE_LEAD)


def _tells_side(prototype: Prototype, finding: Finding, points: np.ndarray) -> bool:
    """Return whether a hand is seen nearly whole, its digits bent to the palm."""
    seen = finding.rows >= 0
    if not palm_is_seen(prototype, finding.rows) or seen.mean() < CLEAR_SHARE:
        return False
    corner, *others = prototype.template[prototype.bases[0]]
    normal = np.cross(*(other - corner for other in others))
    digits = prototype.rigid <= 0.
    typical = np.mean((prototype.template[digits] - corner) @ normal)
    local = (points[finding.rows[seen & digits]] - finding.position) @ finding.rotation
    depth = np.mean((local / finding.size[0] - corner) @ normal)
    return bool(depth / typical > BENT_SHARE)
