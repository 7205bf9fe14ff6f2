"""Fit the thumb: position and axis of the saddle joint, MCP abduction, coupling of the IP.

It is fitted so that the thumb solved from its tip alone reproduces the recorded joints.
"""

from typing import NamedTuple, cast

import numpy as np

from ..core.inverse_kinematics.digit import ASIDE_ROUNDS
from ..core.model.hand import DIGITS, JOINTS, THUMB_ABDUCTION_AXIS, THUMB_COUPLING, Hand
from ..core.model.kinematics import digit_base
from .fingers import MOTION_PERCENTILES
from .least_squares import evenly_spaced, regularised_fit

THUMB_ROW = DIGITS.index('thumb')
MCP_ABDUCTION_ROW = JOINTS.index('thumb_mcp_abduction')
THUMB_FIT_FRAMES = 250
FLEXION_TABLE_STEPS = 500

# Standard deviations of a thumb from the defaults; ours, unsourced.
AXIS_SPREAD = np.tan(np.radians(20.))
CMC_SPREAD = .0025                # [m] from the median of the recorded joint
SLOPE_SPREAD = .5                 # of the slope's logarithm
OFFSET_SPREAD = np.radians(15.)
MCP_ABDUCTION_SPREAD = np.radians(8.)
SLOPE_BOUNDS = (.3, 3.)
OFFSET_BOUNDS = (-np.pi / 4, np.pi / 4)
AXIS_BOUND = 2.5                  # [AXIS_SPREAD], 42 degrees
CMC_BOUND = 4.                    # [CMC_SPREAD]
CMC_WEIGHT = .3                   # [1] of its misses beside those of MCP and IP; from captures


class Saddle(NamedTuple):
    """The fitted part of a thumb, with the field names of `Hand`, as `digit_base` needs.

    Attributes
    ----------
    thumb_cmc : ndarray, shape (3,)
        In the wrist frame [m].
    thumb_abduction_axis, thumb_rest_direction : ndarray, shape (3,)
        Unit length.
    thumb_coupling : tuple of float
        Slope and offset of the IP's flexion against the MCP's [1, rad].
    thumb_mcp_abduction : float
        [rad]
    """

    thumb_cmc: np.ndarray
    thumb_abduction_axis: np.ndarray
    thumb_rest_direction: np.ndarray
    thumb_coupling: tuple[float, float]
    thumb_mcp_abduction: float = 0.


class ThumbAngles(NamedTuple):
    """Angles and joints of a thumb solved from its tip.

    Attributes
    ----------
    abduction, flexion : ndarray, shape (n,)
        Of the CMC, from the x axis of its base [rad].
    mcp, ip : ndarray, shape (n, 3)
        Joints relative to the CMC, in the wrist frame [m].
    """

    abduction: np.ndarray
    flexion: np.ndarray
    mcp: np.ndarray
    ip: np.ndarray


