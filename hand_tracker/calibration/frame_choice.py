"""Choice of frames for a fit, by their coverage of a digit's motion."""

import numpy as np

from ..core.numerics.sampling import evenly_spaced

CANDIDATE_FRAMES = 2500  # evenly spaced, of which frames are chosen


def spread_frames(points: np.ndarray, count: int, least: float) -> np.ndarray:
    """Return frames whose markers are far from each other, the farthest first.

    Parameters
    ----------
    points : ndarray, shape (n, m, 3)
        Markers in the palm's frame, NaN where missing [m].
    count : int
        At most.
    least : float
        Distance of two chosen frames, in the space of all coordinates [m].

    Returns
    -------
    ndarray of int, shape (k,)
        Of the frames with all markers, or else with the most.
    """
    seen = np.isfinite(points).all(axis=2).sum(axis=1)
    usable = np.flatnonzero(seen == seen.max()) if seen.max() else np.empty(0, dtype=int)
    usable = usable[evenly_spaced(len(usable), CANDIDATE_FRAMES)]
    if not len(usable):
        return usable
    flat = np.nan_to_num(points[usable]).reshape(len(usable), -1)
    chosen = [int(np.argmax(((flat - np.median(flat, axis=0)) ** 2).sum(axis=1)))]
    nearest = ((flat - flat[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < count:
        farthest = int(np.argmax(nearest))
        if nearest[farthest] < least ** 2:
            break
        chosen.append(farthest)
        nearest = np.minimum(nearest, ((flat - flat[farthest]) ** 2).sum(axis=1))
    return usable[chosen]
