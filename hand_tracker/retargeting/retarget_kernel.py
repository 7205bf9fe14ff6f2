"""Solve one frame of retargeting: damped Gauss-Newton steps within limits of place and speed.

The cost is a sum of squares, each in metres or scaled to them: finger tips against those of the
person, thumb-finger distances (pinch), clearance between tips, directions of bones, joints that
follow human joints, and small pulls to the last command and to the rest position. The last two
decide only what the others leave open, so that they do not delay what is observed.
"""

from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit
from ..core.numerics.packs import Pack
from ..core.numerics.vectors import Vector, cross, dot, length, scale, subtract, vector
from .box_qp import BoxQp, solve_box_qp
from .robot_model import Joints, place_joints

MAX_JOINTS, MAX_VARIABLES = 48, 32
MAX_TIPS, MAX_PAIRS, MAX_BONES = 5, 10, 20
MAX_CHAIN = 11              # movable joints of a digit, and the end
LEAST_STEP_DAMPING, GREATEST_DAMPING = 1e-9, 1.  # [m²/rad²] of the Levenberg-Marquardt steps
DAMPING_FACTOR = 10.
START_DAMPING = 1e-3        # [m²/rad²] at most, at the start of a frame
COINCIDING = 1e-6           # [m] between two tips whose direction from each other says nothing


class Problem(NamedTuple):
    """Retargeting problem in the palm's frame: the robot's kinematics, targets and weights.

    Attributes
    ----------
    counts : ndarray of int64, shape (5,)
        Joints, variables, tips, pairs and bones that are used of the arrays below.
    joints : Joints
        With `MAX_JOINTS` rows.
    lower, upper, speed, rest : ndarray, shape (MAX_VARIABLES,)
        Limits [rad or m], greatest speed [per second], and position at rest of the variables.
    chain : ndarray of int64, shape (MAX_TIPS, MAX_CHAIN)
        Joints of each tip, the last one first; -1 at the end.
    tip_offset, tip_anchor, human_anchor : ndarray, shape (MAX_TIPS, 3)
        Tip in the last joint's frame; the robot's and the person's point from which the tip is
        compared [m].
    tip_scale, tip_radius, tip_weight : ndarray, shape (MAX_TIPS,)
        Robot's metres per human metre; radius of the sphere at the tip [m]; weight [1].
    tip_landmark : ndarray of int64, shape (MAX_TIPS,)
        Row of the person's tip, behind that of the joint before it.
    human_radius : ndarray, shape (MAX_TIPS,)
        Radius of the person's finger at the tip [m].
    pair : ndarray of int64, shape (MAX_PAIRS, 3)
        Two tips, the thumb's behind, and whether they pinch (thumb and finger).
    bone : ndarray of int64, shape (MAX_BONES, 4)
        Joint that carries it, the person's landmarks it points from and to, its tip.
    bone_direction : ndarray, shape (MAX_BONES, 3)
        In the joint's frame.
    bone_weight : ndarray, shape (MAX_BONES,)
        [m]
    follow : ndarray of int64, shape (MAX_VARIABLES,)
        Human joint that a variable follows; -1 for none.
    follow_scale, follow_offset, follow_weight : ndarray, shape (MAX_VARIABLES,)
        Variable = scale * angle + offset [1, rad], weight [m/rad].
    touch, escape : float
        Distances of the skin of human tips at and below which the robot's touch, and from which
        they are free [m].
    touch_weight, free_weight : float
        Of the distance of a pair while the person's tips touch, and beyond `escape` [1].
    opening : float
        Distance of a gripper's tips at `escape` [m]; 0 for a hand, of whose tips the surfaces are
        as far apart as the person's skin, scaled.
    clearance, clearance_weight : float
        Least distance between the spheres of two tips that do not pinch [m], and its weight [1].
        So small that tips which are on each other's wrong side come past each other.
    smoothness, rest_weight : float
        Pull to the last command and to the rest position [m/rad].
    iterations : int
        At most in a frame.
    tolerance : float
        Change of the variables that ends the iterations [rad or m].
    """

    counts: np.ndarray
    joints: Joints
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    rest: np.ndarray
    chain: np.ndarray
    tip_offset: np.ndarray
    tip_anchor: np.ndarray
    human_anchor: np.ndarray
    tip_scale: np.ndarray
    tip_radius: np.ndarray
    tip_weight: np.ndarray
    tip_landmark: np.ndarray
    human_radius: np.ndarray
    pair: np.ndarray
    bone: np.ndarray
    bone_direction: np.ndarray
    bone_weight: np.ndarray
    follow: np.ndarray
    follow_scale: np.ndarray
    follow_offset: np.ndarray
    follow_weight: np.ndarray
    touch: float
    escape: float
    touch_weight: float
    free_weight: float
    opening: float
    clearance: float
    clearance_weight: float
    smoothness: float
    rest_weight: float
    iterations: int
    tolerance: float


