"""Fit the thumb: position and axes of the saddle joint, roll, coupling of the IP.

First its axes are fitted to the recorded joints. Then the coupling, with a little of the rest, so
that the thumb solved from its tip alone reproduces them.
"""

from typing import NamedTuple

import numpy as np

from ..core.inverse_kinematics.digit import OUT_OF_PLANE_ROUNDS
from ..core.model.hand import (
    JOINTS,
    THUMB_ABDUCTION_AXIS,
    THUMB_AXIS_DISTANCE_RANGE,
    THUMB_COUPLING,
    THUMB_ROLL_RANGE,
    Hand,
)
from ..core.model.kinematics import base_rotation, direction_in_base
from ..core.numerics.sampling import evenly_spaced
from .fingers import MOTION_PERCENTILES
from .landmarks import metacarpal_axes, phalanx_axes
from .least_squares import regularised_fit

MCP_ABDUCTION_ROW = JOINTS.index('thumb_mcp_abduction')
THUMB_FIT_FRAMES = 250
FLEXION_TABLE_STEPS = 500

# Standard deviations of a thumb from the defaults; ours, unsourced.
AXIS_SPREAD = np.tan(np.radians(20.))
CMC_SPREAD = .0025                # [m] from the median of the recorded joint
SLOPE_SPREAD = .5                 # of the slope's logarithm
OFFSET_SPREAD = np.radians(15.)
MCP_ABDUCTION_SPREAD = np.radians(8.)
ROLL_SPREAD = np.radians(45.)
AXIS_DISTANCE_SPREAD = .02        # [m]
SLOPE_BOUNDS = (.3, 3.)
OFFSET_BOUNDS = (-np.pi / 4, np.pi / 4)
AXIS_BOUND = 2.5                  # [AXIS_SPREAD], 42 degrees
CMC_BOUND = 4.                    # [CMC_SPREAD]
CMC_WEIGHT = .3                   # [1] of its misses by the tip, beside MCP and IP; from captures

# Lean, roll [rad] and distance of the axes [m] at which fits start.
LEAN_STARTS = ((0., 0.), (1., 0.), (-1., 0.), (0., 1.), (0., -1.))
ROLL_STARTS = ((0., .002), (.8, .01))


class Saddle(NamedTuple):
    """The fitted part of a thumb, with the field names of `Hand`.

    Attributes
    ----------
    thumb_cmc : ndarray, shape (3,)
        In the wrist frame [m].
    thumb_abduction_axis, thumb_rest_direction : ndarray, shape (3,)
        Unit length.
    thumb_coupling : tuple of float
        Slope and offset of the IP's flexion against the MCP's [1, rad].
    thumb_mcp_abduction, thumb_roll : float
        [rad]
    thumb_axis_distance : float
        [m]
    """

    thumb_cmc: np.ndarray
    thumb_abduction_axis: np.ndarray
    thumb_rest_direction: np.ndarray
    thumb_coupling: tuple[float, float]
    thumb_mcp_abduction: float = 0.
    thumb_roll: float = 0.
    thumb_axis_distance: float = 0.


class ThumbAngles(NamedTuple):
    """Angles and joints of a thumb solved from its tip.

    Attributes
    ----------
    abduction, flexion : ndarray, shape (n,)
        Of the CMC, from the x axis of its base [rad].
    cmc, mcp, ip : ndarray, shape (n, 3)
        Joints relative to `Saddle.thumb_cmc`, in the wrist frame [m].
    """

    abduction: np.ndarray
    flexion: np.ndarray
    cmc: np.ndarray
    mcp: np.ndarray
    ip: np.ndarray


