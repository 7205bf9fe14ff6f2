"""FABRIK with hinge limits in the plane of a digit (Aristidou & Lasenby, 2011).

The paper's solver, made dependable: signed angles are clamped in both passes, so that nothing
breaks at 90 degrees; a straight chain starts slightly bent, as FABRIK never leaves a line
through a collinear target; the best iterate is returned, and stagnation ends the iteration.
"""

import math

import numpy as np

from ..numerics.jit import jit
from ..numerics.vectors import clamp, clamp_angle
from .two_bone import flexion_of

MIN_START_FLEXION = 0.1  # [rad] of the inner hinges
STAGNATION_GAIN = 1e-3   # [1] share of the error that STAGNATION_PERIOD iterations must gain
STAGNATION_PERIOD = 8


@jit
def fabrik(along: float, height: float, bones: np.ndarray, lower: np.ndarray, upper: np.ndarray,
           angles: np.ndarray, tolerance: float, iterations: int) -> int:
    """Solve a planar chain for its target by FABRIK, within the limits of its hinges.

    Parameters
    ----------
    along, height : float
        The target from the first hinge [m].
    bones : ndarray, shape (n,)
        Lengths [m].
    lower, upper : ndarray, shape (n,)
        Limits of each hinge, the first one's against the x axis [rad].
    angles : ndarray, shape (n,)
        Flexion of each hinge: the start, replaced by the solution [rad].
    tolerance : float
        Distance from the target at which the iteration stops [m].
    iterations : int
        Limit of the iterations.

    Returns
    -------
    int
        Iterations used.
    """
    n = len(bones)
    x = np.zeros(n + 1)
    z = np.zeros(n + 1)
    heading = np.zeros(n)
    for i in range(n):
        bend = angles[i]
        if i > 0:
            bend = max(bend, MIN_START_FLEXION)
        angles[i] = clamp(bend, lower[i], upper[i])
    _place(bones, angles, x, z, heading)
    # Without aiming at the target first, a hinge that bends one way only hits its stop.
    aim = flexion_of(along, height) - flexion_of(x[n], z[n])
    angles[0] = clamp_angle(angles[0] + aim, lower[0], upper[0])
    _place(bones, angles, x, z, heading)

    best = math.hypot(x[n] - along, z[n] - height)
    best_angles = angles.copy()
    checked = best
    used = 0
    while used < iterations and best > tolerance:
        used += 1
        x[n] = along
        z[n] = height
        for i in range(n - 1, -1, -1):
            direction = flexion_of(x[i + 1] - x[i], z[i + 1] - z[i])
            if i < n - 1:
                direction = clamp_angle(
                    direction, heading[i + 1] - upper[i + 1], heading[i + 1] - lower[i + 1])
            heading[i] = direction
            x[i] = x[i + 1] - bones[i] * math.cos(direction)
            z[i] = z[i + 1] + bones[i] * math.sin(direction)
        x[0] = 0.0
        z[0] = 0.0
        base = 0.0
        for i in range(n):
            direction = flexion_of(x[i + 1] - x[i], z[i + 1] - z[i])
            angles[i] = clamp_angle(direction - base, lower[i], upper[i])
            base += angles[i]
            heading[i] = base
            x[i + 1] = x[i] + bones[i] * math.cos(base)
            z[i + 1] = z[i] - bones[i] * math.sin(base)
        error = math.hypot(x[n] - along, z[n] - height)
        if error < best:
            best = error
            for i in range(n):
                best_angles[i] = angles[i]
        if used % STAGNATION_PERIOD == 0:
            if best > (1.0 - STAGNATION_GAIN) * checked:
                break
            checked = best
    for i in range(n):
        angles[i] = best_angles[i]
    return used


@jit
def _place(bones: np.ndarray, angles: np.ndarray, x: np.ndarray, z: np.ndarray,
           heading: np.ndarray) -> None:
    """Write the joints (n + 1,) [m] and headings (n,) [rad] of a chain at given angles."""
    base = 0.0
    for i in range(bones.shape[0]):
        base += angles[i]
        heading[i] = base
        x[i + 1] = x[i] + bones[i] * math.cos(base)
        z[i + 1] = z[i] - bones[i] * math.sin(base)
