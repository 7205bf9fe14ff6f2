"""Choice of frames that stand for many."""

import numpy as np


def evenly_spaced(frames: int, count: int) -> np.ndarray:
    """Return up to `count` indices spread evenly over a number of frames."""
    return np.unique(np.linspace(0, frames - 1, min(count, frames)).astype(int))


def every_few(points: np.ndarray, count: int) -> np.ndarray:
    """Return every so many of the frames (T, ...), `count` of them or up to twice as many."""
    return points[::max(len(points) // count, 1)]
