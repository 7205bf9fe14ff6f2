"""Plane of a digit: it holds the abduction axis and the marker (the paper's Φi)."""

import math

from ..filtering.frame_clock import DEFAULT_STEP
from ..numerics.jit import jit
from ..numerics.vectors import Vector, clamp

# Distance of the marker in front of the joint, as a share of the digit's reach, below which its
# direction does not change abduction, and above which it determines it. Ours.
FIST_NEAR = 0.05
FIST_FAR = 0.20
# Weight behind the joint, where errors of the model turn the direction round: abduction then
# settles in a tenth of a second and never jumps. Ours.
BEHIND_JOINT_WEIGHT = 0.1
REFERENCE_STEP = DEFAULT_STEP  # [s] for which these weights hold


@jit
def plane_abduction(target: Vector, lateral: float, reach: float, lower: float, upper: float,
                    previous: float, step: float) -> tuple[float, float, float]:
    """Return the turn of a digit's plane about its abduction axis, and the target in it.

    The turn is less than a quarter from straight, so that the plane never flips when a fist
    brings the marker under the joint and behind it: as it comes under the joint abduction keeps
    its previous value, and behind it follows slowly.

    Parameters
    ----------
    target : vector
        The marker in the digit's base [m].
    lateral : float
        Distance of the marker from the plane, along y [m].
    reach : float
        Length of the chain to the marker [m].
    lower, upper, previous : float
        Limits and previous value of the turn about z [rad].
    step : float
        Since the previous value, `REFERENCE_STEP` where no time passes [s].

    Returns
    -------
    turn, along, height : float
        The turn [rad] and the target in the plane, along x and along z [m].
    """
    x, y, z = target
    projected = math.sqrt(x * x + y * y)
    share = clamp((abs(x) / reach - FIST_NEAR) / (FIST_FAR - FIST_NEAR), 0.0, 1.0)
    turn = previous
    if share > 0.0:
        forward = math.copysign(1.0, x)
        aside = clamp(forward * lateral / projected, -1.0, 1.0)
        direction = math.atan2(forward * y, abs(x)) - math.asin(aside)
        weight = share * share * (3.0 - 2.0 * share)
        if x < 0.0:
            weight *= BEHIND_JOINT_WEIGHT
        if weight < 1.0:
            weight = 1.0 - (1.0 - weight) ** (step / REFERENCE_STEP)
        turn = previous + weight * (direction - previous)
    turn = clamp(turn, lower, upper)
    return turn, x * math.cos(turn) + y * math.sin(turn), z