class Solution(NamedTuple):
    """State of the solver from frame to frame, and its workspace.

    Attributes
    ----------
    position, previous, trial : ndarray, shape (MAX_VARIABLES,)
        Variables now, of the last frame, and workspace [rad or m].
    tips : ndarray, shape (MAX_TIPS, 3)
        The robot's tips at the last evaluation, in the palm's frame [m].
    rotations, origins, axes : ndarray, shape (MAX_JOINTS, ...)
        Frames of the joints and their axes there.
    target : ndarray, shape (MAX_TIPS, 3)
        Where the tips are to be [m]; NaN where the person's is not known.
    pair_target : ndarray, shape (MAX_PAIRS, 2)
        Distance of the tips' centres [m] and its weight [1].
    bone_target : ndarray, shape (MAX_BONES, 3)
        Directions; NaN where not known.
    jacobian : ndarray, shape (MAX_TIPS, 3, MAX_CHAIN)
        Of each tip, by the joints of its chain [m/rad].
    hessian : ndarray, shape (MAX_VARIABLES, MAX_VARIABLES)
        Of the accepted position, without damping.
    gradient : ndarray, shape (MAX_VARIABLES,)
    damping : ndarray, shape (1,)
        Of the last step [m²/rad²].
    qp : BoxQp
    """

    position: np.ndarray
    previous: np.ndarray
    trial: np.ndarray
    tips: np.ndarray
    rotations: np.ndarray
    origins: np.ndarray
    axes: np.ndarray
    target: np.ndarray
    pair_target: np.ndarray
    bone_target: np.ndarray
    jacobian: np.ndarray
    hessian: np.ndarray
    gradient: np.ndarray
    damping: np.ndarray
    qp: BoxQp


@jit
def solve_frame(problem: Pack[Problem], solution: Pack[Solution], human: np.ndarray,
                angles: np.ndarray, dt: float) -> float:
    """Move the robot's variables to the best fit of a frame; return its cost [m²].

    Parameters
    ----------
    problem : pack of Problem
    solution : pack of Solution
        `position` is the start and is replaced.
    human : ndarray, shape (21, 3)
        Landmarks of the person in the palm's frame [m], NaN where not known.
    angles : ndarray, shape (25,)
        Joint angles of the person [rad], NaN where not known.
    dt : float
        Since the last frame [s]; infinite for the first one.
    """
    task, state = problem[0], solution[0]
    n = task.counts[1]
    position, trial, qp = state.position, state.trial, state.qp
    _set_targets(task, state, human)
    for i in range(n):
        state.previous[i] = position[i]
        reach = task.speed[i] * dt
        # The bounds of this frame; of the steps, they count from the position.
        qp.lower[i] = max(task.lower[i], position[i] - reach)
        qp.upper[i] = min(task.upper[i], position[i] + reach)
        trial[i] = min(max(position[i], task.lower[i]), task.upper[i])
    # What damping the last frame needed, this one will.
    cost, damping, was_refused = np.inf, state.damping[0], False
    for _ in range(task.iterations):
        change = _attempt(task, state, angles, cost)
        if change >= 0.:
            cost = change
            if not was_refused:
                damping = max(damping / DAMPING_FACTOR, LEAST_STEP_DAMPING)
            was_refused = False
        else:
            damping *= DAMPING_FACTOR
            was_refused = True
            if damping > GREATEST_DAMPING:
                break
        if _step(task, state, damping) < task.tolerance:
            break
    # The last trial is taken only if it is better.
    final = _attempt(task, state, angles, cost)
    state.damping[0] = min(damping, START_DAMPING)
    return final if final >= 0. else cost


