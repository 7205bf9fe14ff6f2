"""Takes of markers on one hand."""

from collections.abc import Sequence
from os import PathLike
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import LEFT_HAND_MIRROR
from .marker_names import NamedMarker, UsualPlace, canonical_name, identify
from .ruler import UNMEASURED, Ruler

WRONG_MARKERS = 'are labels exchanged, or did a marker slip?'


class InvalidTake(HandTrackerError, ValueError):
    """A file without a take of markers, or a take unfit for a hand."""


class MarkerTake(NamedTuple):
    """A take of markers on one hand.

    Attributes
    ----------
    name : str
    names : tuple of str
        Of the markers, in any usual spelling.
    points : ndarray, shape (T, M, 3)
        NaN where missing [m].
    side : {'right', 'left'}
    rate : float
        [Hz]
    sequence : ndarray of int, shape (T,)
        Changes where the recording was cut.
    is_optical : bool
        Whether the file declares these as markers, not as joints solved from them.
    credit : tuple of str
        Source and licence; empty where the file does not say.
    usual : dict of str to UsualPlace
        Of palm markers at no landmark, where their layout has them.
    notes : tuple of str
        To print: what was assumed of the file.
    """

    name: str
    names: tuple[str, ...]
    points: np.ndarray
    side: str
    rate: float
    sequence: np.ndarray
    is_optical: bool = True
    credit: tuple[str, str] = ('', '')
    usual: dict[str, UsualPlace] = {}
    notes: tuple[str, ...] = ()

    @property
    def mirror(self) -> np.ndarray:
        """Signs of the axes between this hand and a right one, shape (3,)."""
        return LEFT_HAND_MIRROR if self.side == 'left' else np.ones(3)

    def save(self, path: str | PathLike[str]) -> None:
        """Write an npz file for `load_take`."""
        np.savez(path, markers=self.points, marker_names=np.array(self.names), side=self.side,
                 rate_hz=self.rate, sequence=self.sequence)

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Return the markers of canonical names, NaN where there are none, (T, k, 3) [m]."""
        return _columns(self.points, [canonical_name(name) for name in self.names], names)

    def part(self, frames: np.ndarray) -> 'MarkerTake':
        """Return some of the frames."""
        return self._replace(points=self.points[frames], sequence=self.sequence[frames])


class Gathered(NamedTuple):
    """Markers of all takes together, of a right hand.

    Attributes
    ----------
    markers : tuple of NamedMarker
    points : ndarray, shape (T, M, 3)
        [m]
    usual : dict of str to UsualPlace
    ruler : Ruler
        What was measured besides.
    """

    markers: tuple[NamedMarker, ...]
    points: np.ndarray
    usual: dict[str, UsualPlace] = {}
    ruler: Ruler = UNMEASURED

    @property
    def names(self) -> list[str]:
        """Names of the markers."""
        return [marker.name for marker in self.markers]

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Return the markers of some names, NaN where there are none, (T, k, 3) [m]."""
        return _columns(self.points, self.names, names)

    def of(self, digit: int) -> list[int]:
        """Return the columns of a digit's markers, of the palm's for -1."""
        return [i for i, marker in enumerate(self.markers) if marker.digit == digit]


def _columns(points: np.ndarray, mine: Sequence[str], names: Sequence[str]) -> np.ndarray:
    """Return the points (T, n, 3) of some names, NaN of those that are not among mine."""
    found = np.full((len(points), len(names), 3), np.nan)
    for i, name in enumerate(names):
        if name in mine:
            found[:, i] = points[:, mine.index(name)]
    return found


def gather(takes: Sequence[MarkerTake], ruler: Ruler = UNMEASURED) -> Gathered:
    """Return the markers of several takes of one hand together."""
    found: dict[str, NamedMarker] = {}
    for take in takes:
        found.update((marker.name, marker) for marker in identify(take.names) if marker)
    points = np.concatenate([take.columns(tuple(found)) * take.mirror for take in takes])
    points[~np.isfinite(points).all(axis=2)] = np.nan
    usual = {name: place for take in takes for name, place in take.usual.items()}
    return Gathered(tuple(found.values()), points, usual, ruler)
