"""Inverse kinematics of a digit: abduction plane, flexion, intradigital correlation.

The thumb is solved like a finger; only the abduction axis and the rest direction of its saddle
joint are its own (`Hand`), where the paper puts its plane through the index MCP.
"""
# mypy: allow-redefinition

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, JOINTS, Hand
from ..model.kinematics import ABDUCTION_SIGN, digit_base
from ..model.marker_layout import MARKERS, Mounting
from ..numerics.jit import jit
from ..numerics.packs import Pack, packed
from ..numerics.vectors import Vector, clamp, components, frame, rotate, subtract, vector
from .abduction_plane import in_plane, plane_abduction
from .fabrik import fabrik
from .flexion import (
    Linkage,
    NaturalFlexion,
    chain_end,
    choose_three_bone,
    coupled_angle,
    coupled_end,
    flexion_of,
    solve_three_bone,
    solve_two_bone,
    straightest,
)

OUT_OF_PLANE_ROUNDS = 5  # solutions of a digit that leaves its plane, each nearer than the last
CHAIN_JOINTS = 5  # of a digit, the first of a finger its CMC flexion
THUMB = 4         # among the digits
MEASURED_SPREAD = .01    # [rad] of a last joint that a sensor measures
THUMB_MCP_ABDUCTION_JOINT = JOINTS.index('thumb_mcp_abduction')


class Chains(NamedTuple):
    """Chains of the five digits for inverse kinematics, of a right hand.

    Attributes
    ----------
    root : ndarray, shape (5, 3)
        First joint of each chain, in the wrist's frame [m].
    base : ndarray, shape (5, 3, 3)
        Rotation from the chain's base to the wrist's frame (`digit_base`).
    tilt : ndarray, shape (5,)
        Flexion of the rest direction in the base [rad].
    hinges : ndarray of int, shape (5,)
        Hinges of flexion up to the marker, 2 or 3.
    bones : ndarray, shape (5, 3)
        Distances hinge to hinge, the last of `hinges` to the marker [m].
    length : ndarray, shape (5,)
        Of the chain from its root to the marker, stretched [m].
    droop : ndarray, shape (5,)
        Flexion of the marker seen from its hinge at zero angle [rad].
    lateral : ndarray, shape (5,)
        Distance of the marker from the plane, along y [m].
    start : ndarray, shape (5,)
        Second flexion of a coupled chain at its `straightest` [rad].
    sign : ndarray, shape (5,)
        Sign of abduction as a turn about z.
    turn_limits : ndarray, shape (5, 2)
        Least and greatest turn about z, by the limits of abduction [rad].
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    coupling : ndarray, shape (5, 2)
        Slope and offset of the third flexion over the second [1, rad].
    coupling_spread : ndarray, shape (5,)
        Standard deviation of the last joint from its coupling, or as it is measured [rad].
    natural : ndarray, shape (5, 3)
        Slope, offset and spread of the second flexion over the first [1, rad, rad].
    skin : ndarray, shape (5,)
        Standard deviation of the marker from its place, by motion of the skin; 0 if unknown [m].
    measured : ndarray of bool, shape (5,)
        Whether a measured last joint replaces the coupling.
    aside, roll : ndarray, shape (5,)
        Abduction of the second hinge, and turn of its axes about the first bone, by which what
        is behind it leaves the plane [rad].
    advance : ndarray, shape (5,)
        Distance of the first hinge of flexion from the axis of abduction [m].
    is_planar : ndarray of bool, shape (5,)
        Whether these three are zero.
    """

    root: np.ndarray
    base: np.ndarray
    tilt: np.ndarray
    hinges: np.ndarray
    bones: np.ndarray
    length: np.ndarray
    droop: np.ndarray
    lateral: np.ndarray
    start: np.ndarray
    sign: np.ndarray
    turn_limits: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    coupling: np.ndarray
    coupling_spread: np.ndarray
    natural: np.ndarray
    skin: np.ndarray
    measured: np.ndarray
    aside: np.ndarray
    roll: np.ndarray
    advance: np.ndarray
    is_planar: np.ndarray


