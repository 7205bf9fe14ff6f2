"""Flexion of a digit with two hinges, its marker beyond the second, in closed form.

Angles of flexion count from x towards -z in the digit's plane.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import NATURAL_FLEXION_SPREAD
from ..numerics.jit import jit
from ..numerics.vectors import clamp, clamp_angle, wrap_angle

# Costs that choose between two bends of equal fit, in turns of the second hinge [rad]. Ours.
UNNATURAL_COST = 3.0        # [1] per distance from the natural flexion, of the average spread
AVERAGE_SPREAD = float(np.radians(NATURAL_FLEXION_SPREAD))  # [rad]
HYPEREXTENSION_COST = 6.0   # [1] per extension of both beyond zero
MISS_PER_RADIAN = 1e-3      # [m/rad] of the marker
MAX_SECOND_HINGE_SPEED = 15.0  # [rad/s] of the turn to the chosen bend, as of quick fingers


class Linkage(NamedTuple):
    """Planar chain of a digit's hinges, from the first flexion to the marker.

    Attributes
    ----------
    bones : tuple of three float
        Distances hinge to hinge, the last one's to the marker; the third is not read of a
        chain of two hinges [m].
    droop : float
        Flexion of the marker seen from the last hinge at zero angle [rad].
    lower, upper : tuple of three float
        Limits of the flexions [rad].
    slope, offset : float
        Coupling of the third flexion to the second [1, rad].
    hinges : int
        2, or 3 with the third coupled to the second.
    """

    bones: tuple[float, float, float]
    droop: float
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    slope: float
    offset: float
    hinges: int


class NaturalFlexion(NamedTuple):
    """Usual second flexion of a person beside the first: slope first + offset.

    Attributes
    ----------
    slope, offset, spread : float
        Line, and standard deviation from it [1, rad, rad].
    """

    slope: float
    offset: float
    spread: float


@jit
def flexion_of(along: float, height: float) -> float:
    """Return the angle of flexion of a direction in the plane [rad]."""
    return math.atan2(-height, along)


@jit
def solve_two_bone(along: float, height: float, linkage: Linkage, natural: NaturalFlexion,
                   previous2: float, step: float) -> tuple[float, float]:
    """Solve the two flexions of a two-bone chain for its end nearest the target.

    The bend in flexion is unique, unless the end droops dorsally, as a marker on the skin
    does: then the chain is straightest in flexion, and two bends, one on each side of that, fit
    alike. The cheaper one is taken, of naturalness, distance to the previous bend and miss.
    The second hinge then turns to it no faster than a finger does: near straight, millimetres
    of the marker are large angles.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    linkage : Linkage
    natural : NaturalFlexion
        Read where two bends fit alike.
    previous2 : float
        Previous second flexion, read where two bends fit alike [rad].
    step : float
        Since then [s].

    Returns
    -------
    first, second : float
        Angles of flexion [rad].
    """
    lower2, upper2 = linkage.lower[1], linkage.upper[1]
    straight = min(-linkage.droop, upper2)
    if straight <= max(lower2, 0.0):
        angle1, angle2, _ = solve_bend(along, height, linkage, 1.0, lower2, upper2)
        return angle1, angle2

    best1 = 0.0
    best2 = 0.0
    least = math.inf
    for sign, low, high in ((1.0, straight, upper2), (-1.0, lower2, straight)):
        angle1, angle2, miss = solve_bend(along, height, linkage, sign, low, high)
        cost = bend_cost(angle1, angle2, miss, natural, previous2)
        if cost < least:
            least = cost
            best1 = angle1
            best2 = angle2
    most = MAX_SECOND_HINGE_SPEED * step
    if abs(best2 - previous2) > most:
        best2 = previous2 + math.copysign(most, best2 - previous2)
        best1 = aimed(along, height, linkage, best2)
    return best1, best2


@jit
def bend_cost(angle1: float, angle2: float, miss: float, natural: NaturalFlexion,
              previous2: float) -> float:
    """Return the cost of one of two bends, in turns of the second hinge [rad]."""
    return (abs(angle2 - previous2)
            + UNNATURAL_COST * (AVERAGE_SPREAD / natural.spread) * abs(
                angle2 - (natural.offset + natural.slope * max(angle1, 0.0)))
            + HYPEREXTENSION_COST * (max(-angle1, 0.0) + max(-angle2, 0.0))
            + miss / MISS_PER_RADIAN)


@jit
def aim_end(along: float, height: float, linkage: Linkage, x: float,
            y: float) -> tuple[float, float]:
    """Return the first flexion to aim a chain's end at the target, and their distance.

    The end is x along the first bone and y to its palmar side [m].
    """
    angle1 = clamp_angle(
        flexion_of(along, height) - math.atan2(y, x), linkage.lower[0], linkage.upper[0])
    c, s = math.cos(angle1), math.sin(angle1)
    return angle1, math.hypot(along - x * c + y * s, height + x * s + y * c)


@jit
def aimed(along: float, height: float, linkage: Linkage, angle2: float) -> float:
    """Return the first flexion to aim a two-bone chain of a given bend at the target [rad]."""
    bone, second = linkage.bones[0], linkage.bones[1]
    bent = angle2 + linkage.droop
    return clamp_angle(flexion_of(along, height) - math.atan2(
        second * math.sin(bent), bone + second * math.cos(bent)),
        linkage.lower[0], linkage.upper[0])


@jit
def solve_bend(along: float, height: float, linkage: Linkage, sign: float, lower2: float,
               upper2: float) -> tuple[float, float, float]:
    """Return the flexions nearest the target with the chain bent to one side of straight.

    Inside the limits cos PIP = (D² - l1² - l2²) / (2 l1 l2). Beyond, the nearest point of the
    limits' edges, on each of which the other angle is optimal: so hyperextension begins without
    a jump where flexion would break a limit of the first hinge.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    linkage : Linkage
    sign : float
        1 to bend to the flexion side, -1 to the extension side.
    lower2, upper2 : float
        Limits of the second flexion on that side [rad].

    Returns
    -------
    first, second : float
        Angles of flexion [rad].
    miss : float
        Distance of the end from the target [m].
    """
    bone, second = linkage.bones[0], linkage.bones[1]
    droop = linkage.droop
    lower1, upper1 = linkage.lower[0], linkage.upper[0]
    aim = flexion_of(along, height)
    square = along * along + height * height
    cosine = clamp(
        (square - bone * bone - second * second) / (2.0 * bone * second), -1.0, 1.0)
    bend = sign * math.acos(cosine)
    best2 = wrap_angle(bend - droop)
    best1 = wrap_angle(aim - math.atan2(
        second * math.sin(bend), bone + second * math.cos(bend)))
    if lower1 <= best1 <= upper1 and lower2 <= best2 <= upper2:
        return best1, best2, miss_distance(along, height, linkage, best1, best2)

    smallest = math.inf
    for edge2 in (lower2, upper2):
        angle1 = aimed(along, height, linkage, edge2)
        miss = miss_distance(along, height, linkage, angle1, edge2)
        if miss < smallest:
            smallest = miss
            best1 = angle1
            best2 = edge2
    for edge1 in (lower1, upper1):
        rest_along = along - bone * math.cos(edge1)
        rest_height = height + bone * math.sin(edge1)
        angle2 = clamp_angle(
            flexion_of(rest_along, rest_height) - edge1 - droop, lower2, upper2)
        miss = miss_distance(along, height, linkage, edge1, angle2)
        if miss < smallest:
            smallest = miss
            best1 = edge1
            best2 = angle2
    return best1, best2, smallest


@jit
def miss_distance(along: float, height: float, linkage: Linkage, angle1: float,
                  angle2: float) -> float:
    """Return the distance of the end of a two-bone chain from the target [m]."""
    bone, second = linkage.bones[0], linkage.bones[1]
    bent = angle1 + angle2 + linkage.droop
    return math.hypot(
        along - bone * math.cos(angle1) - second * math.cos(bent),
        height + bone * math.sin(angle1) + second * math.sin(bent))
