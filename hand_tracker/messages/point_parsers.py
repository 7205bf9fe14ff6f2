"""Parsers of serialized messages of points by number, and the positions of the hand's markers."""

from __future__ import annotations

import numpy as np

from ..core.numerics.jit import jit
from .marker_array_parser import parse_marker_array
from .mocap4r2_parser import parse_mocap4r2_markers, parse_rigid_bodies
from .point_cloud_parser import MOST_MARKERS, parse_point_cloud
from .pose_array_parser import parse_pose_array

# Numbers of the parsers.
PARSE_MARKER_ARRAY, PARSE_MARKERS, PARSE_RIGID_BODIES, PARSE_POSE_ARRAY, PARSE_CLOUD = range(5)
SMALLEST_POINT = 32  # [bytes], less than any message needs for one, but for those of clouds


def point_capacity(size: int) -> int:
    """Return how many points a message of so many bytes holds at most; of a cloud, are taken."""
    return max(size // SMALLEST_POINT, MOST_MARKERS) + 1


def number_capacity(size: int) -> int:
    """Return how many doubles a message of so many bytes takes, with those behind it of a cloud."""
    return size // 8 + 2 + 3 * MOST_MARKERS


@jit
def parse_points(parser: int, octets: np.ndarray, words: np.ndarray, numbers: np.ndarray,
                 size: int, heads: np.ndarray, places: np.ndarray,
                 strings: np.ndarray) -> tuple[int, int]:
    """Find the points of a message.

    Nothing beyond the bytes is read, whatever lengths and counts they hold.

    Parameters
    ----------
    parser : int
        `PARSE_MARKER_ARRAY` or another of these.
    octets : ndarray of uint8, shape (>= size,)
        As received.
    words : ndarray of int32, shape (>= size // 4,)
    numbers : ndarray, shape (`number_capacity(size)`,)
        The same bytes in this machine's order; positions that a cloud holds are written behind
        them, and what is no position in a message of poses is changed.
    size : int
        Bytes of the message.
    heads : ndarray of int32, shape (n, 5)
        Filled: what tells the points apart, see each parser. Messages with equal heads and strings
        have equal points at the same places.
    places : ndarray of int64, shape (n, 3)
        Filled: where the stamp is in words; where position and the points of a list are in
        doubles.
    strings : ndarray of uint8, shape (>= size,)
        Filled: texts of which the heads have the lengths.

    Returns
    -------
    count : int
        Points found, -1 when the bytes are no such message or n is too small.
    used : int
        Bytes of ``strings``.
    """
    if parser == PARSE_MARKER_ARRAY:
        return parse_marker_array(octets, words, size, heads, places, strings)
    if parser == PARSE_MARKERS:
        return parse_mocap4r2_markers(octets, words, size, heads, places, strings)
    if parser == PARSE_RIGID_BODIES:
        return parse_rigid_bodies(octets, words, size, heads, places, strings)
    if parser == PARSE_POSE_ARRAY:
        return parse_pose_array(octets, words, numbers, size, heads, places, strings)
    return parse_point_cloud(octets, words, numbers, size, heads, places, strings)


@jit
def gather_positions(numbers: np.ndarray, places: np.ndarray, slots: np.ndarray,
                     markers: np.ndarray, scale: float, zero_is_missing: bool,
                     rows: np.ndarray) -> None:
    """Put the positions of markers into the rows of those of the hand.

    Parameters
    ----------
    numbers : ndarray, shape (n,)
    places : ndarray of int64, shape (m, 3)
        See `parse_points`.
    slots, markers : ndarray of int64
        See `Sources`.
    scale, zero_is_missing
        See `markers_from_message`.
    rows : ndarray, shape (n, 3)
        Filled: NaN where not seen.
    """
    rows[:] = np.nan
    for i in range(len(slots)):
        at = places[markers[i], 1]
        x, y, z = numbers[at], numbers[at + 1], numbers[at + 2]
        if not (zero_is_missing and x == 0. and y == 0. and z == 0.):
            row = slots[i]
            rows[row, 0], rows[row, 1], rows[row, 2] = scale * x, scale * y, scale * z
