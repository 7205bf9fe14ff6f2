"""Contact of the digits: none goes through another or the palm, and the hidden are carried.

Both stages work on a right hand in the wrist's frame, after its digits are solved.
"""

import numpy as np

from ..model.capsules import PALM_INDEX, axis_of, close_pairs, nearest_points, place_frames
from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS
from ..numerics.jit import indexed, jit
from ..numerics.vectors import add, clamp, cross, dot, scale, subtract, unit, vector

PENETRATION = .001   # [m] that flesh gives way; ours
# Solved to this share of the tolerance: iteration ends with a small rest.
AIM = .95
ROUNDS = 48          # of linearising the distances
SWEEPS = 30          # over the contacts of a round
PASS = 12            # rounds after which it starts again from where it is
NEAR = .006          # [m] of surfaces that a round may bring together
CLIMB = .003         # [m] of an overlap that a round takes away
LEAP = .03           # [m] as well, where small steps lead nowhere
STEP = .2            # [rad] that an angle changes in a round
FARTHEST = .7        # [rad] that an angle changes in all, so that no digit is thrown about
SETTLED = 3e-4       # [rad] of change in a round
EXACT = 1e-6         # [m] of a round's distances
SOFT = 1e-7          # [m^2/rad^2] of contacts that limits or their lever leave no way out

# Unsourced.
GAP = .0015          # [m] below which surfaces touch


@jit
def separate(capsules, angles, lower, upper, slope, mobility, tolerance):
    """Move the digits apart that are in each other or in the palm, by the least change.

    Minimal is the sum over the free angles (abduction, first and second flexion of each
    digit; the third follows the second) of change^2 / mobility, subject to the limits and
    to no pair of capsules overlapping by more than the tolerance. Distances are linearised
    round by round, and each round's quadratic program solved by Hildreth's method. The change
    grows from zero where an overlap passes the tolerance; without one nothing is touched.

    Parameters
    ----------
    capsules : Capsules
    angles : ndarray, shape (25,)
        Within limits; replaced where digits move [rad].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    slope : ndarray, shape (5,)
        Third flexion over second; 0 where the third is measured [1].
    mobility : ndarray, shape (5,)
        Readiness of each digit to move, from 0 [1].
    tolerance : float
        Overlap that is left [m].

    Returns
    -------
    int
        Rounds used; 0 where nothing was to do.
    """
    rotations = np.empty((1, 25, 3, 3))
    positions = np.empty((1, 25, 3))
    ends = np.empty((capsules.link.size, 2, 3))
    aim = AIM * tolerance
    place_frames(capsules, angles, rotations, positions, ends)
    if not _overlaps(capsules, ends, aim):
        return 0

    rounds = 0
    climb = CLIMB
    while rounds < ROUNDS:
        rounds += _settle(capsules, angles, lower, upper, slope, mobility, aim, climb,
                          min(ROUNDS - rounds, PASS), rotations, positions, ends)
        place_frames(capsules, angles, rotations, positions, ends)
        if not _overlaps(capsules, ends, tolerance):
            break
        # Caught short of it: once more from here, in leaps.
        climb = LEAP
    return rounds


