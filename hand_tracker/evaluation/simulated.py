"""Simulated hands for the evaluations: measured markers, ground truth, calibrated hand model.

The tracker's hand model is not the simulated hand but has the errors of a calibration: 2 % in
every bone and every coordinate of the palm's joints, 1 mm per axis in every marker offset, 10 % of
the slope and 2 degrees in the coupling of the distal joints (standard deviations, drawn for each
motion). Limits and axes of the joints are those of the simulated hand, so that abduction and thumb
are better known than those of a real hand. The tracker's input is the measured markers only.

The seed of a motion is the given seed plus the number of the motion. Eight cameras of 3600 by 3600
pixels and 60 degrees stand in a ring of 1.6 m radius, with noise of half a pixel; the tables of
noise and of solvers use the true markers with added noise instead of cameras. Degrees a joint are
means over the 21 joints that move: the four carpometacarpal joints of the fingers are locked
(Table 1) and left out.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import Hand, preset_limits
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MarkerLayout
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from ..simulation.cameras import CameraRig
from ..simulation.motions import MOTIONS, motion_named
from ..simulation.simulator import calibrated
from ..simulation.visibility import MarkerObservation, observe, skin_layout, triangulate
from .capture_tracking import Tracked, track_markers, tracked_joints
from .evaluation_options import Options
from .metrics import PoseDistance, angle_distance, joint_errors
from .rows import Row, error_statistics

DISTANCE_DECIMALS = 6  # of stored [rad], [rad²] and [degrees]
# Joints that are not locked, shape (25,) bool.
MOVING_JOINTS = np.ptp(preset_limits('paper'), axis=1) > 0.


class Trial(NamedTuple):
    """Hand in motion, its markers in eight cameras, and the calibrated hand model.

    Attributes
    ----------
    motion : str
    rate : float
        [Hz]
    hand : Hand
        The simulated hand.
    angles : ndarray, shape (n, 25)
        True joint angles [rad].
    rotation : ndarray, shape (n, 3, 3)
        True rotation, wrist frame to world.
    position : ndarray, shape (n, 3)
        True position of the wrist [m].
    joints : ndarray, shape (n, 21, 3)
        True joint positions in the order of `LANDMARKS` [m].
    rig : CameraRig
    observed : MarkerObservation
        Markers as all cameras measure them.
    noise : ndarray, shape (n, 8, c, 2)
        Standard normal draws for the image coordinates.
    calibrated_hand : Hand
        Hand model with calibration errors.
    layout : MarkerLayout
        Marker layout with calibration errors.
    """

    motion: str
    rate: float
    hand: Hand
    angles: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    joints: np.ndarray
    rig: CameraRig
    observed: MarkerObservation
    noise: np.ndarray
    calibrated_hand: Hand
    layout: MarkerLayout

    def measured(self, cameras: Iterable[int] | None = None, hidden: bool = True) -> np.ndarray:
        """Return the markers as measured by a subset of the cameras.

        Parameters
        ----------
        cameras : iterable of int, optional
            Default: all.
        hidden : bool
            Whether markers can be occluded; if not, every camera sees every marker.

        Returns
        -------
        ndarray, shape (n, 8, 3)
            NaN where not seen [m].
        """
        seen = self.observed.seen if hidden else np.ones_like(self.observed.seen)
        if cameras is not None:
            seen = seen & np.isin(np.arange(seen.shape[-1]), list(cameras))
        return triangulate(self.rig, self.observed.truth, seen, self.noise).positions

    def track(self, markers: np.ndarray, rate: float | None = None, hand: Hand | None = None,
              options: TrackerOptions | None = None, flexion: np.ndarray | None = None) -> Tracked:
        """Track markers (n, 8, 3) [m], by default with the calibrated hand at the trial's rate.

        Parameters
        ----------
        markers : ndarray, shape (n, 8, 3)
            [m]
        rate : float, optional
            [Hz]
        hand : Hand, optional
        options : TrackerOptions, optional
        flexion : ndarray, shape (n, 5), optional
            Measured flexion of the distal joints [rad].
        """
        tracker = HandTracker(self.calibrated_hand if hand is None else hand, self.layout, options)
        return track_markers(tracker, markers, self.rate if rate is None else rate, flexion=flexion)

    def errors(self, tracked: Tracked, every: int = 1, hand: Hand | None = None) -> Row:
        """Return `mean_mm` and `p95_mm` of all joints; `tracked` has each `every`-th frame."""
        found = tracked_joints(self.calibrated_hand if hand is None else hand, tracked)
        errors = joint_errors(found, self.joints[::every])['all']
        return {'joint_class': 'all', **error_statistics(errors)}


def trial(motion: str, seed: int, rate: float, duration: float,
          layout: MarkerLayout | None = None) -> Trial:
    """Simulate a trial.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    seed : int
        Of motion, noise and calibration errors.
    rate : float
        [Hz]
    duration : float
        Cut to the duration of the motion [s].
    layout : MarkerLayout, optional
        True layout; default: on the skin of the capsules.

    Returns
    -------
    Trial
    """
    hand, rig = Hand.scaled(), CameraRig.ring()
    layout = skin_layout(hand) if layout is None else layout
    moving = motion_named(motion, hand, seed, duration)
    times = np.arange(int(min(duration, moving.duration) * rate)) / rate
    angles, rotation, position = moving.sample(times)
    pose = forward(joint_table(hand), angles, rotation, position)
    noise = np.random.RandomState((seed, 1)).standard_normal(
        (len(times), len(layout.offsets), len(rig.positions), 2))
    observed = observe(rig, hand, layout, angles, rotation, position, noise)
    joints = landmark_positions(hand, pose, position)
    return Trial(motion, rate, hand, angles, rotation, position, joints, rig, observed, noise,
                 *calibrated(hand, layout, seed))


def tasks(options: Options, motions: Iterable[str] | None = None) -> list[tuple[str, int]]:
    """Return (motion, seed) of each motion, by default of all, each with a seed of its own."""
    return [(motion, options.seed + i)
            for i, motion in enumerate(MOTIONS if motions is None else motions)]


def moving_distance(found: np.ndarray, other: np.ndarray) -> PoseDistance:
    """Return the distance of poses (Eq. 11) over the joints that are not locked.

    Parameters
    ----------
    found, other : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    PoseDistance
    """
    return angle_distance(found[:, MOVING_JOINTS], other[:, MOVING_JOINTS])


def distances(prefix: str, found: np.ndarray, other: np.ndarray) -> Row:
    """Return mean and maximum over frames of the pose distance of Eq. 11, in three units.

    Parameters
    ----------
    prefix : str
        Of the keys.
    found, other : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    dict
        By prefix and 'squared', Dist² [rad²]; 'dist', Dist [rad]; 'deg', mean per moving joint
        [degrees]; maxima with the suffix 'max'.
    """
    distance = moving_distance(found, other)
    row: Row = {}
    for name, values in (('squared', distance.squared), ('dist', distance.distance),
                         ('deg', distance.degrees)):
        row[f'{prefix}_{name}'] = round(float(values.mean()), DISTANCE_DECIMALS)
        row[f'{prefix}_{name}_max'] = round(float(values.max()), DISTANCE_DECIMALS)
    return row


def mean_max(rows: Sequence[Row], key: str, digits: int) -> str:
    """Format 'mean (maximum)' over rows of a key and of its maximum."""
    mean = sum(row[key] for row in rows) / len(rows)
    return f'{mean:.{digits}f} ({max(row[key + "_max"] for row in rows):.{digits}f})'


def paper_losses(rows: Sequence[Row], key: str, squared: str, paper: Mapping[Any, str], unit: str
                 ) -> list[str]:
    """Return lines for mean or maximum of Dist² over motions above the published values.

    Parameters
    ----------
    rows : list of dict
    key : str
        Of the varied quantity, such as 'cameras'.
    squared : str
        Key of Dist².
    paper : dict of str
        Published 'mean (maximum)' by the value of `key`.
    unit : str
        Of the varied quantity.

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