def digit_chains(hand: Hand, mounting: Mounting) -> Chains:
    """Return the chains of a right hand's digits with their markers.

    Parameters
    ----------
    hand : Hand
        Of the right side.
    mounting : Mounting
        Of the same hand.

    Returns
    -------
    Chains
    """
    base, root, tilt = (np.array(part) for part in zip(
        *(digit_base(hand, digit) for digit in range(5))))
    markers = mounting.position[MARKERS.index('index'):]
    links = mounting.link[MARKERS.index('index'):]
    third = links % 5 == 4  # the distal link is the last of a digit's five
    ends = hand.bone_ends()
    bones = ends[:, :, 0].copy()
    lateral = markers[:, 1] + np.where(third, ends[:, 1, 1], 0.)
    bones[np.arange(5), np.where(third, 2, 1)] = np.hypot(markers[:, 0], markers[:, 2])
    droop = np.arctan2(-markers[:, 2], markers[:, 0])
    hinges = np.where(third, 3, 2)
    length = (bones * (np.arange(3) < hinges[:, None])).sum(axis=1)
    aside, roll, advance = np.zeros((3, 5))
    aside[THUMB] = np.clip(hand.thumb_mcp_abduction, *hand.limits[THUMB_MCP_ABDUCTION_JOINT])
    roll[THUMB], advance[THUMB] = hand.thumb_roll, hand.thumb_axis_distance
    length += advance
    lower, upper = hand.limits.T.copy()
    sign = np.array(ABDUCTION_SIGN)
    turn_limits = np.sort(sign[:, None] * hand.limits[ABDUCTION_JOINTS], axis=1)
    pack, found = packed(Chains(
        root, base, tilt, hinges, bones, length, droop, lateral, np.zeros(5),
        sign, turn_limits, lower, upper, hand.coupling.copy(), hand.coupling_spread.copy(),
        hand.natural_flexion.copy(), mounting.deviation[MARKERS.index('index'):].copy(),
        np.zeros(5, dtype=bool), aside, roll, advance,
        (aside == 0.) & (roll == 0.) & (advance == 0.)))
    find_starts(pack)
    return found


def reach(chains: Chains) -> np.ndarray:
    """Return how far each digit's marker can be from the root of its chain, shape (5,) [m]."""
    return np.hypot(chains.length, chains.lateral)


@jit
def find_starts(chains: Pack[Chains]) -> None:
    """Find the `start` of the digits whose marker is on their last bone."""
    chains = chains[0]
    for digit in range(5):
        if chains.hinges[digit] == 3:
            chains.start[digit] = straightest(linkage_of(chains, digit))


@jit
def override_coupling(chains: Pack[Chains], distal_flexion: np.ndarray,
                      measured: Pack[Chains]) -> None:
    """Replace the couplings of last joints by measured flexions.

    Parameters
    ----------
    chains : packed Chains
    distal_flexion : ndarray, shape (5,)
        Clamped to the joints' limits; NaN where not measured [rad].
    measured : packed Chains
        Equal to `chains`; its `coupling`, `coupling_spread`, `measured` and `start` are replaced.
    """
    chains, measured = chains[0], measured[0]
    for digit in range(5):
        last = FLEXION_JOINTS[digit, 2]
        slope, offset = chains.coupling[digit, 0], chains.coupling[digit, 1]
        spread = chains.coupling_spread[digit]
        known = math.isfinite(distal_flexion[digit])
        if known:
            slope, spread = 0., MEASURED_SPREAD
            offset = clamp(distal_flexion[digit], chains.lower[last], chains.upper[last])
        measured.measured[digit] = known
        measured.coupling_spread[digit] = spread
        measured.coupling[digit, 0] = slope
        measured.coupling[digit, 1] = offset
        measured.start[digit] = (
            straightest(linkage_of(measured, digit)) if known and chains.hinges[digit] == 3
            else chains.start[digit])


