"""Pose and arch of a palm with any number of markers: damped Gauss-Newton on both.

Markers on the knuckles ride on the metacarpals, which flex at the fingers' CMC joints as the palm
cups. A marker more than three makes that arch observable; how far the metacarpals usually flex,
and that the ring finger's goes along with the little's, decides where markers constrain
little. Ours.
"""

import math

import numpy as np

from ..model.hand import FLEXION_JOINTS
from ..model.marker_rows import ON_WRIST, MarkerRows, RowState
from ..model.palm_triangle import Wrist, rigid_palm
from ..numerics.cholesky import fix_unknown, solve_damped
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import (
    Frame,
    Vector,
    add,
    clamp,
    components,
    distance,
    dot,
    frame,
    length,
    rotate,
    rotate_about,
    rotate_about_y,
    scale,
    store,
    store_pose,
    subtract,
    triangle_normal,
    vector,
)
from .angle_average import AngleAverage, average_angles
from .digit import CHAIN_JOINTS
from .skin_shift import expected_shift, fade_skin_shifts, learn_shift_angle, learn_skin_shift

POSE_UNKNOWNS, UNKNOWNS = 6, 10       # turn and shift of the wrist; then the four CMC flexions
MOST_PALM_STEPS, LEAST_PALM_STEPS = 10, 3
PALM_DAMPING = 1e-9                   # [1]
PALM_STEP_SPREADS = (1., .3)          # [rad, m] of one step: what no marker constrains stays
SETTLED_PALM = 1e-11                  # [rad², m²] of the step after which there is none
PALM_OUTLIER = .015                   # [m] distance at which a marker's weight falls to a quarter
FIRST_PALM_OUTLIER = .04              # [m] in the second step; the first takes all markers alike
MOST_OUTLIERS = 2.                    # [1] such distances beyond which it is of no weight
LOST_PALM = .03                       # [m] of the markers from the last pose: begin anew
# Standard deviations of the CMC flexions from flat: index and middle, ring about its share of the
# little's, little [rad]. Flexion ranges over 11, 7, 20 and 27 degrees, El-shennawy et al. (2001),
# but those of index and middle hardly move by themselves: skin looks as if they did.
CMC_SPREADS = (.008, .008, .07, .35)
RING_SHARE = .5                       # [1] of the little finger's CMC flexion
RING_FLEXION, LITTLE_FLEXION = (int(joint) for joint in FLEXION_JOINTS[2:4, 0])
ARCH_DEVIATION = .03                  # [rad] of a CMC flexion, which moves its knuckle by 2 mm
LEAST_FREE = 4                        # markers of the palm that determine an arch
# [m] Palm markers that are no farther from a line leave the turn about it open: so are those on the
# skin of the knuckles, Kyutech's 6 to 7 mm off it; joint centres are 10 to 11. Ours.
COLLINEAR_WIDTH = .009
PALM_SCALES = .4, 2.5   # [1] of a distance of two palm markers on the hand; ours


@jit
def synergy(gains: np.ndarray, angles: np.ndarray, lower: np.ndarray, upper: np.ndarray,
            arch: np.ndarray) -> None:
    """Write the CMC flexions that usually go with the fingers' angles, within limits.

    Parameters
    ----------
    gains : ndarray, shape (4,)
        As `Hand.palm_synergy` [1].
    angles : ndarray, shape (25,)
        [rad]
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    arch : ndarray, shape (4,)
        The CMC flexions, replaced [rad].
    """
    flexion = max(.5 * (angles[RING_FLEXION] + angles[LITTLE_FLEXION]), 0.)
    for finger in range(4):
        arch[finger] = clamp(gains[finger] * flexion, lower[5 * finger], upper[5 * finger])


@jit
def _flat_place(rows: MarkerRows, row: int) -> Vector:
    """Return a palm marker's place with the palm flat, in the wrist's frame [m]."""
    return add(vector(rows.end[row]), vector(rows.offset[row]))


@jit
def flexed(place: Vector, center: Vector, flexion: float) -> Vector:
    """Return a place [m] turned about a CMC joint [m] by its flexion [rad], distal places down."""
    if flexion == 0.:
        return place
    return add(center, rotate_about_y(subtract(place, center), flexion))


