"""Angles of a digit with several markers: damped Gauss-Newton on all its joints.

Each marker is weighted by its deviation, and less the farther it is from the digit. A digit of
which no marker is seen is solved by its predicted principal marker. What the markers leave open is
decided by the coupling of the last joint, by the flexion natural for the person, and by the last
frame. Where markers are farther off the digit than their deviations, as on bones of another length,
coupling and natural flexion count for as much more. Ours.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from ..model.marker_rows import MarkerRows, RowState
from ..model.palm_triangle import Wrist
from ..numerics.cholesky import factorise, fix_unknown, solve_damped, solve_factorised
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import (
    Frame,
    Vector,
    add,
    clamp,
    components,
    cross,
    dot,
    frame,
    rotate,
    rotate_about_y,
    scale,
    store,
    subtract,
    vector,
)
from .angle_average import AngleAverage, average_angles
from .digit import CHAIN_JOINTS, THUMB, Chains
from .palm_arch import flexed
from .skin_shift import expected_shift, fade_skin_shifts, learn_shift_angle, learn_skin_shift

MOST_STEPS = 12
SOLVE_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e-7, 1e4
SETTLED = 1e-6                # [rad²] of the step after which there is none
OUTLIER = .015                # [m] distance at which a marker's weight falls to a quarter
# Standard deviations of the joints about zero, along the chain [rad]: wide, but for the thumb's MCP
# abduction, which hardly moves. Ours.
FINGER_SPREADS = (1., .35, 1., 1., 1.)
THUMB_SPREADS = (.6, .6, .09, 1., 1.)
# Random walk of a joint [rad/√s]: where markers tell next to nothing of the angles they would leap.
JOINT_RANDOM_WALK = 2.
FAR_OFF = 25.                 # [1] mean cost of a marker, as of five deviations
LARGEST_MISFIT = 25.          # [1] that is learned, as of five deviations too
DIGIT_MISFIT_TIME = .1        # [s] that a digit's misfit is averaged over
INFERRED_DEVIATION = .01      # [m] of a principal marker that the digit's others place
NATURAL_WEIGHT = .1           # [1] of the natural flexion beside markers that show the bend


class DigitWorkspace(NamedTuple):
    """Scratch memory of a digit's fit.

    Attributes
    ----------
    frames : ndarray, shape (5, 3, 3)
        Axes of the links, one a row, in the wrist's frame [1].
    origins, axes : ndarray, shape (5, 3)
        Joints, and the axes about which they turn [m, 1].
    matrix, factor : ndarray, shape (5, 5)
        Normal equations, and their factor [1/rad²].
    gradient, step : ndarray, shape (5,)
        Their right side, and their solution [1/rad, rad].
    angles, tried, last : ndarray, shape (5,)
        Of the digit's joints [rad].
    off_shift : ndarray, shape (5,)
        Angles less the shares of those with the markers' shifts [rad].
    jacobian : ndarray, shape (3, 5)
        Derivatives of a marker's position by the joints [m/rad].
    """

    frames: np.ndarray
    origins: np.ndarray
    axes: np.ndarray
    matrix: np.ndarray
    factor: np.ndarray
    gradient: np.ndarray
    step: np.ndarray
    angles: np.ndarray
    tried: np.ndarray
    last: np.ndarray
    off_shift: np.ndarray
    jacobian: np.ndarray


@partial(jit, inline='always')
def local_digit_workspace() -> DigitWorkspace:
    """Return scratch memory that a kernel uses until it returns, as `local_floats` does."""
    return DigitWorkspace(
        local_floats((5, 3, 3)), local_floats((5, 3)), local_floats((5, 3)), local_floats((5, 5)),
        local_floats((5, 5)), local_floats(5), local_floats(5), local_floats(5), local_floats(5),
        local_floats(5), local_floats(5), local_floats((3, 5)))


@jit
def _turn_about_x(axes: Frame, angle: float) -> Frame:
    """Return a frame turned about its x axis by an angle [rad]: a thumb's roll."""
    c, s = math.cos(angle), math.sin(angle)
    return (axes[0], add(scale(axes[1], c), scale(axes[2], s)),
            subtract(scale(axes[2], c), scale(axes[1], s)))


