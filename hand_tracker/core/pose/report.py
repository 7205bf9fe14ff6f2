"""What a frame tells: the pose, where its markers are, and how sure all that is."""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import DIGIT_OF_JOINT
from ..model.kinematics import place_links
from ..model.states import ABSENT, PREDICTED, REJECTED, SEEN, STALE
from ..numerics.jit import jit
from ..numerics.vectors import add, clamp, distance, frame, rotate, vector

UNSURE = .01  # [m] standard deviation of a marker at which confidence is a third
ASTRAY = .2    # [rad] that an angle is off its solution at which it is a third: UNSURE on a digit


class Report(NamedTuple):
    """A frame's outcome as arrays; see `HandState`.

    Attributes
    ----------
    palm : ndarray of int, shape (1,)
        `PalmState`.
    angles : ndarray, shape (25,)
    wrist_rotation, wrist_position : ndarray, shape (3, 3) and (3,)
    link_rotations, link_positions : ndarray, shape (25, 3, 3) and (25, 3)
    markers : ndarray, shape (8, 3)
    marker_states : ndarray of int, shape (8,)
    hidden_for : ndarray, shape (8,)
    confidence : ndarray, shape (25,)
    residuals : ndarray, shape (8,)
    iterations : ndarray of int, shape (1,)
    """

    palm: np.ndarray
    angles: np.ndarray
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    link_rotations: np.ndarray
    link_positions: np.ndarray
    markers: np.ndarray
    marker_states: np.ndarray
    hidden_for: np.ndarray
    confidence: np.ndarray
    residuals: np.ndarray
    iterations: np.ndarray


def blank_report():
    """Return a `Report` to be written to."""
    return Report(np.zeros(1, dtype=np.int64), np.zeros(25), np.zeros((3, 3)), np.zeros(3),
                  np.zeros((25, 3, 3)), np.zeros((25, 3)), np.zeros((8, 3)),
                  np.zeros(8, dtype=np.int64), np.zeros(8), np.zeros(25), np.zeros(8),
                  np.zeros(1, dtype=np.int64))


@jit
def deviation(covariance):
    """Return the standard deviation of a marker on an axis [m], by its track's covariance."""
    return math.sqrt((covariance[0, 0] + covariance[1, 1] + covariance[2, 2]) / 3.)


@jit
def tell_pose(table, angles, lower, upper, rotation, position, mirror, report):
    """Write the angles within their limits, the wrist, and the links by forward kinematics.

    Parameters
    ----------
    table : JointTable
        Of the hand's own side.
    angles, lower, upper : ndarray, shape (25,)
        [rad]
    rotation, position : ndarray, shape (3, 3) and (3,)
        The wrist of a right hand [m].
    mirror : ndarray, shape (3,)
        -1 on the axes that a left hand has mirrored.
    report : Report
        Changed.
    """
    for joint in range(len(angles)):
        report.angles[joint] = clamp(angles[joint], lower[joint], upper[joint])
    for i in range(3):
        report.wrist_position[i] = mirror[i] * position[i]
        for k in range(3):
            report.wrist_rotation[i, k] = mirror[i] * mirror[k] * rotation[i, k]
    place_links(table.parent, table.rotation, table.translation, table.axis,
                report.angles.reshape((1, 25)), report.wrist_rotation.reshape((1, 3, 3)),
                report.wrist_position.reshape((1, 3)),
                report.link_rotations.reshape((1, 25, 3, 3)),
                report.link_positions.reshape((1, 25, 3)))


@jit
def tell_markers(markers, seen, verdict, palm, digits, mounting, rotation, position, mirror,
                 longest, report):
    """Write where the markers are, what is known of them, and how far the pose is from them.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        Of a right hand, as are the tracks [m].
    seen : ndarray of bool, shape (8,)
    verdict : ndarray of int, shape (8,)
        Of `identify`.
    palm, digits : Tracks
    mounting : Mounting
        Of the hand's own side.
    rotation, position : ndarray, shape (3, 3) and (3,)
        The wrist of a right hand [m].
    mirror : ndarray, shape (3,)
        As for `tell_pose`, which has written the pose.
    longest : float
        Time for which a prediction holds [s].
    report : Report
        Changed.
    """
    axes, origin = frame(rotation), vector(position)
    for i in range(8):
        if i < 3:
            place = vector(palm.mean[i])
            known, hidden_for = palm.known[i], palm.hidden_for[i]
        else:
            place = add(rotate(axes, vector(digits.mean[i - 3])), origin)
            known, hidden_for = digits.known[i - 3], digits.hidden_for[i - 3]
        if seen[i]:
            place = vector(markers[i])
            state = SEEN
        elif not known:
            state = ABSENT
        else:
            state = STALE if hidden_for > longest else PREDICTED
        # What was put right may still be none of this palm.
        judged = verdict[i] == REJECTED or verdict[i] > 0 and seen[i]
        report.marker_states[i] = verdict[i] if judged else state
        report.hidden_for[i] = hidden_for
        for k in range(3):
            report.markers[i, k] = mirror[k] * place[k]
        report.residuals[i] = distance(
            _place(mounting, i, report), vector(report.markers[i])) if seen[i] else math.nan


@jit
def _place(mounting, marker, report):
    """Return where the pose has a marker [m]."""
    link = mounting.link[marker]
    if link < 0:
        axes, origin = frame(report.wrist_rotation), vector(report.wrist_position)
    else:
        axes, origin = frame(report.link_rotations[link]), vector(report.link_positions[link])
    return add(origin, rotate(axes, vector(mounting.position[marker])))


@jit
def tell_confidence(palm, digits, offset, placed, report):
    """Write how sure the angles are: by the spread of markers, and what is still to be corrected.

    Parameters
    ----------
    palm, digits : Tracks
    offset : ndarray, shape (25,)
        Of the angles from those solved [rad].
    placed : bool
        Whether the palm was seen yet.
    report : Report
        Changed.
    """
    of_palm = 0.
    for i in range(3):
        of_palm = max(of_palm, deviation(palm.covariance[i]))
    for joint in range(len(report.confidence)):
        digit = DIGIT_OF_JOINT[joint]
        variance = deviation(digits.covariance[digit]) ** 2 + of_palm ** 2
        # Where a digit is hidden, what is solved is no truth to be off.
        astray = offset[joint] if digits.seen[digit] else 0.
        known = placed and digits.known[digit]
        report.confidence[joint] = math.exp(
            -variance / UNSURE ** 2 - (astray / ASTRAY) ** 2) if known else 0.