@jit
def lay_targets_flat(rows: MarkerRows, state: RowState, angles: np.ndarray) -> None:
    """Lay the fingers' targets to where they are with the palm flat; write its CMC flexions.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Its `targets` are replaced.
    angles : ndarray, shape (25,)
        Changed [rad].
    """
    for finger in range(4):
        store(state.targets, finger, flexed(
            vector(state.targets[finger]), vector(rows.cmc[finger]), -state.arch[finger]))
        angles[5 * finger] = state.arch[finger]


@jit
def fit_principal_palm(rows: MarkerRows, state: RowState, average: AngleAverage,
                       lower: np.ndarray, upper: np.ndarray, angles: np.ndarray, wrist: Wrist,
                       fitted: Wrist, markers: np.ndarray, seen: np.ndarray, step: float) -> None:
    """Place the palm's three principal markers by a rigid fit of all its markers, arch removed.

    Markers that are no palm by their distances are left as measured, for the check to name it.
    Hidden principal markers count as seen, those nearest to the line of the measured ones first, up
    to the number of these; up to two where these are on it, so that the digits hold the palm. As
    one vanishes, the others keep their `skin_shift`.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Its `arch` is replaced, its skin shifts are updated.
    average : AngleAverage
        Of the CMC flexions, where they are fitted; updated.
    lower, upper : ndarray, shape (25,)
        Joint limits [rad].
    angles : ndarray, shape (25,)
        Of the last frame, which an arch follows that no marker shows [rad].
    wrist : Wrist
        Of the last frame.
    fitted : Wrist
        Replaced by the fit.
    markers : ndarray, shape (n, 3)
        The palm's principal ones, first, are replaced [m].
    seen : ndarray of bool, shape (n,)
        Changed.
    step : float
        Since the last frame [s].
    """
    several = rows.has_several[5] > 0
    if not (several or rows.is_cupping[0]) or _is_no_palm(rows, state):
        _interrupt_arch(average)
        return
    if rows.is_cupping[0] and not several:
        synergy(rows.synergy, angles, lower, upper, state.arch)
    store_pose(fitted.rotation, fitted.position, frame(wrist.rotation), vector(wrist.position))
    fitted.placed[0] = wrist.placed[0]
    fade_skin_shifts(rows, state, ON_WRIST, step)
    on_a_line = _are_on_a_line(rows, state)
    is_free = several and rows.is_cupping[0] > 0 and not on_a_line
    count = _solve_palm(rows, state, lower, upper, is_free, fitted)
    if is_free and count >= LEAST_FREE:
        _average_arch(state, average, step)
    else:
        _interrupt_arch(average)
    if count == 0:
        return
    if on_a_line:
        count = min(count, 2)
    elif state.learns_shift[ON_WRIST]:
        _learn_palm_shifts(rows, state, fitted, step)
    _count_as_seen(rows, state, count, seen)
    axes, origin = frame(fitted.rotation), vector(fitted.position)
    for i in range(3):
        store(markers, i, add(origin, rotate(axes, _flat_place(rows, i))))


@jit
def _interrupt_arch(average: AngleAverage) -> None:
    """Keep the average of the arch over a gap, in which its noise is not learned."""
    for finger in range(4):
        average.consecutive[5 * finger] = min(average.consecutive[5 * finger], 1)


@jit
def _average_arch(state: RowState, average: AngleAverage, step: float) -> None:
    """Average the fitted CMC flexions, each by itself."""
    solved = local_floats(CHAIN_JOINTS)
    factor = local_floats((CHAIN_JOINTS, CHAIN_JOINTS))
    factor[0, 0] = 1. / ARCH_DEVIATION
    for finger in range(4):
        solved[0] = state.arch[finger]
        average_angles(average, finger, (0, 1), solved, factor, step)
        state.arch[finger] = average.angles[5 * finger]


@jit
def _is_no_palm(rows: MarkerRows, state: RowState) -> bool:
    """Return whether no two of three measured palm markers are about as far apart as on the hand.

    Whatever their labels, and though some of them are outliers.
    """
    shown = 0
    for i in range(rows.used[0]):
        shown += 1 if _is_shown(rows, state, i) else 0
        for j in range(i):
            if _is_shown(rows, state, i) and _is_shown(rows, state, j):
                apart = distance(_flat_place(rows, i), _flat_place(rows, j))
                found = distance(vector(state.points[i]), vector(state.points[j]))
                if PALM_SCALES[0] * apart <= found <= PALM_SCALES[1] * apart:
                    return False
    return shown >= 3