@jit
def _turn_about_y(axes: Frame, angle: float) -> Frame:
    """Return a frame turned about its y axis by an angle [rad]: flexion."""
    c, s = math.cos(angle), math.sin(angle)
    return (subtract(scale(axes[0], c), scale(axes[2], s)), axes[1],
            add(scale(axes[0], s), scale(axes[2], c)))


@jit
def _turn_about_z(axes: Frame, angle: float) -> Frame:
    """Return a frame turned about its z axis by an angle [rad]: abduction."""
    c, s = math.cos(angle), math.sin(angle)
    return (add(scale(axes[0], c), scale(axes[1], s)),
            subtract(scale(axes[1], c), scale(axes[0], s)), axes[2])


@jit
def place_digit(chains: Chains, bone_ends: np.ndarray, digit: int, angles: np.ndarray,
                workspace: DigitWorkspace) -> None:
    """Write the links of a digit, the palm flat.

    Parameters
    ----------
    chains : Chains
    bone_ends : ndarray, shape (5, 3, 3)
        As `Hand.bone_ends` [m].
    digit : int
    angles : ndarray, shape (5,)
        Along its chain [rad].
    workspace : DigitWorkspace
        Its links are replaced.
    """
    axes, origin = frame(chains.base[digit]), vector(chains.root[digit])
    is_thumb = digit == THUMB
    sign = chains.sign[digit]
    for j in range(CHAIN_JOINTS):
        if j == 0 and not is_thumb:
            _write_link(workspace, 0, axes, origin, (0., 0., 0.))
            continue
        if j == 0 or j == 1 and not is_thumb or j == 2 and is_thumb:
            if j == 2:
                origin = add(origin, rotate(axes, vector(bone_ends[digit, 0])))
                axes = _turn_about_x(axes, chains.roll[digit])
            axes = _turn_about_z(axes, sign * angles[j])
            _write_link(workspace, j, axes, origin, scale(axes[2], sign))
            continue
        if j >= 3 and not (j == 3 and is_thumb):
            origin = add(origin, rotate(axes, vector(bone_ends[digit, 1 if is_thumb else j - 3])))
        first = j == (1 if is_thumb else 2)
        if first:
            origin = add(origin, scale(axes[0], chains.advance[digit]))
        axes = _turn_about_y(axes, angles[j] + (chains.tilt[digit] if first else 0.))
        _write_link(workspace, j, axes, origin, axes[1])


@jit
def _write_link(workspace: DigitWorkspace, j: int, axes: Frame, origin: Vector,
                turn: Vector) -> None:
    """Write a link's frame and its joint into the workspace."""
    for i in range(3):
        workspace.origins[j, i], workspace.axes[j, i] = origin[i], turn[i]
        for k in range(3):
            workspace.frames[j, k, i] = axes[k][i]


@jit
def marker_on_digit(rows: MarkerRows, state: RowState, row: int, angles: np.ndarray,
                     workspace: DigitWorkspace) -> tuple[Vector, Vector]:
    """Return where a marker is expected on a placed digit, and the landmark that it is at [m]."""
    link = rows.link[row]
    axes = _axes_of_link(workspace, link)
    end = add(vector(workspace.origins[link]), rotate(axes, vector(rows.end[row])))
    offset, joint = vector(rows.offset[row]), rows.joint[row]
    if joint >= 0:
        offset = rotate_about_y(offset, rows.share[row] * angles[joint])
    return add(end, rotate(axes, add(offset, expected_shift(rows, state, row)))), end


@jit
def _axes_of_link(workspace: DigitWorkspace, link: int) -> Frame:
    """Return the axes of a placed link."""
    return (vector(workspace.frames[link, 0]), vector(workspace.frames[link, 1]),
            vector(workspace.frames[link, 2]))


