"""Contact: separate overlapping digits (rigidity), drag hidden ones along (friction).

Both work on a right hand in the wrist's frame, on capsules around its bones (`model.capsules`).
"""

from typing import NamedTuple

import numpy as np

from ..model.capsules import (
    PAIR_COUNT,
    PALM_INDEX,
    Capsules,
    Placement,
    axis_of,
    may_touch,
    nearest_points,
    place_capsules,
    place_digit_capsules,
)
from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS
from ..numerics.jit import jit
from ..numerics.packs import indexed
from ..numerics.stack_memory import local_floats, local_integers
from ..numerics.vectors import Vector, add, clamp, cross, dot, scale, subtract, unit, vector

PENETRATION = .001         # [m] default overlap that rigidity leaves, as flesh yields; ours
CONTACT_GAP = .0015        # [m] between surfaces, below which they touch; unsourced

# Of `separate`, sequential quadratic programming with Hildreth's method inside.
TOLERANCE_SHARE = .95      # [1] of the tolerance is aimed at: iteration leaves a small rest
MAX_ROUNDS = 48            # linearisations of the distances
FRAME_ROUNDS = 6           # the same in a frame whose digits turn little: the next one goes on
MAX_SWEEPS = 30            # of Hildreth's method in a round
ROUNDS_PER_START = 12      # rounds after which it starts again from the present angles
DAMPED_ROUNDS = 4          # last rounds of a start, which go half the way
ROUND_GAP = .006           # [m] of surfaces that a round may bring together
ROUND_OVERLAP = .003       # [m] of an overlap that a round removes
RESTART_OVERLAP = .03      # [m] the same after a start that small steps did not solve
MAX_ROUND_CHANGE = .2      # [rad] of an angle in a round
MAX_SEPARATION_CHANGE = .7  # [rad] of an angle in all
SETTLED_CHANGE = 3e-4      # [rad] largest change of a round that ends the iteration
SETTLED_DISTANCE = 1e-6    # [m] largest change of a sweep that ends a round
CONTACT_COMPLIANCE = 1e-7  # [m²/rad²] bounds the force where limits leave no way out


class Mobility(NamedTuple):
    """Limits, coupling and weights of the digits' angles in a contact.

    Attributes
    ----------
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    slope : ndarray, shape (5,)
        Third flexion over second; 0 where the third is measured [1].
    weight : ndarray, shape (6,)
        Readiness of each digit to move, from 0; 0 of the palm [1].
    """

    lower: np.ndarray
    upper: np.ndarray
    slope: np.ndarray
    weight: np.ndarray


class Contacts(NamedTuple):
    """Contacts of a round, one a row, their distances linearised in the free angles.

    Attributes
    ----------
    pairs : ndarray of int, shape (p,)
        Pair of capsules of each contact.
    digits : ndarray of int, shape (p, 2)
        Digits of its two capsules.
    lever : ndarray, shape (p, 2, 3)
        Derivatives of its distance by their free angles [m/rad].
    bound : ndarray, shape (p,)
        By how much the distance shall grow from the start [m].
    stiff : ndarray, shape (p,)
        By how much it grows for each unit of force [m²/rad²].
    force : ndarray, shape (p,)
        Multiplier of its constraint [rad²/m].
    last_force : ndarray, shape (p,)
        The same of each pair in the round before [rad²/m].
    lines : ndarray, shape (25, 2, 3)
        Axes of the joints, of `_place_lines`: directions and moments [1, m].
    """

    pairs: np.ndarray
    digits: np.ndarray
    lever: np.ndarray
    bound: np.ndarray
    stiff: np.ndarray
    force: np.ndarray
    last_force: np.ndarray
    lines: np.ndarray


class FreeAngles(NamedTuple):
    """Changes of abduction, first and second flexion of each digit, rows; the palm's stays zero.

    Attributes
    ----------
    least, most : ndarray, shape (6, 3)
        Bounds of the changes [rad].
    change : ndarray, shape (6, 3)
        Up to this round [rad].
    pushed, goal : ndarray, shape (6, 3)
        Where the contacts' forces push the angles, and the same within bounds [rad].
    """

    least: np.ndarray
    most: np.ndarray
    change: np.ndarray
    pushed: np.ndarray
    goal: np.ndarray