@jit
def _count_as_seen(rows: MarkerRows, state: RowState, count: int, seen: np.ndarray) -> None:
    """Count principal palm markers as seen up to a number, those nearest to the others' line first.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
    count : int
    seen : ndarray of bool, shape (n,)
        Changed.
    """
    shown = 0
    for i in range(3):
        shown += 1 if seen[i] else 0
    if shown >= min(count, 3):
        return
    a, b = _line_ends(rows, state)
    for _ in range(min(count, 3) - shown):
        nearest, least = 0, math.inf
        for i in range(3):
            off = _off_line(rows, i, a, b)
            if not seen[i] and off < least:
                nearest, least = i, off
        seen[nearest] = True


@jit
def _are_on_a_line(rows: MarkerRows, state: RowState) -> bool:
    """Return whether a principal marker known to the palm is hidden, those measured on a line."""
    is_hidden = False
    for i in range(3):
        is_hidden |= state.is_known[i] and not state.is_measured[i]
    if not is_hidden:
        return False
    a, b = _line_ends(rows, state)
    for row in range(rows.used[0]):
        if _is_shown(rows, state, row) and _off_line(rows, row, a, b) > COLLINEAR_WIDTH:
            return False
    return True


@jit
def write_line(rows: MarkerRows, state: RowState, line: np.ndarray) -> None:
    """Write the two measured palm markers; zeros where others than two are measured.

    Three on a line would tell of the turn about it, little but their noise.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
    line : ndarray, shape (2, 3)
        Replaced [m].
    """
    shown = 0
    for row in range(rows.used[0]):
        if _is_shown(rows, state, row):
            if shown < 2:
                store(line, shown, vector(state.points[row]))
            shown += 1
    if shown != 2:
        line[:] = 0.


@jit
def _line_ends(rows: MarkerRows, state: RowState) -> tuple[int, int]:
    """Return the two measured palm markers that are farthest apart on the hand; one twice."""
    farthest, a, b = -1., 0, 0
    for i in range(rows.used[0]):
        for j in range(i + 1):
            if _is_shown(rows, state, i) and _is_shown(rows, state, j):
                apart = distance(_flat_place(rows, i), _flat_place(rows, j))
                if apart > farthest:
                    farthest, a, b = apart, i, j
    return a, b


@jit
def _off_line(rows: MarkerRows, row: int, a: int, b: int) -> float:
    """Return how far a palm marker's place is off the line through those of two others [m]."""
    start = _flat_place(rows, a)
    along = subtract(_flat_place(rows, b), start)
    off = subtract(_flat_place(rows, row), start)
    square = dot(along, along)
    return length(subtract(off, scale(along, dot(off, along) / square))) if square > 0. else (
        length(off))


@jit
def _flexion(rows: MarkerRows, state: RowState, row: int) -> float:
    """Return the flexion of the metacarpal that a palm marker is on, 0 on the wrist [rad]."""
    return state.arch[rows.link[row]] if rows.link[row] >= 0 else 0.


@jit
def _expected_place(rows: MarkerRows, state: RowState, row: int) -> Vector:
    """Return where a palm marker is expected, in the wrist's frame [m]."""
    flat = add(_flat_place(rows, row), expected_shift(rows, state, row))
    return flexed(flat, vector(rows.cmc[rows.link[row]]), _flexion(rows, state, row))


@jit
def _in_wrist(state: RowState, row: int, axes: Frame, origin: Vector) -> Vector:
    """Return a measured marker in the frame of a wrist [m]."""
    return components(axes, subtract(vector(state.points[row]), origin))


@jit
def _learn_palm_shifts(rows: MarkerRows, state: RowState, wrist: Wrist, step: float) -> None:
    """Average the shifts of the palm's measured markers, and its arch, at a pose of the wrist."""
    axes, origin = frame(wrist.rotation), vector(wrist.position)
    for row in range(rows.used[0]):
        if _is_shown(rows, state, row):
            miss = subtract(_in_wrist(state, row, axes, origin), _expected_place(rows, state, row))
            learn_skin_shift(
                rows, state, row, rotate_about_y(miss, -_flexion(rows, state, row)), step)
    for finger in range(4):
        learn_shift_angle(state, 5 * finger, state.arch[finger], step)


