"""Evidence on the side, right or left, of an unlabelled hand, summed over postures.

A flat hand fits the mirrored hand, seen from behind, as well: only fingers bent to the palm show
the side, and the more such postures, the surer.
"""

import numpy as np

from .hand_track import HandTrack
from .palm_search import Finding, palm_is_seen
from .prototypes import Prototype

# Bound of a posture's cost lead, sum above which the hand is of the other side, and bound of the
# sum [variances]; ours.
POSTURE_LEAD, OTHER_SIDE_LEAD, SIDE_MEMORY = 20., 30., 200.
# Bound of the sum while no hand is followed, as the next may be another [variances]; ours.
SEARCHED_MEMORY = 40.
SIDE_PERIOD = .25           # [s] between two postures; between two checks, up to twice that
ANOTHER_POSTURE = .010      # [m] mean motion of the markers to a new posture; ours
CLEAR_SHARE = .85           # least share of seen markers for a posture to show the side; ours
BENT_SHARE = .6             # of the digits' mean palmar depth, above which they are bent; ours


class SideEvidence:
    """Evidence that a hand is the mirrored one, of the other side.

    Parameters
    ----------
    own, mirrored : Prototype
        Of the hand, and of the same of the other side.

    Attributes
    ----------
    lead : float
        Cost lead of the mirrored hand, summed over postures [variances].
    is_other_side : bool
        Whether the points fit the mirrored hand better.
    """

    def __init__(self, own: Prototype, mirrored: Prototype) -> None:
        self.judge_by(own, mirrored)
        self._posture = np.full(own.template.shape, np.inf)     # the last one added
        self._unchecked_for = SIDE_PERIOD   # [s]
        self.forget()

    def judge_by(self, own: Prototype, mirrored: Prototype) -> None:
        """Judge postures by other statistics of the two sides from now on."""
        self._own, self._mirrored = own, mirrored

    def forget(self) -> None:
        """Forget all postures."""
        self.lead, self.is_other_side = 0., False

    def lose(self) -> None:
        """Forget the evidence for the side, and most of that against it; see `SEARCHED_MEMORY`."""
        self.lead = min(max(self.lead, 0.), SEARCHED_MEMORY)

    def elapse(self, step: float) -> None:
        """Advance by a time step [s]."""
        self._unchecked_for += step

    def is_due(self, may_wait: bool = False) -> bool:
        """Return whether a check is due: after `SIDE_PERIOD`, or twice that if it may wait."""
        return self._unchecked_for >= (2. * SIDE_PERIOD if may_wait else SIDE_PERIOD)

    def add(self, lead: float, track: HandTrack, found: Finding, points: np.ndarray,
            is_followed: bool = True) -> None:
        """Add a posture's cost lead, if it shows the side and differs from the last posture.

        Parameters
        ----------
        lead : float
            Cost lead of the mirrored hand [variances].
        track : HandTrack
            Of the hand as it was found.
        found : Finding
            The mirrored hand.
        points : ndarray, shape (n, 3)
            [m]
        is_followed : bool, optional
            Whether that is confirmed; one that is not may be dropped for another.
        """
        if not self.is_due():
            return
        self._unchecked_for = 0.
        posture = track.local
        # To the nearest marker, as changed labels are no new posture.
        squares = ((posture[:, None] - self._posture) ** 2).sum(axis=2)
        moved = np.sqrt(squares.min(axis=1).mean())
        if moved < ANOTHER_POSTURE or not (
                _tells_side(self._mirrored, found, points) if lead > 0.
                else _tells_side(self._own, track.finding, points)):
            return
        self._posture = posture.copy()
        self.lead += min(max(lead, -POSTURE_LEAD), POSTURE_LEAD)
        memory = SIDE_MEMORY if is_followed else SEARCHED_MEMORY
        self.lead = min(max(self.lead, -memory), memory)
        self.is_other_side = self.lead > (0. if self.is_other_side else OTHER_SIDE_LEAD)


def _tells_side(prototype: Prototype, finding: Finding, points: np.ndarray) -> bool:
    """Return whether a posture shows the side: nearly all markers seen, digits bent to the palm."""
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