@jit
def _attempt(task: Problem, state: Solution, angles: np.ndarray, cost: float) -> float:
    """Evaluate the trial; accept it and return its cost if that is less, else return -1."""
    n = task.counts[1]
    tried = _evaluate(task, state, angles)
    if not tried < cost:
        return -1.
    for i in range(n):
        state.position[i] = state.trial[i]
        state.gradient[i] = state.qp.gradient[i]
        for j in range(n):
            state.hessian[i, j] = state.qp.hessian[i, j]
    return tried


@jit
def _step(task: Problem, state: Solution, damping: float) -> float:
    """Write the next trial, a step from the position; return its greatest change."""
    n, qp = task.counts[1], state.qp
    for i in range(n):
        qp.gradient[i] = state.gradient[i]
        for j in range(n):
            qp.hessian[i, j] = state.hessian[i, j]
        qp.hessian[i, i] += damping
        # Bounds of the step.
        qp.lower[i] -= state.position[i]
        qp.upper[i] -= state.position[i]
        qp.solution[i] = min(max(0., qp.lower[i]), qp.upper[i])
    solve_box_qp(n, qp)
    greatest = 0.
    for i in range(n):
        qp.lower[i] += state.position[i]
        qp.upper[i] += state.position[i]
        state.trial[i] = min(max(state.position[i] + qp.solution[i], task.lower[i]),
                             task.upper[i])
        greatest = max(greatest, abs(qp.solution[i]))
    return greatest


@jit
def _set_targets(task: Problem, state: Solution, human: np.ndarray) -> None:
    """Write where tips, pairs and bones are to be from the person's landmarks."""
    for tip in range(task.counts[2]):
        row = task.tip_landmark[tip]
        for k in range(3):
            state.target[tip, k] = task.tip_anchor[tip, k] + task.tip_scale[tip] * (
                human[row, k] - task.human_anchor[tip, k])
    for pair in range(task.counts[3]):
        first, second = task.pair[pair, 0], task.pair[pair, 1]
        touching = task.tip_radius[first] + task.tip_radius[second]
        state.pair_target[pair, 0], state.pair_target[pair, 1] = touching + task.clearance, 0.
        if task.pair[pair, 2] == 0:
            continue
        apart = _skin_distance(task, human, first, second)
        if not apart < np.inf:  # or NaN
            continue
        t = min(max((apart - task.touch) / (task.escape - task.touch), 0.), 1.)
        far = task.opening
        if far == 0.:
            far = touching + task.escape * .5 * (task.tip_scale[first] + task.tip_scale[second])
        ease = 1. - t
        state.pair_target[pair, 0] = touching + t * max(far - touching, 0.)
        state.pair_target[pair, 1] = (
            task.free_weight + (task.touch_weight - task.free_weight) * ease * ease)
    for bone in range(task.counts[4]):
        start, end = vector(human[task.bone[bone, 1]]), vector(human[task.bone[bone, 2]])
        along = subtract(end, start)
        size = length(along)
        for k in range(3):
            state.bone_target[bone, k] = along[k] / size if size > 0. else np.nan


@jit
def _skin_distance(task: Problem, human: np.ndarray, first: int, second: int) -> float:
    """Return the distance between the skin of two of the person's finger tips [m].

    Tips lie on the skin at the ends of fingers: as the pads touch, tips are a centimetre apart.
    """
    pads = length(subtract(_pad(task, human, first), _pad(task, human, second)))
    skin = pads - task.human_radius[first] - task.human_radius[second]
    if skin == skin:
        return skin
    # Where the joint before a tip is not known, nor is the pad.
    return length(subtract(vector(human[task.tip_landmark[first]]),
                           vector(human[task.tip_landmark[second]])))


@jit
def _pad(task: Problem, human: np.ndarray, tip: int) -> Vector:
    """Return the centre of the sphere that ends at a tip of the person's; NaN if not known."""
    row = task.tip_landmark[tip]
    end = vector(human[row])
    along = subtract(end, vector(human[row - 1]))
    size = length(along)
    if not size > 0.:
        return (np.nan, np.nan, np.nan)
    return subtract(end, scale(along, task.human_radius[tip] / size))


