"""Coverage: range of motion of each joint in a take, and the movements still needed."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..core.model.hand import ABDUCTION_JOINTS, DIGITS, FINGERS, FLEXION_JOINTS

# Range of a joint that a calibration asks for [degrees]; ours. Of the first and second flexion of
# each digit, index finger to thumb: a thumb's have 40 and 35 degrees in Table 1.
WANTED_FLEXION = (*((50., 50.),) * len(FINGERS), (30., 18.))
# Of the abduction of each digit, index finger to thumb: the live calibration asks for 16 between
# index and little finger, of which each has a share as in a spread of simulated hands; the middle
# finger, from which the others spread, hardly turns.
WANTED_ABDUCTION = (6., 1., 4., 10., 20.)
MOTION_ENDS = (1., 99.)  # percentiles of the angles
TASKS = {
    ('finger', 'turn'): 'spread the fingers and close them again, straight',
    ('finger', 'first'): 'bend the {digit} finger in its knuckle and straighten it, alone',
    ('finger', 'second'): 'bend the {digit} finger in its middle joint and straighten it, alone',
    ('thumb', 'turn'): 'circle with the thumb',
    ('thumb', 'first'): 'bring the thumb to the tip of each finger in turn',
    ('thumb', 'second'): 'bend the thumb and straighten it',
}


class Covered(NamedTuple):
    """Range of a joint in a take.

    Attributes
    ----------
    digit : str
    joint : {'turn', 'first', 'second'}
        Abduction, and the first and second flexion.
    degrees, wanted : float
        Range that was seen, and that a calibration asks for [degrees].
    task : str
        Movement to widen it.
    """

    digit: str
    joint: str
    degrees: float
    wanted: float
    task: str

    @property
    def share(self) -> float:
        """Share of the range asked for, at most 1."""
        return min(1., self.degrees / self.wanted)


def coverage(angles: np.ndarray) -> list[Covered]:
    """Return the range of motion of each digit's joints.

    Parameters
    ----------
    angles : ndarray, shape (n, 25)
        Postures of a take [rad].

    Returns
    -------
    list of Covered
        Three for each digit, index finger to thumb.
    """
    if not len(angles):
        return []
    low, high = np.degrees(np.percentile(angles, MOTION_ENDS, axis=0))
    found = []
    for row, digit in enumerate(DIGITS):
        rows = (ABDUCTION_JOINTS[row], *FLEXION_JOINTS[row, :2])
        for joint, kind, wanted in zip(rows, ('turn', 'first', 'second'), (
                WANTED_ABDUCTION[row], *WANTED_FLEXION[row])):
            seen = float(high[joint] - low[joint])
            task = TASKS[_of_kind(digit), kind].format(digit=digit)
            found.append(Covered(digit, kind, seen, wanted, task))
    return found


def missing_movements(covered: Iterable[Covered]) -> list[str]:
    """Return the movements that would show what is not covered, each for all its digits."""
    digits: dict[tuple[str, str], list[str]] = {}
    for one in covered:
        if one.share < 1.:
            digits.setdefault((_of_kind(one.digit), one.joint), []).append(one.digit)
    return [TASKS[task].format(digit=', '.join(of_task)) for task, of_task in digits.items()]


def _of_kind(digit: str) -> str:
    return 'thumb' if digit == 'thumb' else 'finger'
