"""Hands in known poses, and the markers on them."""

from functools import lru_cache

import numpy as np

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.natural_poses import natural_poses
from hand_tracker.core.tracker import HandTracker

# Bent well away from the singular poses, so that seeing it twice changes nothing; of the
# thumb's angles, one marker tells some combinations only.
BENT_ANGLES = np.array(((0., .05, .5, .8, .32),) * 4 + ((.1, -.1, .05, .2, .2),)).ravel()
RIGHT = Hand.scaled()
LAYOUT = MarkerLayout()


@lru_cache(maxsize=16)
def skeleton(hand, layout=LAYOUT):
    """Return the joint table and the mounting of a hand, both as they are for all its poses."""
    return joint_table(hand), layout.mounting(hand)


def markers_of(hand, angles, layout=None, *wrist):
    """Return the markers of a hand in a pose of its joints and of its wrist."""
    table, mounting = skeleton(hand, layout or LAYOUT)
    return marker_positions(mounting, forward(table, angles, *wrist), *wrist)


def hand_at(angles=BENT_ANGLES, hand=RIGHT, layout=LAYOUT, offset=(0., 0., 1.), turn=0.):
    """Return the eight markers of a hand in a pose."""
    c, s = np.cos(turn), np.sin(turn)
    at = np.array(((c, -s, 0.), (s, c, 0.), (0., 0., 1.))), np.array(offset)
    return markers_of(hand, angles, layout, *at)


def motion(hand, count=40):
    """Return frames of a moving hand that loses markers in every known way."""
    frames = []
    for t in np.linspace(0., 2., count):
        angles = np.clip(BENT_ANGLES * (1. + .4 * np.sin(3. * t)), *hand.limits.T)
        frames.append(hand_at(angles, hand, offset=(.1 * t, .05, 1.), turn=.5 * t))
    frames[10][4] = np.nan
    frames[11][4] = frames[12][6] = 0.
    frames[15][1] = np.nan
    frames[20][:3] = np.nan
    frames[25][3] = 1e300
    return frames


def rest_state(seen=range(8), side='right'):
    """Return the state of a tracker that sees some markers of a hand at rest."""
    hand = Hand.scaled(side=side)
    places = markers_of(hand, np.zeros(len(JOINTS)))
    tracker = HandTracker(hand)
    hidden = np.full((8, 3), np.nan)
    hidden[list(seen)] = places[list(seen)]
    return tracker.update(hidden)


def from_pose_to_pose(seed, poses=20):
    """Return the markers of a right hand that takes natural poses, 0.1 s each, at 100 Hz."""
    hand = Hand.scaled()
    keys = natural_poses(hand)[poses * seed:poses * (seed + 1)]
    times = np.arange(poses * 10) / 10.
    angles = np.array([np.interp(times, np.arange(poses), column) for column in keys.T]).T
    return markers_of(hand, angles)


def bending(number):
    """Return the markers of a hand that bends to and fro, in frame `number`."""
    return hand_at(BENT_ANGLES * (1. + .3 * np.sin(.02 * number)))