@jit
def separate(capsules: Capsules, angles: np.ndarray, mobility: Mobility, tolerance: float,
             placement: Placement, most_rounds: int = MAX_ROUNDS) -> int:
    """Move overlapping digits apart, and out of the palm, by the least change of angles.

    Minimises the sum over the free angles (abduction, first and second flexion of each digit;
    the third follows the second) of change² / mobility, subject to the limits and to every
    pair of capsules overlapping by at most the tolerance. The distances are linearised round by
    round, each round's quadratic program is solved by Hildreth's method. Without an overlap
    beyond the tolerance nothing changes, and the change grows from zero with it.

    Parameters
    ----------
    capsules : Capsules
    angles : ndarray, shape (25,)
        Within limits; replaced where digits move [rad].
    mobility : Mobility
        Pairs of digits that are not ready to move, at 0, may overlap.
    tolerance : float
        Overlap that remains [m].
    placement : Placement
        Replaced by that of the angles.
    most_rounds : int, optional

    Returns
    -------
    int
        Rounds used; 0 without an overlap.
    """
    aim = TOLERANCE_SHARE * tolerance
    place_capsules(capsules, angles, placement)
    if not _overlaps(capsules, placement.ends, mobility, aim):
        return 0

    rounds = 0
    removed = ROUND_OVERLAP
    while rounds < most_rounds:
        rounds += _solve_rounds(capsules, angles, mobility, placement, aim, removed,
                                min(most_rounds - rounds, ROUNDS_PER_START))
        if not _overlaps(capsules, placement.ends, mobility, tolerance):
            break
        # Stuck before the tolerance: start again from here with larger steps.
        removed = RESTART_OVERLAP
    return rounds


@jit
def _solve_rounds(capsules: Capsules, angles: np.ndarray, mobility: Mobility, placement: Placement,
                  aim: float, removed: float, rounds: int) -> int:
    """Bring all overlaps to `aim` by the least change of `angles`; return the rounds used.

    Parameters
    ----------
    capsules : Capsules
    angles : ndarray, shape (25,)
        Replaced [rad].
    mobility : Mobility
    placement : Placement
        Of `angles`; goes with them.
    aim : float
        Overlap that remains [m].
    removed : float
        Overlap that a round removes at most [m].
    rounds : int
        At most so many.
    """
    before = local_floats(25)
    for joint in range(25):
        before[joint] = angles[joint]
    free = FreeAngles(
        indexed(local_floats((6, 3))), indexed(local_floats((6, 3))), indexed(local_floats((6, 3))),
        indexed(local_floats((6, 3))), indexed(local_floats((6, 3))))
    _bound_changes(mobility, before, free)
    contacts = Contacts(
        indexed(local_integers(PAIR_COUNT)), indexed(local_integers((PAIR_COUNT, 2))),
        indexed(local_floats((PAIR_COUNT, 2, 3))), indexed(local_floats(PAIR_COUNT)),
        indexed(local_floats(PAIR_COUNT)), indexed(local_floats(PAIR_COUNT)),
        local_floats(PAIR_COUNT), indexed(local_floats((25, 2, 3))))
    for number in range(rounds):
        used = _list_contacts(capsules, angles, mobility, placement, aim, removed, free, contacts)
        _push_apart(contacts, used, mobility, free)
        contacts.last_force[:] = 0.0
        for k in range(used):
            contacts.last_force[contacts.pairs[k]] = contacts.force[k]
        # Sliding contacts make the iteration oscillate: damp its last rounds.
        share = 1.0 if number < rounds - DAMPED_ROUNDS else 0.5
        moved = _change_angles(before, mobility, share, free, angles)
        for digit in range(5):
            if mobility.weight[digit] > 0.0:
                place_digit_capsules(capsules, digit, angles, placement)
        if moved < SETTLED_CHANGE:
            return number + 1
    return rounds


