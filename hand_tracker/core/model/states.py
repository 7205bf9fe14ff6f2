"""States of the palm and of each marker in a frame, as enums and as integers for kernels."""

import enum

import numpy as np


class PalmState(enum.IntEnum):
    """State of the palm; from LOST on its pose is predicted, if it was ever seen."""

    TRACKED = 0         # all palm markers are seen
    CARRIED = 1         # hidden palm markers are placed by those seen
    LOST = 2            # no palm marker is seen
    COINCIDENT = 3      # two palm markers coincide
    COLLINEAR = 4       # the palm markers are collinear
    TOO_FAR_APART = 5   # two palm markers are farther apart than on this hand
    WAITING = 6         # the three palm markers have not been seen together yet
    TOO_CLOSE = 7       # all palm markers are closer together than on this hand


# Kernels return integers; indexing this is ten times as fast as PalmState(...).
PALM_STATES = tuple(PalmState)
TRACKED = int(PalmState.TRACKED)
CARRIED = int(PalmState.CARRIED)
LOST = int(PalmState.LOST)
COINCIDENT = int(PalmState.COINCIDENT)
COLLINEAR = int(PalmState.COLLINEAR)
TOO_FAR_APART = int(PalmState.TOO_FAR_APART)
WAITING = int(PalmState.WAITING)
TOO_CLOSE = int(PalmState.TOO_CLOSE)


class MarkerState(enum.IntEnum):
    """State of a marker: how its position was obtained."""

    SEEN = 0       # measured
    PREDICTED = 1  # hidden, predicted
    ABSENT = 2     # not seen since the start: its rest position, moved with the others
    REJECTED = 3   # measured as an outlier, predicted instead
    SWAPPED = 4    # measured under another marker's label, corrected
    STALE = 5      # hidden for longer than predictions hold


# Kernels store integers.
SEEN = int(MarkerState.SEEN)
PREDICTED = int(MarkerState.PREDICTED)
ABSENT = int(MarkerState.ABSENT)
REJECTED = int(MarkerState.REJECTED)
SWAPPED = int(MarkerState.SWAPPED)
STALE = int(MarkerState.STALE)


def are_seen(states: np.ndarray) -> np.ndarray:
    """Return which markers were measured, under their own label or another, by their states."""
    return (states == SEEN) | (states == SWAPPED)
