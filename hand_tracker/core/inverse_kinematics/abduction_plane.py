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
                    previous: float, step: float) -> float:
    """Return the turn of a digit's plane about its abduction axis [rad].

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
    """
    turn = previous
    direction, weight, _ = plane_direction(target, lateral, reach, FIST_NEAR, FIST_FAR, step)
    if weight > 0.0:
        turn = previous + weight * (direction - previous)
    return clamp(turn, lower, upper)


@jit
def in_plane(target: Vector, turn: float, tilt: float) -> tuple[float, float]:
    """Return a target in a digit's plane: along the rest direction, and above it [m].

    Parameters
    ----------
    target : vector
        In the digit's base [m].
    turn : float
        Of the plane about the abduction axis [rad].
    tilt : float
        Flexion of the rest direction in the base [rad].
    """
    along, height = target[0] * math.cos(turn) + target[1] * math.sin(turn), target[2]
    c, s = math.cos(tilt), math.sin(tilt)
    return c * along - s * height, s * along + c * height


@jit
def plane_direction(target: Vector, lateral: float, reach: float, near: float, far: float,
                    step: float) -> tuple[float, float, float]:
    """Return the turn of a digit's plane towards its marker, with weight and certainty.

    Parameters
    ----------
    target, lateral, reach, step
        As for `plane_abduction`.
    near, far : float
        Distance of the marker in front of the joint, as a share of the reach: below `near` its
        direction carries no information, above `far` it is certain [1].

    Returns
    -------
    direction : float
        0 without information [rad].
    weight, certainty : float
        Of the direction over a step, less behind the joint, and by the distance alone [1].
    """
    x, y, _ = target
    share = clamp((abs(x) / reach - near) / (far - near), 0.0, 1.0)
    if not share > 0.0:
        return 0.0, 0.0, 0.0
    forward = math.copysign(1.0, x)
    aside = clamp(forward * lateral / math.sqrt(x * x + y * y), -1.0, 1.0)
    certainty = share * share * (3.0 - 2.0 * share)
    weight = certainty if x >= 0.0 else certainty * BEHIND_JOINT_WEIGHT
    if weight < 1.0:
        weight = 1.0 - (1.0 - weight) ** (step / REFERENCE_STEP)
    return math.atan2(forward * y, abs(x)) - math.asin(aside), weight, certainty
