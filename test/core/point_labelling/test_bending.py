"""Digits that bend as no learned frame has shown."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import FINGERS, FLEXION_JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.bending import bending
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.prototypes import learn_prototype

DIGITS_OF_MARKERS = -1, -1, -1, 0, 1, 2, 3, 4


def markers_at(angles):
    """Return the markers of poses, (T, 8, 3) [m]."""
    hand = Hand.scaled()
    return marker_positions(MarkerLayout().mounting(hand), forward(joint_table(hand), angles))


@pytest.mark.parametrize('finger', range(len(FINGERS)))
@pytest.mark.parametrize('bend', (.4, .7))
def test_a_finger_that_was_never_seen_to_bend_keeps_its_label(finger, bend):
    random = np.random.default_rng(1)
    still = markers_at(np.zeros((50, 25))) + random.normal(0., .0003, (50, 8, 3))
    labeller = CloudLabeller([learn_prototype(MARKERS, still, DIGITS_OF_MARKERS, 'right')])
    angles = np.zeros((1, 25))
    angles[:, FLEXION_JOINTS[finger, :2]] = bend
    order = random.permutation(8)
    found = labeller.label_frame(markers_at(angles)[0, order]).rows[0]
    assert np.array_equal(found, np.argsort(order))


def test_what_the_frames_show_is_not_widened():
    random = np.random.default_rng(1)
    angles = np.zeros((400, 25))
    for joints in FLEXION_JOINTS[:, :2].T:
        angles[:, joints] = random.uniform(-1.5, 1.5, (400, 5))
    frames = markers_at(angles)
    # Deviations of 10 and 6 mm are added to those of the frames.
    learned = learn_prototype(MARKERS, frames, DIGITS_OF_MARKERS, 'right').statistics
    for marker in range(3, 7):
        places = frames[:, marker] - frames[:, marker].mean(axis=0)
        shown = np.linalg.slogdet(
            places.T @ places / len(places) + (.010 ** 2 + .006 ** 2) * np.eye(3))[1]
        assert learned.marginal_constant[marker] == pytest.approx(shown, abs=1e-6)


def test_markers_farther_out_move_farther_and_none_sideways_or_of_the_palm():
    # A palm in the plane z = 0, and a finger along x with two markers.
    places = np.array(((0., -.04, 0.), (0., .04, 0.), (-.08, 0., 0.), (.04, 0., 0.), (.08, 0., 0.)))
    moments = bending(places, np.array((-1, -1, -1, 0, 0)))
    deviations = np.sqrt(np.diag(moments)).reshape(5, 3)
    assert (deviations[:3] == 0.).all()
    assert deviations[3:, 1] == pytest.approx(0., abs=1e-9)
    assert .01 < deviations[3, 2] < deviations[4, 2] < .08
    assert moments[11, 14] > 0.  # both on one side of the palm
