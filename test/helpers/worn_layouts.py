"""Hands in motion that wear a layout with several markers a digit, and are tracked by them."""

import numpy as np

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.tracker import HandTracker, TrackerOptions
from hand_tracker.simulation.motions import motion_named

WEARER = Hand.scaled()
SEVERAL_A_DIGIT = 'optitrack_hand', 'dfki13', 'sig18_19', 'kyutech23'
WORN_RATE = 120.


def markers_of(layout, motion='demo', rate=WORN_RATE, seconds=3.):
    """Return the markers of a motion with noise, (T, n, 3) [m]."""
    times = np.arange(int(rate * seconds)) / rate
    moved = motion_named(motion, WEARER, 1, 10.).sample(times + 2.)
    # Not named as the paper's eight, knuckles ride on their metacarpals.
    riding = MarkerLayout(layout.places, layout.offsets, names=[f'{n}.' for n in layout.names],
                          skin_shares=layout.skin_shares)
    places = marker_positions(
        riding.mounting(WEARER), forward(joint_table(WEARER), *moved), *moved[1:])
    return places + np.random.default_rng(0).normal(scale=2e-4, size=places.shape)


def tracked(layout, frames, rate=WORN_RATE, hand=WEARER, **options):
    """Return the angles of tracked frames, (T, 25) [degrees], and the states of their markers."""
    tracker = HandTracker(hand, layout, TrackerOptions(**options))
    states = [tracker.update(frame, i / rate) for i, frame in enumerate(frames)]
    return (np.degrees([state.angles for state in states]),
            np.array([state.marker_states for state in states]))
