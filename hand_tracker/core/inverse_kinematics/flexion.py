"""Flexion of a digit in its plane, in closed form: two hinges, or three with the last coupled.

Angles of flexion count from x towards -z in the plane. The marker is beyond the last hinge. With
three hinges the third is coupled to the second (intradigital correlation: DIP = slope PIP +
offset, 0.8 PIP in the paper), which resolves the redundant hinge of the thumb with its marker at
the tip, and of fingers with such markers.
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
REGULA_FALSI_STEPS = 40
FIRST_DESCENT_STEP = 0.1  # [rad]
LAST_DESCENT_STEP = 1e-8  # [rad]
ANGLE_ROUNDING = 1e-9     # [rad] of an angle that is not clamped


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
    least : float
        First flexion below which the second stays: a thumb's CMC extends without its MCP [rad].
    """

    slope: float
    offset: float
    spread: float
    least: float = -math.inf


@jit
def flexion_of(along: float, height: float) -> float:
    """Return the angle of flexion of a direction in the plane [rad]."""
    return math.atan2(-height, along)


@jit
def coupled_angle(linkage: Linkage, angle2: float) -> float:
    """Return the third flexion coupled to the second, within its limits [rad]."""
    return clamp(linkage.slope * angle2 + linkage.offset, linkage.lower[2], linkage.upper[2])


@jit
def coupled_end(linkage: Linkage, angle2: float, angle3: float) -> tuple[float, float]:
    """Return the end of a three-bone chain, along the first bone and to its palmar side [m]."""
    bone, middle, third = linkage.bones
    bent = angle2 + angle3 + linkage.droop
    return (bone + middle * math.cos(angle2) + third * math.cos(bent),
            middle * math.sin(angle2) + third * math.sin(bent))


@jit
def chain_end(linkage: Linkage, angle2: float) -> tuple[float, float]:
    """Return the end of a chain of two or three bones, as `coupled_end` does, coupled [m]."""
    if linkage.hinges == 3:
        return coupled_end(linkage, angle2, coupled_angle(linkage, angle2))
    bent = angle2 + linkage.droop
    return (linkage.bones[0] + linkage.bones[1] * math.cos(bent),
            linkage.bones[1] * math.sin(bent))


@jit
def chain_reach(linkage: Linkage, angle2: float) -> float:
    """Return the distance of a chain's end from its first hinge [m]."""
    bone, middle, third = linkage.bones
    # Rounding may make the square of an end at the first hinge negative.
    if linkage.hinges == 3:
        bent = coupled_angle(linkage, angle2) + linkage.droop
        return math.sqrt(max(bone * bone + middle * middle + third * third + 2.0 * (
            bone * (middle * math.cos(angle2) + third * math.cos(angle2 + bent))
            + middle * third * math.cos(bent)), 0.0))
    return math.sqrt(max(bone * bone + middle * middle
                         + 2.0 * bone * middle * math.cos(angle2 + linkage.droop), 0.0))


@jit
def aim_end(along: float, height: float, linkage: Linkage, x: float,
            y: float) -> tuple[float, float]:
    """Return the first flexion to aim a chain's end at the target, and their distance.

    The end is x along the first bone and y to its palmar side [m].
    """
    ideal1 = flexion_of(along, height) - math.atan2(y, x)
    angle1 = clamp_angle(ideal1, linkage.lower[0], linkage.upper[0])
    if abs(wrap_angle(angle1 - ideal1)) < ANGLE_ROUNDING:
        # Within the limits: the end lies on the line to the target.
        return angle1, abs(math.hypot(along, height) - math.hypot(x, y))
    c, s = math.cos(angle1), math.sin(angle1)
    return angle1, math.hypot(along - x * c + y * s, height + x * s + y * c)


@jit
def _bend_cost(angle1: float, angle2: float, miss: float, natural: NaturalFlexion,
               previous2: float) -> float:
    """Return the cost of one of two bends, in turns of the second hinge [rad]."""
    return (abs(angle2 - previous2)
            + UNNATURAL_COST * (AVERAGE_SPREAD / natural.spread) * abs(
                angle2 - (natural.offset + natural.slope * max(angle1, 0.0)))
            + HYPEREXTENSION_COST * (max(-angle1, 0.0) + max(-angle2, 0.0))
            + miss / MISS_PER_RADIAN)


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
        cost = _bend_cost(angle1, angle2, miss, natural, previous2)
        if cost < least:
            least = cost
            best1 = angle1
            best2 = angle2
    return _limit_turn(along, height, linkage, best1, best2, previous2, step)


