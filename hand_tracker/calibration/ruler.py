"""What a ruler says of a hand and of its markers, beside takes."""

from typing import NamedTuple

USUAL_MARKER_HEIGHT = .004      # [m] of a marker's centre above the skin: 8 mm balls. Ours
RULER_SPREAD = .02              # of a measured length, as a logarithm. Ours


class Ruler(NamedTuple):
    """Measured lengths; None of those that are not.

    Attributes
    ----------
    length : float or None
        Of the hand, from the crease of the wrist to the tip of the middle finger [m].
    breadth : float or None
        Across the knuckles of index to little finger [m].
    fingers : tuple of float, length 4, or None
        Of the bent index to little finger, from the knuckle over its back to the tip [m].
    marker_height : float
        Of the markers' centres above the skin [m].
    """

    length: float | None = None
    breadth: float | None = None
    fingers: tuple[float, ...] | None = None
    marker_height: float = USUAL_MARKER_HEIGHT

    @property
    def raised(self) -> float:
        """Height of the markers' centres above that of usual markers [m]."""
        return self.marker_height - USUAL_MARKER_HEIGHT


UNMEASURED = Ruler()