@jit
def _evaluate(task: Problem, state: Solution, angles: np.ndarray) -> float:
    """Write Hessian and gradient of the cost at the trial into the QP; return the cost."""
    n, qp, trial = task.counts[1], state.qp, state.trial
    _place(task, state)
    cost = 0.
    small, rest = task.smoothness * task.smoothness, task.rest_weight * task.rest_weight
    for i in range(n):
        for j in range(n):
            qp.hessian[i, j] = 0.
        moved, away = trial[i] - state.previous[i], trial[i] - task.rest[i]
        qp.hessian[i, i] = small + rest
        qp.gradient[i] = small * moved + rest * away
        cost += small * moved * moved + rest * away * away
        joint = task.follow[i]
        if joint >= 0 and angles[joint] == angles[joint]:
            off = trial[i] - task.follow_scale[i] * angles[joint] - task.follow_offset[i]
            weight = task.follow_weight[i] * task.follow_weight[i]
            qp.hessian[i, i] += weight
            qp.gradient[i] += weight * off
            cost += weight * off * off
    for tip in range(task.counts[2]):
        weight = task.tip_weight[tip] * task.tip_weight[tip]
        if weight > 0. and state.target[tip, 0] == state.target[tip, 0]:
            off = subtract(vector(state.tips[tip]), vector(state.target[tip]))
            cost += weight * dot(off, off)
            _add_tip(task, state, tip, off, weight)
    for pair in range(task.counts[3]):
        cost += _add_pair(task, state, pair)
    for bone in range(task.counts[4]):
        if state.bone_target[bone, 0] == state.bone_target[bone, 0]:
            cost += _add_bone(task, state, bone)
    for i in range(n):
        for j in range(i):
            qp.hessian[j, i] = qp.hessian[i, j]
    return cost


@jit
def _place(task: Problem, state: Solution) -> None:
    """Write joint frames, axes, tips and the tips' Jacobians at the trial."""
    place_joints(task.joints, task.counts[0], state.trial, state.rotations, state.origins)
    for joint in range(task.counts[0]):
        for i in range(3):
            state.axes[joint, i] = task.joints.multiplier[joint] * (
                state.rotations[joint, i, 0] * task.joints.axis[joint, 0]
                + state.rotations[joint, i, 1] * task.joints.axis[joint, 1]
                + state.rotations[joint, i, 2] * task.joints.axis[joint, 2])
    for tip in range(task.counts[2]):
        last = task.chain[tip, 0]
        for i in range(3):
            state.tips[tip, i] = state.origins[last, i] + (
                state.rotations[last, i, 0] * task.tip_offset[tip, 0]
                + state.rotations[last, i, 1] * task.tip_offset[tip, 1]
                + state.rotations[last, i, 2] * task.tip_offset[tip, 2])
        place = vector(state.tips[tip])
        for k in range(MAX_CHAIN):
            joint = task.chain[tip, k]
            if joint < 0:
                break
            column = vector(state.axes[joint])
            if task.joints.is_prismatic[joint] == 0:
                column = cross(column, subtract(place, vector(state.origins[joint])))
            for i in range(3):
                state.jacobian[tip, i, k] = column[i]


@jit
def _column(state: Solution, tip: int, k: int) -> Vector:
    return (state.jacobian[tip, 0, k], state.jacobian[tip, 1, k], state.jacobian[tip, 2, k])


@jit
def _add_entry(state: Solution, row: int, column: int, value: float) -> None:
    """Add to the lower triangle of the Hessian, where each pair of joints comes once."""
    if row >= column:
        state.qp.hessian[row, column] += value
    else:
        state.qp.hessian[column, row] += value