@jit
def _solve_digit_angles(chains: Chains, rows: MarkerRows, state: RowState, digit: int,
                        solved: np.ndarray, walk: float,
                        workspace: DigitWorkspace) -> tuple[int, float]:
    """Solve a digit's angles by its fitted markers, in `state.angles`.

    Parameters
    ----------
    chains : Chains
    rows : MarkerRows
    state : RowState
        Its `local` are the markers that `is_fitted` names; its `angles` are the last frame's and
        replaced.
    digit : int
    solved : ndarray, shape (25,)
        Angles by the principal marker, where the solution begins if they fit better [rad].
    walk : float
        Standard deviation of a joint from the last frame; 0 where that says nothing [rad].
    workspace : DigitWorkspace
        Overwritten.

    Returns
    -------
    fitted : int
        Fitted markers of the digit; angles are replaced if there is one.
    cost : float
        Of the solution, as a mean over these markers, in squared deviations [1].
    """
    fitted = 0
    for row in range(rows.used[0]):
        if rows.digit[row] == digit and state.is_fitted[row]:
            fitted += 1
    if fitted == 0:
        return 0, 0.
    first = _first_joint(digit)
    angles, tried = workspace.angles, workspace.tried
    for j in range(CHAIN_JOINTS):
        angles[j] = clamp(state.angles[5 * digit + j], chains.lower[5 * digit + j],
                          chains.upper[5 * digit + j])
        workspace.last[j] = angles[j]
        tried[j] = solved[5 * digit + j]
    cost = _equations(chains, rows, state, digit, angles, walk, workspace)
    if cost > fitted * FAR_OFF:
        # The last frame says little: begin where the principal marker's solution fits better.
        if _equations(chains, rows, state, digit, tried, walk, workspace) < cost:
            for j in range(CHAIN_JOINTS):
                angles[j] = tried[j]
        cost = _equations(chains, rows, state, digit, angles, walk, workspace)
    damping = SOLVE_DAMPING
    for _ in range(MOST_STEPS):
        _fix_active_limits(chains, digit, first, workspace)
        if not solve_damped(workspace.matrix, workspace.gradient, CHAIN_JOINTS, damping,
                            workspace.factor, workspace.step):
            break
        size = 0.
        for j in range(CHAIN_JOINTS):
            joint = 5 * digit + j
            tried[j] = clamp(
                angles[j] + workspace.step[j], chains.lower[joint], chains.upper[joint])
            size += (tried[j] - angles[j]) ** 2
        if size < SETTLED and damping <= SOLVE_DAMPING:
            # So small a step of an undamped solution needs no proof.
            for j in range(CHAIN_JOINTS):
                angles[j] = tried[j]
            break
        found = _equations(chains, rows, state, digit, tried, walk, workspace)
        if found <= cost:
            cost = found
            for j in range(CHAIN_JOINTS):
                angles[j] = tried[j]
            damping = max(.1 * damping, LEAST_DAMPING)
            if size < SETTLED:
                break
        else:
            damping = 10. * max(damping, .01)
            if damping > MOST_DAMPING or size < 1e-2 * SETTLED:
                break
            _equations(chains, rows, state, digit, angles, walk, workspace)
    for j in range(first, CHAIN_JOINTS):
        state.angles[5 * digit + j] = angles[j]
    return fitted, cost / fitted


@jit
def _first_joint(digit: int) -> int:
    """Return the first joint that is fitted: all of the thumb; the palm's arch is solved before."""
    return 0 if digit == THUMB else 1


@jit
def _fix_active_limits(chains: Chains, digit: int, first: int, workspace: DigitWorkspace) -> None:
    """Fix the joints at a limit that they are pulled beyond, and those before the first."""
    for j in range(CHAIN_JOINTS):
        joint = 5 * digit + j
        pull = workspace.gradient[j]
        if j >= first and not (workspace.angles[j] <= chains.lower[joint] and pull < 0.
                               or workspace.angles[j] >= chains.upper[joint] and pull > 0.):
            continue
        fix_unknown(workspace.matrix, workspace.gradient, j, CHAIN_JOINTS)


