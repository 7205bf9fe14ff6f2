"""The frame's report: angles and pose, positions and states of the markers, deviations."""

import math
from typing import NamedTuple

import numpy as np

from ..filtering.tracks import Tracks, position_deviation
from ..inverse_kinematics.digit import THUMB, Chains
from ..inverse_kinematics.skin_shift import expected_shift
from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS
from ..model.kinematics import JointTable, place_links
from ..model.marker_layout import MARKERS, MarkerLayout, Mounting
from ..model.marker_rows import LAYOUT_CAPACITY, PRINCIPALS, MarkerRows, RowState
from ..model.palm_triangle import Wrist
from ..model.states import ABSENT, PREDICTED, REJECTED, SEEN, STALE, SWAPPED
from ..numerics.jit import jit
from ..numerics.vectors import (
    Vector,
    add,
    clamp,
    column,
    cross,
    deviation_within,
    distance,
    dot,
    frame,
    length,
    rotate,
    rotate_about_y,
    scale,
    subtract,
    vector,
)
from .deviation import (
    ACROSS_DIGIT,
    HIDDEN_TIME,
    LEAST_LEVER,
    LIMITS_SHARE,
    MODEL_DEVIATION,
    MOST_MISFIT,
    REFUTING_MISFIT,
    SADDLE_DEVIATION,
    SHARED_ERROR,
)

# First link of each digit that hangs on the joint of its chain's root: MCP, the thumb's CMC.
FIRST_LINKS = np.array((1, 6, 11, 16, 20))
LISTED_TIME, LISTED_RESIDUAL, LISTED_COLUMNS = 3, 4, 5  # behind the position


def listed_count(layout: MarkerLayout) -> int:
    """Return the number of markers that a report lists: 0 for the paper's eight, else all."""
    return 0 if layout.names == MARKERS else len(layout.names)


