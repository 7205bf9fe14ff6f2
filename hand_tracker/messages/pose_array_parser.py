"""Parser of serialized geometry_msgs/PoseArrays, such as of landmarks."""

from __future__ import annotations

import math

import numpy as np

from ..core.numerics.jit import jit
from .sequences import POSE_BYTES, aligned, counted

BESIDE_ORIGIN = 1e-9   # [m] along x


@jit
def _is_zero(numbers: np.ndarray, place: int) -> bool:
    return numbers[place] == 0. and numbers[place + 1] == 0. and numbers[place + 2] == 0.


@jit
def parse_pose_array(octets: np.ndarray, words: np.ndarray, numbers: np.ndarray, size: int,
                     heads: np.ndarray, places: np.ndarray,
                     strings: np.ndarray) -> tuple[int, int]:
    """Find the poses of a PoseArray; those that are missing are changed to NaN.

    Poses at exactly (0, 0, 0) are missing. But one alone is where its source has the origin: it is
    moved by nothing to speak of, as markers at exactly zero are lost ones.

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
    at_origin = 0
    for i in range(poses):
        heads[i] = 0
        place = (at + POSE_BYTES * i) // 8
        places[i, 0], places[i, 1], places[i, 2] = 0, place, 0
        at_origin += _is_zero(numbers, place)
    for i in range(poses):
        place = places[i, 1]
        if at_origin and _is_zero(numbers, place):
            if at_origin == 1:
                numbers[place] = BESIDE_ORIGIN
            else:
                numbers[place] = numbers[place + 1] = numbers[place + 2] = math.nan
    heads[0, 0] = frame_length
    strings[:frame_length] = octets[frame:frame + frame_length]
    return poses, frame_length
