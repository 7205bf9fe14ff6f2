"""Markers of any layout as rows for kernels: the eight principal ones, then the further ones.

All arrays have `ROW_CAPACITY` rows, so that the kernels are compiled once for all layouts.
"""

from typing import NamedTuple

import numpy as np

from .hand import DIGITS, FINGERS, Hand
from .marker_layout import (
    COUNT_RANGE,
    MARKERS,
    PALM_LANDMARKS,
    SKIN_JOINTS,
    MarkerLayout,
)
from .states import SEEN

PRINCIPALS = len(MARKERS)
LAYOUT_CAPACITY = COUNT_RANGE[1]
ROW_CAPACITY = PRINCIPALS + LAYOUT_CAPACITY - 3  # three of the palm are always principal
# Deviation of a marker of which none is known, and the least that is believed [m]. Ours.
USUAL_DEVIATION, LEAST_DEVIATION = .001, .0005
ON_WRIST = -1


class MarkerRows(NamedTuple):
    """Markers of a layout on a right hand.

    Attributes
    ----------
    used : ndarray of int, shape (1,)
        Number of rows in use.
    order : ndarray of int, shape (65,)
        Row of the marker in the layout; -1 for a principal marker that the layout lacks.
    digit : ndarray of int, shape (65,)
        Digit, 0 to 4, index finger to thumb; -1 of the palm.
    link : ndarray of int, shape (65,)
        Of a digit's marker, its link, 0 to 4; of the palm's, the finger on whose metacarpal it
        is, -1 on the wrist.
    end, offset : ndarray, shape (65, 3)
        Landmark in the frame of the link, of the palm's in that of the wrist with the palm flat,
        and marker from there [m].
    joint : ndarray of int, shape (65,)
        Joint of the digit, 0 to 4, with whose flexion the offset turns; -1 where it does not.
    share : ndarray, shape (65,)
        Share of that flexion by which it turns [1].
    variance : ndarray, shape (65,)
        Of the marker on an axis [m²].
    has_several : ndarray of bool, shape (6,)
        Whether a digit has another marker than its principal one, or this one's offset turns,
        which no closed form knows; the last is of the palm.
    cmc : ndarray, shape (4, 3)
        CMC joints of the fingers in the wrist's frame [m].
    bone_ends : ndarray, shape (5, 3, 3)
        As of `Hand.bone_ends` [m].
    synergy : ndarray, shape (4,)
        As `Hand.palm_synergy` [1].
    is_cupping : ndarray of bool, shape (1,)
        Whether the palm's arch is solved or follows its synergy.
    is_needed : ndarray of bool, shape (1,)
        Whether the layout is another than the paper's eight, the palm may cup or an offset turns.
    """

    used: np.ndarray
    order: np.ndarray
    digit: np.ndarray
    link: np.ndarray
    end: np.ndarray
    offset: np.ndarray
    joint: np.ndarray
    share: np.ndarray
    variance: np.ndarray
    has_several: np.ndarray
    cmc: np.ndarray
    bone_ends: np.ndarray
    synergy: np.ndarray
    is_cupping: np.ndarray
    is_needed: np.ndarray


def layout_rows(layout: MarkerLayout) -> np.ndarray:
    """Return the row of the layout that is in each row of the kernels, -1 for none, shape (k,)."""
    return np.array((*layout.principal, *layout.further))


def marker_rows(hand: Hand, layout: MarkerLayout, palm_arch: str) -> MarkerRows:
    """Return a layout's markers as rows for kernels.

    Parameters
    ----------
    hand : Hand
        Of the right side.
    layout : MarkerLayout
    palm_arch : {'flat', 'observed', 'synergy'}

    Returns
    -------
    MarkerRows
    """
    order = layout_rows(layout)
    mounting, principal = layout.mounting(hand), layout.principal_mounting(hand)
    rows = MarkerRows(
        np.array((len(order),)), np.full(ROW_CAPACITY, -1),
        np.full(ROW_CAPACITY, ON_WRIST), np.full(ROW_CAPACITY, ON_WRIST),
        np.zeros((ROW_CAPACITY, 3)), np.zeros((ROW_CAPACITY, 3)),
        np.full(ROW_CAPACITY, -1), np.zeros(ROW_CAPACITY),
        np.full(ROW_CAPACITY, USUAL_DEVIATION ** 2), np.zeros(len(DIGITS) + 1, dtype=bool),
        hand.finger_cmc.copy(), hand.bone_ends(), hand.palm_synergy.copy(),
        np.zeros(1, dtype=bool), np.zeros(1, dtype=bool))
    for row, at in enumerate(order):
        rows.order[row] = at
        place = layout.places[at] if at >= 0 else MarkerLayout().places[row]
        name = place.split('_')[0]
        if place not in PALM_LANDMARKS:
            rows.digit[row] = DIGITS.index(name)
            link = mounting.link[at] if at >= 0 else principal.link[row]
            position = mounting.position[at] if at >= 0 else principal.position[row]
            rows.link[row] = link % 5
            rows.offset[row] = layout.offsets[at] if at >= 0 else 0.
            rows.share[row] = layout.skin_shares[at] if at >= 0 else 0.
            if rows.share[row] and link in SKIN_JOINTS:
                rows.joint[row] = SKIN_JOINTS[link] % 5
            rows.end[row] = position - rows.offset[row]
        else:
            finger = FINGERS.index(name) if place.endswith('_mcp') else ON_WRIST
            rows.link[row] = finger
            rows.offset[row] = layout.offsets[at]
            rows.end[row] = mounting.position[at] - rows.offset[row]
            if mounting.link[at] >= 0:
                rows.end[row] += hand.finger_cmc[finger]
        if at >= 0:
            known = layout.deviations[at] or USUAL_DEVIATION
            rows.variance[row] = max(known, LEAST_DEVIATION) ** 2
        if row >= PRINCIPALS or rows.joint[row] >= 0:
            rows.has_several[rows.digit[row]] = True
    rows.is_cupping[0] = shows_arch(layout, palm_arch)
    rows.is_needed[0] = (layout.names != MARKERS or rows.is_cupping[0]
                         or rows.has_several.any())
    return rows


