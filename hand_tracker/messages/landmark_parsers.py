"""Parsers of serialized messages of landmarks: PoseArrays, NamedPoseArrays and MarkerArrays.

Landmarks at exactly (0, 0, 0) are missing. But one alone of a hand is where its source has the
origin: it is moved by nothing to speak of, as markers at exactly zero are lost ones.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.numerics.jit import jit
from .marker_array import CUBE, CYLINDER, SPHERE
from .marker_array_parser import parse_marker_array
from .sequences import POSE_BYTES, aligned, counted

BESIDE_ORIGIN = 1e-9   # [m] along x
MOST_LANDMARKS = 26    # of a hand
LEFT_NAME, RIGHT_NAME = (np.frombuffer(word, np.uint8) for word in (b'left_', b'right_'))
CASE = 32              # bit that distinguishes a small letter from its capital
OF_NO_HAND, OF_ONE_HAND, OF_OTHER_HAND = range(3)


@jit
def _is_zero(numbers: np.ndarray, place: int) -> bool:
    return numbers[place] == 0. and numbers[place + 1] == 0. and numbers[place + 2] == 0.


@jit
def _mark_missing(numbers: np.ndarray, places: np.ndarray, count: int, hand: int) -> None:
    """Change the positions of a hand's landmarks that are missing to NaN.

    Its landmarks are those of the first ``count`` that have its number instead of a list's place.
    """
    at_origin = 0
    for i in range(count):
        at_origin += places[i, 2] == hand and _is_zero(numbers, places[i, 1])
    if at_origin == 0:
        return
    for i in range(count):
        place = places[i, 1]
        if places[i, 2] == hand and _is_zero(numbers, place):
            if at_origin == 1:
                numbers[place] = BESIDE_ORIGIN
            else:
                numbers[place] = numbers[place + 1] = numbers[place + 2] = math.nan


@jit
def parse_pose_array(octets: np.ndarray, words: np.ndarray, numbers: np.ndarray, size: int,
                     heads: np.ndarray, places: np.ndarray,
                     strings: np.ndarray) -> tuple[int, int]:
    """Find the poses of a PoseArray; those that are missing are changed to NaN.

    Parameters
    ----------
    octets, words, numbers, size, places
        See `parse_points`.
    heads : ndarray of int32, shape (n, 5)
        Filled: length of the frame, 0 but for the first.
    strings : ndarray of uint8, shape (>= size,)
        Filled: the frame.

    Returns
    -------
    count, used : int
        See `parse_points`.
    """
    frame_length, frame = counted(words, size, 8)
    poses, at = counted(words, size, frame + frame_length)
    if poses > 0:
        at = aligned(at, 8)
    if at + POSE_BYTES * poses > size or poses > len(heads):
        return -1, 0
    if poses == 0:
        return 0, 0
    for i in range(poses):
        heads[i] = 0
        places[i, 0], places[i, 1] = 0, (at + POSE_BYTES * i) // 8
        places[i, 2] = OF_ONE_HAND
    _mark_missing(numbers, places, poses, OF_ONE_HAND)
    heads[0, 0] = frame_length
    strings[:frame_length] = octets[frame:frame + frame_length]
    return poses, frame_length


@jit
def _begins(octets: np.ndarray, text: int, length: int, word: np.ndarray) -> bool:
    """Return whether a text begins with a word, in capitals or not."""
    if length < len(word):
        return False
    for i in range(len(word)):
        if octets[text + i] | CASE != word[i] | CASE:
            return False
    return True


@jit
def parse_named_poses(octets: np.ndarray, words: np.ndarray, numbers: np.ndarray, size: int,
                      heads: np.ndarray, places: np.ndarray,
                      strings: np.ndarray) -> tuple[int, int]:
    """Find the poses of a NamedPoseArray; those that are missing or not valid are changed to NaN.

    Parameters
    ----------
    octets, words, numbers, size, places
        See `parse_points`.
    heads : ndarray of int32, shape (n, 5)
        Filled: length of the frame and numbers of names, poses and validities, 0 but for the
        first; length of the name. There is one alone where these numbers are not equal.
    strings : ndarray of uint8, shape (>= size,)
        Filled: the frame, then the names.

    Returns
    -------
    count, used : int
        See `parse_points`.
    """
    frame_length, frame = counted(words, size, 8)
    names, at = counted(words, size, frame + frame_length)
    if at > size:
        return -1, 0
    strings[:frame_length] = octets[frame:frame + frame_length]
    used = frame_length
    for i in range(names):
        length, text = counted(words, size, at)
        at = text + length
        if at > size or i == len(heads):
            return -1, 0
        heads[i] = 0
        heads[i, 4] = length
        places[i, 2] = OF_NO_HAND
        if _begins(octets, text, length, LEFT_NAME):
            places[i, 2] = OF_ONE_HAND
        elif _begins(octets, text, length, RIGHT_NAME):
            places[i, 2] = OF_OTHER_HAND
        strings[used:used + length] = octets[text:at]
        used += length
    poses, at = counted(words, size, at)
    if poses > 0:
        at = aligned(at, 8)
    validities, valid = counted(words, size, at + POSE_BYTES * poses)
    if valid + validities > size:
        return -1, 0
    if names != poses or names != validities:
        heads[0, 0], heads[0, 1], heads[0, 2] = frame_length, names, poses
        heads[0, 3], heads[0, 4] = validities, 0
        return 1, frame_length
    if names == 0:
        return 0, 0
    for i in range(names):
        place = at // 8 + POSE_BYTES // 8 * i
        places[i, 0], places[i, 1] = 0, place
        if octets[valid + i] == 0:
            numbers[place] = numbers[place + 1] = numbers[place + 2] = math.nan
    _mark_missing(numbers, places, names, OF_ONE_HAND)
    _mark_missing(numbers, places, names, OF_OTHER_HAND)
    heads[0, 0], heads[0, 1], heads[0, 2], heads[0, 3] = frame_length, names, poses, validities
    return names, used


@jit
def parse_landmark_markers(octets: np.ndarray, words: np.ndarray, numbers: np.ndarray, size: int,
                           heads: np.ndarray, places: np.ndarray,
                           strings: np.ndarray) -> tuple[int, int]:
    """Find the markers of a MarkerArray; those of landmarks that are missing are changed to NaN.

    Parameters
    ----------
    octets, words, numbers, size, places
        See `parse_points`.
    heads, strings
        See `parse_marker_array`.

    Returns
    -------
    count, used : int
        See `parse_points`.
    """
    count, used = parse_marker_array(octets, words, size, heads, places, strings)
    for i in range(count):
        number, kind = heads[i, 2], heads[i, 3]
        is_landmark = 0 <= number < MOST_LANDMARKS and (
            kind == SPHERE or kind == CUBE or kind == CYLINDER)
        places[i, 2] = OF_ONE_HAND if is_landmark else OF_NO_HAND
    _mark_missing(numbers, places, count, OF_ONE_HAND)
    return count, used
