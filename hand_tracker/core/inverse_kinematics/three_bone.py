"""Flexion within a digit's plane when a third hinge follows the second.

Intradigital correlation: DIP = slope PIP + offset, 0.8 PIP in the paper. The thumb's tip
marker, and fingers with a marker on the tip, hang on three hinges; the coupling settles the
redundant one.
"""

import math

from ..numerics.jit import jit
from ..numerics.vectors import clamp, clamp_angle, wrap_angle
from .two_bone import flexion_of

SEARCH_STEPS = 40
FIRST_STEP, LAST_STEP = 0.1, 1e-8  # [rad] of going downhill


@jit
def coupled_angle(angle2, slope, offset, lower3, upper3):
    """Return the third flexion that follows the second, within its limits [rad]."""
    return clamp(slope * angle2 + offset, lower3, upper3)


@jit
def coupled_end(bone, middle, third, droop, angle2, angle3):
    """Return the end of a three-bone chain, along the first bone and to its palmar side [m]."""
    bent = angle2 + angle3 + droop
    return (bone + middle * math.cos(angle2) + third * math.cos(bent),
            middle * math.sin(angle2) + third * math.sin(bent))


@jit
def straightest(bone, middle, third, droop, slope, offset, lower2, upper2, lower3, upper3):
    """Return the second flexion at which a coupled chain reaches farthest [rad].

    From there on the distance of its end falls, which makes `coupled_form` unique.
    """
    if slope == 0.0:
        # Rigid behind the second hinge: its end in line with the first bone
        bent = coupled_angle(0.0, 0.0, offset, lower3, upper3) + droop
        return clamp(-math.atan2(third * math.sin(bent), middle + third * math.cos(bent)),
                     lower2, upper2)
    best = 0.0
    farthest = -1.0
    for step in range(1001):
        angle2 = lower2 + (upper2 - lower2) * step / 1000
        x, y = coupled_end(bone, middle, third, droop, angle2,
                           coupled_angle(angle2, slope, offset, lower3, upper3))
        if math.hypot(x, y) > farthest:
            farthest = math.hypot(x, y)
            best = angle2
    return best


@jit
def coupled_form(along, height, bone, middle, third, droop, slope, offset, start,
                 lower1, upper1, lower2, upper2, lower3, upper3):
    """Return the three flexions that bring the end of a coupled chain to the target.

    The third flexion follows the second, which leaves one unknown, found by its distance
    (regula falsi, Illinois); the first aims. Where the second meets its limit the third
    bends on alone; where the first does, the others reach for the nearest point.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    bone, middle, third : float
        Distances of the hinges and of the third from the end [m].
    droop : float
        Flexion of the end seen from the third hinge at zero angle [rad].
    slope, offset : float
        Coupling of the third flexion to the second [1, rad].
    start : float
        The second flexion at which the chain is `straightest` [rad].
    lower1, upper1, lower2, upper2, lower3, upper3 : float
        Limits [rad].

    Returns
    -------
    first, second, third : float
        Angles of flexion [rad].
    """
    aim = flexion_of(along, height)
    wanted = math.hypot(along, height)

    near = start
    far = upper2
    angle2 = start
    angle3 = coupled_angle(start, slope, offset, lower3, upper3)
    x, y = coupled_end(bone, middle, third, droop, angle2, angle3)
    excess = math.hypot(x, y) - wanted
    full3 = coupled_angle(upper2, slope, offset, lower3, upper3)
    x, y = coupled_end(bone, middle, third, droop, upper2, full3)
    shortage = math.hypot(x, y) - wanted
    if excess > 0.0 and shortage >= 0.0:
        angle2 = upper2
        base = math.hypot(bone + middle * math.cos(upper2), middle * math.sin(upper2))
        lean = upper2 - math.atan2(
            middle * math.sin(upper2), bone + middle * math.cos(upper2))
        cosine = clamp((wanted * wanted - base * base - third * third)
                       / (2.0 * base * third), -1.0, 1.0)
        angle3 = clamp(math.acos(cosine) - lean - droop, full3, upper3)
    elif excess > 0.0:
        for _ in range(SEARCH_STEPS):
            angle2 = (near * shortage - far * excess) / (shortage - excess)
            angle3 = coupled_angle(angle2, slope, offset, lower3, upper3)
            x, y = coupled_end(bone, middle, third, droop, angle2, angle3)
            difference = math.hypot(x, y) - wanted
            if abs(difference) < 1e-13:
                break
            if difference > 0.0:
                near = angle2
                excess = difference
                shortage *= 0.5
            else:
                far = angle2
                shortage = difference
                excess *= 0.5
    x, y = coupled_end(bone, middle, third, droop, angle2, angle3)
    ideal1 = aim - math.atan2(y, x)
    angle1 = clamp_angle(ideal1, lower1, upper1)
    if abs(wrap_angle(angle1 - ideal1)) > 1e-9:
        angle2, angle3 = _nearest(along, height, angle1, angle2, angle3, bone, middle, third,
                                  droop, slope, offset, start, upper2, lower3, upper3)
    return angle1, angle2, angle3


@jit
def _curled(curl, slope, offset, upper2, lower3, upper3):
    """Return the second and third flexion of a chain that curls: the third goes on alone."""
    angle2 = min(curl, upper2)
    angle3 = coupled_angle(angle2, slope, offset, lower3, upper3)
    return angle2, min(angle3 + curl - angle2, upper3)


@jit
def _nearest(along, height, angle1, angle2, angle3, bone, middle, third, droop, slope, offset,
             start, upper2, lower3, upper3):
    """Return the flexions nearest the target when the first is fixed, downhill from those given.

    Going downhill keeps to one side of a target that is out of reach, where the nearest of
    all points may jump.
    """
    # The target in the frame of the first bone, palmar side positive.
    ahead = along * math.cos(angle1) - height * math.sin(angle1)
    below = -along * math.sin(angle1) - height * math.cos(angle1)
    farthest = upper2 + upper3 - coupled_angle(upper2, slope, offset, lower3, upper3)
    curl = angle2
    if angle2 == upper2:
        curl += angle3 - coupled_angle(upper2, slope, offset, lower3, upper3)
    x, y = coupled_end(bone, middle, third, droop, angle2, angle3)
    miss = math.hypot(x - ahead, y - below)
    step = FIRST_STEP
    while abs(step) > LAST_STEP:
        tried = clamp(curl + step, start, farthest)
        angle2, angle3 = _curled(tried, slope, offset, upper2, lower3, upper3)
        x, y = coupled_end(bone, middle, third, droop, angle2, angle3)
        nearer = math.hypot(x - ahead, y - below)
        if nearer < miss:
            miss = nearer
            curl = tried
        else:
            step *= -0.5
    return _curled(curl, slope, offset, upper2, lower3, upper3)
