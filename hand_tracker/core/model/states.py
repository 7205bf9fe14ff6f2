"""States of the palm and of the markers in a frame."""

import enum


class PalmState(enum.IntEnum):
    """What is known of the palm; from LOST on it is predicted, if it was seen before."""

    TRACKED = 0
    CARRIED = 1         # a palm marker is hidden, its place is carried by the others
    LOST = 2            # no palm marker is seen
    COINCIDENT = 3      # two palm markers lie in one place
    COLLINEAR = 4       # the palm markers lie on one line
    TOO_FAR_APART = 5   # the palm markers are farther apart than on this hand
    WAITING = 6         # the three palm markers have not been seen together yet
    TOO_CLOSE = 7       # all palm markers are closer together than on this hand


# Kernels return plain integers; to call PalmState takes ten times as long.
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
    """What is known of a marker."""

    SEEN = 0
    PREDICTED = 1  # hidden
    ABSENT = 2     # not seen since the start: where it usually is with the others
    REJECTED = 3   # seen where it cannot be, and predicted instead
    SWAPPED = 4    # seen under another marker's label, and put right
    STALE = 5      # hidden for longer than a prediction holds


# Kernels store plain integers.
SEEN = int(MarkerState.SEEN)
PREDICTED = int(MarkerState.PREDICTED)
ABSENT = int(MarkerState.ABSENT)
REJECTED = int(MarkerState.REJECTED)
SWAPPED = int(MarkerState.SWAPPED)
STALE = int(MarkerState.STALE)