@jit
def _equations(chains: Chains, rows: MarkerRows, state: RowState, digit: int, angles: np.ndarray,
               walk: float, workspace: DigitWorkspace) -> float:
    """Write the normal equations at angles (5,) into the workspace; return the cost."""
    matrix, gradient, by = workspace.matrix, workspace.gradient, workspace.jacobian
    matrix[:] = 0.
    gradient[:] = 0.
    cost, fitted = 0., 0
    place_digit(chains, rows.bone_ends, digit, angles, workspace)
    for row in range(rows.used[0]):
        if rows.digit[row] != digit or not state.is_fitted[row]:
            continue
        fitted += 1
        place, end = marker_on_digit(rows, state, row, angles, workspace)
        miss = subtract(vector(state.local[row]), place)
        link = rows.link[row]
        # By how far a marker is off its place, shifted or not: as shifts fade the weights stay. The
        # gradient takes them for those of the shifted distance, which few markers are far off.
        off = add(miss, rotate(_axes_of_link(workspace, link), expected_shift(rows, state, row)))
        loss = 1. + dot(off, off) / (OUTLIER * OUTLIER)
        cost += dot(miss, miss) / (rows.variance[row] * loss)
        weight = 1. / (rows.variance[row] * loss * loss)
        joints = link + 1
        for j in range(joints):
            v = cross(vector(workspace.axes[j]), subtract(place, vector(workspace.origins[j])))
            by[0, j], by[1, j], by[2, j] = v[0], v[1], v[2]
        if rows.joint[row] >= 0:
            joint, share = rows.joint[row], rows.share[row]
            for j in range(joints, joint):  # abduction of the thumb's MCP, which moves no skin
                by[0, j], by[1, j], by[2, j] = 0., 0., 0.
            v = cross(vector(workspace.frames[link, 1]), subtract(place, end))
            by[0, joint], by[1, joint], by[2, joint] = share * v[0], share * v[1], share * v[2]
            joints = joint + 1
        for i in range(joints):
            gradient[i] += weight * (by[0, i] * miss[0] + by[1, i] * miss[1] + by[2, i] * miss[2])
            for j in range(i + 1):
                matrix[i, j] += weight * (
                    by[0, i] * by[0, j] + by[1, i] * by[1, j] + by[2, i] * by[2, j])
    natural_weight = NATURAL_WEIGHT if fitted > 1 else 1.
    return cost + _priors(chains, state, digit, angles, walk, natural_weight, workspace)


@jit
def _priors(chains: Chains, state: RowState, digit: int, angles: np.ndarray, walk: float,
            natural_weight: float, workspace: DigitWorkspace) -> float:
    """Add the usual angles, the natural flexion, the coupling and the last frame; return costs.

    Usual angles, natural flexion and coupling are taken about what they were off at the angles with
    the markers' shifts, by the share of these.
    """
    matrix, gradient = workspace.matrix, workspace.gradient
    misfit = max(state.misfit[digit], 1.)
    share, off_shift = state.skin_shift_share[digit], workspace.off_shift
    for j in range(CHAIN_JOINTS):
        off_shift[j] = angles[j] - share * state.skin_shift_angles[5 * digit + j]
    spreads = THUMB_SPREADS if digit == THUMB else FINGER_SPREADS
    cost = 0.
    for j in range(CHAIN_JOINTS):
        weight = spreads[j] ** -2
        off = off_shift[j]
        cost += weight * off * off
        matrix[j, j] += weight
        gradient[j] -= weight * off
        if walk > 0.:
            off = angles[j] - workspace.last[j]
            weight = walk ** -2
            cost += weight * off * off
            matrix[j, j] += weight
            gradient[j] -= weight * off
    first = 1 if digit == THUMB else 2
    second = 3
    natural = chains.natural[digit]
    cost += _add_coupling_prior(
        matrix, gradient, off_shift, second, first, natural[0], (1. - share) * natural[1],
        natural[2] / math.sqrt(natural_weight * misfit))
    cost += _add_coupling_prior(
        matrix, gradient, off_shift, 4, 3, chains.coupling[digit, 0],
        (1. - share) * chains.coupling[digit, 1],
        chains.coupling_spread[digit] / math.sqrt(misfit))
    return cost


@jit
def _add_coupling_prior(matrix: np.ndarray, gradient: np.ndarray, angles: np.ndarray, joint: int,
                        other: int, slope: float, offset: float, spread: float) -> float:
    """Add the prior joint = slope · other + offset, of a spread [rad]; return its cost."""
    weight = spread ** -2
    off = angles[joint] - slope * angles[other] - offset
    matrix[joint, joint] += weight
    matrix[joint, other] -= weight * slope
    matrix[other, other] += weight * slope * slope
    gradient[joint] -= weight * off
    gradient[other] += weight * slope * off
    return weight * off * off


@jit
def place_on_digit(chains: Chains, rows: MarkerRows, state: RowState, row: int,
                   workspace: DigitWorkspace) -> Vector:
    """Return where a digit's marker is by its solved angles, the palm flat [m]."""
    digit = rows.digit[row]
    for j in range(CHAIN_JOINTS):
        workspace.angles[j] = state.angles[5 * digit + j]
    place_digit(chains, rows.bone_ends, digit, workspace.angles, workspace)
    return marker_on_digit(rows, state, row, workspace.angles, workspace)[0]