@jit
def _add_tip(task: Problem, state: Solution, tip: int, off: Vector, weight: float) -> None:
    """Add the square of a tip's distance from its target.

    Of a target out of reach the distance stays large, and Gauss-Newton alone would overshoot: the
    curvature of the tip's path is added, off · ∂²p/∂q_i∂q_j with ∂²p/∂q_i∂q_j = a_i × ∂p/∂q_j for
    a joint i that is not beyond j. A target nearer than the tip would make that negative.
    """
    first_joint = 0
    while task.chain[tip, first_joint + 1] >= 0:
        first_joint += 1
    root = vector(state.origins[task.chain[tip, first_joint]])
    is_out_of_reach = dot(off, subtract(vector(state.tips[tip]), root)) < 0.
    for k in range(first_joint + 1):
        joint = task.chain[tip, k]
        row, first = task.joints.variable[joint], _column(state, tip, k)
        state.qp.gradient[row] += weight * dot(first, off)
        is_curved = is_out_of_reach and task.joints.is_prismatic[joint] == 0
        for j in range(k + 1):
            other, second = task.joints.variable[task.chain[tip, j]], _column(state, tip, j)
            value = dot(first, second)
            if is_curved:
                value += dot(off, cross(vector(state.axes[joint]), second))
            value *= weight
            # Mimic joints share a variable: both orders fall on its diagonal.
            _add_entry(state, row, other, 2. * value if j < k and row == other else value)


@jit
def _add_pair(task: Problem, state: Solution, pair: int) -> float:
    """Add the square of a pair's distance from its own, return its cost.

    A pair without weight counts only where it is nearer than its clearance.
    """
    first, second = task.pair[pair, 0], task.pair[pair, 1]
    apart = subtract(vector(state.tips[first]), vector(state.tips[second]))
    distance = length(apart)
    off = distance - state.pair_target[pair, 0]
    weight = state.pair_target[pair, 1]
    if weight == 0.:
        # Beyond `escape` a thumb keeps clear of the fingers too.
        weight = task.clearance_weight if off < 0. else 0.
    if weight == 0.:
        return 0.
    weight *= weight
    # Tips that coincide, as a closed gripper's, part along the palm's y, with the thumb ahead.
    along = scale(apart, 1. / distance) if distance > COINCIDING else (0., -1., 0.)
    # The row of the distance by all variables is kept in the QP's workspace.
    row = state.qp.slope
    for i in range(task.counts[1]):
        row[i] = 0.
    for k in range(MAX_CHAIN):
        if task.chain[first, k] < 0:
            break
        row[task.joints.variable[task.chain[first, k]]] += dot(along, _column(state, first, k))
    for k in range(MAX_CHAIN):
        if task.chain[second, k] < 0:
            break
        row[task.joints.variable[task.chain[second, k]]] -= dot(along, _column(state, second, k))
    for i in range(task.counts[1]):
        if row[i] != 0.:
            state.qp.gradient[i] += weight * row[i] * off
            for j in range(i + 1):
                state.qp.hessian[i, j] += weight * row[i] * row[j]
    return weight * off * off


@jit
def _add_bone(task: Problem, state: Solution, bone: int) -> float:
    """Add the square of a bone's turn from the person's, return its cost."""
    carrier, tip = task.bone[bone, 0], task.bone[bone, 3]
    r, d = state.rotations[carrier], task.bone_direction[bone]
    now = (r[0, 0] * d[0] + r[0, 1] * d[1] + r[0, 2] * d[2],
           r[1, 0] * d[0] + r[1, 1] * d[1] + r[1, 2] * d[2],
           r[2, 0] * d[0] + r[2, 1] * d[1] + r[2, 2] * d[2])
    off = subtract(now, vector(state.bone_target[bone]))
    weight = task.bone_weight[bone] * task.bone_weight[bone]
    start = 0
    while task.chain[tip, start] != carrier:
        start += 1
    for k in range(start, MAX_CHAIN):
        joint = task.chain[tip, k]
        if joint < 0:
            break
        if task.joints.is_prismatic[joint] != 0:
            continue
        row = task.joints.variable[joint]
        first = cross(vector(state.axes[joint]), now)
        state.qp.gradient[row] += weight * dot(first, off)
        for j in range(start, k + 1):
            below = task.chain[tip, j]
            if task.joints.is_prismatic[below] == 0:
                other = task.joints.variable[below]
                value = weight * dot(first, cross(vector(state.axes[below]), now))
                _add_entry(state, row, other, 2. * value if j < k and row == other else value)
    return weight * dot(off, off)
