"""Contact of the digits: none goes through another or the palm, and the hidden are carried.

Both stages work on a right hand in the wrist's frame, after its digits are solved.
"""

import numpy as np

from .capsules import PALM, far_apart, nearest_points, place_frames
from .digit import ABDUCTION, FLEXION
from .jit import jit
from .vectors import add, clamp, cross, dot, scale, subtract, unit, vector

PENETRATION = .001   # [m] that flesh gives way
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
FRICTION = .5        # share of the neighbour's movement along the skin


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
    least = np.zeros((6, 3))
    most = np.zeros((6, 3))
    ready = np.zeros(6)
    for digit in range(5):
        ready[digit] = mobility[digit]
        for i in range(3):
            joint = _joint(digit, i)
            least[digit, i] = max(lower[joint] - before[joint], -FARTHEST)
            most[digit, i] = min(upper[joint] - before[joint], FARTHEST)
    change = np.zeros((6, 3))
    pushed = np.zeros((6, 3))
    goal = np.zeros((6, 3))
    lever = np.zeros((count, 2, 3))
    force = np.zeros(count)
    bound = np.empty(count)
    stiff = np.empty(count)
    active = np.empty(count, dtype=np.int64)
    for number in range(rounds):
        used = 0
        pushed[:] = 0.0
        for pair in range(count):
            overlap = _linearise(capsules, pair, angles, lower, upper, slope, rotations,
                                 positions, ends, lever[pair])
            if overlap < -NEAR:
                force[pair] = 0.0
                continue
            size = 0.0
            past = 0.0
            for end in range(2):
                digit = capsules.digits[pair, end]
                for i in range(3):
                    size += ready[digit] * lever[pair, end, i] ** 2
                    past += lever[pair, end, i] * change[digit, i]
                    pushed[digit, i] += ready[digit] * force[pair] * lever[pair, end, i]
            bound[pair] = min(overlap - aim, climb) + past
            stiff[pair] = size + SOFT
            active[used] = pair
            used += 1
        for digit in range(6):
            for i in range(3):
                goal[digit, i] = clamp(pushed[digit, i], least[digit, i], most[digit, i])
        for _ in range(SWEEPS):
            moved = 0.0
            for k in range(used):
                pair = active[k]
                gained = SOFT * force[pair]
                for end in range(2):
                    digit = capsules.digits[pair, end]
                    for i in range(3):
                        gained += lever[pair, end, i] * goal[digit, i]
                more = max((bound[pair] - gained) / stiff[pair], -force[pair])
                if more == 0.0:
                    continue
                force[pair] += more
                moved = max(moved, abs(more) * stiff[pair])
                for end in range(2):
                    digit = capsules.digits[pair, end]
                    for i in range(3):
                        pushed[digit, i] += ready[digit] * more * lever[pair, end, i]
                        goal[digit, i] = clamp(
                            pushed[digit, i], least[digit, i], most[digit, i])
            if moved < EXACT:
                break
        moved = 0.0
        for digit in range(5):
            for i in range(3):
                # Contacts that slide make it swing: later rounds go half the way.
                share = 1.0 if number < PASS - 4 else 0.5
                step = share * clamp(goal[digit, i] - change[digit, i], -STEP, STEP)
                change[digit, i] += step
                moved = max(moved, abs(step))
            _move(before, lower, upper, slope, digit, change[digit], angles)
        if moved < SETTLED:
            return number + 1
        place_frames(capsules, angles, rotations, positions, ends)
    return rounds


@jit
def _joint(digit, i):
    """Return a digit's abduction (0), first (1) or second (2) flexion as a joint."""
    if i == 0:
        return ABDUCTION[digit]
    return FLEXION[digit, i - 1]