@jit
def _bound_changes(mobility: Mobility, before: np.ndarray, free: FreeAngles) -> None:
    """Write the bounds of the changes of angles (25,)."""
    for digit in range(5):
        for i in range(3):
            joint = _joint(digit, i)
            free.least[digit, i] = max(
                mobility.lower[joint] - before[joint], -MAX_SEPARATION_CHANGE)
            free.most[digit, i] = min(
                mobility.upper[joint] - before[joint], MAX_SEPARATION_CHANGE)


@jit
def _list_contacts(capsules: Capsules, angles: np.ndarray, mobility: Mobility,
                   placement: Placement, aim: float, removed: float, free: FreeAngles,
                   contacts: Contacts) -> int:
    """List and linearise the contacts of a round, pushed as in the last one; return their number.

    Parameters are those of `_solve_rounds`; `pushed` of `free`, and `contacts`, are replaced.
    """
    for digit in range(5):
        if mobility.weight[digit] > 0.0:
            _place_lines(capsules, digit, placement, contacts.lines)
    used = 0
    for digit in range(5):
        for i in range(3):
            free.pushed[digit, i] = 0.0
    ends = indexed(placement.ends)
    for pair in range(PAIR_COUNT):
        if not (_gives_way(capsules, pair, mobility)
                and may_touch(capsules, ends, pair, ROUND_GAP)):
            continue
        overlap = _linearise(capsules, pair, angles, mobility, contacts.lines, ends, used,
                             contacts.lever)
        if overlap < -ROUND_GAP:
            continue
        contacts.force[used] = contacts.last_force[pair]
        size = 0.0
        past = 0.0
        for end in range(2):
            digit = contacts.digits[used, end] = capsules.digits[pair, end]
            weight = mobility.weight[digit]
            if weight == 0.0:
                continue
            for i in range(3):
                lever = contacts.lever[used, end, i]
                size += weight * lever ** 2
                past += lever * free.change[digit, i]
                free.pushed[digit, i] += weight * contacts.force[used] * lever
        contacts.bound[used] = min(overlap - aim, removed) + past
        contacts.stiff[used] = size + CONTACT_COMPLIANCE
        contacts.pairs[used] = pair
        used += 1
    return used


@jit
def _push_apart(contacts: Contacts, used: int, mobility: Mobility, free: FreeAngles) -> None:
    """Solve a round's quadratic programme by Hildreth's method, in `free.goal`."""
    for digit in range(5):
        for i in range(3):
            free.goal[digit, i] = clamp(
                free.pushed[digit, i], free.least[digit, i], free.most[digit, i])
    for _ in range(MAX_SWEEPS):
        moved = 0.0
        for k in range(used):
            gained = CONTACT_COMPLIANCE * contacts.force[k]
            for end in range(2):
                digit = contacts.digits[k, end]
                if mobility.weight[digit] == 0.0:
                    continue
                for i in range(3):
                    gained += contacts.lever[k, end, i] * free.goal[digit, i]
            if gained >= contacts.bound[k] and contacts.force[k] == 0.0:
                continue
            more = max((contacts.bound[k] - gained) / contacts.stiff[k], -contacts.force[k])
            contacts.force[k] += more
            moved = max(moved, abs(more) * contacts.stiff[k])
            for end in range(2):
                digit = contacts.digits[k, end]
                weight = mobility.weight[digit]
                if weight == 0.0:
                    continue
                for i in range(3):
                    free.pushed[digit, i] += weight * more * contacts.lever[k, end, i]
                    free.goal[digit, i] = clamp(
                        free.pushed[digit, i], free.least[digit, i], free.most[digit, i])
        if moved < SETTLED_DISTANCE:
            break


@jit
def _change_angles(before: np.ndarray, mobility: Mobility, share: float, free: FreeAngles,
                   angles: np.ndarray) -> float:
    """Go a share of the way to a round's goal; return the largest change of an angle [rad].

    `before` and `angles`, replaced, are (25,) [rad].
    """
    moved = 0.0
    for digit in range(5):
        if mobility.weight[digit] == 0.0:
            continue
        for i in range(3):
            step = share * clamp(free.goal[digit, i] - free.change[digit, i], -MAX_ROUND_CHANGE,
                                 MAX_ROUND_CHANGE)
            free.change[digit, i] += step
            moved = max(moved, abs(step))
        _move_digit(before, mobility, digit, free.change, angles)
    return moved


