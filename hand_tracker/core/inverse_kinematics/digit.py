"""Inverse kinematics of one digit: its plane, its flexion, its intradigital correlation.

The thumb is solved as the fingers are: its saddle joint only has an abduction axis and a
rest direction of its own (`Hand`), where the paper puts its plane through the index MCP.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, FLEXION_JOINTS, RELAXED_FINGERS, RELAXED_THUMB
from ..model.kinematics import ABDUCTION_SIGN, digit_base
from ..model.marker_layout import MARKERS
from ..numerics.jit import jit
from ..numerics.vectors import clamp, components, frame, vector
from .abduction_plane import plane_abduction
from .fabrik import fabrik
from .three_bone import coupled_angle, coupled_form, straightest
from .two_bone import closed_form

# Second flexion for one of the first, between the straight and the relaxed hand.
NATURAL = np.array([second / first for first, second in (*RELAXED_FINGERS, RELAXED_THUMB[1::2])])


class Chains(NamedTuple):
    """The five digits as the solver sees them, of a right hand.

    Attributes
    ----------
    root : ndarray, shape (5, 3)
        The joint at which the chain starts, in the wrist's frame [m].
    base : ndarray, shape (5, 3, 3)
        Rotation from the chain's base to the wrist's frame (`digit_base`).
    tilt : ndarray, shape (5,)
        Flexion of the base's rest direction [rad].
    hinges : ndarray of int, shape (5,)
        2 when the marker rides behind the second hinge, 3 behind the third.
    bones : ndarray, shape (5, 3)
        Distances hinge to hinge, the last of `hinges` to the marker [m].
    droop : ndarray, shape (5,)
        Flexion of the marker seen from its hinge at zero angle [rad].
    lateral : ndarray, shape (5,)
        Distance of the marker from the plane, along y [m].
    start : ndarray, shape (5,)
        Second flexion at which a coupled chain is straightest [rad].
    sign : ndarray, shape (5,)
        Sign of a turn about z that abducts.
    lower, upper : ndarray, shape (25,)
        Limits [rad].
    coupling : ndarray, shape (5, 2)
        Slope and offset [1, rad].
    measured : ndarray of bool, shape (5,)
        Whether the last joint is measured in place of coupled.
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
    measured: np.ndarray


def chains(hand, mounting):
    """Return the digits of a right hand with their markers.

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
    start = np.array([_start(digit, bones, droop, hand.coupling, lower, upper)
                      for digit in range(5)])
    return Chains(root, base, tilt, np.where(third, 3, 2), bones, droop,
                  markers[:, 1].copy(), start, np.array(ABDUCTION_SIGN),
                  lower, upper, hand.coupling.copy(), np.zeros(5, dtype=bool))


@jit
def measure(chains, distal_flexion, measured):
    """Take measured flexions of last joints in place of their couplings.

    Parameters
    ----------
    chains : packed Chains
    distal_flexion : ndarray, shape (5,)
        NaN where not measured; the limits of those joints hold [rad].
    measured : packed Chains
        Those, but for `coupling`, `measured` and `start`, which are replaced.
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
        measured.start[digit] = _start(
            digit, chains.bones, chains.droop, measured.coupling, chains.lower, chains.upper)


@jit
def _start(digit, bones, droop, coupling, lower, upper):
    second, third = FLEXION_JOINTS[digit, 1], FLEXION_JOINTS[digit, 2]
    return straightest(
        bones[digit, 0], bones[digit, 1], bones[digit, 2], droop[digit], coupling[digit, 0],
        coupling[digit, 1], lower[second], upper[second], lower[third], upper[third])


@jit
def solve_digit(chains, digit, target, angles, step, by_fabrik, tolerance, iterations):
    """Solve one digit for its marker; its joints in `angles` are replaced.

    Parameters
    ----------
    chains : Chains
    digit : int
        0 to 4, index finger to thumb.
    target : vector
        The marker from the chain's root, in the wrist's frame [m].
    angles : ndarray, shape (25,)
        Previous angles, replaced [rad].
    step : float
        Since the previous angles, `plane.FRAME` where no time passes [s].
    by_fabrik : bool
        FABRIK instead of the closed form.
    tolerance, iterations : float, int
        Of FABRIK [m].

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
    droop = chains.droop[digit]
    tilt = chains.tilt[digit]
    slope, offset = chains.coupling[digit]
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
        joints = FLEXION_JOINTS[digit][:hinges]
        lows = lower[joints]
        highs = upper[joints]
        bends = angles[joints]
        lows[-1] += droop
        highs[-1] += droop
        bends[-1] += droop
        used = fabrik(along, height, bones[:hinges], lows, highs, bends, tolerance, iterations)
        bends[-1] -= droop
        for i in range(hinges):
            angles[joints[i]] = bends[i]
    elif hinges == 2:
        angles[first], angles[second] = closed_form(
            along, height, bones[0], bones[1], droop, NATURAL[digit], lower[first],
            upper[first], lower[second], upper[second], angles[second], step)
    else:
        angles[first], angles[second], angles[third] = coupled_form(
            along, height, bones[0], bones[1], bones[2], droop, slope, offset,
            chains.start[digit], lower[first], upper[first],
            lower[second], upper[second], lower[third], upper[third])
    if hinges == 2:
        angles[third] = coupled_angle(angles[second], slope, offset, lower[third], upper[third])
    # Offsets of markers and turns of base may round past a limit.
    for joint in (abduction, first, second, third):
        angles[joint] = clamp(angles[joint], lower[joint], upper[joint])
    return used


@jit
def solve_digits(chains, roots, markers, angles, step, by_fabrik, tolerance, iterations):
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