@jit
def _move(before, lower, upper, slope, digit, change, angles):
    """Write a digit's angles, its third flexion following the second."""
    for i in range(3):
        joint = _joint(digit, i)
        angles[joint] = clamp(before[joint] + change[i], lower[joint], upper[joint])
    joint = FLEXION[digit, 2]
    angles[joint] = clamp(
        before[joint] + slope[digit] * change[2], lower[joint], upper[joint])


@jit
def _overlaps(capsules, ends, tolerance):
    """Return whether any pair overlaps by more than the tolerance."""
    for pair in range(capsules.first.size):
        if far_apart(capsules, pair, ends, 0.0):
            continue
        distance = nearest_points(ends[capsules.first[pair]], ends[capsules.second[pair]])[2]
        if capsules.apart[pair] - distance > tolerance:
            return True
    return False


@jit
def _along(segment, share):
    """Return the point at a share of a segment (2, 3)."""
    start = vector(segment[0])
    return add(start, scale(subtract(vector(segment[1]), start), share))


@jit
def _linearise(capsules, pair, angles, lower, upper, slope, rotations, positions, ends, lever):
    """Write the change of a pair's distance by its digits' free angles; return its overlap.

    lever : ndarray, shape (2, 3), replaced [m/rad]
    """
    first = capsules.first[pair]
    second = capsules.second[pair]
    if far_apart(capsules, pair, ends, NEAR):
        return -2.0 * NEAR
    s, t, distance = nearest_points(ends[first], ends[second])
    lever[:] = 0.0
    overlap = capsules.apart[pair] - distance
    if overlap < -NEAR:
        return overlap
    a = _along(ends[first], s)
    b = _along(ends[second], t)
    way = subtract(a, b)
    side = vector(capsules.side[pair])
    normal = unit(way)
    if distance < 1e-9:
        normal = unit(cross(subtract(_along(ends[first], 1.0), _along(ends[first], 0.0)),
                            subtract(_along(ends[second], 1.0), _along(ends[second], 0.0))))
        if dot(normal, side) < 0.0:
            normal = scale(normal, -1.0)
    elif dot(way, side) < 0.0:
        # Gone through each other: back to where they belong.
        normal = scale(normal, -1.0)
        overlap = capsules.apart[pair] + distance
    for end in range(2):
        digit = capsules.digits[pair, end]
        if digit == PALM:
            continue
        link = capsules.link[first if end == 0 else second]
        point = a if end == 0 else b
        sign = 1.0 if end == 0 else -1.0
        for i in range(3):
            joint = _joint(digit, i)
            if joint <= link:
                lever[end, i] = sign * _turning(
                    capsules, joint, rotations, positions, point, normal)
        third = FLEXION[digit, 2]
        if third <= link and lower[third] < angles[third] < upper[third]:
            lever[end, 2] += sign * slope[digit] * _turning(
                capsules, third, rotations, positions, point, normal)
    return overlap


@jit
def _turning(capsules, joint, rotations, positions, point, normal):
    """Return how fast a joint moves a point along a direction [m/rad]."""
    x, y, z = vector(capsules.axis[joint])
    turn = rotations[0, joint]
    axis = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
            turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
            turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z)
    return dot(cross(axis, subtract(point, vector(positions[0, joint]))), normal)


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
    for pair in range(capsules.first.size):
        if far_apart(capsules, pair, before, gap):
            continue
        first = capsules.first[pair]
        second = capsules.second[pair]
        s, t, distance = nearest_points(before[first], before[second])
        weight = min(1.0 - (distance - capsules.apart[pair]) / gap, 1.0)
        if weight <= 0.0:
            continue
        for end in range(2):
            digit = capsules.digits[pair, end]
            other = capsules.digits[pair, 1 - end]
            if digit == PALM or not hidden[digit] or (other != PALM and hidden[other]):
                continue
            row = second if end == 0 else first
            share = t if end == 0 else s
            moved = subtract(_along(after[row], share), _along(before[row], share))
            # From the neighbour into the hidden digit.
            normal = unit(scale(subtract(_along(before[first], s), _along(before[second], t)),
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
