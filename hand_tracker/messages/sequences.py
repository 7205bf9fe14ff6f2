"""Offsets of strings and sequences in serialized messages, for parsers.

The encoding is plain CDR (XCDR1), DDS-XTypes 1.3, 7.4. Lengths are checked against the end of the
message, whatever they are.
"""

from __future__ import annotations

import numpy as np

from ..core.numerics.jit import jit

POSE_BYTES = 7 * 8  # [bytes] of a geometry_msgs/Pose

@jit
def aligned(at: int, to: int) -> int:
    """Return the first place from ``at`` on that is a multiple of ``to``."""
    return (at + to - 1) // to * to


@jit
def counted(words: np.ndarray, size: int, at: int) -> tuple[int, int]:
    """Read a sequence's length; return it and the offset of its items, `size` + 1 if cut off."""
    at = aligned(at, 4)
    if at + 4 > size:
        return 0, size + 1
    count = words[at // 4]
    if count < 0:  # more than any buffer holds
        return 0, size + 1
    return count, at + 4


@jit
def after(words: np.ndarray, size: int, at: int, width: int, alignment: int) -> int:
    """Return the offset of the end of a sequence of items ``width`` bytes wide."""
    count, at = counted(words, size, at)
    if count > 0:
        at = aligned(at, alignment) + count * width
    return at
