"""Parsers of serialized messages of mocap4r2's drivers: mocap4r2_msgs/Markers and RigidBodies."""

from __future__ import annotations

import numpy as np

from ..core.numerics.jit import jit
from .sequences import POSE_BYTES, aligned, counted

USE_INDEX = 1     # constant of mocap4r2_msgs/Marker: a marker without a name
AS_BEFORE = -1    # length of a body's name, where it is that of the marker before


@jit
def _marker(octets: np.ndarray, words: np.ndarray, size: int,
            at: int) -> tuple[int, int, int, int]:
    """Read a marker; return index, length and place of its name, and place of its position.

    The length is 0 of a marker that has an index alone; the position ends beyond `size` where the
    message is cut off.
    """
    index = aligned(at + 1, 4)
    length, name = counted(words, size, index + 4)
    position = aligned(name + length, 8)
    if position + 24 > size:
        return 0, 0, name, size
    number = words[index // 4]
    if octets[at] == USE_INDEX or length == 0 or octets[name] == 0:
        return number, 0, name, position
    return number, length, name, position


@jit
def parse_mocap4r2_markers(octets: np.ndarray, words: np.ndarray, size: int, heads: np.ndarray,
                           places: np.ndarray, strings: np.ndarray) -> tuple[int, int]:
    """Find the markers of a Markers message.

    Parameters
    ----------
    octets, words, size, places
        See `parse_points`.
    heads : ndarray of int32, shape (n, 5)
        Filled: length of the frame, 0 but for the first; 0; 0; 0; length of the name, 0 of a
        marker without.
    strings : ndarray of uint8, shape (>= size,)
        Filled: the frame, then the names.

    Returns
    -------
    count, used : int
        See `parse_points`.
    """
    return _parse(octets, words, size, heads, places, strings, False)


@jit
def parse_rigid_bodies(octets: np.ndarray, words: np.ndarray, size: int, heads: np.ndarray,
                       places: np.ndarray, strings: np.ndarray) -> tuple[int, int]:
    """Find the markers of the bodies of a RigidBodies message.

    Parameters
    ----------
    octets, words, size, places
        See `parse_points`.
    heads : ndarray of int32, shape (n, 5)
        Filled: length of the frame, 0 but for the first; of the body's name, `AS_BEFORE` but for
        its first; index where there is no name; 0; length of the name.
    strings : ndarray of uint8, shape (>= size,)
        Filled: the frame, then for each body its name and those of its markers.

    Returns
    -------
    count, used : int
        See `parse_points`.
    """
    return _parse(octets, words, size, heads, places, strings, True)


@jit
def _parse(octets: np.ndarray, words: np.ndarray, size: int, heads: np.ndarray,
           places: np.ndarray, strings: np.ndarray, has_bodies: bool) -> tuple[int, int]:
    """Find the markers of a message; one of markers alone is like a body without name and pose."""
    found = used = bodies = 0
    frame_length, frame = counted(words, size, 8)
    at = aligned(frame + frame_length, 4) + 4
    if has_bodies:
        bodies, at = counted(words, size, at)
    for _ in range(bodies if has_bodies else 1):
        body_length, body = 0, at
        if has_bodies:
            body_length, body = counted(words, size, at)
        markers, at = counted(words, size, body + body_length)
        for number in range(markers):
            index, length, name, position = _marker(octets, words, size, at)
            at = position + 24
            if at > size or found == len(heads):
                return -1, 0
            heads[found] = 0
            if found == 0:
                heads[0, 0] = frame_length
                strings[:frame_length] = octets[frame:frame + frame_length]
                used = frame_length
            if has_bodies:
                heads[found, 1] = body_length if number == 0 else AS_BEFORE
                heads[found, 2] = index if length == 0 else 0
                if number == 0:
                    strings[used:used + body_length] = octets[body:body + body_length]
                    used += body_length
            heads[found, 4] = length
            strings[used:used + length] = octets[name:name + length]
            used += length
            places[found, 0], places[found, 1], places[found, 2] = 0, position // 8, 0
            found += 1
        if has_bodies:
            at = aligned(at, 8) + POSE_BYTES
        if at > size:
            return -1, 0
    if at > size:
        return -1, 0
    return found, used