def fit_thumb(hand: Hand, thumb: np.ndarray) -> Hand:
    """Return `hand` with the thumb's CMC, axes, MCP abduction and coupling fitted.

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

    default, across, along = _default_axes()

    def saddle(x: np.ndarray) -> Saddle:
        axis = default + AXIS_SPREAD * (x[0] * across + x[1] * along)
        return Saddle(
            hand.thumb_cmc + CMC_SPREAD * x[4:7], axis / np.linalg.norm(axis),
            hand.thumb_rest_direction, (THUMB_COUPLING[0] * np.exp(SLOPE_SPREAD * x[2]),
                                        THUMB_COUPLING[1] + OFFSET_SPREAD * x[3]),
            MCP_ABDUCTION_SPREAD * x[7])

    def residuals(x: np.ndarray) -> np.ndarray:
        part = saddle(x)
        solved = solve_thumb(hand, part, recorded[:, 3] - part.thumb_cmc)
        joints = np.stack((0. * solved.mcp, solved.mcp, solved.ip), axis=1) + part.thumb_cmc
        misses = np.sqrt(((joints - recorded[:, :3]) ** 2).sum(axis=2))
        return misses * (CMC_WEIGHT, 1., 1.)

    slopes = np.log(np.divide(SLOPE_BOUNDS, THUMB_COUPLING[0])) / SLOPE_SPREAD
    offsets = np.subtract(OFFSET_BOUNDS, THUMB_COUPLING[1]) / OFFSET_SPREAD
    bounds = np.array([(-AXIS_BOUND, AXIS_BOUND)] * 2 + [slopes, offsets]
                      + [(-CMC_BOUND, CMC_BOUND)] * 3
                      + [hand.limits[MCP_ABDUCTION_ROW] / MCP_ABDUCTION_SPREAD]).T
    starts = [np.array((a, b, k, 0., 0., 0., 0., 0.)) for k in (-.7, .7)
              for a, b in ((0., 0.), (1., 0.), (-1., 0.), (0., 1.), (0., -1.))]
    part = saddle(regularised_fit(residuals, starts, bounds))
    return hand.replace(
        thumb_cmc=part.thumb_cmc, thumb_abduction_axis=part.thumb_abduction_axis,
        thumb_rest_direction=_rest_direction(hand, part, thumb[:, 3] - part.thumb_cmc),
        thumb_mcp_abduction=part.thumb_mcp_abduction,
        coupling=np.vstack((hand.coupling[:4], part.thumb_coupling)))


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
    base, _, _ = digit_base(cast(Hand, saddle), THUMB_ROW)
    local = base.T @ tips.T
    table = _flexion_table(hand, saddle.thumb_coupling)
    _, middle, last = hand.thumb_bones
    beside = np.zeros_like(local)  # of the tip by the MCP's abduction
    aside = saddle.thumb_mcp_abduction
    for _ in range(ASIDE_ROUNDS if aside else 1):
        turn, flexion, mcp, ip = _solve_plane(hand, table, local - beside)
        distal, across, dorsal = _metacarpal_axes(turn, flexion)
        ahead = middle * np.cos(mcp) + last * np.cos(mcp + ip)
        beside = ((np.cos(aside) - 1.) * distal + np.sin(aside) * across) * ahead
    first = hand.thumb_bones[0] * distal
    second = first + middle * (
        np.cos(mcp) * (np.cos(aside) * distal + np.sin(aside) * across) - np.sin(mcp) * dorsal)
    return ThumbAngles(turn, flexion, (base @ first).T, (base @ second).T)


def _solve_plane(hand: Hand, table: tuple[np.ndarray, np.ndarray], tips: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return turn, flexion, MCP and IP of a thumb that stays in its plane, (n,) each [rad].

    `tips` (3, n) are in its base [m].
    """
    x, y, z = tips
    turn = np.arctan2(np.copysign(y, x * y), np.abs(x))
    along = np.copysign(np.hypot(x, y), x)
    flexions = np.interp(np.hypot(along, z), *table)
    mcp, ip = flexions.real, flexions.imag
    bones = hand.thumb_bones
    ahead = bones[0] + bones[1] * np.cos(mcp) + bones[2] * np.cos(mcp + ip)
    below = bones[1] * np.sin(mcp) + bones[2] * np.sin(mcp + ip)
    return turn, np.arctan2(-z, along) - np.arctan2(below, ahead), mcp, ip


def _metacarpal_axes(turn: np.ndarray, flexion: np.ndarray
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where metacarpals point in the thumb's base, across and dorsally, (3, n) each."""
    c, s, cf, sf = np.cos(turn), np.sin(turn), np.cos(flexion), np.sin(flexion)
    return (np.array((c * cf, s * cf, -sf)), np.array((-s, c, np.zeros_like(s))),
            np.array((c * sf, s * sf, cf)))


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
    base, _, _ = digit_base(cast(Hand, saddle), THUMB_ROW)
    return base @ (
        np.cos(flexion) * np.cos(abduction), np.cos(flexion) * np.sin(abduction),
        -np.sin(flexion))
