"""Takes of markers on the skin of a simulated hand."""

import numpy as np

from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import PAPER_PLACES, marker_positions
from hand_tracker.simulation.skin_take import EVERY_JOINT, skin_take

__all__ = ['EVERY_JOINT', 'SKIN_OFFSET', 'WORN_PLACES', 'simulated_take', 'worn_markers']

SKIN_OFFSET = .008  # [m] dorsal
WORN_PLACES = PAPER_PLACES
TAKE_MOTIONS = 'spelling', 'power_grasp', 'precision_grasp', 'piano'


def simulated_take(hand, names, seconds=16., **more):
    """Return a take of a hand in motions of the library, and its angles (T, 25) [rad]."""
    return skin_take(hand, names, **{'motions': TAKE_MOTIONS, 'seconds': seconds,
                                     'height': SKIN_OFFSET, **more})


def worn_markers(hand, layout, angles):
    """Return the eight markers (T, 8, 3) of a hand that stays in its place [m]."""
    rotation, position = np.tile(np.eye(3), (len(angles), 1, 1)), np.zeros((len(angles), 3))
    return marker_positions(layout.mounting(hand), forward(
        joint_table(hand), angles, rotation, position), rotation, position)