@jit
def _solve_palm(rows: MarkerRows, state: RowState, lower: np.ndarray, upper: np.ndarray,
                is_free: bool, wrist: Wrist) -> int:
    """Fit wrist and arch to the measured markers of the palm.

    Parameters
    ----------
    rows : MarkerRows
    state : RowState
        Its `arch` is where the fit begins, and is replaced where it is free.
    lower, upper : ndarray, shape (25,)
        Joint limits [rad].
    is_free : bool
        Whether the arch is fitted too.
    wrist : Wrist
        Where the fit begins if it was placed; pose replaced.

    Returns
    -------
    int
        Measured markers of the palm.
    """
    seen = 0
    for row in range(rows.used[0]):
        if rows.digit[row] < 0 and state.is_measured[row]:
            seen += 1
    if seen == 0 or seen < 3 and not wrist.placed[0]:
        return 0
    if seen >= 3 and (not wrist.placed[0] or _mean_miss(rows, state, wrist) > LOST_PALM):
        _place_by_three(rows, state, wrist)
    is_free = is_free and seen >= LEAST_FREE
    count = UNKNOWNS if is_free else POSE_UNKNOWNS
    matrix = local_floats((UNKNOWNS, UNKNOWNS))
    factor = local_floats((UNKNOWNS, UNKNOWNS))
    gradient = local_floats(UNKNOWNS)
    step = local_floats(UNKNOWNS)
    for number in range(MOST_PALM_STEPS):
        outlier = (math.inf if number == 0 else FIRST_PALM_OUTLIER if number == 1
                   else PALM_OUTLIER)
        _palm_equations(rows, state, wrist, outlier, matrix, gradient)
        if is_free:
            _arch_prior(state, lower, upper, matrix, gradient)
        if not solve_damped(matrix, gradient, count, PALM_DAMPING, factor, step):
            break
        _move(wrist, step)
        size = 0.
        for finger in range(4):
            if is_free:
                joint = 5 * finger
                state.arch[finger] = clamp(state.arch[finger] + step[POSE_UNKNOWNS + finger],
                                           lower[joint], upper[joint])
        for k in range(UNKNOWNS):
            size += step[k] * step[k]
        if number + 1 >= LEAST_PALM_STEPS and size < SETTLED_PALM:
            break
    return seen


@jit
def _mean_miss(rows: MarkerRows, state: RowState, wrist: Wrist) -> float:
    """Return the mean distance of the palm's markers from their places on the last pose [m]."""
    axes, origin = frame(wrist.rotation), vector(wrist.position)
    total, count = 0., 0
    for row in range(rows.used[0]):
        if _is_shown(rows, state, row):
            total += distance(_in_wrist(state, row, axes, origin),
                              _expected_place(rows, state, row))
            count += 1
    return total / count


@jit
def _place_by_three(rows: MarkerRows, state: RowState, wrist: Wrist) -> None:
    """Place the wrist by the three measured markers of the largest triangle on the hand."""
    largest, a, b, c = -1., 0, 0, 0
    for i in range(rows.used[0]):
        for j in range(i):
            for k in range(j):
                if not (_is_shown(rows, state, i) and _is_shown(rows, state, j)
                        and _is_shown(rows, state, k)):
                    continue
                normal = triangle_normal(
                    _flat_place(rows, i), _flat_place(rows, j), _flat_place(rows, k))
                size = dot(normal, normal)
                if size > largest:
                    largest, a, b, c = size, i, j, k
    corners = vector(state.points[a]), vector(state.points[b]), vector(state.points[c])
    normal = triangle_normal(*corners)
    if dot(normal, normal) <= 0.:
        return
    template = local_floats((3, 3))
    store(template, 0, _flat_place(rows, a))
    store(template, 1, _flat_place(rows, b))
    store(template, 2, _flat_place(rows, c))
    axes, origin = rigid_palm(corners, template)
    store_pose(wrist.rotation, wrist.position, axes, origin)


@jit
def _is_shown(rows: MarkerRows, state: RowState, row: int) -> bool:
    """Return whether a row is a measured marker of the palm."""
    return rows.digit[row] < 0 and state.is_measured[row]


