"""Standard deviation of each published angle.

A marker tells of its digit's angles by how it moves with them: the direction of the digit's plane
of abduction, its direction in the plane of the first flexion, its distance from the first joint,
the reach, of the second. Of a straight digit the reach changes by the square of the second flexion
alone; there natural flexion bounds it. The last joint follows its coupling. Besides noise, the
error of the hand's model counts, by far the most of both: bones, joints and the marker's place.

Without a marker an angle's deviation is a share of the range between its limits, and that of a
hidden digit grows to it. Unlike the variance of `angle_filter`, which is chosen for quiet angles,
this one is meant to hold: about two thirds of the errors lie within it (`hand_tracker evaluate
deviations`). Ours; no source.
"""

import math

import numpy as np

from ..filtering.tracks import Tracks, position_deviation
from ..inverse_kinematics.digit import THUMB, Chains
from ..inverse_kinematics.digit_angles import MEASURED_SPREAD
from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS
from ..model.marker_layout import MARKERS, PALM_MARKERS, Mounting
from ..numerics.jit import jit
from ..numerics.vectors import (
    Vector,
    add,
    cross,
    dot,
    frame,
    length,
    rotate,
    scale,
    subtract,
    vector,
)
from .report import Report

LIMITS_SHARE = 1. / 6.     # [1] of the range of an angle that nothing shows
HIDDEN_TIME = 1.2          # [s] in which a hidden digit's variance comes within 1/e² of that
# Error of the hand's model at a marker whose motion on the skin is unknown, along its digit [m].
MODEL_DEVIATION = .0018
ACROSS_DIGIT = 1.5         # [1] the same across the digit, relative to it
SHARED_ERROR = 1.8         # [1] by how much more several markers of a digit err, as they err alike
SADDLE_DEVIATION = .045    # [rad] of the thumb's abduction, by the axes of its saddle joint
LEAST_LEVER = 1e-3         # [m] below which a marker is taken for one on the axis
# Abduction, first and second flexion of each digit, (15,): what its marker shows.
SHOWN_JOINTS = np.concatenate((ABDUCTION_JOINTS, FLEXION_JOINTS[:, :2].ravel()))


def unknown_deviation(limits: np.ndarray) -> np.ndarray:
    """Return the standard deviation of angles that nothing shows, shape (25,) [rad].

    Parameters
    ----------
    limits : ndarray, shape (25, 2)
        [rad]
    """
    return LIMITS_SHARE * np.ptp(limits, axis=1)


@jit
def mean_confidence(deviations: np.ndarray, rows: np.ndarray, unknown: np.ndarray) -> float:
    """Return how much is known of the hand: 1 exact, 0 as much as where no marker is seen.

    The mean over the angles that markers show of 1 - (deviation / deviation of the unknown)².

    Parameters
    ----------
    deviations : ndarray
        Standard deviations of the angles, among others [rad].
    rows : ndarray of int, shape (25,)
        Where the hand's are among them.
    unknown : ndarray, shape (25,)
        By `unknown_deviation` [rad].

    Returns
    -------
    float
    """
    total, count = 0., 0
    for joint in SHOWN_JOINTS:
        if unknown[joint] > 0.:
            share = deviations[rows[joint]] / unknown[joint]
            total += max(0., 1. - share * share)
            count += 1
    return total / count if count else 1.


@jit
def write_deviation(chains: Chains, mounting: Mounting, palm: Tracks, digits: Tracks,
                    several: np.ndarray, offset: np.ndarray, placed: bool,
                    report: Report) -> None:
    """Write the standard deviation of each angle.

    Parameters
    ----------
    chains : Chains
    mounting : Mounting
        Of the principal markers, on the hand's own side.
    palm, digits : Tracks
    several : ndarray, shape (25,)
        Deviation of the angles that several markers show, else 0 [rad].
    offset : ndarray, shape (25,)
        Of the blended angles from the estimated ones [rad].
    placed : bool
        Whether the palm has been seen.
    report : Report
        Its pose is written already; changed.
    """
    for joint in range(len(report.deviation)):
        report.deviation[joint] = LIMITS_SHARE * (chains.upper[joint] - chains.lower[joint])
    if not placed:
        return
    palm_spread = 0.
    for i in range(len(PALM_MARKERS)):
        palm_spread = max(palm_spread, position_deviation(palm.covariance[i]))
    for digit in range(len(MARKERS) - len(PALM_MARKERS)):
        if not digits.known[digit]:
            continue
        noise = palm_spread * palm_spread
        if digits.seen[digit]:
            noise += position_deviation(digits.covariance[digit]) ** 2
        _write_digit(chains, digit, _place(mounting, digit, report), noise,
                     digits.hidden_for[digit], report)
        if not digits.seen[digit]:
            continue
        for joint in range(5 * digit, 5 * digit + 5):
            if several[joint] > 0.:
                unknown = LIMITS_SHARE * (chains.upper[joint] - chains.lower[joint])
                shown = SHARED_ERROR * several[joint]
                report.deviation[joint] = _within(shown * shown, unknown, 0.)
            # An angle that still goes back to its marker is off by as much as it has to go.
            if offset[joint] != 0.:
                report.deviation[joint] = math.hypot(report.deviation[joint], offset[joint])