@jit
def _settle(capsules, angles, lower, upper, slope, mobility, aim, climb, rounds, rotations,
            positions, ends):
    """Bring all overlaps to `aim` by the least change of `angles`; return the rounds used."""
    count = capsules.first.size
    before = angles.copy()
    # Digit by digit, abduction, first and second flexion; the palm's row stays zero.
    least = indexed(np.zeros((6, 3)))
    most = indexed(np.zeros((6, 3)))
    ready = indexed(np.zeros(6))
    for digit in range(5):
        ready[digit] = mobility[digit]
        for i in range(3):
            joint = _joint(digit, i)
            least[digit, i] = max(lower[joint] - before[joint], -FARTHEST)
            most[digit, i] = min(upper[joint] - before[joint], FARTHEST)
    change = indexed(np.zeros((6, 3)))
    pushed = indexed(np.zeros((6, 3)))
    goal = indexed(np.zeros((6, 3)))
    lines = indexed(np.empty((25, 2, 3)))
    # Contact by contact
    lever = indexed(np.empty((count, 2, 3)))
    digits = indexed(np.empty((count, 2), dtype=np.int64))
    force = indexed(np.empty(count))
    bound = indexed(np.empty(count))
    stiff = indexed(np.empty(count))
    pairs = indexed(np.empty(count, dtype=np.int64))
    last_force = np.zeros(count)
    for number in range(rounds):
        _place_lines(capsules, rotations, positions, lines)
        used = 0
        for digit in range(5):
            for i in range(3):
                pushed[digit, i] = 0.0
        for pair in close_pairs(capsules, ends, NEAR):
            overlap = _linearise(capsules, pair, angles, lower, upper, slope, lines, ends, used,
                                 lever)
            if overlap < -NEAR:
                continue
            force[used] = last_force[pair]
            size = 0.0
            past = 0.0
            for end in range(2):
                digit = digits[used, end] = capsules.digits[pair, end]
                for i in range(3):
                    size += ready[digit] * lever[used, end, i] ** 2
                    past += lever[used, end, i] * change[digit, i]
                    pushed[digit, i] += ready[digit] * force[used] * lever[used, end, i]
            bound[used] = min(overlap - aim, climb) + past
            stiff[used] = size + SOFT
            pairs[used] = pair
            used += 1
        for digit in range(5):
            for i in range(3):
                goal[digit, i] = clamp(pushed[digit, i], least[digit, i], most[digit, i])
        for _ in range(SWEEPS):
            moved = 0.0
            for k in range(used):
                gained = SOFT * force[k]
                for end in range(2):
                    digit = digits[k, end]
                    for i in range(3):
                        gained += lever[k, end, i] * goal[digit, i]
                more = max((bound[k] - gained) / stiff[k], -force[k])
                if more == 0.0:
                    continue
                force[k] += more
                moved = max(moved, abs(more) * stiff[k])
                for end in range(2):
                    digit = digits[k, end]
                    for i in range(3):
                        pushed[digit, i] += ready[digit] * more * lever[k, end, i]
                        goal[digit, i] = clamp(
                            pushed[digit, i], least[digit, i], most[digit, i])
            if moved < EXACT:
                break
        last_force[:] = 0.0
        for k in range(used):
            last_force[pairs[k]] = force[k]
        moved = 0.0
        for digit in range(5):
            for i in range(3):
                # Contacts that slide make it swing: later rounds go half the way.
                share = 1.0 if number < PASS - 4 else 0.5
                step = share * clamp(goal[digit, i] - change[digit, i], -STEP, STEP)
                change[digit, i] += step
                moved = max(moved, abs(step))
            _move(before, lower, upper, slope, digit, change, angles)
        if moved < SETTLED:
            return number + 1
        place_frames(capsules, angles, rotations, positions, ends)
    return rounds


@jit
def _joint(digit, i):
    """Return a digit's abduction (0), first (1) or second (2) flexion as a joint."""
    if i == 0:
        return ABDUCTION_JOINTS[digit]
    return FLEXION_JOINTS[digit, i - 1]


@jit
def _move(before, lower, upper, slope, digit, change, angles):
    """Write a digit's angles, its third flexion following the second."""
    for i in range(3):
        joint = _joint(digit, i)
        angles[joint] = clamp(before[joint] + change[digit, i], lower[joint], upper[joint])
    joint = FLEXION_JOINTS[digit, 2]
    angles[joint] = clamp(
        before[joint] + slope[digit] * change[digit, 2], lower[joint], upper[joint])


@jit
def _overlaps(capsules, ends, tolerance):
    """Return whether any pair overlaps by more than the tolerance."""
    close = close_pairs(capsules, ends, 0.0)
    ends = indexed(ends)
    for pair in close:
        distance = nearest_points(
            axis_of(ends, capsules.first[pair]), axis_of(ends, capsules.second[pair]))[2]
        if capsules.apart[pair] - distance > tolerance:
            return True
    return False


@jit
def _along(segment, share):
    """Return the point at a share of a segment, a pair of vectors."""
    start, end = segment
    return add(start, scale(subtract(end, start), share))


@jit
def _place_lines(capsules, rotations, positions, lines):
    """Write the joints' axes as lines, shape (25, 2, 3): directions, and moments [m]."""
    rotations, positions, axes = indexed(rotations), indexed(positions), indexed(capsules.axis)
    for joint in range(25):
        x, y, z = axes[joint, 0], axes[joint, 1], axes[joint, 2]
        for i in range(3):
            lines[joint, 0, i] = (rotations[0, joint, i, 0] * x + rotations[0, joint, i, 1] * y
                                  + rotations[0, joint, i, 2] * z)
        moment = cross(
            (positions[0, joint, 0], positions[0, joint, 1], positions[0, joint, 2]),
            (lines[joint, 0, 0], lines[joint, 0, 1], lines[joint, 0, 2]))
        for i in range(3):
            lines[joint, 1, i] = moment[i]


