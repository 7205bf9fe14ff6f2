"""FABRIK with hinge limits in the plane of a digit (Aristidou & Lasenby, 2011).

The paper's solver, made dependable: signed angles are clamped in both passes, so that nothing
breaks at 90 degrees; a straight chain starts slightly bent, as FABRIK never leaves a line
through a collinear target; the best iterate is returned, and stagnation ends the iteration.
Of a chain of three hinges the coupled two last bones are one rigid bone in each iteration, so
that the intradigital correlation holds in every iterate.
"""

import math

from ..numerics.jit import jit
from ..numerics.vectors import clamp, clamp_angle, wrap_angle
from .flexion import Linkage, chain_end, flexion_of

MIN_START_FLEXION = 0.1  # [rad] of the second hinge
STAGNATION_GAIN = 1e-3   # [1] share of the error that STAGNATION_PERIOD iterations must gain
STAGNATION_PERIOD = 8


@jit
def fabrik(along: float, height: float, linkage: Linkage, start: tuple[float, float],
           tolerance: float, iterations: int) -> tuple[float, float, int]:
    """Solve a digit's chain for its marker by FABRIK, within the limits of its hinges.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    linkage : Linkage
    start : (float, float)
        First and second flexion to start from [rad].
    tolerance : float
        Distance from the target to stop at [m].
    iterations : int
        Limit of the iterations.

    Returns
    -------
    first, second : float
        Angles of flexion [rad].
    used : int
        Iterations used.
    """
    bone = linkage.bones[0]
    lower1, upper1 = linkage.lower[0], linkage.upper[0]
    lower2, upper2 = linkage.lower[1], linkage.upper[1]
    second = clamp(max(start[1], MIN_START_FLEXION), lower2, upper2)
    x, z = _end(linkage, 0.0, second)
    # Without aiming at the target first, a hinge that bends one way only hits its stop.
    first = clamp_angle(flexion_of(along, height) - flexion_of(x, z), lower1, upper1)
    x, z = _end(linkage, first, second)
    best = math.hypot(x - along, z - height)
    best1, best2 = first, second
    checked = best
    used = 0
    while used < iterations and best > tolerance:
        used += 1
        rest, lean = _rest_of_chain(linkage, second)
        # Backward: the end at the target, the second hinge on the line to where it is.
        heading = flexion_of(along - bone * math.cos(first), height + bone * math.sin(first))
        x = along - rest * math.cos(heading)
        z = height + rest * math.sin(heading)
        heading -= lean
        # Forward: the first hinge at the root.
        first = clamp_angle(
            clamp_angle(flexion_of(x, z), heading - upper2, heading - lower2), lower1, upper1)
        heading = flexion_of(along - bone * math.cos(first), height + bone * math.sin(first))
        second = clamp_angle(heading - first - lean, lower2, upper2)
        x, z = _end(linkage, first, second)
        error = math.hypot(x - along, z - height)
        if error < best:
            best, best1, best2 = error, first, second
        if used % STAGNATION_PERIOD == 0:
            if best > (1.0 - STAGNATION_GAIN) * checked:
                break
            checked = best
    return best1, best2, used


@jit
def _rest_of_chain(linkage: Linkage, second: float) -> tuple[float, float]:
    """Return the distance from second hinge to marker, and its flexion there beyond `second`."""
    if linkage.hinges == 2:
        return linkage.bones[1], linkage.droop
    x, y = chain_end(linkage, second)
    ahead = x - linkage.bones[0]
    return math.hypot(ahead, y), wrap_angle(math.atan2(y, ahead) - second)


@jit
def _end(linkage: Linkage, first: float, second: float) -> tuple[float, float]:
    """Return the marker's place along and above the plane's axis [m]."""
    rest, lean = _rest_of_chain(linkage, second)
    bent = first + second + lean
    return (linkage.bones[0] * math.cos(first) + rest * math.cos(bent),
            -linkage.bones[0] * math.sin(first) - rest * math.sin(bent))
