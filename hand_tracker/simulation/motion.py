"""Minimum-jerk motion through hand poses, with a periodic sway of the wrist.

Between poses every joint follows the minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5 (Flash and
Hogan, J. Neurosci. 5, 1985), which is monotonic: limits that hold in both poses hold between.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import DIGITS, FINGERS, Hand
from .poses import pose_angles

JOINTS_OF_DIGIT = 5
# From the units of sway tables, [m] and [degrees], to [m] and [rad].
SI_OF_SWAY = np.concatenate((np.ones(3), np.radians(np.ones(3))))


class MotionStep(NamedTuple):
    """Movement to a named pose, followed by a rest in it.

    Attributes
    ----------
    pose : str
        One of `NAMED_POSES`.
    move, hold : float
        Durations of movement and rest [s].
    delays : tuple of float
        Delay of each digit's movement, index finger to thumb [s].
    """

    pose: str
    move: float
    hold: float
    delays: tuple[float, ...] = (0.,) * len(DIGITS)


class Keyframe(NamedTuple):
    """Joint angles to move to, and the rest in them.

    Attributes
    ----------
    angles : ndarray, shape (25,)
        [rad]
    move, hold : float
        Durations of movement and rest [s].
    delays : float or array_like, shape (5,)
        Delay of each digit's movement, index finger to thumb [s].
    """

    angles: np.ndarray
    move: float
    hold: float
    delays: ArrayLike = 0.


class Sway(NamedTuple):
    """Periodic motion of the wrist: a Fourier series of its position and its Euler angles.

    Attributes
    ----------
    period : float
        [s]
    centre : ndarray, shape (6,)
        Mean position x, y, z [m], then mean roll, pitch and yaw [rad].
    amplitude, phase : ndarray, shape (h, 6)
        Of the harmonics 1 to h: amplitudes [m, rad] and phases [rad].
    """

    period: float
    centre: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray


@dataclass(frozen=True)
class Motion:
    """Keyframes of the joint angles, timed for each digit, and the sway of the wrist.

    Parameters
    ----------
    times : ndarray, shape (k, 5)
        Times of each digit's keyframes, not decreasing [s].
    angles : ndarray, shape (k, 25)
        Joint angles of the keyframes, in the order of `JOINTS` [rad].
    sway : Sway
    """

    times: np.ndarray
    angles: np.ndarray
    sway: Sway

    @property
    def duration(self) -> float:
        """Time of the last keyframe of any digit [s]."""
        return float(self.times[-1].max())

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return joint angles and wrist pose at given times, clipped to the duration.

        Parameters
        ----------
        times : ndarray, shape (n,)
            [s]

        Returns
        -------
        angles : ndarray, shape (n, 25)
            [rad]
        wrist_rotation : ndarray, shape (n, 3, 3)
            Wrist frame to world.
        wrist_position : ndarray, shape (n, 3)
            In the world [m].
        """
        times = np.clip(times, 0., self.duration)
        angles = np.empty((len(times), self.angles.shape[1]))
        for digit in range(len(DIGITS)):
            joints = slice(JOINTS_OF_DIGIT * digit, JOINTS_OF_DIGIT * (digit + 1))
            keys = self.times[:, digit]
            after = np.clip(np.searchsorted(keys, times, side='right'), 1, len(keys) - 1)
            span = keys[after] - keys[after - 1]
            progress = np.clip((times - keys[after - 1]) / np.where(span > 0., span, 1.), 0., 1.)
            start, end = self.angles[after - 1, joints], self.angles[after, joints]
            angles[:, joints] = start + minimum_jerk(progress)[:, None] * (end - start)
        return (angles, *_sway_pose(self.sway, times))


def minimum_jerk(progress: np.ndarray) -> np.ndarray:
    """Return the minimum-jerk position profile, 0 to 1, at normalised times 0 to 1."""
    return progress ** 3 * (10. + progress * (6. * progress - 15.))


def _sway_pose(sway: Sway, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the wrist's rotations (n, 3, 3) and positions (n, 3) [m] at times (n,) [s]."""
    harmonic = np.arange(1, len(sway.amplitude) + 1)[:, None]
    angle = 2. * np.pi * harmonic * times[:, None, None] / sway.period + sway.phase  # (n, h, 6)
    moved = sway.centre + (sway.amplitude * np.sin(angle)).sum(axis=1)
    (cr, cp, cy), (sr, sp, sy) = np.cos(moved[:, 3:]).T, np.sin(moved[:, 3:]).T
    rotation = np.array((
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr)))
    return np.moveaxis(rotation, 2, 0), moved[:, :3]