@jit
def linkage_of(chains: Chains, digit: int) -> Linkage:
    """Return the `Linkage` of a digit's flexions."""
    bones = chains.bones[digit]
    first, second, third = FLEXION_JOINTS[digit]
    lower, upper = chains.lower, chains.upper
    return Linkage((bones[0], bones[1], bones[2]), chains.droop[digit],
                   (lower[first], lower[second], lower[third]),
                   (upper[first], upper[second], upper[third]),
                   chains.coupling[digit, 0], chains.coupling[digit, 1], chains.hinges[digit])


@jit
def natural_flexion_of(chains: Chains, digit: int) -> NaturalFlexion:
    """Return the `NaturalFlexion` of a digit."""
    natural = chains.natural[digit]
    return NaturalFlexion(natural[0], natural[1], natural[2],
                          0. if digit == THUMB else -math.inf)


@jit
def _solve_digit(chains: Chains, digit: int, target: Vector, angles: np.ndarray, step: float,
                 by_fabrik: bool, tolerance: float, iterations: int) -> int:
    """Solve one digit's angles for its marker.

    Parameters
    ----------
    chains : Chains
    digit : int
        0 to 4, index finger to thumb.
    target : vector
        The marker from the chain's root, in the wrist's frame [m].
    angles : ndarray, shape (25,)
        Previous angles; the digit's are replaced [rad].
    step : float
        Since the previous angles, `REFERENCE_STEP` where no time passes [s].
    by_fabrik : bool
        FABRIK instead of the closed form.
    tolerance, iterations : float, int
        Bounds of FABRIK's iteration [m, 1].

    Returns
    -------
    int
        Iterations of FABRIK.
    """
    abduction = ABDUCTION_JOINTS[digit]
    first, second, third = FLEXION_JOINTS[digit]
    lower = chains.lower
    upper = chains.upper
    hinges = chains.hinges[digit]
    linkage = linkage_of(chains, digit)
    sign = chains.sign[digit]

    target = components(frame(chains.base[digit]), target)
    least, most = chains.turn_limits[digit]
    turn = plane_abduction(target, chains.lateral[digit], chains.length[digit], least, most,
                           sign * angles[abduction], step)
    angles[abduction] = sign * turn
    # In the frame of the rest direction flexion starts at zero.
    along, height = in_plane(target, turn, chains.tilt[digit])
    used = 0
    if by_fabrik:
        angles[first], angles[second], used = fabrik(
            along, height, linkage, (angles[first], angles[second]), tolerance, iterations)
    elif hinges == 2:
        angles[first], angles[second] = solve_two_bone(
            along, height, linkage, natural_flexion_of(chains, digit), angles[second], step)
    elif chains.skin[digit] > 0.0:
        angles[first], angles[second], angles[third] = choose_three_bone(
            along, height, linkage, chains.start[digit], natural_flexion_of(chains, digit),
            angles[second], step)
    else:
        angles[first], angles[second], angles[third] = solve_three_bone(
            along, height, linkage, chains.start[digit])
    if hinges == 2 or by_fabrik:
        angles[third] = coupled_angle(linkage, angles[second])
    # Rounding of droop and sign may step past a limit.
    for joint in (abduction, first, second, third):
        angles[joint] = clamp(angles[joint], lower[joint], upper[joint])
    return used