def fit_thumb(hand: Hand, thumb: np.ndarray) -> Hand:
    """Return `hand` with the thumb's CMC, axes, roll, MCP abduction and coupling fitted.

    Parameters
    ----------
    hand : Hand
        With bones and an initial CMC.
    thumb : ndarray, shape (T, 4, 3)
        CMC, MCP, IP and tip of a right hand, in the palm frame [m].

    Returns
    -------
    Hand
    """
    recorded = thumb[evenly_spaced(len(thumb), THUMB_FIT_FRAMES)]
    metacarpal = np.median(recorded[:, 1] - recorded[:, 0], axis=0)
    default, across, along = _default_axes()
    rest = hand.thumb_rest_direction

    def saddle(x: np.ndarray, coupling: np.ndarray) -> Saddle:
        roll, distance = ROLL_SPREAD * x[6], AXIS_DISTANCE_SPREAD * x[7]
        # The CMC's axes are rolled back as far as the phalanges are rolled, so that these bend
        # where they are recorded to.
        axis = _turned(default + AXIS_SPREAD * (x[0] * across + x[1] * along), rest, -roll)
        axis /= np.linalg.norm(axis)
        ahead = metacarpal - (metacarpal @ axis) * axis
        return Saddle(
            hand.thumb_cmc + CMC_SPREAD * x[2:5] - distance * ahead / np.linalg.norm(ahead), axis,
            rest, (THUMB_COUPLING[0] * np.exp(SLOPE_SPREAD * coupling[0]),
                   THUMB_COUPLING[1] + OFFSET_SPREAD * coupling[1]),
            MCP_ABDUCTION_SPREAD * x[5], roll, distance)

    def misses_of_axes(x: np.ndarray) -> np.ndarray:
        return _misses_of_axes(saddle(x, np.zeros(2)), recorded)

    def misses_by_tip(change: np.ndarray) -> np.ndarray:
        part = saddle(np.append(axes[:6] + change[:6], axes[6:]), change[6:])
        solved = solve_thumb(hand, part, recorded[:, 3] - part.thumb_cmc)
        joints = np.stack((solved.cmc, solved.mcp, solved.ip), axis=1) + part.thumb_cmc
        return np.linalg.norm(joints - recorded[:, :3], axis=2) * (CMC_WEIGHT, 1., 1.)

    bounds = np.array([(-AXIS_BOUND, AXIS_BOUND)] * 2 + [(-CMC_BOUND, CMC_BOUND)] * 3
                      + [hand.limits[MCP_ABDUCTION_ROW] / MCP_ABDUCTION_SPREAD,
                         np.divide(THUMB_ROLL_RANGE, ROLL_SPREAD),
                         np.divide(THUMB_AXIS_DISTANCE_RANGE, AXIS_DISTANCE_SPREAD)])
    axes = regularised_fit(misses_of_axes, [
        np.array((*lean, 0., 0., 0., 0., roll / ROLL_SPREAD,
                  distance / AXIS_DISTANCE_SPREAD))
        for lean in LEAN_STARTS for roll, distance in ROLL_STARTS], bounds.T)
    slopes = np.log(np.divide(SLOPE_BOUNDS, THUMB_COUPLING[0])) / SLOPE_SPREAD
    offsets = np.subtract(OFFSET_BOUNDS, THUMB_COUPLING[1]) / OFFSET_SPREAD
    change = regularised_fit(
        misses_by_tip, [np.array((0., 0., 0., 0., 0., 0., slope, 0.)) for slope in (-.7, .7)],
        np.vstack((bounds[:6] - axes[:6, None], slopes, offsets)).T)
    part = saddle(np.append(axes[:6] + change[:6], axes[6:]), change[6:])
    return hand.replace(
        thumb_cmc=part.thumb_cmc, thumb_abduction_axis=part.thumb_abduction_axis,
        thumb_rest_direction=_rest_direction(hand, part, thumb[:, 3] - part.thumb_cmc),
        thumb_mcp_abduction=part.thumb_mcp_abduction, thumb_roll=part.thumb_roll,
        thumb_axis_distance=part.thumb_axis_distance,
        coupling=np.vstack((hand.coupling[:4], part.thumb_coupling)))


def _misses_of_axes(saddle: Saddle, joints: np.ndarray) -> np.ndarray:
    """Return the residuals of recorded joints from a thumb's axes and its plane of flexion.

    Parameters
    ----------
    saddle : Saddle
    joints : ndarray, shape (n, 4, 3)
        CMC, MCP, IP and tip, in the palm frame [m].

    Returns
    -------
    ndarray, shape (n, 3)
        Of the CMC, by a metacarpal as recorded, and of IP and tip from the plane of the
        phalanges [m].
    """
    base, _ = base_rotation(saddle.thumb_abduction_axis, saddle.thumb_rest_direction)
    local = (joints - saddle.thumb_cmc) @ base
    x, y, z = (local[:, 1] - local[:, 0]).T
    turn, flexion = np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))
    cmc = np.column_stack((np.cos(turn), np.sin(turn), 0. * turn)) * saddle.thumb_axis_distance
    straight, bent = phalanx_axes(saddle.thumb_mcp_abduction, saddle.thumb_roll).T
    normal = np.einsum('ijt,i->tj', metacarpal_axes(turn, flexion), np.cross(straight, bent))
    return np.column_stack((np.linalg.norm(local[:, 0] - cmc, axis=1),
                            *(((local[:, i] - local[:, 1]) * normal).sum(axis=1) for i in (2, 3))))


