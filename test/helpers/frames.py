"""Frames of a hand at rest as they come in, and the tracker's states of them."""

from functools import cache

import numpy as np

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.marker_array import MarkerFrame
from hand_tracker.messages.stamps import Stamp

RESTING = marker_positions(
    MarkerLayout().mounting(Hand.scaled()),
    forward(joint_table(Hand.scaled()), np.zeros(len(JOINTS))))
ZERO_STAMP = Stamp(0, 0)


def frame(positions=RESTING, stamp=ZERO_STAMP, unknown=(), foreign=(), doubled=()):
    """Return what a message held."""
    return MarkerFrame(stamp or None, 'mocap', np.asarray(positions), unknown, foreign, doubled)


def hidden(*slots):
    """Return the markers of a hand at rest without some."""
    positions = RESTING.copy()
    positions[list(slots)] = np.nan
    return positions


@cache
def tracked_hand():
    """Return the hand at rest, tracked."""
    return HandTracker().update(RESTING)


def state_of(palm=PalmState.TRACKED, **states):
    """Return a tracked hand some markers of which are in other states than SEEN."""
    marker_states = np.full(len(MARKERS), MarkerState.SEEN)
    for marker, state in states.items():
        marker_states[MARKERS.index(marker)] = state
    seen = marker_states == MarkerState.SEEN
    return tracked_hand()._replace(
        palm=palm, marker_states=marker_states, hidden_for=np.where(seen, 0., 2.5))