def shows_arch(layout: MarkerLayout, palm_arch: str = 'observed') -> bool:
    """Return whether the palm's CMC joints are solved, or follow their synergy.

    Parameters
    ----------
    layout : MarkerLayout
        Shows them with a marker more than three on the palm, and one on a knuckle.
    palm_arch : {'flat', 'observed', 'synergy'}, optional

    Returns
    -------
    bool
    """
    palm = [place for place in layout.places if place in PALM_LANDMARKS]
    observed = len(palm) > 3 and any(place.endswith('_mcp') for place in palm)
    return palm_arch == 'synergy' or palm_arch == 'observed' and observed


class RowState(NamedTuple):
    """State of the marker rows from frame to frame, of a right hand.

    Attributes
    ----------
    points : ndarray, shape (65, 3)
        This frame's markers as measured [m].
    is_measured, was_measured : ndarray of bool, shape (65,)
        In this and in the last frame.
    is_fitted : ndarray of bool, shape (65,)
        Whether the digit's angles are fitted to it: measured, or the predicted principal one of a
        digit of which no marker is seen.
    is_known : ndarray of bool, shape (65,)
        Whether measured since the start.
    hidden_for : ndarray, shape (65,)
        [s]
    away_for : ndarray, shape (65,)
        Time since a digit's marker was last seen in place, infinite before it was [s].
    velocity : ndarray, shape (65, 3)
        Of the digits' markers then, in the wrist's frame, the palm laid flat [m/s].
    verdict : ndarray of int, shape (65,)
        REJECTED of a digit's further marker that is refused, SWAPPED of two of a digit whose labels
        are exchanged, else SEEN.
    refused_at : ndarray, shape (65, 3)
        Where a refused marker was last, as `local` [m].
    arch : ndarray, shape (4,)
        Flexion of the fingers' CMC joints [rad].
    angles : ndarray, shape (25,)
        Solved by all markers of a digit [rad].
    deviation : ndarray, shape (25,)
        Standard deviation of these, 0 where a digit is not solved so [rad].
    local : ndarray, shape (65, 3)
        This frame's markers in the wrist's frame, the palm laid flat [m].
    targets : ndarray, shape (5, 3)
        The digits' filtered principal markers in the wrist's frame, the palm laid flat [m].
    is_solved : ndarray of bool, shape (5,)
        Digits solved by Gauss-Newton in this frame, so that the closed form need not.
    is_followed : ndarray of bool, shape (5,)
        The others whose principal marker is seen.
    learns_shift : ndarray of bool, shape (6,)
        Whether shifts of each digit, and of the palm, are learned in this frame.
    seen_shift : ndarray, shape (65, 3)
        How far each marker is off its place, in the frame of its link, as last seen with all others
        of its digit, or of the palm [m].
    seen_shift_angles : ndarray, shape (25,)
        Angles with these shifts [rad].
    skin_shift, skin_shift_angles : ndarray, shape (65, 3) and (25,)
        The same when a marker of the digit, or of the palm, last vanished [m, rad].
    skin_shift_share : ndarray, shape (6,)
        Share of these that the fit of each digit takes into account, the last of the palm [1].
    misfit : ndarray, shape (5,)
        Of each digit, square of its markers' distances from it over their variances, for each
        degree of freedom, averaged while its skin shifts are learned [1].
    """

    points: np.ndarray
    is_measured: np.ndarray
    was_measured: np.ndarray
    is_fitted: np.ndarray
    is_known: np.ndarray
    hidden_for: np.ndarray
    away_for: np.ndarray
    velocity: np.ndarray
    verdict: np.ndarray
    refused_at: np.ndarray
    arch: np.ndarray
    angles: np.ndarray
    deviation: np.ndarray
    local: np.ndarray
    targets: np.ndarray
    is_solved: np.ndarray
    is_followed: np.ndarray
    learns_shift: np.ndarray
    seen_shift: np.ndarray
    seen_shift_angles: np.ndarray
    skin_shift: np.ndarray
    skin_shift_angles: np.ndarray
    skin_shift_share: np.ndarray
    misfit: np.ndarray


def initial_rows(relaxed: np.ndarray) -> RowState:
    """Return the `RowState` before the first frame, at angles of shape (25,) [rad]."""
    def none() -> np.ndarray:
        return np.zeros(ROW_CAPACITY, dtype=bool)

    return RowState(np.full((ROW_CAPACITY, 3), np.nan), none(), none(), none(), none(),
                    np.zeros(ROW_CAPACITY), np.full(ROW_CAPACITY, np.inf),
                    np.zeros((ROW_CAPACITY, 3)), np.full(ROW_CAPACITY, SEEN),
                    np.zeros((ROW_CAPACITY, 3)), np.zeros(len(FINGERS)), relaxed.copy(),
                    np.zeros(len(relaxed)), np.zeros((ROW_CAPACITY, 3)), np.zeros((len(DIGITS), 3)),
                    np.zeros(len(DIGITS), dtype=bool), np.zeros(len(DIGITS), dtype=bool),
                    np.zeros(len(DIGITS) + 1, dtype=bool),
                    np.zeros((ROW_CAPACITY, 3)), relaxed.copy(), np.zeros((ROW_CAPACITY, 3)),
                    relaxed.copy(), np.zeros(len(DIGITS) + 1), np.ones(len(DIGITS)))