@jit
def lay_flat(rows: MarkerRows, state: RowState, row: int, local: Vector) -> Vector:
    """Return a digit's marker, in the wrist's frame [m], where it is with the palm laid flat."""
    digit = rows.digit[row]
    return flexed(local, vector(rows.cmc[digit]), -state.arch[digit]) if digit < 4 else local


@jit
def _walk(step: float) -> float:
    """Return the standard deviation of a joint after a step [s] from the last frame [rad]."""
    return JOINT_RANDOM_WALK * math.sqrt(max(step, 1e-4))


@jit
def infer_principal_markers(chains: Chains, rows: MarkerRows, state: RowState, wrist: Wrist,
                            angles: np.ndarray, markers: np.ndarray, seen: np.ndarray,
                            step: float) -> None:
    """Place each digit's hidden principal marker by the digit's other markers.

    Parameters
    ----------
    chains : Chains
    rows : MarkerRows
    state : RowState
        Its `local` are the markers; its `angles` are replaced, its skin shifts fade.
    wrist : Wrist
    angles : ndarray, shape (25,)
        Of the last frame, by the principal markers [rad].
    markers : ndarray, shape (8, 3)
        Changed [m].
    seen : ndarray of bool, shape (8,)
        Set where a marker is placed.
    step : float
        Since the last frame [s].
    """
    axes, origin = frame(wrist.rotation), vector(wrist.position)
    walk = _walk(step)
    for digit in range(5):
        if not rows.has_several[digit]:
            continue
        fade_skin_shifts(rows, state, digit, step)
        if seen[3 + digit]:
            continue
        workspace = local_digit_workspace()
        if _solve_digit_angles(chains, rows, state, digit, angles, walk, workspace)[0]:
            local = place_on_digit(chains, rows, state, 3 + digit, workspace)
            if digit < 4:
                local = flexed(local, vector(rows.cmc[digit]), state.arch[digit])
            store(markers, 3 + digit, add(origin, rotate(axes, local)))
            seen[3 + digit] = True


@jit
def solve_followed_digits(chains: Chains, rows: MarkerRows, state: RowState, seen: np.ndarray,
                          places: np.ndarray, changed: np.ndarray, angles: np.ndarray,
                          step: float) -> None:
    """Solve digits with several markers and unchanged evidence, starting from the last angles.

    So are digits of which no marker is seen, by their predicted principal one.

    Parameters
    ----------
    chains : Chains
    rows : MarkerRows
    state : RowState
        Its `angles` and `is_solved` are replaced for these digits.
    seen : ndarray of bool, shape (8,)
    places : ndarray, shape (5, 3)
        Of the digits' principal markers, filtered or predicted, in the wrist's frame [m].
    changed : ndarray of bool, shape (5,)
        Digits whose evidence changed.
    angles : ndarray, shape (25,)
        Of the last frame, replaced for digits that are solved well [rad].
    step : float
        Since the last frame [s].
    """
    workspace, walk = local_digit_workspace(), _walk(step)
    for digit in range(5):
        principal = 3 + digit
        if not rows.has_several[digit] or seen[principal] and (
                changed[digit] or not state.is_measured[principal]):
            continue
        if not seen[principal]:
            store(state.local, principal, lay_flat(rows, state, principal, vector(places[digit])))
            state.is_fitted[principal] = True
        _, cost = _solve_digit_angles(chains, rows, state, digit, state.angles, walk, workspace)
        state.is_solved[digit] = cost < FAR_OFF
        if state.is_solved[digit]:
            for joint in range(5 * digit, 5 * digit + 5):
                angles[joint] = state.angles[joint]


