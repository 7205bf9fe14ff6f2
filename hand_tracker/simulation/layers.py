"""Layered motion: finger strokes and tremor added to a motion through poses.

Layers add to the free joints; DIP and thumb IP follow from the coupling.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS, FINGERS, JOINTS, Hand
from .motion import Motion, minimum_jerk
from .poses import COUPLING_JOINTS

# Enslaving: share of the moved digit's (row) movement that each digit (column) follows [1]. Low
# and high pairs as in the paper's interdependence of fingers; values unsourced, within its 0.1 to
# 0.3.
ENSLAVING = np.array((
    (1., .10, .04, .02, 0.),
    (.08, 1., .22, .06, 0.),
    (.03, .20, 1., .25, 0.),
    (.02, .06, .28, 1., 0.),
    (.02, .01, .01, .01, 1.)))
THUMB_CMC_SHARE = .6  # [1] of an MCP's flexion: the thumb's CMC has a smaller range (Table 1)


class Strokes(NamedTuple):
    """Finger strokes: short minimum-jerk movements out of a posture and back.

    Attributes
    ----------
    start, rise, stay, fall : ndarray, shape (s,)
        Start times, ascending, and durations of each phase [s].
    change : ndarray, shape (s, 25)
        Change of the joint angles at the peak of each stroke [rad].
    """

    start: np.ndarray
    rise: np.ndarray
    stay: np.ndarray
    fall: np.ndarray
    change: np.ndarray

    @classmethod
    def none(cls) -> 'Strokes':
        """Return an empty set of strokes."""
        none = np.empty(0)
        return cls(none, none, none, none, np.empty((0, len(JOINTS))))

    def sample(self, times: np.ndarray) -> np.ndarray:
        """Return the angles added at times (n,) [s], shape (n, 25) [rad]."""
        added = np.zeros((len(times), len(JOINTS)))
        if not len(times) or not len(self.start):
            return added
        # Only strokes that overlap these times: long recordings are sampled in short blocks.
        longest = (self.rise + self.stay + self.fall).max()
        first, last = np.searchsorted(self.start, (times.min() - longest, times.max()))
        for start, rise, stay, fall, change in zip(*(part[first:last] for part in self)):
            since = times - start
            now = np.flatnonzero((since > 0.) & (since < rise + stay + fall))
            up = minimum_jerk(np.clip(since[now] / rise, 0., 1.))
            down = minimum_jerk(np.clip((since[now] - rise - stay) / fall, 0., 1.))
            added[now] += (up - down)[:, None] * change
        return added


class Tremor(NamedTuple):
    """Joint tremor: a sum of sines at each joint.

    Attributes
    ----------
    frequency : ndarray, shape (h,)
        [Hz]
    amplitude, phase : ndarray, shape (h, 25)
        [rad]
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray

    @classmethod
    def none(cls) -> 'Tremor':
        """Return a tremor of no components."""
        none = np.empty((0, len(JOINTS)))
        return cls(np.empty(0), none, none)

    def sample(self, times: np.ndarray) -> np.ndarray:
        """Return the angles added at times (n,) [s], shape (n, 25) [rad]."""
        added = np.zeros((len(times), len(JOINTS)))
        for frequency, amplitude, phase in zip(*self):
            added += amplitude * np.sin(2. * np.pi * frequency * times[:, None] + phase)
        return added


@dataclass(frozen=True)
class LayeredMotion:
    """Motion through poses with added strokes and tremor.

    Parameters
    ----------
    base : Motion
    hand : Hand
        Its limits and coupling are enforced at every sample.
    strokes : Strokes, optional
    tremor : Tremor, optional
    """

    base: Motion
    hand: Hand
    strokes: Strokes = Strokes.none()
    tremor: Tremor = Tremor.none()

    @property
    def duration(self) -> float:
        """Duration of the base motion [s]."""
        return self.base.duration

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return joint angles and wrist pose at given times, as `Motion.sample`."""
        times = np.clip(times, 0., self.duration)
        angles, rotation, position = self.base.sample(times)
        angles = angles + self.strokes.sample(times) + self.tremor.sample(times)
        lower, upper = self.hand.limits.T
        angles = np.clip(angles, lower, upper)
        slope, offset = self.hand.coupling.T
        angles[:, COUPLING_JOINTS + 1] = slope * angles[:, COUPLING_JOINTS] + offset
        return np.clip(angles, lower, upper), rotation, position


def finger_stroke(digit: int, mcp: float, pip: float) -> np.ndarray:
    """Return the change of joint angles at the peak of a digit's stroke, with enslaved digits.

    Parameters
    ----------
    digit : int
        0 to 4, index finger to thumb.
    mcp, pip : float
        Flexion of MCP and PIP; in the thumb of the CMC, scaled down, and of the MCP [rad].

    Returns
    -------
    ndarray, shape (25,)
        [rad]
    """
    change = np.zeros(len(JOINTS))
    share = ENSLAVING[digit]
    change[[JOINTS.index(f'{finger}_mcp_flexion') for finger in FINGERS]] = share[:4] * mcp
    change[[JOINTS.index(f'{finger}_pip_flexion') for finger in FINGERS]] = share[:4] * pip
    thumb = share[DIGITS.index('thumb')]
    change[JOINTS.index('thumb_cmc_flexion')] = THUMB_CMC_SHARE * thumb * mcp
    change[JOINTS.index('thumb_mcp_flexion')] = thumb * pip
    return change
