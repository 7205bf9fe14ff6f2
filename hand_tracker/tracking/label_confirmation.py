"""Whether single frames confirm labels, before the hand's size is learned from them. No ROS.

A hand whose size was learned from wrong labels fits these labels, and would keep them.
"""

from collections.abc import Sequence

import numpy as np

from ..core.point_labelling.cloud_labeller import CloudLabeller
from ..core.point_labelling.palm_search import SEARCH_BUDGET
from ..core.point_labelling.prototypes import HandPrototype

CONFIRMED_SHARE = .75       # of labels that single frames must give as well; ours


def are_confirmed(clouds: Sequence[tuple[np.ndarray, np.ndarray]],
                  prototype: HandPrototype) -> bool | None:
    """Return whether most labels are those that each frame gives by itself, without history.

    Parameters
    ----------
    clouds : sequence of (ndarray, ndarray)
        Of each frame the points, (n, 3), and those that are labelled as the markers, (M, 3), not
        numbers for a hidden one [m].
    prototype : HandPrototype
        To label single frames by.

    Returns
    -------
    bool or None
        None where no frame tells: without a hand, or where the search takes longer than a frame
        may.
    """
    labeller, seen, same = CloudLabeller([prototype]), 0, 0
    for points, places in clouds:
        labels = labeller.label_frame(points, SEARCH_BUDGET)
        if labels.found[0]:
            seen += int(np.isfinite(places).all(axis=1).sum())
            same += int((places == labels.places[0]).all(axis=1).sum())
    return same >= CONFIRMED_SHARE * seen if seen else None
