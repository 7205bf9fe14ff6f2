"""Natural motion: poses joined by minimum-jerk movements while the wrist sways.

Flash & Hogan, J. Neurosci. 5 (1985): a movement from rest to rest of least jerk follows
10 s^3 - 15 s^4 + 6 s^5, which never leaves the range between its ends.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS, FINGERS
from .poses import pose_angles

JOINTS_OF_DIGIT = 5


class Step(NamedTuple):
    """A movement to a pose, and the rest in it.

    Attributes
    ----------
    pose : str
        One of `POSES`.
    move, hold : float
        Durations [s].
    delays : tuple of float
        By which index finger to thumb set out later [s].
    """

    pose: str
    move: float
    hold: float
    delays: tuple = (0.,) * len(DIGITS)


class Sway(NamedTuple):
    """Movement of the wrist as sums of sines, the same again after each period.

    Attributes
    ----------
    period : float
        [s]
    centre : ndarray, shape (6,)
        Position, then roll, pitch and yaw [m, rad].
    amplitude, phase : ndarray, shape (h, 6)
        Of the harmonics 1 to h [m, rad] and [rad].
    """

    period: float
    centre: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray


@dataclass(frozen=True)
class Motion:
    """Keyframes of the 25 joints, each digit at its own times, and the wrist's sway.

    Parameters
    ----------
    times : ndarray, shape (k, 5)
        Of the keyframes of each digit, not decreasing [s].
    angles : ndarray, shape (k, 25)
        In the order of `JOINTS` [rad].
    sway : Sway
    """

    times: np.ndarray
    angles: np.ndarray
    sway: Sway

    @property
    def duration(self):
        """Return when the last digit has come to rest and been held [s]."""
        return float(self.times[-1].max())

    def sample(self, times):
        """Return the motion at given times; before and after it the hand holds still.

        Parameters
        ----------
        times : array_like, shape (n,)
            [s]

        Returns
        -------
        angles : ndarray, shape (n, 25)
            [rad]
        wrist_rotation : ndarray, shape (n, 3, 3)
            From the wrist's frame to the surroundings.
        wrist_position : ndarray, shape (n, 3)
            [m]
        """
        times = np.clip(np.asarray(times, dtype=float), 0., self.duration)
        angles = np.empty((len(times), self.angles.shape[1]))
        for digit in range(len(DIGITS)):
            joints = slice(JOINTS_OF_DIGIT * digit, JOINTS_OF_DIGIT * (digit + 1))
            keys = self.times[:, digit]
            after = np.clip(np.searchsorted(keys, times, side='right'), 1, len(keys) - 1)
            span = keys[after] - keys[after - 1]
            share = np.clip((times - keys[after - 1]) / np.where(span > 0., span, 1.), 0., 1.)
            start, end = self.angles[after - 1, joints], self.angles[after, joints]
            angles[:, joints] = start + minimum_jerk(share)[:, None] * (end - start)
        return (angles, *sway_pose(self.sway, times))


def minimum_jerk(share):
    """Return the share of the way after a share of the time, both 0 to 1."""
    return share ** 3 * (10. + share * (6. * share - 15.))


def sway_pose(sway, times):
    """Return the wrist's rotations (n, 3, 3) and positions (n, 3) at given times [s]."""
    harmonic = np.arange(1, len(sway.amplitude) + 1)[:, None]
    angle = 2. * np.pi * harmonic * times[:, None, None] / sway.period + sway.phase  # (n, h, 6)
    moved = sway.centre + (sway.amplitude * np.sin(angle)).sum(axis=1)
    (cr, cp, cy), (sr, sp, sy) = np.cos(moved[:, 3:]).T, np.sin(moved[:, 3:]).T
    rotation = np.array((
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr)))
    return np.moveaxis(rotation, 2, 0), moved[:, :3]


def motion_of(steps, hand, sway):
    """Return the motion through poses, which starts at rest in the first.

    Parameters
    ----------
    steps : sequence of Step
        The first one's `move` does not count.
    hand : Hand
    sway : Sway

    Returns
    -------
    Motion
    """
    known = {name: pose_angles(name, hand) for name in {step.pose for step in steps}}
    times, angles = [], []
    clock = 0.
    for i, step in enumerate(steps):
        delays = np.array(step.delays)
        arrival = clock + (delays + step.move if i else 0. * delays)
        clock = arrival.max() + step.hold
        times += [arrival, np.full(len(DIGITS), clock)]
        angles += [known[step.pose]] * 2
    # A digit leaves a pose when its delay of the next step has passed.
    for i, step in enumerate(steps[1:]):
        times[2 * i + 1] = times[2 * i + 1] + step.delays
    return Motion(np.array(times), np.array(angles), sway)


THUMB_LAST = (0.02, 0., .02, .05, .22)
THUMB_FIRST = (.22, .20, .20, .22, 0.)
LITTLE_FIRST = (.36, .24, .12, 0., .18)
INDEX_FIRST = (0., .04, .08, .12, 0.)

DEMO_STEPS = (
    Step('relaxed', 0., .5),
    Step('open', .6, .3, INDEX_FIRST),
    Step('fist', .7, .4, THUMB_LAST),
    Step('open', .6, .2, THUMB_FIRST),
    Step('spread', .5, .3),
    Step('ready', .6, .1),
    *(step for finger in FINGERS for step in (
        Step(f'oppose_{finger}', .5, .2), Step('ready', .4, 0.))),
    Step('fist', .6, .2, THUMB_LAST),
    Step('one', .45, .4),
    Step('two', .45, .4),
    Step('three', .45, .4),
    Step('four', .45, .4),
    Step('five', .5, .4),
    Step('pinch', .6, .2),
    Step('five', .5, .1),
    Step('pinch', .6, .2),
    Step('open', .5, .2),
    Step('rolled', .45, 0., LITTLE_FIRST),
    Step('open', .45, 0., LITTLE_FIRST),
    Step('rolled', .45, 0., LITTLE_FIRST),
    Step('open', .45, .1, LITTLE_FIRST),
    Step('relaxed', .7, .5),
)

# [m] and [degrees]: some 20 cm and some tens of degrees, fingers raised obliquely.
DEMO_CENTRE = (.05, -.10, 1.10, 0., -50., 10.)
DEMO_AMPLITUDE = (
    (.060, .080, .040, 24., 6., 14.),
    (.030, .025, .030, 10., 9., 8.),
    (.010, .012, .010, 8., 6., 6.))
DEMO_PHASE = ((0., 90., 40., 10., 200., 120.), (70., 20., 160., 250., 30., 300.),
              (210., 140., 0., 80., 110., 20.))


def demo_motion(hand):
    """Return half a minute of what a hand can do: the motion of the packaged recording.

    Open, fist, spread, opposition to each finger, counting one to five, pinch, wave; it
    ends in the pose in which it starts.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    Motion
    """
    unit = np.concatenate((np.ones(3), np.radians(np.ones(3))))
    motion = motion_of(DEMO_STEPS, hand, Sway(1., *np.zeros((3, 1, 6))))
    return Motion(motion.times, motion.angles, Sway(
        motion.duration, DEMO_CENTRE * unit, DEMO_AMPLITUDE * unit, np.radians(DEMO_PHASE)))
