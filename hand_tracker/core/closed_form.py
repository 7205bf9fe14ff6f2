"""Flexion within a digit's plane, exactly: two hinges and the marker beyond the second.

Angles of flexion count from x towards -z.
"""

import math

from .jit import jit
from .vectors import clamp, clamp_angle, wrap


@jit
def flexion_of(along, height):
    """Return the angle of flexion of a direction in the plane [rad]."""
    return math.atan2(-height, along)


@jit
def closed_form(along, height, bone, second, droop, lower1, upper1, lower2, upper2, previous2):
    """Return the two flexions that bring the end of a two-bone chain nearest the target.

    cos PIP = (D² - l1² - l2²) / (2 l1 l2) inside the limits, bent to the flexion side; on
    their edges the other angle is the best one, which gives the nearest point of the edges.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    bone, second : float
        Distance of the hinges, and of the second hinge from the end [m].
    droop : float
        Flexion of the end seen from the second hinge at zero angle [rad].
    lower1, upper1, lower2, upper2 : float
        Limits [rad].
    previous2 : float
        Chooses between two flexed solutions, which offset markers can have [rad].

    Returns
    -------
    first, second : float
        Angles of flexion [rad].
    """
    aim = flexion_of(along, height)
    square = along * along + height * height
    cosine = clamp(
        (square - bone * bone - second * second) / (2.0 * bone * second), -1.0, 1.0)
    bend = math.acos(cosine)

    found = False
    best1 = 0.0
    best2 = 0.0
    for sign in (1.0, -1.0):
        angle2 = wrap(sign * bend - droop)
        angle1 = wrap(aim - math.atan2(
            second * math.sin(sign * bend), bone + second * math.cos(sign * bend)))
        inside = lower1 <= angle1 <= upper1 and lower2 <= angle2 <= upper2
        # The other bend is taken for flexion only: hyperextension comes in on the edges,
        # without a jump, where flexion would break a limit of the first hinge.
        if inside and (sign > 0.0 or angle2 >= 0.0):
            if not found or abs(angle2 - previous2) < abs(best2 - previous2):
                found = True
                best1 = angle1
                best2 = angle2
    if found:
        return best1, best2

    smallest = math.inf
    for edge2 in (lower2, upper2):
        bent = edge2 + droop
        angle1 = clamp_angle(aim - math.atan2(
            second * math.sin(bent), bone + second * math.cos(bent)), lower1, upper1)
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
    return best1, best2


@jit
def miss_distance(along, height, bone, second, droop, angle1, angle2):
    """Return the distance of the end of a two-bone chain from the target [m]."""
    bent = angle1 + angle2 + droop
    return math.hypot(
        along - bone * math.cos(angle1) - second * math.cos(bent),
        height + bone * math.sin(angle1) + second * math.sin(bent))