@jit
def _limit_turn(along: float, height: float, linkage: Linkage, angle1: float, angle2: float,
                previous2: float, step: float) -> tuple[float, float]:
    """Return flexions whose second has turned from the previous one no faster than a finger does.

    Where it is held back the first aims at the target anew.
    """
    most = MAX_SECOND_HINGE_SPEED * step
    if abs(angle2 - previous2) > most:
        angle2 = previous2 + math.copysign(most, angle2 - previous2)
        x, y = chain_end(linkage, angle2)
        angle1, _ = aim_end(along, height, linkage, x, y)
    return angle1, angle2


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
    x = bone + second * cosine
    y = sign * second * math.sqrt(1.0 - cosine * cosine)
    best2 = wrap_angle(sign * math.acos(cosine) - droop)
    best1 = wrap_angle(aim - math.atan2(y, x))
    if lower1 <= best1 <= upper1 and lower2 <= best2 <= upper2:
        return best1, best2, abs(math.sqrt(square) - math.hypot(x, y))

    smallest = math.inf
    for edge2 in (lower2, upper2):
        x, y = chain_end(linkage, edge2)
        angle1, miss = aim_end(along, height, linkage, x, y)
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


@jit
def straightest(linkage: Linkage) -> float:
    """Return the second flexion of a coupled chain's greatest reach [rad].

    Beyond it the distance of the end decreases, so that the solution of `solve_three_bone` is
    unique.
    """
    lower2, upper2 = linkage.lower[1], linkage.upper[1]
    if linkage.slope == 0.0:
        # Rigid behind the second hinge: its end in line with the first bone
        bent = coupled_angle(linkage, 0.0) + linkage.droop
        middle, third = linkage.bones[1], linkage.bones[2]
        return clamp(-math.atan2(third * math.sin(bent), middle + third * math.cos(bent)),
                     lower2, upper2)
    best = 0.0
    farthest = -1.0
    for step in range(1001):
        angle2 = lower2 + (upper2 - lower2) * step / 1000
        x, y = coupled_end(linkage, angle2, coupled_angle(linkage, angle2))
        if math.hypot(x, y) > farthest:
            farthest = math.hypot(x, y)
            best = angle2
    return best


@jit
def solve_three_bone(along: float, height: float, linkage: Linkage,
                     start: float) -> tuple[float, float, float]:
    """Solve the three flexions of a coupled chain for its end at the target.

    The second flexion is found by the target's distance (regula falsi, Illinois variant), the
    third follows it, and the first aims. Where the second is at its limit the third bends on
    alone; where the first is, the others approach the target as near as they can.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    linkage : Linkage
    start : float
        The second flexion of the chain at its `straightest` [rad].

    Returns
    -------
    first, second, third : float
        Angles of flexion [rad].
    """
    bone, middle, third = linkage.bones
    upper2 = linkage.upper[1]
    aim = flexion_of(along, height)
    wanted = math.hypot(along, height)

    angle2 = start
    angle3 = coupled_angle(linkage, start)
    full3 = coupled_angle(linkage, upper2)
    excess = chain_reach(linkage, start) - wanted
    shortage = chain_reach(linkage, upper2) - wanted
    if excess > 0.0 and shortage >= 0.0:
        angle2 = upper2
        base = math.hypot(bone + middle * math.cos(upper2), middle * math.sin(upper2))
        lean = upper2 - math.atan2(
            middle * math.sin(upper2), bone + middle * math.cos(upper2))
        cosine = clamp((wanted * wanted - base * base - third * third)
                       / (2.0 * base * third), -1.0, 1.0)
        angle3 = clamp(math.acos(cosine) - lean - linkage.droop, full3, linkage.upper[2])
    elif excess > 0.0:
        angle2 = _bend_of_reach(linkage, wanted, start, upper2)
        angle3 = coupled_angle(linkage, angle2)
    x, y = coupled_end(linkage, angle2, angle3)
    ideal1 = aim - math.atan2(y, x)
    angle1 = clamp_angle(ideal1, linkage.lower[0], linkage.upper[0])
    if abs(wrap_angle(angle1 - ideal1)) > ANGLE_ROUNDING:
        angle2, angle3 = _descend(along, height, linkage, angle1, angle2, angle3)
    return angle1, angle2, angle3


