"""Simulated hands for the evaluations: what the cameras measure, and what the tracker knows.

The tracker wears the hand that a calibration would find, not the simulated one: every bone
and every coordinate of the palm's joints errs by 2 %, every marker's place by 1 mm per axis
(standard deviations). It is given nothing but measured markers.
"""

from typing import NamedTuple

import numpy as np

from ..core.hand import Hand
from ..core.layout import MarkerLayout
from ..core.metrics import angle_distance
from ..core.tracker import HandTracker
from ..simulation.cameras import CameraRig
from ..simulation.motions import MOTIONS, motion_named
from ..simulation.sight import Sight, look, skin_layout, triangulate
from ..simulation.simulate import calibrated
from .tracking import track

DECIMALS = 6  # of stored distances and degrees


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

    def track(self, markers, rate=None, hand=None):
        """Return what the tracker says of markers, with another hand than the calibrated one."""
        tracker = HandTracker(self.worn if hand is None else hand, self.layout)
        return track(tracker, markers, self.rate if rate is None else rate)


def trial(motion, seed, rate, duration):
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

    Returns
    -------
    Trial
    """
    hand, rig = Hand.scaled(), CameraRig.ring()
    layout = skin_layout(hand)
    moving = motion_named(motion, hand, seed, duration)
    times = np.arange(int(min(duration, moving.duration) * rate)) / rate
    truth = moving.sample(times)
    noise = np.random.RandomState((seed, 1)).standard_normal(
        (len(times), len(layout.offsets), len(rig.positions), 2))
    sight = look(rig, hand, layout, *truth, noise)
    return Trial(motion, rate, hand, *truth, rig, sight, noise, *calibrated(hand, layout, seed))


def tasks(options, *more):
    """Return (motion, seed, ...) of every motion, each with its own seed and calibration."""
    return [(motion, options.seed + i, *more) for i, motion in enumerate(MOTIONS)]


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
        'squared' is Dist² [rad²], 'dist' its root [rad], 'deg' degrees per joint.
    """
    distance = angle_distance(found, other)
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
