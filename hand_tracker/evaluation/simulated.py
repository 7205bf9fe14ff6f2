"""Simulated hands for the evaluations: what the cameras measure, and what the tracker knows.

The tracker wears the hand that a calibration would find, not the simulated one: every bone
and every coordinate of the palm's joints errs by 2 %, every marker's place by 1 mm per axis,
the coupling of last joints by 10 % of its slope and by 2 degrees (standard deviations, drawn
anew for each motion). Limits and axes of the joints are those of the simulated hand, so that
abduction and thumb are better known than of a real hand. The tracker is given nothing but
measured markers.

Each motion has a seed of its own, the given one and the motion's number. Eight cameras of
3600 by 3600 picture elements and 60 degrees stand in a ring of 1.6 m radius and see a marker
to half a picture element; the motion of the noise and solver tables is seen without cameras.
Degrees a joint are means over the 21 joints that move: the four carpometacarpal joints of the
fingers are locked (Table 1) and left out.
"""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import Hand, preset_limits
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MarkerLayout
from ..core.tracker import HandTracker
from ..simulation.cameras import CameraRig
from ..simulation.motions import MOTIONS, motion_named
from ..simulation.simulator import calibrated
from ..simulation.visibility import Sight, look, skin_layout, triangulate
from .capture_tracking import Tracked, track, tracked_joints
from .metrics import angle_distance, joint_errors
from .rows import spread

DECIMALS = 6  # of stored distances and degrees
MOVING = np.ptp(preset_limits('paper'), axis=1) > 0.


class Trial(NamedTuple):
    """A hand in motion, what eight cameras see of it, and the tracker's idea of it.

    Attributes
    ----------
    motion : str
    rate : float
        [Hz]
    hand : Hand
        The true one.
    angles : ndarray, shape (n, 25)
        True [rad].
    rotation, position : ndarray, shape (n, 3, 3) and (n, 3)
        True, of the wrist [m].
    joints : ndarray, shape (n, 21, 3)
        True, in the order of `LANDMARKS` [m].
    rig : CameraRig
    sight : Sight
    noise : ndarray, shape (n, 8, c, 2)
        Standard normal, of each camera's pictures.
    worn : Hand
        As calibrated.
    layout : MarkerLayout
        As calibrated.
    """

    motion: str
    rate: float
    hand: Hand
    angles: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    joints: np.ndarray
    rig: CameraRig
    sight: Sight
    noise: np.ndarray
    worn: Hand
    layout: MarkerLayout

    def measured(self, cameras=None, hidden=True):
        """Return the markers that some of the cameras measure.

        Parameters
        ----------
        cameras : sequence of int, optional
            All when left out.
        hidden : bool
            False to let every camera see every marker.

        Returns
        -------
        ndarray, shape (n, 8, 3)
            NaN where not seen [m].
        """
        seen = self.sight.seen if hidden else np.ones_like(self.sight.seen)
        if cameras is not None:
            seen = seen & np.isin(np.arange(seen.shape[-1]), cameras)
        return triangulate(self.rig, self.sight.truth, seen, self.noise).positions

    def track(self, markers, rate=None, hand=None, options=None, flexion=None):
        """Return what the tracker says of markers, with the calibrated hand if no other."""
        tracker = HandTracker(self.worn if hand is None else hand, self.layout, options)
        return track(tracker, markers, self.rate if rate is None else rate, flexion=flexion)

    def errors(self, tracked: Tracked, every=1, hand=None):
        """Return `mean_mm` and `p95_mm` of all joints of every so many frames."""
        found = tracked_joints(self.worn if hand is None else hand, tracked)
        return {'joint_class': 'all', **spread(joint_errors(found, self.joints[::every])['all'])}


def trial(motion, seed, rate, duration, layout=None):
    """Return a trial.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    seed : int
        Of motion, noise and calibration.
    rate : float
        [Hz]
    duration : float
        At most; not more than the motion has [s].
    layout : MarkerLayout, optional
        Where the markers are; on the skin of capsules when left out.

    Returns
    -------
    Trial
    """
    hand, rig = Hand.scaled(), CameraRig.ring()
    layout = skin_layout(hand) if layout is None else layout
    moving = motion_named(motion, hand, seed, duration)
    times = np.arange(int(min(duration, moving.duration) * rate)) / rate
    angles, rotation, position = truth = moving.sample(times)
    pose = forward(joint_table(hand), angles, rotation, position)
    noise = np.random.RandomState((seed, 1)).standard_normal(
        (len(times), len(layout.offsets), len(rig.positions), 2))
    sight = look(rig, hand, layout, *truth, noise)
    joints = landmark_positions(hand, pose, position)
    return Trial(motion, rate, hand, *truth, joints, rig, sight, noise,
                 *calibrated(hand, layout, seed))


def tasks(options, *more):
    """Return (motion, seed, ...) of every motion, each with its own seed and calibration."""
    return [(motion, options.seed + i, *more) for i, motion in enumerate(MOTIONS)]


def moving_distance(found, other):
    """Return the distance of poses (Eq. 11) whose locked joints do not count in means.

    Parameters
    ----------
    found, other : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    PoseDistance
    """
    return angle_distance(found[:, MOVING], other[:, MOVING])


def distances(prefix, found, other):
    """Return mean and maximum over frames of the three readings of Eq. 11.

    Parameters
    ----------
    prefix : str
        Of the keys.
    found, other : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    dict
        'squared' is Dist² [rad²], 'dist' its root [rad], 'deg' degrees per joint that moves.
    """
    distance = moving_distance(found, other)
    row = {}
    for name, values in (('squared', distance.squared), ('dist', distance.distance),
                         ('deg', distance.degrees)):
        row[f'{prefix}_{name}'] = round(float(values.mean()), DECIMALS)
        row[f'{prefix}_{name}_max'] = round(float(values.max()), DECIMALS)
    return row


def mean_max(rows, key, digits):
    """Return 'mean (max)' over rows of a key and of its maximum."""
    mean = sum(row[key] for row in rows) / len(rows)
    return f'{mean:.{digits}f} ({max(row[key + "_max"] for row in rows):.{digits}f})'


def paper_losses(rows, key, squared, paper, unit):
    """Return where mean and maximum of Dist² over motions are above the paper's.

    Parameters
    ----------
    rows : list of dict
    key : str
        Of what is varied, such as 'cameras'.
    squared : str
        Key of Dist².
    paper : dict of str
        'mean (maximum)' by the value of `key`.
    unit : str

    Returns
    -------
    list of str
    """
    lines = []
    for value, published in paper.items():
        found = [row[squared] for row in rows if row[key] == value]
        ours = sum(found) / len(found), max(
            row[f'{squared}_max'] for row in rows if row[key] == value)
        worse = [f'{name} Dist² {mine:.3f} rad² against {theirs} in the paper'
                 for name, mine, theirs in zip(('mean', 'maximum'), ours,
                                               published.strip(')').split(' ('))
                 if mine > float(theirs)]
        if worse:
            lines.append(f'{value} {unit}: ' + ', '.join(worse))
    return lines