@jit
def _palm_equations(rows: MarkerRows, state: RowState, wrist: Wrist, outlier: float,
                    matrix: np.ndarray, gradient: np.ndarray) -> None:
    """Write the normal equations of a step by the measured markers, in the wrist's frame."""
    matrix[:] = 0.
    gradient[:] = 0.
    for k in range(POSE_UNKNOWNS):
        matrix[k, k] = PALM_STEP_SPREADS[k // 3] ** -2
    axes, origin = frame(wrist.rotation), vector(wrist.position)
    by = local_floats((3, UNKNOWNS))
    for row in range(rows.used[0]):
        if not _is_shown(rows, state, row):
            continue
        finger = rows.link[row]
        x, y, z = _expected_place(rows, state, row)
        ex, ey, ez = subtract(_in_wrist(state, row, axes, origin), (x, y, z))
        # By how far a marker is off its place, shifted or not: as shifts fade the weights stay.
        off = add((ex, ey, ez), rotate_about_y(
            expected_shift(rows, state, row), _flexion(rows, state, row)))
        if length(off) > MOST_OUTLIERS * outlier:
            continue
        loss = 1. + dot(off, off) / (outlier * outlier)
        weight = 1. / (rows.variance[row] * loss * loss)
        by[:] = 0.
        by[0, 1], by[0, 2], by[0, 3] = z, -y, 1.
        by[1, 0], by[1, 2], by[1, 4] = -z, x, 1.
        by[2, 0], by[2, 1], by[2, 5] = y, -x, 1.
        last = POSE_UNKNOWNS
        if finger >= 0:
            last = POSE_UNKNOWNS + finger + 1
            by[0, last - 1] = z - rows.cmc[finger, 2]
            by[2, last - 1] = rows.cmc[finger, 0] - x
        for i in range(last):
            if POSE_UNKNOWNS <= i < last - 1:
                continue
            gradient[i] += weight * (by[0, i] * ex + by[1, i] * ey + by[2, i] * ez)
            for j in range(i + 1):
                matrix[i, j] += weight * (
                    by[0, i] * by[0, j] + by[1, i] * by[1, j] + by[2, i] * by[2, j])


@jit
def _arch_prior(state: RowState, lower: np.ndarray, upper: np.ndarray, matrix: np.ndarray,
                gradient: np.ndarray) -> None:
    """Add the prior of the CMC flexions to the normal equations; fix those at an active limit.

    By the share of the skin shifts it is taken about what it was off at the angles with them.
    """
    first, ring, little = POSE_UNKNOWNS, POSE_UNKNOWNS + 2, POSE_UNKNOWNS + 3
    arch, share = state.arch, state.skin_shift_share[ON_WRIST]
    for finger in (0, 1, 3):
        weight = CMC_SPREADS[finger] ** -2
        matrix[first + finger, first + finger] += weight
        gradient[first + finger] -= weight * (
            arch[finger] - share * state.skin_shift_angles[5 * finger])
    weight = CMC_SPREADS[2] ** -2
    off = (arch[2] - share * state.skin_shift_angles[10]
           - RING_SHARE * (arch[3] - share * state.skin_shift_angles[15]))
    matrix[ring, ring] += weight
    matrix[little, ring] -= weight * RING_SHARE
    matrix[little, little] += weight * RING_SHARE * RING_SHARE
    gradient[ring] -= weight * off
    gradient[little] += weight * RING_SHARE * off
    for finger in range(4):
        at = first + finger
        pull = gradient[at]
        if not (arch[finger] <= lower[5 * finger] and pull < 0.
                or arch[finger] >= upper[5 * finger] and pull > 0.):
            continue
        fix_unknown(matrix, gradient, at, UNKNOWNS)


@jit
def _move(wrist: Wrist, step: np.ndarray) -> None:
    """Turn and shift the wrist by a step in its own frame."""
    turn = (step[0], step[1], step[2])
    angle = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    axes = frame(wrist.rotation)
    for k in range(3):
        for i in range(3):
            wrist.position[i] += axes[k][i] * step[3 + k]
    if angle > 0.:
        about = (turn[0] / angle, turn[1] / angle, turn[2] / angle)
        for k in range(3):
            unit = (1. if k == 0 else 0., 1. if k == 1 else 0., 1. if k == 2 else 0.)
            x, y, z = rotate_about(about, angle, unit)
            for i in range(3):
                wrist.rotation[i, k] = axes[0][i] * x + axes[1][i] * y + axes[2][i] * z