@jit
def _joint(digit: int, i: int) -> int:
    """Return a digit's abduction (0), first (1) or second (2) flexion as a joint."""
    if i == 0:
        return ABDUCTION_JOINTS[digit]
    return FLEXION_JOINTS[digit, i - 1]


@jit
def _move_digit(before: np.ndarray, mobility: Mobility, digit: int, change: np.ndarray,
                angles: np.ndarray) -> None:
    """Write a digit's angles, changed within limits; its third flexion follows the second."""
    lower, upper = mobility.lower, mobility.upper
    for i in range(3):
        joint = _joint(digit, i)
        angles[joint] = clamp(before[joint] + change[digit, i], lower[joint], upper[joint])
    joint = FLEXION_JOINTS[digit, 2]
    angles[joint] = clamp(
        before[joint] + mobility.slope[digit] * change[digit, 2], lower[joint], upper[joint])


@jit
def _gives_way(capsules: Capsules, pair: int, mobility: Mobility) -> bool:
    """Return whether a digit of a pair may move."""
    first, second = capsules.digits[pair, 0], capsules.digits[pair, 1]
    return mobility.weight[first] + mobility.weight[second] > 0.0


@jit
def _overlaps(capsules: Capsules, ends: np.ndarray, mobility: Mobility,
              tolerance: float) -> bool:
    """Return whether any pair that gives way overlaps by more than the tolerance."""
    ends = indexed(ends)
    for pair in range(PAIR_COUNT):
        if not (_gives_way(capsules, pair, mobility)
                and may_touch(capsules, ends, pair, 0.0)):
            continue
        distance = nearest_points(
            axis_of(ends, capsules.first[pair]), axis_of(ends, capsules.second[pair]))[2]
        if capsules.apart[pair] - distance > tolerance:
            return True
    return False


@jit
def _along(segment: tuple[Vector, Vector], share: float) -> Vector:
    """Return the point at a share [0, 1] of a segment, a pair of vectors [m]."""
    start, end = segment
    return add(start, scale(subtract(end, start), share))


@jit
def _place_lines(capsules: Capsules, digit: int, placement: Placement, lines: np.ndarray) -> None:
    """Write a digit's axes as Plücker lines, of shape (25, 2, 3): directions, moments [m]."""
    rotations, positions, axes = (indexed(placement.rotations), indexed(placement.positions),
                                  indexed(capsules.axis))
    for joint in range(5 * digit, 5 * digit + 5):
        x, y, z = axes[joint, 0], axes[joint, 1], axes[joint, 2]
        for i in range(3):
            lines[joint, 0, i] = (rotations[joint, i, 0] * x + rotations[joint, i, 1] * y
                                  + rotations[joint, i, 2] * z)
        moment = cross(
            (positions[joint, 0], positions[joint, 1], positions[joint, 2]),
            (lines[joint, 0, 0], lines[joint, 0, 1], lines[joint, 0, 2]))
        for i in range(3):
            lines[joint, 1, i] = moment[i]


