"""Labels from frame to frame: which of them might be exchanged."""

import numpy as np

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.point_labelling.following import doubt_labels
from hand_tracker.core.point_labelling.hand_track import begin_track
from hand_tracker.core.point_labelling.natural_poses import model_prototype
from hand_tracker.core.point_labelling.palm_search import blank_finding


def test_a_point_may_be_that_of_a_marker_whose_own_may_be_none():
    statistics = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS).statistics
    index, ring, little = map(MARKERS.index, ('index', 'ring', 'little'))
    finding = blank_finding(len(MARKERS))
    finding.rows[:] = np.arange(len(MARKERS))
    track = begin_track(statistics, finding, statistics.template)
    track.trusted_for[:] = 2.
    # The little finger has a point since .1 s ago that may be none, as the ring finger returns.
    track.trusted_for[little, little] = .1
    track.hidden_for[ring] = .3
    cost = np.full((len(MARKERS), len(MARKERS)), np.inf)
    np.fill_diagonal(cost, -20.)
    doubt_labels(track, cost, finding.rows)
    assert track.trusted_for[ring, little] == track.trusted_for[little, ring] == .1
    assert track.trusted_for[ring, ring] == 0.
    assert track.trusted_for[ring, index] == track.trusted_for[index, little] == 2.