@jit
def _linearise(capsules, pair, angles, lower, upper, slope, lines, ends, row, lever):
    """Write the change of a pair's distance by its digits' free angles; return its overlap.

    lever : ndarray, shape (p, 2, 3), a row replaced [m/rad]
    """
    ends = indexed(ends)
    first = axis_of(ends, capsules.first[pair])
    second = axis_of(ends, capsules.second[pair])
    s, t, distance = nearest_points(first, second)
    overlap = float(capsules.apart[pair]) - distance
    if overlap < -NEAR:
        return overlap
    a = _along(first, s)
    b = _along(second, t)
    way = subtract(a, b)
    side = vector(capsules.side[pair])
    normal = unit(way)
    if distance < 1e-9:
        normal = unit(cross(subtract(first[1], first[0]), subtract(second[1], second[0])))
        if dot(normal, side) < 0.0:
            normal = scale(normal, -1.0)
    elif dot(way, side) < 0.0:
        # Gone through each other: back to where they belong.
        normal = scale(normal, -1.0)
        overlap = float(capsules.apart[pair]) + distance
    for end in range(2):
        for i in range(3):
            lever[row, end, i] = 0.0
        digit = capsules.digits[pair, end]
        if digit == PALM_INDEX:
            continue
        link = capsules.link[capsules.first[pair] if end == 0 else capsules.second[pair]]
        # The line along which the pair pushes the digit: direction and moment
        push = normal if end == 0 else scale(normal, -1.0)
        moment = cross(a if end == 0 else b, push)
        for i in range(3):
            joint = _joint(digit, i)
            if joint <= link:
                lever[row, end, i] = _turning(lines, joint, push, moment)
        third = FLEXION_JOINTS[digit, 2]
        if third <= link and lower[third] < angles[third] < upper[third]:
            lever[row, end, 2] += float(slope[digit]) * _turning(lines, third, push, moment)
    return overlap


@jit
def _turning(lines, joint, push, moment):
    """Return how fast a joint moves along a line what is on it [m/rad]: their moment."""
    return (lines[joint, 0, 0] * moment[0] + lines[joint, 0, 1] * moment[1]
            + lines[joint, 0, 2] * moment[2] + lines[joint, 1, 0] * push[0]
            + lines[joint, 1, 1] * push[1] + lines[joint, 1, 2] * push[2])


@jit
def carry(capsules, before, after, hidden, gap, friction, displacement):
    """Write by how much the neighbours that move carry the hidden digits along.

    A capsule of a hidden digit that touched one of a seen digit in the last frame follows
    it: by a share of its movement along the skin, and by all of its movement into the hidden
    digit, for nothing goes through. The palm holds what it touches. Contacts are weighted
    by how close they are, so that none begins or ends with a jump.

    Parameters
    ----------
    capsules : Capsules
    before, after : ndarray, shape (c, 2, 3)
        Capsules of the last pose, and with the seen digits of this frame (`place_capsules`),
        in the wrist's frame [m].
    hidden : ndarray of bool, shape (5,)
    gap : float
        Of the surfaces, below which they touch [m].
    friction : float
        Share of the neighbour's movement, 0 to 1.
    displacement : ndarray, shape (5, 3)
        Of the digits' markers, replaced; zero for seen ones and where nothing touches [m].
    """
    displacement[:] = 0.0
    weights = np.zeros(6)
    for pair in close_pairs(capsules, before, gap):
        first = capsules.first[pair]
        second = capsules.second[pair]
        was_first, was_second = axis_of(before, first), axis_of(before, second)
        s, t, distance = nearest_points(was_first, was_second)
        weight = min(1.0 - (distance - capsules.apart[pair]) / gap, 1.0)
        if weight <= 0.0:
            continue
        for end in range(2):
            digit = capsules.digits[pair, end]
            other = capsules.digits[pair, 1 - end]
            if digit == PALM_INDEX or not hidden[digit] or (other != PALM_INDEX and hidden[other]):
                continue
            row = second if end == 0 else first
            share = t if end == 0 else s
            moved = subtract(_along(axis_of(after, row), share),
                             _along(axis_of(before, row), share))
            # From the neighbour into the hidden digit.
            normal = unit(scale(subtract(_along(was_first, s), _along(was_second, t)),
                                1.0 - 2.0 * end))
            inward = dot(moved, normal)
            moved = add(scale(subtract(moved, scale(normal, inward)), friction),
                        scale(normal, max(inward, 0.0)))
            weights[digit] += weight
            for i in range(3):
                displacement[digit, i] += weight * moved[i]
    for digit in range(5):
        if weights[digit] > 1.0:
            for i in range(3):
                displacement[digit, i] /= weights[digit]