@jit
def refine_digits(chains: Chains, rows: MarkerRows, state: RowState, average: AngleAverage,
                  seen: np.ndarray, angles: np.ndarray, step: float) -> None:
    """Solve the remaining digits with several markers, from the angles by their principal one.

    Parameters
    ----------
    chains : Chains
    rows : MarkerRows
    state : RowState
        Its `angles` and `deviation` are replaced, its misfits and skin shifts are updated.
    average : AngleAverage
        Of the measured digits; updated.
    seen : ndarray of bool, shape (8,)
    angles : ndarray, shape (25,)
        By the principal markers; replaced for digits that are solved well by all theirs [rad].
    step : float
        Since the last frame [s].
    """
    workspace = local_digit_workspace()
    for digit in range(5):
        first = _first_joint(digit)
        is_solved, is_averaged = False, False
        if rows.has_several[digit] and seen[3 + digit]:
            # One whose principal marker is hidden was solved before.
            is_solved = state.is_solved[digit] or not state.is_measured[3 + digit]
            if not is_solved:
                fitted, cost = _solve_digit_angles(
                    chains, rows, state, digit, angles, 0., workspace)
                is_solved = fitted > 1 or cost < FAR_OFF
        state.deviation[5 * digit:5 * digit + 5] = 0.
        if is_solved:
            is_averaged = _write_deviation(chains, rows, state, digit, workspace) and _is_measured(
                rows, state, digit)
            if state.learns_shift[digit]:
                _learn_shifts(rows, state, digit, step, workspace)
        if is_averaged:
            average_angles(average, digit, (first, CHAIN_JOINTS), workspace.angles,
                           workspace.factor, step)
        else:
            average.consecutive[5 * digit + first] = 0
        for j in range(CHAIN_JOINTS):
            joint = 5 * digit + j
            if not is_solved or j < first:
                state.angles[joint] = angles[joint]
            elif is_averaged:
                average.angles[joint] = clamp(
                    average.angles[joint], chains.lower[joint], chains.upper[joint])
                angles[joint] = average.angles[joint]
            else:
                angles[joint] = state.angles[joint]


@jit
def _is_measured(rows: MarkerRows, state: RowState, digit: int) -> bool:
    """Return whether any marker of a digit is measured."""
    for row in range(rows.used[0]):
        if rows.digit[row] == digit and state.is_measured[row]:
            return True
    return False


@jit
def _learn_shifts(rows: MarkerRows, state: RowState, digit: int, step: float,
                  workspace: DigitWorkspace) -> None:
    """Average a digit's misfit and its markers' shifts, placed by `_write_deviation`."""
    total, count = 0., 0
    for row in range(rows.used[0]):
        if rows.digit[row] == digit and state.is_measured[row]:
            place, _ = marker_on_digit(rows, state, row, workspace.angles, workspace)
            miss = subtract(vector(state.local[row]), place)
            square = dot(miss, miss)
            total += square / (rows.variance[row] * (1. + square / (OUTLIER * OUTLIER)))
            count += 1
            learn_skin_shift(rows, state, row, components(
                _axes_of_link(workspace, rows.link[row]), miss), step)
    # One marker is met, whatever the bones: what several told of them stays.
    if count > 1:
        # The thumb's MCP abduction, its fifth joint, hardly moves.
        freedom = 3 * count - 4
        share = 1. - math.exp(-step / DIGIT_MISFIT_TIME)
        state.misfit[digit] += share * (
            min(total / freedom, LARGEST_MISFIT) - state.misfit[digit])
    for j in range(_first_joint(digit), CHAIN_JOINTS):
        learn_shift_angle(state, 5 * digit + j, workspace.angles[j], step)


@jit
def _write_deviation(chains: Chains, rows: MarkerRows, state: RowState, digit: int,
                     workspace: DigitWorkspace) -> bool:
    """Write the standard deviations of a digit's solved angles by all its markers.

    The factor of the normal equations is left in the workspace; returns whether there is one.
    """
    for j in range(CHAIN_JOINTS):
        workspace.angles[j] = state.angles[5 * digit + j]
    _equations(chains, rows, state, digit, workspace.angles, 0., workspace)
    matrix, one, column = workspace.matrix, workspace.gradient, workspace.step
    first = _first_joint(digit)
    for j in range(first):
        fix_unknown(matrix, one, j, CHAIN_JOINTS)
    if not factorise(matrix, CHAIN_JOINTS, 0., workspace.factor):
        return False
    spreads = THUMB_SPREADS if digit == THUMB else FINGER_SPREADS
    misfit = max(state.misfit[digit], 1.)
    for j in range(first, CHAIN_JOINTS):
        one[:] = 0.
        one[j] = 1.
        solve_factorised(workspace.factor, one, CHAIN_JOINTS, column)
        state.deviation[5 * digit + j] = min(math.sqrt(misfit * column[j]), spreads[j])
    return True
