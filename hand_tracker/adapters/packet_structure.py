"""Structure of packets: the header bits that decide the layout, and the offsets of points.

A system's packets are alike for minutes: while their counts, names and ids are those of the last
one, nothing has to be decoded but numbers at known places.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from .clock_estimate import ClockLine

FLOAT = np.dtype('<f4')
POINT_SIZE = 3 * FLOAT.itemsize   # [bytes]
NO_PLACE = -1                       # in place of a place
NO_PLACES_SHOWN, NONE_SHOWN = np.zeros(0, int), np.zeros(0, bool)


class PacketStructure:
    """Mask and value of a packet's header bits; packets that match have one layout.

    Parameters
    ----------
    data : bytes
        The packet.
    mask : bytes
        Of its size: ones where it decides.

    Attributes
    ----------
    data, mask
    """

    def __init__(self, data: bytes, mask: bytes) -> None:
        self.data, self.mask = data, mask
        self._size, self._mask = len(data), int.from_bytes(mask, 'little')
        self._bits = int.from_bytes(data, 'little') & self._mask

    def matches(self, data: bytes) -> bool:
        """Return whether another packet has this layout."""
        return (len(data) == self._size
                and int.from_bytes(data, 'little') & self._mask == self._bits)


class PacketOrigin(NamedTuple):
    """Offsets of a frame's numbers in its packet, and in all that match its structure.

    Attributes
    ----------
    structure : PacketStructure
    markers : ndarray of int
        Places of the frame's markers, `NO_PLACE` for those that no such packet shows.
    points : ndarray of int
        Places of the anonymous points; those without a finite position are left out of a frame.
    turn : ndarray, shape (3, 3)
        By which they are multiplied.
    order, time : int
        Places of a number of eight bytes that goes up from packet to packet, and of the exposure.
    tick : float
        Of the exposure [s].
    now : callable
        Returns the last number that goes up, the `ClockLine`, and `wall_offset` [ns].
    follow : callable
        To be called with a packet that was read by its origin alone, and when it was received.
    filled_in : ndarray of int
        Places of positions that were filled in for occluded markers.
    may_be_filled : ndarray of bool
        Of each marker, whether it is occluded where its position is one of those.
    labelled : ndarray of int
        Places of positions of labelled markers.
    repeated : int
        Number of the points, from the first on, that are left out where their position is one of
        those.
    """

    structure: PacketStructure
    markers: np.ndarray
    points: np.ndarray
    turn: np.ndarray
    order: int
    time: int
    tick: float
    now: Callable[[], tuple[int, ClockLine, int]]
    follow: Callable[[bytes, int], None]
    filled_in: np.ndarray = NO_PLACES_SHOWN
    may_be_filled: np.ndarray = NONE_SHOWN
    labelled: np.ndarray = NO_PLACES_SHOWN
    repeated: int = 0

    def of_rows(self, rows: list[int]) -> PacketOrigin:
        """Return the origin of a frame with some of the markers, by their rows."""
        flags = self.may_be_filled
        return self._replace(markers=self.markers[rows],
                             may_be_filled=flags[rows] if len(flags) else flags)


def point_places(starts: Sequence[int]) -> np.ndarray:
    """Return the places of all bytes of points that start at some, shape (n, POINT_SIZE)."""
    return np.add.outer(np.array(starts, int), np.arange(POINT_SIZE))


def points_at(octets: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the points at places of a packet, as it has them.

    Parameters
    ----------
    octets : ndarray of uint8
        The packet.
    places : ndarray of int, shape (n, POINT_SIZE)
        See `point_places`.

    Returns
    -------
    ndarray of float32, shape (n, 3)
    """
    return octets[places].view(FLOAT)