class Report(NamedTuple):
    """The fields of `HandState` as arrays that kernels fill.

    Attributes
    ----------
    palm : ndarray of int, shape (1,)
        `PalmState`.
    angles : ndarray, shape (25,)
        [rad]
    wrist_rotation, wrist_position : ndarray, shape (3, 3) and (3,)
        [m]
    link_rotations, link_positions : ndarray, shape (25, 3, 3) and (25, 3)
        [m]
    markers : ndarray, shape (8, 3)
        [m]
    marker_states : ndarray of int, shape (8,)
        `MarkerState`.
    hidden_for : ndarray, shape (8,)
        [s]
    deviation : ndarray, shape (25,)
        Standard deviation of the angles [rad].
    residuals : ndarray, shape (8,)
        [m]
    iterations : ndarray of int, shape (1,)
    listed : ndarray, shape (60, 5)
        Markers of another layout than the paper's eight, in its order: position [m], time
        hidden [s] and residual [m].
    listed_states : ndarray of int, shape (60,)
        Their `MarkerState`.
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
    deviation: np.ndarray
    residuals: np.ndarray
    iterations: np.ndarray
    listed: np.ndarray
    listed_states: np.ndarray


def blank_report() -> Report:
    """Return a `Report` of zeros."""
    return Report(np.zeros(1, dtype=np.int64), np.zeros(25), np.zeros((3, 3)), np.zeros(3),
                  np.zeros((25, 3, 3)), np.zeros((25, 3)), np.zeros((8, 3)),
                  np.zeros(8, dtype=np.int64), np.zeros(8), np.zeros(25), np.zeros(8),
                  np.zeros(1, dtype=np.int64), np.zeros((LAYOUT_CAPACITY, LISTED_COLUMNS)),
                  np.zeros(LAYOUT_CAPACITY, dtype=np.int64))


@jit
def mean_residual(residuals: np.ndarray) -> float:
    """Return the mean distance of the seen markers from the hand [m]; NaN where none is seen.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        NaN for markers that are not seen [m].
    """
    total, count = 0., 0
    for residual in residuals:
        if residual >= 0.:
            total += residual
            count += 1
    return total / count if count else math.nan


@jit
def hang_digits(roots: np.ndarray, hand_roots: np.ndarray, mirror: np.ndarray,
                report: Report) -> None:
    """Shift the links of each digit to its first joint as the paper's spheres found it.

    Parameters
    ----------
    roots, hand_roots : ndarray, shape (5, 3)
        First joints as found and on the hand, in the frame of a right hand's wrist [m].
    mirror : ndarray, shape (3,)
        As for `write_pose`.
    report : Report
        With the pose; changed.
    """
    axes = frame(report.wrist_rotation)
    for digit in range(5):
        shift = rotate(axes, (
            mirror[0] * (roots[digit, 0] - hand_roots[digit, 0]),
            mirror[1] * (roots[digit, 1] - hand_roots[digit, 1]),
            mirror[2] * (roots[digit, 2] - hand_roots[digit, 2])))
        for link in range(FIRST_LINKS[digit], 5 * digit + 5):
            for k in range(3):
                report.link_positions[link, k] += shift[k]


@jit
def write_pose(table: JointTable, angles: np.ndarray, lower: np.ndarray, upper: np.ndarray,
               wrist: Wrist, mirror: np.ndarray, report: Report) -> None:
    """Write the angles within their limits, the wrist, and the links by forward kinematics.

    Parameters
    ----------
    table : JointTable
        Of the hand's own side.
    angles, lower, upper : ndarray, shape (25,)
        [rad]
    wrist : Wrist
        Of a right hand.
    mirror : ndarray, shape (3,)
        -1 on the axes that a left hand mirrors, else 1.
    report : Report
        Changed.
    """
    for joint in range(len(angles)):
        report.angles[joint] = clamp(angles[joint], lower[joint], upper[joint])
    for i in range(3):
        report.wrist_position[i] = mirror[i] * wrist.position[i]
        for k in range(3):
            report.wrist_rotation[i, k] = mirror[i] * mirror[k] * wrist.rotation[i, k]
    place_links(JointTable(table.parent[:], table.rotation[:], table.translation[:], table.axis[:]),
                report.angles[:], report.wrist_rotation[:], report.wrist_position[:],
                report.link_rotations[:], report.link_positions[:])


@jit
def write_markers(markers: np.ndarray, seen: np.ndarray, palm: Tracks, digits: Tracks, wrist: Wrist,
                  mirror: np.ndarray, report: Report) -> None:
    """Write the markers' positions, measured or predicted, and since when they are hidden.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        Of a right hand, as are the tracks and the wrist [m].
    seen : ndarray of bool, shape (8,)
    palm, digits : Tracks
    wrist : Wrist
    mirror : ndarray, shape (3,)
        As for `write_pose`.
    report : Report
        Changed.
    """
    axes, origin = frame(wrist.rotation), vector(wrist.position)
    for i in range(8):
        if seen[i]:
            place = vector(markers[i])
        elif i < 3:
            place = vector(palm.mean[i])
        else:
            place = add(rotate(axes, vector(digits.mean[i - 3])), origin)
        report.hidden_for[i] = palm.hidden_for[i] if i < 3 else digits.hidden_for[i - 3]
        for k in range(3):
            report.markers[i, k] = mirror[k] * place[k]


@jit
def write_marker_states(seen: np.ndarray, verdict: np.ndarray, palm: Tracks, digits: Tracks,
                        longest: float, report: Report) -> None:
    """Write the `MarkerState` of each marker.

    Parameters
    ----------
    seen : ndarray of bool, shape (8,)
    verdict : ndarray of int, shape (8,)
        Of `associate`.
    palm, digits : Tracks
    longest : float
        Time for which a prediction holds [s].
    report : Report
        Changed; its `hidden_for` is written already.
    """
    for i in range(8):
        if seen[i]:
            state = SEEN
        elif not (palm.known[i] if i < 3 else digits.known[i - 3]):
            state = ABSENT
        else:
            state = STALE if report.hidden_for[i] > longest else PREDICTED
        # A label put right does not count where the palm's check then hid the marker.
        judged = verdict[i] == REJECTED or verdict[i] > 0 and seen[i]
        report.marker_states[i] = verdict[i] if judged else state


@jit
def write_residuals(seen: np.ndarray, mounting: Mounting, report: Report) -> None:
    """Write the distance of each seen marker from its place on the reported pose [m].

    Parameters
    ----------
    seen : ndarray of bool, shape (8,)
    mounting : Mounting
        Of the hand's own side.
    report : Report
        Changed; its pose and markers are written already.
    """
    for i in range(8):
        if not seen[i]:
            report.residuals[i] = math.nan
            continue
        link = mounting.link[i]
        if link < 0:
            axes, origin = frame(report.wrist_rotation), vector(report.wrist_position)
        else:
            axes, origin = frame(report.link_rotations[link]), vector(report.link_positions[link])
        place = add(origin, rotate(axes, vector(mounting.position[i])))
        report.residuals[i] = distance(place, vector(report.markers[i]))


@jit
def write_rows(rows: MarkerRows, state: RowState, longest: float, mirror: np.ndarray,
               report: Report) -> None:
    """Write the markers of another layout than the paper's eight.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
    longest : float
        Time for which a prediction holds [s].
    mirror : ndarray, shape (3,)
        As for `write_pose`.
    report : Report
        Changed; its pose and principal markers are written already.
    """
    for row in range(rows.used[0]):
        measured = state.is_measured[row] > 0
        # A hidden marker is as far off its place on the hand as it was last.
        shift = (0., 0., 0.) if measured else expected_shift(rows, state, row)
        place = _place_of_row(rows, row, shift, mirror, report)
        x, y, z = state.points[row]
        if measured:
            place, miss = (mirror[0] * x, mirror[1] * y, mirror[2] * z), distance(
                (mirror[0] * x, mirror[1] * y, mirror[2] * z), place)
        else:
            miss = math.nan
        kind = SEEN if measured else ABSENT if not state.is_known[row] else (
            STALE if state.hidden_for[row] > longest else PREDICTED)
        if state.verdict[row] != SEEN:
            kind = state.verdict[row]
        if row < PRINCIPALS:
            if measured or report.marker_states[row] == SEEN:
                for k in range(3):
                    report.markers[row, k] = place[k]
            # A verdict of the association stands.
            if report.marker_states[row] not in (REJECTED, SWAPPED):
                report.marker_states[row] = kind
            kind = report.marker_states[row]
            # What the association has refused, or found under another label, is known only now.
            if kind != SEEN and kind != SWAPPED:
                miss = math.nan
            elif not measured:
                miss = distance(vector(report.markers[row]), place)
            report.hidden_for[row] = state.hidden_for[row]
            report.residuals[row] = miss
            place = vector(report.markers[row])
        if rows.order[row] >= 0:
            listed = report.listed[rows.order[row]]
            for k in range(3):
                listed[k] = place[k]
            listed[LISTED_TIME], listed[LISTED_RESIDUAL] = state.hidden_for[row], miss
            report.listed_states[rows.order[row]] = kind


@jit
def _place_of_row(rows: MarkerRows, row: int, shift: Vector, mirror: np.ndarray,
                  report: Report) -> Vector:
    """Return a marker's place on the reported pose, its offset turned with the skin [m].

    `shift` is how far it is off there, in the frame of its link on a right hand [m].
    """
    digit, link = rows.digit[row], rows.link[row]
    end, offset = vector(rows.end[row]), vector(rows.offset[row])
    at = 5 * digit + link if digit >= 0 else 5 * link
    if digit < 0 and link >= 0:
        end = subtract(end, vector(rows.cmc[link]))
    if rows.joint[row] >= 0:
        offset = rotate_about_y(
            offset, rows.share[row] * report.angles[5 * digit + rows.joint[row]])
    local = add(add(end, offset), shift)
    local = (mirror[0] * local[0], mirror[1] * local[1], mirror[2] * local[2])
    if digit < 0 and link < 0:
        axes, origin = frame(report.wrist_rotation), vector(report.wrist_position)
    else:
        axes, origin = frame(report.link_rotations[at]), vector(report.link_positions[at])
    return add(origin, rotate(axes, local))


@jit
def write_deviation(chains: Chains, mounting: Mounting, palm: Tracks, digits: Tracks,
                    several: np.ndarray, offset: np.ndarray, placed: bool,
                    report: Report) -> None:
    """Write the standard deviation of each angle, as in `deviation`.

    Parameters
    ----------
    chains : Chains
    mounting : Mounting
        Of the principal markers, on the hand's own side.
    palm, digits : Tracks
        Their misfits are changed.
    several : ndarray, shape (25,)
        Deviation of the angles that several markers show, else 0 [rad].
    offset : ndarray, shape (25,)
        Of the blended angles from the estimated ones [rad].
    placed : bool
        Whether the palm has been seen.
    report : Report
        Its pose and residuals are written already; changed.
    """
    found = report.deviation
    for joint in range(len(found)):
        found[joint] = LIMITS_SHARE * (chains.upper[joint] - chains.lower[joint])
    palm_spread = _palm_deviation(palm, placed, report.residuals)
    hand_misfit = 0.
    for digit in range(5):
        if not placed or not digits.known[digit]:
            continue
        joints = range(5 * digit, 5 * digit + 5)
        noise, lost, hidden_for = palm_spread * palm_spread, 0., digits.hidden_for[digit]
        if digits.seen[digit]:
            noise += position_deviation(digits.covariance[digit]) ** 2
        if hidden_for > 0.:
            lost = 1. - math.exp(-2. * hidden_for / HIDDEN_TIME)
        skin = chains.skin[digit]
        usual = skin if skin > 0. else MODEL_DEVIATION
        misfit = report.residuals[3 + digit]
        for joint in joints:
            # Of an angle that still goes back to its marker it is known how far.
            if offset[joint] != 0.:
                misfit = 0.
        if misfit > digits.misfit[digit]:
            digits.misfit[digit] = misfit
        misfit = digits.misfit[digit] * math.exp(-hidden_for / HIDDEN_TIME)
        # One marker alone, however far off, does not refute the others.
        hand_misfit += .2 * min(misfit, MOST_MISFIT)
        refuted = min(misfit / REFUTING_MISFIT, 1.) ** 2
        lost = max(lost, refuted)
        model = max(usual, misfit)
        turn_variance, first_variance, second_variance = _shown_variances(
            chains, mounting, digit, noise, model, report.link_rotations, report.link_positions)
        abduction = ABDUCTION_JOINTS[digit]
        first, second, third = FLEXION_JOINTS[digit]
        found[abduction] = deviation_within(turn_variance, found[abduction], lost)
        found[first] = deviation_within(first_variance, found[first], lost)
        found[second] = deviation_within(second_variance, found[second], lost)
        coupled = chains.coupling[digit, 0] * found[second]
        spread = chains.coupling_spread[digit]
        found[third] = deviation_within(coupled * coupled + spread * spread, found[third], 0.)

        if not digits.seen[digit]:
            continue
        for joint in joints:
            range_of_joint = chains.upper[joint] - chains.lower[joint]
            if several[joint] > 0.:
                shown = SHARED_ERROR * several[joint] * (model / usual)
                found[joint] = deviation_within(
                    shown * shown, LIMITS_SHARE * range_of_joint, refuted)
            # An angle that still goes back to its marker is off by as much as it has to go, within
            # limits that may be new.
            if offset[joint] != 0.:
                found[joint] = min(math.hypot(found[joint], offset[joint]), range_of_joint)
    # Where the whole hand is refuted, so is a digit that happens to meet its marker.
    refuted = min(hand_misfit / REFUTING_MISFIT, 1.) ** 2
    for joint in range(len(found)):
        unknown = LIMITS_SHARE * (chains.upper[joint] - chains.lower[joint])
        if found[joint] < unknown:
            found[joint] = math.sqrt(
                (1. - refuted) * found[joint] ** 2 + refuted * unknown ** 2)


@jit
def _palm_deviation(palm: Tracks, placed: bool, residuals: np.ndarray) -> float:
    """Update misfits; return the standard deviation of the worst of the palm's markers [m]."""
    deviation = 0.
    for i in range(3):
        # A hidden marker's residual is NaN: its last misfit counts, for a while.
        if placed and residuals[i] > palm.misfit[i]:
            palm.misfit[i] = residuals[i]
        deviation = max(deviation, position_deviation(palm.covariance[i]),
                        palm.misfit[i] * math.exp(-palm.hidden_for[i] / HIDDEN_TIME))
    return deviation