def _motion_of(steps: Sequence[MotionStep], hand: Hand, sway: Sway) -> Motion:
    """Return the motion through named poses, starting at rest in the first.

    Parameters
    ----------
    steps : sequence of MotionStep
        `move` of the first is ignored.
    hand : Hand
    sway : Sway

    Returns
    -------
    Motion
    """
    known = {name: pose_angles(name, hand) for name in {step.pose for step in steps}}
    # Not `motion_through`, whose sums round otherwise: the packaged recordings stay bit-equal.
    times: list[np.ndarray] = []
    angles, clock = [], 0.
    for step in steps:
        delays = np.array(step.delays)
        if times:
            times[-1] = times[-1] + delays
        arrival = clock + (delays + step.move if times else 0. * delays)
        clock = arrival.max() + step.hold
        times += [arrival, np.full(len(DIGITS), clock)]
        angles += [known[step.pose]] * 2
    return Motion(np.array(times), np.array(angles), sway)


def motion_through(keyframes: Sequence[Keyframe], sway: Sway) -> Motion:
    """Return the motion through keyframes, starting at rest in the first.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        `move` and `delays` of the first are ignored.
    sway : Sway

    Returns
    -------
    Motion
    """
    times: list[np.ndarray] = []
    angles, clock = [], 0.
    for keyframe in keyframes:
        delays = np.broadcast_to(keyframe.delays, len(DIGITS))
        if times:
            # A digit leaves its last pose after its delay.
            times[-1] = times[-1] + delays
            arrival = clock + delays + keyframe.move
        else:
            arrival = np.zeros(len(DIGITS))
        clock = arrival.max() + keyframe.hold
        times += [arrival, np.full(len(DIGITS), clock)]
        angles += [keyframe.angles] * 2
    return Motion(np.array(times), np.array(angles), sway)


THUMB_LAST = (0.02, 0., .02, .05, .22)
THUMB_FIRST = (.22, .20, .20, .22, 0.)
LITTLE_FIRST = (.36, .24, .12, 0., .18)
INDEX_FIRST = (0., .04, .08, .12, 0.)

DEMO_STEPS = (
    MotionStep('relaxed', 0., .5),
    MotionStep('open', .6, .3, INDEX_FIRST),
    MotionStep('fist', .7, .4, THUMB_LAST),
    MotionStep('open', .6, .2, THUMB_FIRST),
    MotionStep('spread', .5, .3),
    MotionStep('ready', .6, .1),
    *(step for finger in FINGERS for step in (
        MotionStep(f'oppose_{finger}', .5, .2), MotionStep('ready', .4, 0.))),
    MotionStep('fist', .6, .2, THUMB_LAST),
    MotionStep('one', .45, .4),
    MotionStep('two', .45, .4),
    MotionStep('three', .45, .4),
    MotionStep('four', .45, .4),
    MotionStep('five', .5, .4),
    MotionStep('pinch', .6, .2),
    MotionStep('five', .5, .1),
    MotionStep('pinch', .6, .2),
    MotionStep('open', .5, .2),
    MotionStep('rolled', .45, 0., LITTLE_FIRST),
    MotionStep('open', .45, 0., LITTLE_FIRST),
    MotionStep('rolled', .45, 0., LITTLE_FIRST),
    MotionStep('open', .45, .1, LITTLE_FIRST),
    MotionStep('relaxed', .7, .5),
)

# Sway of the wrist: x, y, z [m], then roll, pitch, yaw [degrees].
DEMO_CENTRE = np.array((.05, -.10, 1.10, 0., -50., 10.))
DEMO_AMPLITUDE = np.array((
    (.060, .080, .040, 24., 6., 14.),
    (.030, .025, .030, 10., 9., 8.),
    (.010, .012, .010, 8., 6., 6.)))
DEMO_PHASE = ((0., 90., 40., 10., 200., 120.), (70., 20., 160., 250., 30., 300.),
              (210., 140., 0., 80., 110., 20.))


def demo_motion(hand: Hand) -> Motion:
    """Return the motion of the packaged recordings, about half a minute.

    Opening, fist, spreading, thumb opposition to each finger, counting from one to five,
    pinching and waving; first and last pose are equal.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    Motion
    """
    motion = _motion_of(DEMO_STEPS, hand, Sway(1., *np.zeros((3, 1, 6))))
    return Motion(motion.times, motion.angles, Sway(
        motion.duration, DEMO_CENTRE * SI_OF_SWAY, DEMO_AMPLITUDE * SI_OF_SWAY,
        np.radians(DEMO_PHASE)))