@jit
def _bend_of_reach(linkage: Linkage, wanted: float, near: float, far: float) -> float:
    """Return the second flexion of a reach, between two flexions of more and less reach [rad]."""
    angle2 = near
    excess = chain_reach(linkage, near) - wanted
    shortage = chain_reach(linkage, far) - wanted
    last = 0.0
    for _ in range(REGULA_FALSI_STEPS):
        angle2 = (near * shortage - far * excess) / (shortage - excess)
        difference = chain_reach(linkage, angle2) - wanted
        if abs(difference) < 1e-13:
            break
        # An end that stays twice counts half.
        share = 0.5 if difference * last > 0.0 else 1.0
        if difference > 0.0:
            near, excess, shortage = angle2, difference, share * shortage
        else:
            far, shortage, excess = angle2, difference, share * excess
        last = difference
    return angle2


@jit
def choose_three_bone(along: float, height: float, linkage: Linkage, start: float,
                      natural: NaturalFlexion, previous2: float, step: float
                      ) -> tuple[float, float, float]:
    """Return the three flexions of the cheaper bend, of the two on either side of straightest.

    A marker on the nail is farthest with the digit bent a little; as for `solve_two_bone`, two
    bends then fit alike, and the second hinge turns to the cheaper one no faster than fingers do.

    Parameters
    ----------
    along, height, linkage, start
        As for `solve_three_bone`.
    natural : NaturalFlexion
    previous2 : float
        Previous second flexion [rad].
    step : float
        Since then [s].

    Returns
    -------
    first, second, third : float
        Angles of flexion [rad].
    """
    angle1, angle2, angle3 = solve_three_bone(along, height, linkage, start)
    lower2 = linkage.lower[1]
    if start <= max(lower2, 0.0):
        return angle1, angle2, angle3
    wanted = math.hypot(along, height)
    other2 = lower2
    if wanted >= chain_reach(linkage, start):
        other2 = start
    elif wanted > chain_reach(linkage, lower2):
        other2 = _bend_of_reach(linkage, wanted, start, lower2)
    x, y = chain_end(linkage, other2)
    other1, miss = aim_end(along, height, linkage, x, y)
    x, y = coupled_end(linkage, angle2, angle3)
    _, flexed_miss = aim_end(along, height, linkage, x, y)
    if (_bend_cost(other1, other2, miss, natural, previous2)
            < _bend_cost(angle1, angle2, flexed_miss, natural, previous2)):
        angle1, angle2, angle3 = other1, other2, coupled_angle(linkage, other2)
    angle1, turned2 = _limit_turn(along, height, linkage, angle1, angle2, previous2, step)
    if turned2 != angle2:
        angle3 = coupled_angle(linkage, turned2)
    return angle1, turned2, angle3


@jit
def _curled(linkage: Linkage, curl: float) -> tuple[float, float]:
    """Return the second and third flexion at a curl: beyond the coupling the third adds alone."""
    angle2 = min(curl, linkage.upper[1])
    angle3 = coupled_angle(linkage, angle2)
    return angle2, min(angle3 + curl - angle2, linkage.upper[2])


@jit
def _descend(along: float, height: float, linkage: Linkage, angle1: float, angle2: float,
             angle3: float) -> tuple[float, float]:
    """Return the second and third flexion nearest the target at a given first, by descent.

    Descending from the given flexions stays on one side of an unreachable target, where the
    globally nearest point may jump. The chain may extend beyond its `straightest`.
    """
    # The target in the frame of the first bone, palmar side positive.
    ahead = along * math.cos(angle1) - height * math.sin(angle1)
    below = -along * math.sin(angle1) - height * math.cos(angle1)
    upper2 = linkage.upper[1]
    full3 = coupled_angle(linkage, upper2)
    farthest = upper2 + linkage.upper[2] - full3
    curl = angle2
    if angle2 == upper2:
        curl += angle3 - full3
    x, y = coupled_end(linkage, angle2, angle3)
    miss = math.hypot(x - ahead, y - below)
    step = FIRST_DESCENT_STEP
    while abs(step) > LAST_DESCENT_STEP:
        tried = clamp(curl + step, linkage.lower[1], farthest)
        angle2, angle3 = _curled(linkage, tried)
        x, y = coupled_end(linkage, angle2, angle3)
        nearer = math.hypot(x - ahead, y - below)
        if nearer < miss:
            miss = nearer
            curl = tried
        else:
            step *= -0.5
    return _curled(linkage, curl)
