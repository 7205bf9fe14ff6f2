"""Inverse kinematics of a digit: abduction plane, flexion, intradigital correlation.

The thumb is solved like a finger; only the abduction axis and the rest direction of its saddle
joint are its own (`Hand`), where the paper puts its plane through the index MCP.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, Hand
from ..model.kinematics import ABDUCTION_SIGN, digit_base
from ..model.marker_layout import MARKERS, Mounting
from ..numerics.jit import jit, packed
from ..numerics.vectors import Vector, clamp, components, frame, vector
from .abduction_plane import plane_abduction
from .fabrik import fabrik
from .three_bone import choose_three_bone, coupled_angle, solve_three_bone, straightest
from .two_bone import Linkage, NaturalFlexion, solve_two_bone

Pack = Any  # sequence of one record, from `numerics.jit.packed`


class Chains(NamedTuple):
    """Chains of the five digits for inverse kinematics, of a right hand.

    Attributes
    ----------
    root : ndarray, shape (5, 3)
        Joint at which each chain starts, in the wrist's frame [m].
    base : ndarray, shape (5, 3, 3)
        Rotation from the chain's base to the wrist's frame (`digit_base`).
    tilt : ndarray, shape (5,)
        Flexion of the rest direction in the base [rad].
    hinges : ndarray of int, shape (5,)
        Hinges of flexion up to the marker, 2 or 3.
    bones : ndarray, shape (5, 3)
        Distances hinge to hinge, the last of `hinges` to the marker [m].
    droop : ndarray, shape (5,)
        Flexion of the marker seen from its hinge at zero angle [rad].
    lateral : ndarray, shape (5,)
        Distance of the marker from the plane, along y [m].
    start : ndarray, shape (5,)
        Second flexion at which a coupled chain is `straightest` [rad].
    sign : ndarray, shape (5,)
        Sign of a turn about z that abducts.
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    coupling : ndarray, shape (5, 2)
        Slope and offset of the third flexion over the second [1, rad].
    natural : ndarray, shape (5, 3)
        Slope, offset and spread of the second flexion over the first [1, rad, rad].
    skin : ndarray, shape (5,)
        Standard deviation of the marker from its place, by skin that moves; 0 where unknown [m].
    measured : ndarray of bool, shape (5,)
        Whether a measured last joint replaces the coupling.
    """

    root: np.ndarray
    base: np.ndarray
    tilt: np.ndarray
    hinges: np.ndarray
    bones: np.ndarray
    droop: np.ndarray
    lateral: np.ndarray
    start: np.ndarray
    sign: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    coupling: np.ndarray
    natural: np.ndarray
    skin: np.ndarray
    measured: np.ndarray


def chains(hand: Hand, mounting: Mounting) -> Chains:
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
    bones = np.vstack((hand.finger_bones, hand.thumb_bones))
    bones[np.arange(5), np.where(third, 2, 1)] = np.hypot(markers[:, 0], markers[:, 2])
    droop = np.arctan2(-markers[:, 2], markers[:, 0])
    lower, upper = hand.limits.T.copy()
    pack, found = packed(Chains(
        root, base, tilt, np.where(third, 3, 2), bones, droop, markers[:, 1].copy(), np.zeros(5),
        np.array(ABDUCTION_SIGN), lower, upper, hand.coupling.copy(),
        hand.natural_flexion.copy(), mounting.deviation[MARKERS.index('index'):].copy(),
        np.zeros(5, dtype=bool)))
    # Without a measured flexion this finds `start`.
    measure(pack, np.full(5, np.nan), pack)
    return found


def reach(chains: Chains) -> np.ndarray:
    """Return how far each digit's marker can be from the root of its chain, shape (5,) [m]."""
    counted = np.arange(3) < chains.hinges[:, None]
    return np.hypot((chains.bones * counted).sum(axis=1), chains.lateral)


@jit
def measure(chains: Pack, distal_flexion: np.ndarray, measured: Pack) -> None:
    """Replace the couplings of last joints by measured flexions.

    Parameters
    ----------
    chains : packed Chains
    distal_flexion : ndarray, shape (5,)
        Clamped to the joints' limits; NaN where not measured [rad].
    measured : packed Chains
        Equal to `chains` but for `coupling`, `measured` and `start`, which are replaced.
    """
    chains, measured = chains[0], measured[0]
    for digit in range(5):
        last = FLEXION_JOINTS[digit, 2]
        slope, offset = chains.coupling[digit, 0], chains.coupling[digit, 1]
        known = math.isfinite(distal_flexion[digit])
        if known:
            slope = 0.
            offset = clamp(distal_flexion[digit], chains.lower[last], chains.upper[last])
        measured.measured[digit] = known
        measured.coupling[digit, 0] = slope
        measured.coupling[digit, 1] = offset
        measured.start[digit] = straightest(linkage_of(measured, digit))


@jit
def linkage_of(chains: Chains, digit: int) -> Linkage:
    """Return the `Linkage` of a digit's flexions."""
    bones = chains.bones[digit]
    first, second, third = FLEXION_JOINTS[digit]
    lower, upper = chains.lower, chains.upper
    return Linkage((bones[0], bones[1], bones[2]), chains.droop[digit],
                   (lower[first], lower[second], lower[third]),
                   (upper[first], upper[second], upper[third]),
                   chains.coupling[digit, 0], chains.coupling[digit, 1])


@jit
def natural_flexion_of(chains: Chains, digit: int) -> NaturalFlexion:
    """Return the `NaturalFlexion` of a digit."""
    natural = chains.natural[digit]
    return NaturalFlexion(natural[0], natural[1], natural[2])


@jit
def solve_digit(chains: Chains, digit: int, target: Vector, angles: np.ndarray, step: float,
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
        At which FABRIK stops [m, 1].

    Returns
    -------
    int
        Iterations of FABRIK.
    """
    abduction = ABDUCTION_JOINTS[digit]
    first, second, third = FLEXION_JOINTS[digit]
    lower = chains.lower
    upper = chains.upper
    bones = chains.bones[digit]
    hinges = chains.hinges[digit]
    tilt = chains.tilt[digit]
    linkage = linkage_of(chains, digit)
    sign = chains.sign[digit]

    reach = 0.0
    for i in range(hinges):
        reach += bones[i]
    low = min(sign * lower[abduction], sign * upper[abduction])
    high = max(sign * lower[abduction], sign * upper[abduction])
    turn, along, height = plane_abduction(
        components(frame(chains.base[digit]), target), chains.lateral[digit], reach,
        low, high, sign * angles[abduction], step)
    angles[abduction] = sign * turn

    # In the frame of the rest direction flexion starts at zero.
    c = math.cos(tilt)
    s = math.sin(tilt)
    along, height = c * along - s * height, s * along + c * height

    used = 0
    if by_fabrik:
        angles[first], angles[second], used = fabrik(
            along, height, linkage, hinges, (angles[first], angles[second]), tolerance, iterations)
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
        As for `solve_digit`.

    Returns
    -------
    int
        Iterations of FABRIK, over all digits.
    """
    used = 0
    for digit in range(5):
        root = vector(roots[digit])
        marker = vector(markers[digit])
        target = (marker[0] - root[0], marker[1] - root[1], marker[2] - root[2])
        used += solve_digit(
            chains, digit, target, angles, step, by_fabrik, tolerance, iterations)
    return used
