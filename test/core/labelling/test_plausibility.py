"""The cost of a labelling by the hand alone."""

import numpy as np
from helpers.hands import RIGHT, hand_at, markers_of

from hand_tracker.core.labelling.plausibility import label_cost, permuted_costs, typical_places
from hand_tracker.core.labelling.readings import DIGIT_PERMUTATIONS
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.point_labelling.natural_poses import natural_poses

TYPICAL = typical_places(RIGHT, MarkerLayout().mounting(RIGHT))


def test_costs_of_all_orders_of_the_digits_are_those_of_each_labelling():
    seen = np.ones(8, dtype=bool)
    for angles in natural_poses(RIGHT, 20):
        # The wrist's frame is that of the markers.
        markers = markers_of(RIGHT, angles)
        whole = [label_cost(markers, seen, np.array((0, 1, 2, *(3 + order))), TYPICAL)
                 for order in DIGIT_PERMUTATIONS]
        digits = permuted_costs(markers[3:], DIGIT_PERMUTATIONS, TYPICAL)
        np.testing.assert_allclose(np.subtract(whole, whole[0]), digits - digits[0], atol=1e-9)


def test_the_labels_of_a_hand_at_rest_are_its_best():
    markers = hand_at(RIGHT.relaxed(), offset=(0., 0., 0.))
    assert permuted_costs(markers[3:], DIGIT_PERMUTATIONS, TYPICAL).argmin() == 0