@jit
def _linearise(capsules: Capsules, pair: int, angles: np.ndarray, mobility: Mobility,
               lines: np.ndarray, ends: np.ndarray, row: int, lever: np.ndarray) -> float:
    """Write the derivative of a pair's distance by the free angles of digits that may move.

    Parameters
    ----------
    capsules : Capsules
    pair : int
    angles : ndarray, shape (25,)
        [rad]
    mobility : Mobility
    lines : ndarray, shape (25, 2, 3)
        Of `_place_lines`.
    ends : ndarray, shape (c, 3, 3)
        Of `Placement`, `indexed` [m].
    row : int
    lever : ndarray, shape (p, 2, 3)
        Its row is replaced, for both digits of the pair [m/rad].

    Returns
    -------
    float
        Overlap of the pair, negative for a gap [m].
    """
    lower, upper, slope = mobility.lower, mobility.upper, mobility.slope
    first = axis_of(ends, capsules.first[pair])
    second = axis_of(ends, capsules.second[pair])
    s, t, distance = nearest_points(first, second)
    overlap = float(capsules.apart[pair]) - distance
    if overlap < -ROUND_GAP:
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
        # They passed through each other: push them back.
        normal = scale(normal, -1.0)
        overlap = float(capsules.apart[pair]) + distance
    for end in range(2):
        digit = capsules.digits[pair, end]
        if mobility.weight[digit] == 0.0:
            continue
        for i in range(3):
            lever[row, end, i] = 0.0
        link = capsules.link[capsules.first[pair] if end == 0 else capsules.second[pair]]
        # The line of the pair's force on the digit: direction and moment
        push = normal if end == 0 else scale(normal, -1.0)
        moment = cross(a if end == 0 else b, push)
        for i in range(3):
            joint = _joint(digit, i)
            if joint <= link:
                lever[row, end, i] = _velocity_along(lines, joint, push, moment)
        third = FLEXION_JOINTS[digit, 2]
        if third <= link and lower[third] < angles[third] < upper[third]:
            lever[row, end, 2] += float(slope[digit]) * _velocity_along(lines, third, push, moment)
    return overlap


@jit
def _velocity_along(lines: np.ndarray, joint: int, push: Vector, moment: Vector) -> float:
    """Return the speed along a line per turn of a joint: the two lines' moment [m/rad]."""
    return (lines[joint, 0, 0] * moment[0] + lines[joint, 0, 1] * moment[1]
            + lines[joint, 0, 2] * moment[2] + lines[joint, 1, 0] * push[0]
            + lines[joint, 1, 1] * push[1] + lines[joint, 1, 2] * push[2])


@jit
def drag_hidden(capsules: Capsules, before: np.ndarray, after: np.ndarray, seen: np.ndarray,
                gap: float, friction: float, displacement: np.ndarray) -> None:
    """Write the displacement of hidden digits by the seen digits that touch them.

    A capsule of a hidden digit that touched one of a seen digit in the last frame follows
    it: by a share of the neighbour's tangential motion (friction), and by all of its motion
    into the hidden digit. Contacts with the palm, which rests, hold a digit. The closeness of a
    contact is its weight, so that none begins or ends with a jump.

    Parameters
    ----------
    capsules : Capsules
    before, after : ndarray, shape (c, 3, 3)
        Capsules (of a `Placement`) in the last frame and with this frame's seen digits, in
        the wrist's frame [m].
    seen : ndarray of bool, shape (5,)
    gap : float
        Between surfaces, below which they touch [m].
    friction : float
        Share of the neighbour's tangential motion, 0 to 1 [1].
    displacement : ndarray, shape (5, 3)
        Of the digits' markers, replaced; zero for seen ones and without a contact [m].
    """
    displacement[:] = 0.0
    before, after = indexed(before), indexed(after)
    weights = local_floats(6)
    for pair in range(PAIR_COUNT):
        a, b = capsules.digits[pair, 0], capsules.digits[pair, 1]
        # One is hidden, and the other seen or the palm.
        is_dragging = not seen[a] if b == PALM_INDEX else seen[a] != seen[b]
        if not (is_dragging and may_touch(capsules, before, pair, gap)):
            continue
        first = capsules.first[pair]
        second = capsules.second[pair]
        was_first, was_second = axis_of(before, first), axis_of(before, second)
        s, t, distance = nearest_points(was_first, was_second)
        weight = min(1.0 - (distance - capsules.apart[pair]) / gap, 1.0)
        if weight <= 0.0:
            continue
        for end in range(2):
            digit = capsules.digits[pair, end]
            if digit == PALM_INDEX or seen[digit]:
                continue
            row = second if end == 0 else first
            share = t if end == 0 else s
            moved = subtract(_along(axis_of(after, row), share),
                             _along(axis_of(before, row), share))
            # Unit vector from the neighbour into the hidden digit
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