def solve_thumb(hand: Hand, saddle: Saddle, tips: np.ndarray) -> ThumbAngles:
    """Solve the thumb for positions of its tip, without limits of the CMC.

    Parameters
    ----------
    hand : Hand
        Uses its thumb's bones and the limits of MCP and IP.
    saddle : Saddle
    tips : ndarray, shape (n, 3)
        Relative to the CMC, in the wrist frame of a right hand [m].

    Returns
    -------
    ThumbAngles
    """
    base, _ = base_rotation(saddle.thumb_abduction_axis, saddle.thumb_rest_direction)
    x, y, z = base.T @ tips.T
    level = np.hypot(x, y)
    table = _flexion_table(hand, saddle.thumb_coupling)
    metacarpal, proximal, distal = hand.thumb_bones
    out = phalanx_axes(saddle.thumb_mcp_abduction, saddle.thumb_roll)
    lateral, more = np.zeros_like(x), 0.
    for _ in range(OUT_OF_PLANE_ROUNDS if out[1].any() or saddle.thumb_axis_distance else 1):
        along = (np.copysign(np.sqrt(np.maximum(level ** 2 - lateral ** 2, 0.)), x)
                 - saddle.thumb_axis_distance)
        flexions = np.interp(np.sqrt(np.maximum(along ** 2 + z ** 2 + more, 0.)), *table)
        mcp, ip = flexions.real, flexions.imag
        ahead = proximal * np.cos(mcp) + distal * np.cos(mcp + ip)
        below = proximal * np.sin(mcp) + distal * np.sin(mcp + ip)
        forward, lateral, down = out @ (ahead, below) + ((metacarpal,), (0.,), (0.,))
        more = (metacarpal + ahead) ** 2 + below ** 2 - forward ** 2 - down ** 2
    turn = np.arctan2(np.copysign(y, x * y), np.abs(x)) - np.arcsin(
        np.clip(np.copysign(lateral, x * lateral) / level, -1., 1.))
    flexion = np.arctan2(-z, along) - np.arctan2(down, forward)
    cmc = saddle.thumb_axis_distance * np.array((np.cos(turn), np.sin(turn), 0. * turn))
    axes = metacarpal_axes(turn, flexion)
    first = cmc + metacarpal * axes[0]
    second = first + np.einsum('ijt,it->jt', axes, out @ (
        proximal * np.cos(mcp), proximal * np.sin(mcp)))
    return ThumbAngles(turn, flexion, *((base @ joint).T for joint in (cmc, first, second)))


def _turned(v: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Return a vector (3,) turned about a unit axis."""
    return (np.cos(angle) * v + np.sin(angle) * np.cross(axis, v)
            + (1. - np.cos(angle)) * (axis @ v) * axis)


def _default_axes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the default abduction axis and two unit vectors orthogonal to it."""
    axis = np.divide(THUMB_ABDUCTION_AXIS, np.linalg.norm(THUMB_ABDUCTION_AXIS))
    across = np.cross(axis, (0., 0., 1.))
    across /= np.linalg.norm(across)
    return axis, across, np.cross(axis, across)


def _flexion_table(hand: Hand, coupling: tuple[float, float]
                   ) -> tuple[np.ndarray, np.ndarray]:
    """Tabulate increasing reaches [m] with their MCP and IP flexion [rad].

    These are real and imaginary part of one number, so that both are looked up at once. The IP is
    coupled to the MCP; at the limit of the MCP it flexes further alone.
    """
    slope, offset = coupling
    limits = hand.limits[[JOINTS.index('thumb_mcp_flexion'), JOINTS.index('thumb_ip_flexion')]]
    mcp = np.linspace(limits[0, 0], limits[0, 1], FLEXION_TABLE_STEPS)
    ip = np.clip(slope * mcp + offset, *limits[1])
    alone = np.linspace(ip[-1], limits[1, 1], FLEXION_TABLE_STEPS)
    mcp = np.append(mcp, np.full(FLEXION_TABLE_STEPS, mcp[-1]))
    ip = np.append(ip, alone)
    bones = hand.thumb_bones
    reach = np.hypot(bones[0] + bones[1] * np.cos(mcp) + bones[2] * np.cos(mcp + ip),
                     bones[1] * np.sin(mcp) + bones[2] * np.sin(mcp + ip))
    straightest = np.argmax(reach)
    falling = np.minimum.accumulate(reach[straightest:])[::-1]
    return falling, (mcp + 1j * ip)[straightest:][::-1]


def _rest_direction(hand: Hand, saddle: Saddle, tips: np.ndarray) -> np.ndarray:
    """Return the rest direction to centre recorded CMC angles within their limits, (3,)."""
    solved = solve_thumb(hand, saddle, tips)
    rows = [JOINTS.index('thumb_cmc_abduction'), JOINTS.index('thumb_cmc_flexion')]
    abduction, flexion = (
        np.percentile(angles, MOTION_PERCENTILES).mean() - limits.mean()
        for angles, limits in zip((solved.abduction, solved.flexion), hand.limits[rows]))
    base, _ = base_rotation(saddle.thumb_abduction_axis, saddle.thumb_rest_direction)
    return base @ direction_in_base(abduction, flexion)
