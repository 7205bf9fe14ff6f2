"""Flexion within a digit's plane, exactly: two hinges and the marker beyond the second.

Angles of flexion count from x towards -z.
"""

import math

from ..numerics.jit import jit
from ..numerics.vectors import clamp, clamp_angle, wrap_angle

# What chooses between two bends that fit alike, against a turn of the second hinge. Ours.
UNNATURAL = 3.0       # of its distance from what is natural with the first
HYPEREXTENDED = 6.0   # of the extension of both beyond zero
MISS = 1e-3           # [m/rad]
FASTEST = 15.0        # [rad/s] at which the second hinge then turns, as quick fingers do


@jit
def flexion_of(along, height):
    """Return the angle of flexion of a direction in the plane [rad]."""
    return math.atan2(-height, along)


@jit
def closed_form(along, height, bone, second, droop, natural, lower1, upper1, lower2, upper2,
                previous2, step):
    """Return the two flexions that bring the end of a two-bone chain nearest the target.

    There is one such bend in flexion, unless the end lies dorsal of its bone, as a marker on
    the skin does: then the chain is straightest in flexion, and two bends, one on each side of
    that, fit alike. Taken is what is natural and near the previous bend, and misses little; the
    second hinge turns to it, and from straight, where millimetres tell nothing, no faster than
    fingers do.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    bone, second : float
        Distance of the hinges, and of the second hinge from the end [m].
    droop : float
        Flexion of the end seen from the second hinge at zero angle [rad].
    natural : float
        Second flexion for one of the first, of a hand at ease.
    lower1, upper1, lower2, upper2 : float
        Limits [rad].
    previous2 : float
        Previous second flexion; read where there are two bends [rad].
    step : float
        Since then [s].

    Returns
    -------
    first, second : float
        Angles of flexion [rad].
    """
    straight = min(-droop, upper2)
    if straight <= max(lower2, 0.0):
        angle1, angle2, _ = one_bend(
            along, height, bone, second, droop, 1.0, lower1, upper1, lower2, upper2)
        return angle1, angle2

    best1 = 0.0
    best2 = 0.0
    least = math.inf
    for sign, low, high in ((1.0, straight, upper2), (-1.0, lower2, straight)):
        angle1, angle2, miss = one_bend(
            along, height, bone, second, droop, sign, lower1, upper1, low, high)
        cost = (abs(angle2 - previous2)
                + UNNATURAL * abs(angle2 - natural * max(angle1, 0.0))
                + HYPEREXTENDED * (max(-angle1, 0.0) + max(-angle2, 0.0)) + miss / MISS)
        if cost < least:
            least = cost
            best1 = angle1
            best2 = angle2
    most = FASTEST * step
    if abs(best2 - previous2) > most:
        best2 = previous2 + math.copysign(most, best2 - previous2)
        best1 = aimed(along, height, bone, second, best2 + droop, lower1, upper1)
    return best1, best2


@jit
def aimed(along, height, bone, second, bent, lower1, upper1):
    """Return the first flexion that turns a bent chain towards the target [rad]."""
    return clamp_angle(flexion_of(along, height) - math.atan2(
        second * math.sin(bent), bone + second * math.cos(bent)), lower1, upper1)


@jit
def one_bend(along, height, bone, second, droop, sign, lower1, upper1, lower2, upper2):
    """Return the nearest bend to one side of straight.

    cos PIP = (D² - l1² - l2²) / (2 l1 l2) inside the limits; on their edges the other angle is
    the best one, which gives the nearest point of the edges: so hyperextension comes in without
    a jump, where flexion would break a limit of the first hinge.

    Parameters
    ----------
    along, height, bone, second, droop, lower1, upper1, lower2, upper2
        As for `closed_form`.
    sign : float
        1 to bend to the flexion side, -1 to the other.

    Returns
    -------
    first, second : float
        Angles of flexion [rad].
    miss : float
        Distance of the end from the target [m].
    """
    aim = flexion_of(along, height)
    square = along * along + height * height
    cosine = clamp(
        (square - bone * bone - second * second) / (2.0 * bone * second), -1.0, 1.0)
    bend = sign * math.acos(cosine)
    best2 = wrap_angle(bend - droop)
    best1 = wrap_angle(aim - math.atan2(
        second * math.sin(bend), bone + second * math.cos(bend)))
    if lower1 <= best1 <= upper1 and lower2 <= best2 <= upper2:
        return best1, best2, miss_distance(along, height, bone, second, droop, best1, best2)

    smallest = math.inf
    for edge2 in (lower2, upper2):
        angle1 = aimed(along, height, bone, second, edge2 + droop, lower1, upper1)
        miss = miss_distance(along, height, bone, second, droop, angle1, edge2)
        if miss < smallest:
            smallest = miss
            best1 = angle1
            best2 = edge2
    for edge1 in (lower1, upper1):
        rest_along = along - bone * math.cos(edge1)
        rest_height = height + bone * math.sin(edge1)
        angle2 = clamp_angle(
            flexion_of(rest_along, rest_height) - edge1 - droop, lower2, upper2)
        miss = miss_distance(along, height, bone, second, droop, edge1, angle2)
        if miss < smallest:
            smallest = miss
            best1 = edge1
            best2 = angle2
    return best1, best2, smallest


@jit
def miss_distance(along, height, bone, second, droop, angle1, angle2):
    """Return the distance of the end of a two-bone chain from the target [m]."""
    bent = angle1 + angle2 + droop
    return math.hypot(
        along - bone * math.cos(angle1) - second * math.cos(bent),
        height + bone * math.sin(angle1) + second * math.sin(bent))
