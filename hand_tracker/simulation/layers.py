"""Motion in layers: a movement through poses, strokes of single fingers on it, and tremor.

What a layer adds is added to the free joints; DIP and thumb IP follow them as ever.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS, FINGERS, JOINTS, Hand
from .motion import Motion, minimum_jerk
from .poses import LEADERS

# [1] of a finger's movement that each digit goes along with: the low and high pairs of the
# paper's interdependence of fingers; the numbers are ours, unsourced, within its 0.1 to 0.3.
ENSLAVING = np.array((
    (1., .10, .04, .02, 0.),
    (.08, 1., .22, .06, 0.),
    (.03, .20, 1., .25, 0.),
    (.02, .06, .28, 1., 0.),
    (.02, .01, .01, .01, 1.)))
THUMB_CMC_SHARE = .6  # [1] of a finger's MCP: the thumb's saddle has less room (Table 1)


class Strokes(NamedTuple):
    """Short movements out of the posture and back: each rises, stays and falls.

    Attributes
    ----------
    start, rise, stay, fall : ndarray, shape (s,)
        Starts ascend [s].
    change : ndarray, shape (s, 25)
        At the height of each stroke [rad].
    """

    start: np.ndarray
    rise: np.ndarray
    stay: np.ndarray
    fall: np.ndarray
    change: np.ndarray

    @classmethod
    def none(cls):
        """Return no strokes."""
        return cls(*np.empty((4, 0)), np.empty((0, len(JOINTS))))

    def sample(self, times):
        """Return what the strokes add at given times, shape (n, 25) [rad]."""
        added = np.zeros((len(times), len(JOINTS)))
        if not len(times) or not len(self.start):
            return added
        # Only strokes that the times overlap: long recordings are made in many short parts.
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
    """Sums of sines in the joints.

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
    def none(cls):
        """Return no tremor."""
        return cls(np.empty(0), *np.empty((2, 0, len(JOINTS))))

    def sample(self, times):
        """Return what the tremor adds at given times, shape (n, 25) [rad]."""
        added = np.zeros((len(times), len(JOINTS)))
        for frequency, amplitude, phase in zip(*self):
            added += amplitude * np.sin(2. * np.pi * frequency * times[:, None] + phase)
        return added


@dataclass(frozen=True)
class LayeredMotion:
    """A motion through poses with strokes and tremor on it.

    Parameters
    ----------
    base : Motion
    hand : Hand
        Its limits and its coupling hold at every sample.
    strokes : Strokes, optional
    tremor : Tremor, optional
    """

    base: Motion
    hand: Hand
    strokes: Strokes = Strokes.none()
    tremor: Tremor = Tremor.none()

    @property
    def duration(self):
        """Return the duration of the motion through poses [s]."""
        return self.base.duration

    def sample(self, times):
        """Return the motion at given times; parameters and returns as for `Motion.sample`."""
        times = np.clip(np.asarray(times, dtype=float), 0., self.duration)
        angles, rotation, position = self.base.sample(times)
        angles = angles + self.strokes.sample(times) + self.tremor.sample(times)
        lower, upper = self.hand.limits.T
        angles = np.clip(angles, lower, upper)
        slope, offset = self.hand.coupling.T
        angles[:, LEADERS + 1] = slope * angles[:, LEADERS] + offset
        return np.clip(angles, lower, upper), rotation, position


def finger_stroke(digit, mcp, pip):
    """Return what one digit's stroke changes, its neighbours going along.

    Parameters
    ----------
    digit : int
        0 to 4, index finger to thumb.
    mcp, pip : float
        Of the MCP (the thumb's CMC, less) and of the PIP (the thumb's MCP) [rad].

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
