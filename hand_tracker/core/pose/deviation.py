"""Standard deviation of each published angle.

A marker shows those angles of its digit that move it: the direction of the digit's plane
of abduction, its direction in the plane of the first flexion, its distance from the first joint,
the reach, of the second. Of a straight digit the reach changes by the square of the second flexion
alone; there natural flexion bounds it. The last joint follows its coupling. Besides noise, the
error of the hand's model counts, by far the most of both: bones, joints and the marker's place.
It is at least the marker's own distance from the hand: one that is far off refutes the pose, also
for a while afterwards.

Without a marker an angle's deviation is a share of the range between its limits, and that of a
hidden digit grows to it. Unlike the variance of `angle_filter`, which is chosen for quiet angles,
this one is meant to hold: about two thirds of the errors lie within it (`hand_tracker evaluate
deviations`). `report` writes it. Ours; no source.
"""

import math

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS
from ..numerics.jit import jit

LIMITS_SHARE = 1. / 6.     # [1] prior deviation of an angle, as a share of its range
HIDDEN_TIME = 1.2          # [s] in which a hidden digit's variance comes within 1/e² of the prior
# Error of the hand's model at a marker whose motion on the skin is unknown, along its digit [m].
MODEL_DEVIATION = .0018
ACROSS_DIGIT = 1.5         # [1] the same across the digit, relative to it
SHARED_ERROR = 1.8         # [1] factor for several markers of a digit: their errors correlate
REFUTING_MISFIT = .02      # [m] of a marker from the hand, at which it tells nothing of its digit
MOST_MISFIT = .04          # [m] of one marker that counts against the others
SADDLE_DEVIATION = .045    # [rad] of the thumb's abduction, by the axes of its saddle joint
LEAST_LEVER = 1e-3         # [m] distance from the axis below which a marker counts as on it
# Abduction, first and second flexion of each digit, (15,): what its marker shows.
SHOWN_JOINTS = np.concatenate((ABDUCTION_JOINTS, FLEXION_JOINTS[:, :2].ravel()))


def unknown_deviation(limits: np.ndarray) -> np.ndarray:
    """Return the prior standard deviation of angles, without any marker, shape (25,) [rad].

    Parameters
    ----------
    limits : ndarray, shape (25, 2)
        [rad]
    """
    return LIMITS_SHARE * np.ptp(limits, axis=1)


@jit
def mean_confidence(deviations: np.ndarray, rows: np.ndarray, unknown: np.ndarray) -> float:
    """Return the confidence in the hand's angles: 1 if exact, 0 at the prior, without any marker.

    The mean of 1 - (deviation / prior deviation)² over the angles that markers show.

    Parameters
    ----------
    deviations : ndarray
        Standard deviations of the angles, among others [rad].
    rows : ndarray of int, shape (25,)
        Where the hand's are among them.
    unknown : ndarray
        Prior deviations, by `unknown_deviation` of the publisher, in the order of `deviations`
        [rad]. An angle whose prior is no positive number has confidence 0; one where both are 0 is
        locked, and does not count.

    Returns
    -------
    float
    """
    total, count = 0., 0
    for joint in SHOWN_JOINTS:
        found, most = deviations[rows[joint]], unknown[rows[joint]]
        if found == 0. and most == 0.:
            continue
        count += 1
        if 0. <= found < most < math.inf:
            total += 1. - (found / most) ** 2
    return total / count if count else 1.