@jit
def _shown_variances(chains: Chains, mounting: Mounting, digit: int, noise: float, model: float,
                     rotations: np.ndarray, positions: np.ndarray) -> tuple[float, float, float]:
    """Return the variances of abduction, first and second flexion that a marker leaves [rad²].

    Parameters
    ----------
    chains : Chains
    mounting : Mounting
    digit : int
    noise : float
        Variance of the marker by noise [m²].
    model : float
        Standard deviation of the marker by the hand's model, along its digit [m].
    rotations : ndarray, shape (25, 3, 3)
        Of the links.
    positions : ndarray, shape (25, 3)
        Of the links' joints [m].
    """
    along = noise + model * model
    across = noise + (ACROSS_DIGIT * model) ** 2
    abduction = ABDUCTION_JOINTS[digit]
    first, second, third = FLEXION_JOINTS[digit]
    # The marker on the pose, and how it moves with each angle [m/rad].
    link = mounting.link[3 + digit]
    place = add(vector(positions[link]),
                rotate(frame(rotations[link]), vector(mounting.position[3 + digit])))
    bone = subtract(vector(positions[second]), vector(positions[first]))
    beyond = subtract(place, vector(positions[second]))
    reach = add(bone, beyond)
    by_abduction = cross(column(rotations[abduction], 2),
                         subtract(place, vector(positions[abduction])))
    by_first = cross(column(rotations[first], 1), reach)
    by_second = cross(column(rotations[second], 1), beyond)
    if chains.hinges[digit] == 3:
        last = subtract(place, vector(positions[third]))
        by_second = add(by_second, scale(cross(column(rotations[third], 1), last),
                                         chains.coupling[digit, 0]))

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
    return turn_variance, first_variance, second_variance
