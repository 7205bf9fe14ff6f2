"""Recent clouds of a followed hand with their labels, which single frames confirm or not.

A hand whose size was learned from wrong labels fits these labels, and would keep them. No ROS.
"""

import math
from collections import deque

import numpy as np

from ..core.point_labelling.cloud_labeller import CloudLabeller
from ..core.point_labelling.palm_search import SEARCH_BUDGET
from ..core.point_labelling.prototypes import HandPrototype

KEPT_CLOUDS = 12
KEEPING_PERIOD = .08        # [s] between two
CONFIRMED_SHARE = .75       # of labels that single frames must give as well; ours


class RecentClouds:
    """The last clouds in which a hand was found, a period apart."""

    def __init__(self) -> None:
        self._clouds: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=KEPT_CLOUDS)
        self._last = -math.inf      # [s]

    def add(self, points: np.ndarray, places: np.ndarray, time: float) -> None:
        """Keep a frame, if the last one kept is a period ago, or comes later.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            [m]
        places : ndarray, shape (M, 3)
            Those that are labelled as the markers, not numbers for a hidden one [m].
        time : float
            [s]
        """
        if not 0. <= time - self._last < KEEPING_PERIOD:
            self._clouds.append((points, places))
            self._last = time

    def confirm(self, prototype: HandPrototype) -> bool:
        """Return whether single frames, without history, give most labels; any thread may ask.

        Frames without a hand, or that take longer to search than a frame may, are left out.

        Parameters
        ----------
        prototype : HandPrototype
            To label single frames by.
        """
        labeller, seen, same = CloudLabeller([prototype]), 0, 0
        for points, places in tuple(self._clouds):
            labels = labeller.label_frame(points, SEARCH_BUDGET)
            if labels.found[0]:
                seen += int(np.isfinite(places).all(axis=1).sum())
                same += int((places == labels.places[0]).all(axis=1).sum())
        return seen > 0 and same >= CONFIRMED_SHARE * seen