@jit
def planar_marker(chains: Chains, digit: int, marker: Vector, angles: np.ndarray) -> Vector:
    """Return where a marker would be if all bones of its digit lay in the plane of abduction.

    The planar digit bends like the true one. As the place depends on the bend, and the bend is
    solved for the place, they are found in rounds.

    Parameters
    ----------
    chains : Chains
    digit : int
    marker : vector
        In the digit's base [m].
    angles : ndarray, shape (25,)
        Of which those of second and third flexion count [rad].

    Returns
    -------
    vector
        In the digit's base [m].
    """
    _, second, third = FLEXION_JOINTS[digit]
    linkage = linkage_of(chains, digit)
    if chains.hinges[digit] == 3:
        end, below = coupled_end(linkage, angles[second], angles[third])
    else:
        end, below = chain_end(linkage, angles[second])
    ahead, beside = end - linkage.bones[0], chains.lateral[digit]
    aside = chains.sign[digit] * chains.aside[digit]
    c, s = math.cos(aside), math.sin(aside)
    along, across = c * ahead - s * beside, s * ahead + c * beside
    c, s = math.cos(chains.roll[digit]), math.sin(chains.roll[digit])
    forward, lateral = along + linkage.bones[0], c * across + s * below
    down = c * below - s * across

    x, y, height = marker
    level = math.sqrt(x * x + y * y)
    sense = math.copysign(1., x)
    distance = sense * math.sqrt(max(level * level - lateral * lateral, 0.)) - chains.advance[digit]
    reach = math.sqrt(max(distance * distance + height * height + end * end + below * below
                          - forward * forward - down * down, 0.))
    bend = flexion_of(distance, height) + math.atan2(below, end) - math.atan2(down, forward)
    turn = math.atan2(sense * y, abs(x))
    if level > 0.:
        turn -= math.asin(clamp(sense * lateral / level, -1., 1.))
    distance, height = reach * math.cos(bend), -reach * math.sin(bend)
    c, s = math.cos(turn), math.sin(turn)
    return c * distance - s * beside, s * distance + c * beside, height


@jit
def solve_digits(chains: Chains, roots: np.ndarray, markers: np.ndarray, angles: np.ndarray,
                 step: float, by_fabrik: bool, tolerance: float, iterations: int) -> int:
    """Solve the five digits, index finger to thumb.

    Parameters
    ----------
    chains : Chains
    roots, markers : ndarray, shape (5, 3)
        First joints and markers of the digits, in the wrist's frame [m].
    angles : ndarray, shape (25,)
        Previous angles, replaced [rad].
    step, by_fabrik, tolerance, iterations
        As for `_solve_digit`.

    Returns
    -------
    int
        Iterations of FABRIK, over all digits.
    """
    used = 0
    for digit in range(5):
        target = subtract(vector(markers[digit]), vector(roots[digit]))
        used += solve_rooted_digit(chains, digit, target, angles, step, by_fabrik, tolerance,
                                   iterations)
    return used


@jit
def solve_rooted_digit(chains: Chains, digit: int, target: Vector, angles: np.ndarray,
                       step: float, by_fabrik: bool, tolerance: float, iterations: int) -> int:
    """Solve a digit for its marker's place from its first joint, in the wrist's frame [m].

    Parameters and returned value are as for `_solve_digit`, but that bones may leave the plane;
    `angles` are all of the hand, shape (25,), of which the digit's are changed [rad].
    """
    used = 0
    if chains.is_planar[digit]:
        used = _solve_digit(chains, digit, target, angles, step, by_fabrik, tolerance, iterations)
    else:
        joints = (ABDUCTION_JOINTS[digit], FLEXION_JOINTS[digit, 0], FLEXION_JOINTS[digit, 1],
                  FLEXION_JOINTS[digit, 2])
        before = angles[joints[0]], angles[joints[1]], angles[joints[2]], angles[joints[3]]
        base = frame(chains.base[digit])
        marker = components(base, target)
        for _ in range(OUT_OF_PLANE_ROUNDS):
            flat = rotate(base, planar_marker(chains, digit, marker, angles))
            # Each round goes on from the last frame, not from the round before.
            for i in range(4):
                angles[joints[i]] = before[i]
            used += _solve_digit(chains, digit, flat, angles, step, by_fabrik, tolerance,
                                 iterations)
    if digit == THUMB:
        angles[THUMB_MCP_ABDUCTION_JOINT] = chains.aside[digit]
    return used
