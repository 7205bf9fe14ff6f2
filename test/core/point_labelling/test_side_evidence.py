"""Evidence on the side of a hand: postures that tell it, and that are others than the last."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import FLEXION_JOINTS, JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.natural_poses import model_prototype
from hand_tracker.core.point_labelling.side_evidence import (
    OTHER_SIDE_LEAD,
    POSTURE_LEAD,
    SEARCHED_MEMORY,
    SIDE_MEMORY,
    SIDE_PERIOD,
    SideEvidence,
)

PROTOTYPE = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS)


def posture(bend):
    """Return points of a hand with fingers bent by an angle [rad], and its track."""
    hand, angles = Hand.scaled(), np.zeros((1, len(JOINTS)))
    angles[:, FLEXION_JOINTS[:4]] = bend
    points = marker_positions(
        MarkerLayout().mounting(hand), forward(joint_table(hand), angles))[0]
    labeller = CloudLabeller([PROTOTYPE])
    assert labeller.update(points).found[0]
    return points, labeller._hands[0].track


@pytest.fixture(name='evidence')
def new_evidence():
    return SideEvidence(PROTOTYPE.statistics, PROTOTYPE.mirrored().statistics)


def add(evidence, lead, bend, step=SIDE_PERIOD):
    points, track = posture(bend)
    evidence.elapse(step)
    evidence.add(lead, track, track.finding, points)


def test_a_flat_hand_tells_no_side_and_a_bent_one_does(evidence):
    add(evidence, -9., 0.)
    assert evidence.lead == 0.
    add(evidence, -9., .9)
    assert evidence.lead == -9.


def test_a_posture_counts_once_and_no_other_within_the_period(evidence):
    for _ in range(3):
        add(evidence, -9., .9)
    assert evidence.lead == -9.
    add(evidence, -9., 1.2)
    add(evidence, -9., .9, .5 * SIDE_PERIOD)
    assert evidence.lead == -18.
    add(evidence, -9., .9, .5 * SIDE_PERIOD)
    assert evidence.lead == -27.


def test_labels_that_change_are_no_other_posture(evidence):
    points, track = posture(.9)
    for rows in (np.arange(8), [0, 1, 2, 6, 4, 5, 3, 7]):
        track.local[:] = track.local[rows]
        evidence.elapse(SIDE_PERIOD)
        evidence.add(-9., track, track.finding, points)
    assert evidence.lead == -9.


def test_no_posture_decides_alone_and_a_verdict_is_mended_by_many(evidence):
    evidence._mirrored = PROTOTYPE.statistics   # so that the same postures are bent to its palm
    bends = [.7 + .3 * (number % 2) for number in range(40)]
    add(evidence, 1e3, bends[0])
    assert evidence.lead == POSTURE_LEAD < OTHER_SIDE_LEAD and not evidence.is_other_side
    for bend in bends[1:20]:
        add(evidence, 1e3, bend)
    assert evidence.lead == SIDE_MEMORY and evidence.is_other_side
    for bend in bends[20:29]:
        add(evidence, -1e3, bend)
    assert 0. < evidence.lead < OTHER_SIDE_LEAD and evidence.is_other_side
    add(evidence, -1e3, bends[29])
    assert not evidence.is_other_side
    evidence.forget()
    assert evidence.lead == 0.


def test_of_a_lost_hand_little_evidence_is_left(evidence):
    for number in range(4):
        add(evidence, -1e3, .7 + .3 * (number % 2))
    assert evidence.lead == -4. * POSTURE_LEAD
    evidence.lose()
    assert evidence.lead == 0.
    evidence.lead = SIDE_MEMORY
    evidence.lose()
    assert evidence.lead == SEARCHED_MEMORY > OTHER_SIDE_LEAD
