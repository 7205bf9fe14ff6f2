"""Choice of the tracker's eight markers among those of a take."""

from itertools import combinations

import numpy as np

from ..core.model.marker_layout import DIGIT_LANDMARKS, MARKERS, PAPER_PLACES
from .marker_names import NamedMarker

# Landmarks at which the tracker takes a digit's marker, the paper's first.
WORN_LANDMARKS = {digit: sorted(places, key=lambda place: place not in PAPER_PLACES)
                  for digit, places in DIGIT_LANDMARKS.items()}
PAPER_PALM = PAPER_PLACES[:3]


def worn_names(markers: tuple[NamedMarker, ...], palm: dict[str, np.ndarray]) -> tuple[str, ...]:
    """Return the names of the worn markers, in the order of `MARKERS`; '' where there is none.

    Parameters
    ----------
    markers : tuple of NamedMarker
    palm : dict of str to ndarray, shape (3,)
        Places of the rigid palm markers in the palm's frame of a right hand [m].

    Returns
    -------
    tuple of str
        Where the wrist's is missing or not rigid, another that makes the widest triangle with the
        knuckles; where a knuckle's is, the three palm markers of the widest triangle of all.
    """
    names = [marker.name for marker in markers]
    corners = PAPER_PALM if all(name in palm for name in PAPER_PALM) else _widest(palm)
    digits = [next((place for place in WORN_LANDMARKS[digit] if place in names), '')
              for digit in MARKERS[len(PAPER_PALM):]]
    return (*corners, *digits)


def _widest(palm: dict[str, np.ndarray]) -> tuple[str, str, str]:
    """Return the three palm markers of the widest triangle: the proximal one, then thumb's side."""
    if len(palm) < len(PAPER_PALM):
        return '', '', ''

    def normal(names: tuple[str, ...]) -> np.ndarray:
        return np.cross(palm[names[2]] - palm[names[0]], palm[names[1]] - palm[names[0]])

    able = list(combinations(palm, 3))
    knuckles = set(PAPER_PALM[1:])
    three = max([names for names in able if knuckles < set(names)] or able,
                key=lambda names: float(np.linalg.norm(normal(names))))
    proximal = min(three, key=lambda name: palm[name][0])
    first, second = (name for name in three if name != proximal)
    # As r, p and q of the tracker: seen from the back of the hand p is on the thumb's side of q.
    if normal((proximal, first, second))[2] < 0.:
        first, second = second, first
    return proximal, first, second
