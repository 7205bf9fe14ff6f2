"""The steps of a frame: each is called, and has its say in the pose."""

from dataclasses import replace

import numpy as np
import pytest

from hand_tracker.core.model.hand import FINGERS, FLEXION_JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.tracker import HandTracker

STEP = 1. / 120.
HAND = Hand.scaled()
# What is measured is what comes out, and what is hidden stays where it was.
HELD = TrackerOptions(smoothing=False, rigidity=False, inertia=0., transdigital_memory=0.,
                      stale='hold', reentry_rate=1000.)
LEADERS = FLEXION_JOINTS[:4, 0]


def bent(flexion, pip=.5):
    """Return the angles of a hand with these flexions of the four MCPs."""
    angles = np.zeros(25)
    angles[LEADERS] = flexion
    angles[FLEXION_JOINTS[:, 1]] = pip
    angles[FLEXION_JOINTS[:, 2]] = HAND.coupling[:, 0] * pip + HAND.coupling[:, 1]
    return angles


def markers_of(angles, hidden=(), rotation=None, position=None):
    """Return the markers of a pose, those named hidden."""
    pose = forward(joint_table(HAND), angles, rotation, position)
    markers = marker_positions(MarkerLayout().mounting(HAND), pose, rotation, position)
    markers[[MARKERS.index(name) for name in hidden]] = np.nan
    return markers


@pytest.mark.parametrize('finger, neighbour, bound', [
    ('index', 'middle', .5), ('middle', 'ring', .6), ('little', 'ring', .7)])
def test_a_hidden_finger_does_not_stay_bent_while_its_neighbours_open(finger, neighbour, bound):
    tracker = HandTracker(options=replace(
        HELD, bound_index_middle=.5, bound_middle_ring=.6, bound_ring_little=.7))
    last = np.full(4, 1.2)
    tracker.update(markers_of(bent(last)), 0.)
    # The middle finger's other neighbour is kept, so that one bound tells.
    opening = [name for name in FINGERS if name != finger and (finger, name) != (
        'middle', 'index')]
    for frame in range(1, 31):
        last[[FINGERS.index(name) for name in opening]] = 1.2 * (1. - frame / 30.)
        state = tracker.update(markers_of(bent(last), [finger]), frame * STEP)
    flexion = dict(zip(FINGERS, state.angles[LEADERS]))
    assert abs(flexion[neighbour]) < 1e-6
    assert flexion[finger] == pytest.approx(bound, abs=1e-6)
