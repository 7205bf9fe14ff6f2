"""Fit the fingers' abduction axes, phalanges out of plane, splay, and coupling of DIP to PIP.

Each axis is fitted so that the plane that contains it and the MCP, and that the DIP is as far
from as the middle phalanx deviates, contains the recorded PIP.
"""

import numpy as np

from ..core.model.hand import COUPLING_OFFSET_RANGE, FINGERS, SLOPE_RANGE, Hand
from ..core.model.kinematics import digit_base
from ..core.numerics.sampling import evenly_spaced
from .landmarks import STRONG_FLEXION, digit_angles
from .least_squares import regularised_fit

FINGER_FIT_FRAMES = 400
MOTION_PERCENTILES = (1., 99.)  # of recorded angles, the limits of the range of motion

# Standard deviation of an axis's lean from dorsal, as a tangent; ours, by captures of which each
# fifth was fitted and the rest judged.
LEAN_SPREAD = np.tan(np.radians(10.))
LEAN_BOUND = 2.5  # [LEAN_SPREAD]
# The same of the middle phalanx's deviation from the plane [rad].
DEVIATION_SPREAD = np.radians(5.)
DEVIATION_BOUND = 2.5  # [DEVIATION_SPREAD]

# Variance of the recorded PIP [rad²] at which measured and usual slope have equal weight: a few
# grasps determine the slope poorly. Ours, from captures.
USUAL_SLOPE_WORTH = .1


def fit_fingers(hand: Hand, fingers: np.ndarray) -> Hand:
    """Return `hand` with axes, deviations, splay and coupling of its fingers fitted.

    Parameters
    ----------
    hand : Hand
        With MCP joints, bones and the usual coupling.
    fingers : ndarray, shape (T, 4, 4, 3)
        MCP, PIP, DIP and tip of each finger of a right hand, in the palm frame [m].

    Returns
    -------
    Hand
    """
    frames = evenly_spaced(len(fingers), FINGER_FIT_FRAMES)
    axes, deviations = [], []
    for finger in range(len(FINGERS)):
        pip, dip = (fingers[frames, finger, joint] - fingers[frames, finger, 0] for joint in (1, 2))
        middle = hand.finger_bones[finger, 1]

        def residuals(x: np.ndarray, pip: np.ndarray = pip, dip: np.ndarray = dip,
                      middle: float = middle) -> np.ndarray:
            return _off_plane(_leaning_axis(x), middle * np.sin(DEVIATION_SPREAD * x[2]), pip, dip)

        bounds = (LEAN_BOUND, LEAN_BOUND, DEVIATION_BOUND)
        found = regularised_fit(
            residuals, [np.zeros(3)], np.multiply.outer((-1., 1.), bounds))
        axes.append(_leaning_axis(found))
        deviations.append(DEVIATION_SPREAD * found[2])
    hand = hand.replace(finger_abduction_axes=axes, phalanx_deviation=deviations)
    splay = [_middle_of_abduction(hand, finger, fingers[:, finger, 1] - fingers[:, finger, 0])
             for finger in range(len(FINGERS))]
    coupling = hand.coupling.copy()
    for finger in range(len(FINGERS)):
        pip, dip = digit_angles(hand, finger, fingers[:, finger])[:, 2:].T
        coupling[finger] = _fitted_coupling(pip, dip, coupling[finger, 0])
    return hand.replace(splay=splay, coupling=coupling)


def _leaning_axis(lean: np.ndarray) -> np.ndarray:
    """Return an axis that leans from dorsal by tangents [LEAN_SPREAD], the first two numbers."""
    axis = np.array((LEAN_SPREAD * lean[0], LEAN_SPREAD * lean[1], 1.))
    return axis / np.linalg.norm(axis)


def _off_plane(axis: np.ndarray, aside: float, pip: np.ndarray, dip: np.ndarray) -> np.ndarray:
    """Return the distance of PIP joints from planes through an axis that DIP joints lie beside.

    Parameters
    ----------
    axis : ndarray, shape (3,)
        Unit length.
    aside : float
        Of the DIP from the plane, towards the thumb [m].
    pip, dip : ndarray, shape (n, 3)
        From the MCP [m].

    Returns
    -------
    ndarray, shape (n, 1)
        Less the nearer the DIP is to the axis, where it defines no plane [m].
    """
    across = np.cross(axis, dip)
    radius = np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    # Behind the joint the plane's normal is the other way round.
    sine = np.clip(np.copysign(aside / radius, aside * dip[:, :1]), -1., 1.)
    normal = np.sqrt(1. - sine ** 2) * across - sine * np.cross(axis, across)
    return (pip * normal).sum(axis=1, keepdims=True) / np.linalg.norm(dip, axis=1, keepdims=True)


def _middle_of_abduction(hand: Hand, finger: int, proximal: np.ndarray) -> float:
    """Return the splay in the middle of a finger's recorded abduction [rad].

    Parameters
    ----------
    hand : Hand
    finger : int
    proximal : ndarray, shape (T, 3)
        From MCP to PIP, in the palm frame [m].
    """
    base, _, _ = digit_base(hand, finger)
    x, y, z = (proximal @ base).T
    flexion = np.arctan2(-z, np.hypot(x, y))
    usable = (x > 0.) & (np.abs(flexion) < STRONG_FLEXION)
    if not usable.any():
        return hand.splay[finger]
    turn = np.percentile(np.arctan2(y, x)[usable], MOTION_PERCENTILES).mean()
    direction = base @ (np.cos(turn), np.sin(turn), 0.)
    # The line in which the plane of that direction and the axis intersects the palm.
    axis = base[:, 2]
    rest = direction - direction[2] / axis[2] * axis
    return np.arctan2(rest[1], rest[0])


def _fitted_coupling(pip: np.ndarray, dip: np.ndarray, usual: float) -> tuple[float, float]:
    """Return slope and offset [1, rad] of DIP over PIP, regularised towards the usual slope."""
    covariance = np.cov(pip, dip, bias=True)
    slope = np.clip((covariance[0, 1] + USUAL_SLOPE_WORTH * usual)
                    / (covariance[0, 0] + USUAL_SLOPE_WORTH), *SLOPE_RANGE)
    return slope, np.clip(dip.mean() - slope * pip.mean(), *COUPLING_OFFSET_RANGE)
