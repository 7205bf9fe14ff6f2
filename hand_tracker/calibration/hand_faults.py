"""Faults of recorded hands: another unit than metres, or the other side."""

import numpy as np

KNUCKLE_DISTANCE = (.03, .12)    # [m] of index and little finger's: others are another unit
UNITS = {'metres': 1., 'millimetres': 1e-3, 'centimetres': 1e-2}
SIDE_MARGIN = .004               # [m] dorsal of its knuckle on the average: another side


def unit_of(distance: float) -> str:
    """Return the unit in which the knuckles of index and little finger are so far apart.

    Parameters
    ----------
    distance : float

    Returns
    -------
    str
        One of `UNITS`, empty where it is none.
    """
    low, high = KNUCKLE_DISTANCE
    return next((name for name, factor in UNITS.items() if low <= factor * distance <= high), '')


def bend_to_back(heights: np.ndarray, knuckles: np.ndarray, least: float,
                 margin: float = SIDE_MARGIN) -> bool:
    """Return whether fingers bend to the back of the palm, as those of the other side seem to.

    Parameters
    ----------
    heights : ndarray, shape (T, n)
        Of the fingers' ends above the palm, NaN where not seen [m].
    knuckles : ndarray
        Heights of the knuckles [m].
    least : float
        Range from which on a finger's end counts [m].
    margin : float, optional
        Height above its knuckle, in the mean over the fingers' ranges [m].
    """
    heights = heights[:, np.isfinite(heights).any(axis=0)]
    if not heights.size or not np.isfinite(knuckles).any():
        return False
    low, high = np.nanpercentile(heights, (2., 98.), axis=0)
    middles = (low + high)[high - low > least] / 2. - np.nanmedian(knuckles)
    return bool(len(middles) and middles.mean() > margin)
