"""Parser of serialized sensor_msgs/PointCloud2s, whatever fields they have beside x, y and z."""

from __future__ import annotations

import math
import sys

import numpy as np

from ..core.numerics.jit import jit
from .sequences import aligned, counted

MOST_MARKERS = 1000   # or points of a message; the first are taken
NO_FIELD = -1
# Constants of sensor_msgs/PointField: INT8 to FLOAT64.
INT8, UINT8, INT16, UINT16, INT32, UINT32, FLOAT32, FLOAT64 = range(1, 9)
X, Y, Z = b'xyz'
WIDTHS = 0, 1, 1, 2, 2, 4, 4, 4, 8  # [bytes] of these
HOST_IS_BIG_ENDIAN = sys.byteorder == 'big'


@jit
def _coordinate(octets: np.ndarray, at: int, kind: int, is_swapped: bool, numbers: np.ndarray,
                place: int) -> float:
    """Return a number of a cloud, by way of the eight bytes at ``place``, which are aligned."""
    width = WIDTHS[kind]
    raw = numbers.view(np.uint8)
    for i in range(width):
        raw[8 * place + i] = octets[at + (width - 1 - i if is_swapped else i)]
    if kind == FLOAT32:
        return float(numbers.view(np.float32)[2 * place])
    if kind == FLOAT64:
        return float(numbers[place])
    if kind == INT8:
        return float(numbers.view(np.int8)[8 * place])
    if kind == UINT8:
        return float(raw[8 * place])
    if kind == INT16:
        return float(numbers.view(np.int16)[4 * place])
    if kind == UINT16:
        return float(numbers.view(np.uint16)[4 * place])
    if kind == INT32:
        return float(numbers.view(np.int32)[2 * place])
    return float(numbers.view(np.uint32)[2 * place])


@jit
def parse_point_cloud(octets: np.ndarray, words: np.ndarray, numbers: np.ndarray, size: int,
                      heads: np.ndarray, places: np.ndarray,
                      strings: np.ndarray) -> tuple[int, int]:
    """Find the points of a PointCloud2; their positions are written behind the message.

    Points with a NaN or infinite coordinate do not count, nor those after the first `MOST_MARKERS`.

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
    at = aligned(frame + frame_length, 4)
    fields, field = counted(words, size, at + 8)
    if field > size:
        return -1, 0
    height, width = words[at // 4], words[at // 4 + 1]
    x = y = z = NO_FIELD
    x_kind = y_kind = z_kind = 0
    for _ in range(fields):
        length, name = counted(words, size, field)
        offset = aligned(name + length, 4)
        field = aligned(offset + 5, 4) + 4
        if field > size:
            return -1, 0
        if length == 2 and octets[name + 1] == 0:
            start, kind = words[offset // 4], octets[offset + 4]
            if octets[name] == X:
                x, x_kind = start, kind
            elif octets[name] == Y:
                y, y_kind = start, kind
            elif octets[name] == Z:
                z, z_kind = start, kind
    steps = aligned(field + 1, 4)
    count, data = counted(words, size, steps + 8)
    if data + count + 1 > size or min(x, y, z, height, width) < 0:
        return -1, 0
    step, row_step = words[steps // 4], words[steps // 4 + 1]
    if (min(x_kind, y_kind, z_kind) < INT8 or max(x_kind, y_kind, z_kind) > FLOAT64
            or x + WIDTHS[x_kind] > step or y + WIDTHS[y_kind] > step
            or z + WIDTHS[z_kind] > step):
        return -1, 0
    if height == 0 or width == 0:
        return 0, 0
    if height > 1 and row_step < width * step or (height - 1) * row_step + width * step > count:
        return -1, 0
    is_swapped = (octets[field] != 0) != HOST_IS_BIG_ENDIAN
    found, place = 0, aligned(size, 8) // 8
    for i in range(height):
        for k in range(width):
            if found == MOST_MARKERS:
                return found, frame_length
            if found == len(heads) or place + 3 > len(numbers):
                return -1, 0
            at = data + i * row_step + k * step
            numbers[place] = _coordinate(octets, at + x, x_kind, is_swapped, numbers, place)
            numbers[place + 1] = _coordinate(
                octets, at + y, y_kind, is_swapped, numbers, place + 1)
            numbers[place + 2] = _coordinate(
                octets, at + z, z_kind, is_swapped, numbers, place + 2)
            if not (math.isfinite(numbers[place]) and math.isfinite(numbers[place + 1])
                    and math.isfinite(numbers[place + 2])):
                continue
            heads[found] = 0
            if found == 0:
                heads[0, 0] = frame_length
                strings[:frame_length] = octets[frame:frame + frame_length]
            places[found, 0], places[found, 1], places[found, 2] = 0, place, 0
            place += 3
            found += 1
    return found, frame_length if found else 0