@jit
def _place(mounting: Mounting, digit: int, report: Report) -> Vector:
    """Return the place of a digit's marker on the reported pose [m]."""
    marker = len(PALM_MARKERS) + digit
    link = mounting.link[marker]
    return add(vector(report.link_positions[link]), rotate(
        frame(report.link_rotations[link]), vector(mounting.position[marker])))


@jit
def _write_digit(chains: Chains, digit: int, place: Vector, noise: float, hidden_for: float,
                 report: Report) -> None:
    """Write the deviations of a digit's angles by its one marker.

    Parameters
    ----------
    chains : Chains
    digit : int
    place : Vector
        The marker's, on the reported pose [m].
    noise : float
        Variance of the marker against the palm, on an axis [m²].
    hidden_for : float
        Time since the marker was seen [s].
    report : Report
        Changed.
    """
    abduction = ABDUCTION_JOINTS[digit]
    first, second, third = FLEXION_JOINTS[digit]
    skin = chains.skin[digit]
    model = skin if skin > 0. else MODEL_DEVIATION
    along = noise + model * model
    across = noise + (ACROSS_DIGIT * model) ** 2
    # How the marker moves with each angle [m/rad].
    bone = subtract(vector(report.link_positions[second]), vector(report.link_positions[first]))
    beyond = subtract(place, vector(report.link_positions[second]))
    reach = add(bone, beyond)
    by_abduction = cross(_axis(report, abduction, 2), reach)
    by_first = cross(_axis(report, first, 1), reach)
    by_second = cross(_axis(report, second, 1), beyond)
    slope = chains.coupling[digit, 0]
    if chains.hinges[digit] == 3:
        last = subtract(place, vector(report.link_positions[third]))
        by_second = add(by_second, scale(cross(_axis(report, third, 1), last), slope))

    far = max(length(reach), LEAST_LEVER)
    change = dot(by_second, reach) / far
    # Of a straight digit the reach falls by half of this times the square of the angle.
    curvature = max(dot(bone, beyond), 0.) / far
    information = change * change / along + .5 * curvature / math.sqrt(along)
    natural = chains.natural[digit, 2] ** 2
    second_variance = natural / (information * natural + 1.)
    lever = max(dot(by_first, by_first), LEAST_LEVER * LEAST_LEVER)
    # As the second flexion errs, the first aims the marker back.
    lean = dot(by_second, by_first) / lever
    first_variance = along / lever + lean * lean * second_variance
    lever = max(dot(by_abduction, by_abduction), LEAST_LEVER * LEAST_LEVER)
    turn_variance = across / lever
    if digit == THUMB:
        turn_variance += SADDLE_DEVIATION * SADDLE_DEVIATION

    lost = 1. - math.exp(-2. * hidden_for / HIDDEN_TIME) if hidden_for > 0. else 0.
    report.deviation[abduction] = _within(turn_variance, report.deviation[abduction], lost)
    report.deviation[first] = _within(first_variance, report.deviation[first], lost)
    report.deviation[second] = _within(second_variance, report.deviation[second], lost)
    coupled = slope * report.deviation[second]
    spread = MEASURED_SPREAD if chains.measured[digit] else chains.coupling_spread[digit]
    report.deviation[third] = _within(
        coupled * coupled + spread * spread, report.deviation[third], 0.)


@jit
def _within(variance: float, unknown: float, lost: float) -> float:
    """Return the deviation of an angle by its marker and its limits [rad].

    Parameters
    ----------
    variance : float
        By the marker [rad²].
    unknown : float
        Deviation of the angle if nothing shows it [rad].
    lost : float
        Share of what the marker told that is lost since it was seen [1].
    """
    prior = unknown * unknown
    known = variance * prior / (variance + prior)
    return math.sqrt(known + lost * (prior - known))


@jit
def _axis(report: Report, link: int, column: int) -> Vector:
    """Return an axis of a link's frame."""
    rotation = report.link_rotations[link]
    return rotation[0, column], rotation[1, column], rotation[2, column]
