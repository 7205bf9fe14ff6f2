"""Parser of serialized MarkerArrays."""

from __future__ import annotations

import numpy as np

from ..core.numerics.jit import jit
from .marker_array import ADD, CUBE, CUBE_LIST, CYLINDER, POINTS, SPHERE, SPHERE_LIST
from .sequences import after, aligned, counted


@jit
def parse_marker_array(octets: np.ndarray, words: np.ndarray, size: int, heads: np.ndarray,
                       places: np.ndarray, strings: np.ndarray) -> tuple[int, int]:
    """Find the point-like markers that a MarkerArray adds.

    Nothing beyond the bytes is read, whatever lengths and counts they hold.

    Parameters
    ----------
    octets, words, size, places
        See `parse_points`.
    heads : ndarray of int32, shape (n, 5)
        Filled: lengths of frame and namespace, id, type, number of the list's points.
    strings : ndarray of uint8, shape (>= size,)
        Filled: frame and namespace of each.

    Returns
    -------
    count : int
        Markers found, -1 when the bytes are no MarkerArray.
    used : int
        Bytes of ``strings``.
    """
    found = used = 0
    markers, at = counted(words, size, 0)
    for _ in range(markers):
        stamp = aligned(at, 4)
        frame_length, frame = counted(words, size, stamp + 8)
        ns_length, ns = counted(words, size, frame + frame_length)
        head = aligned(ns + ns_length, 4)  # id, type, action
        if head + 12 > size:
            return -1, 0
        number, kind, action = words[head // 4], words[head // 4 + 1], words[head // 4 + 2]
        pose = aligned(head + 12, 8)
        # Of 7 + 3 doubles of pose and scale; 4 floats, a Duration and a flag.
        points_count, points = counted(words, size, pose + 80 + 16 + 8 + 1)
        is_list = kind == CUBE_LIST or kind == SPHERE_LIST or kind == POINTS
        if points_count > 0:
            points = aligned(points, 8)
        at = after(words, size, points + 24 * points_count, 16, 4)  # colors
        at = after(words, size, at, 1, 1)  # texture_resource
        at = after(words, size, aligned(at, 4) + 8, 1, 1)  # texture: stamp, frame
        at = after(words, size, at, 1, 1)  # its format
        at = after(words, size, at, 1, 1)  # its data
        at = after(words, size, at, 8, 4)  # uv_coordinates
        at = after(words, size, at, 1, 1)  # text
        at = after(words, size, at, 1, 1)  # mesh_resource
        at = after(words, size, at, 1, 1)  # mesh_file: its name
        at = after(words, size, at, 1, 1)  # its data
        at += 1  # mesh_use_embedded_materials
        if at > size:
            return -1, 0
        if action != ADD or not (is_list or kind == CUBE or kind == SPHERE or kind == CYLINDER):
            continue
        heads[found, 0], heads[found, 1] = frame_length, ns_length
        heads[found, 2], heads[found, 3] = number, kind
        heads[found, 4] = points_count if is_list else 0
        places[found, 0], places[found, 1], places[found, 2] = stamp // 4, pose // 8, points // 8
        strings[used:used + frame_length] = octets[frame:frame + frame_length]
        used += frame_length
        strings[used:used + ns_length] = octets[ns:ns + ns_length]
        used += ns_length
        found += 1
    if at > size:
        return -1, 0
    return found, used
