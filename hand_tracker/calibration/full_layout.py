"""Marker layout of all markers of a take, by their fitted mounts."""

import numpy as np

from ..core.model.hand import LINKS, Hand
from ..core.model.marker_layout import (
    DEVIATION_RANGE,
    LINK_OF_LANDMARK,
    OFFSET_RANGE,
    PALM_LANDMARKS,
    SKIN_SHARE_RANGE,
    MarkerLayout,
    landmark_on_link,
)
from .layout_names import names_in_layout
from .marker_fit import MarkerFit

LANDMARK_OF_ROW = {LINKS.index(link): place for place, link in LINK_OF_LANDMARK.items()
                   if link in LINKS}


def full_layout(fit: MarkerFit) -> MarkerLayout:
    """Return the layout of all markers of a fit.

    Parameters
    ----------
    fit : MarkerFit

    Returns
    -------
    MarkerLayout
        With the names of the fit's markers. Those at a knuckle ride on its metacarpal.
    """
    right = fit.hand.as_right()
    noise: dict[str, float] = {}
    for row, digit in enumerate(fit.digits):
        if digit is not None:
            mine = [marker.name for marker in fit.markers if marker.digit == row]
            noise.update(zip(mine, digit.problem.noise.tolist()))
    names, places, offsets, deviations, shares = [], [], [], [], []
    for i, marker in enumerate(fit.markers):
        if marker.name not in fit.mounts:
            continue
        mount = fit.mounts[marker.name]
        if mount.link >= 0:
            place, offset = LANDMARK_OF_ROW[mount.link], mount.offset
        else:
            place, offset = _palm_place(right, marker.name, mount.offset)
            moved = fit.local[:, i] - mount.offset
            noise[marker.name] = float(np.sqrt(np.nanmedian(np.square(moved), axis=0).mean()))
        names.append(marker.name)
        places.append(place)
        offsets.append(np.clip(offset, -OFFSET_RANGE, OFFSET_RANGE))
        deviations.append(np.clip(noise.get(marker.name, 0.), *DEVIATION_RANGE))
        shares.append(np.clip(mount.share, *SKIN_SHARE_RANGE))
    return MarkerLayout(places, np.array(offsets), np.array(deviations), names, np.array(shares))


def fitted_layout(fit: MarkerFit, layout: MarkerLayout) -> MarkerLayout:
    """Return a layout with its markers where a fit has found them.

    Parameters
    ----------
    fit : MarkerFit
        To takes whose markers are named as by `names_in_layout`.
    layout : MarkerLayout
        Markers that the takes lack stay where it has them.

    Returns
    -------
    MarkerLayout
    """
    found = full_layout(fit)
    places, offsets = list(layout.places), layout.offsets.copy()
    deviations, shares = layout.deviations.copy(), layout.skin_shares.copy()
    for row, name in enumerate(names_in_layout(layout)[0]):
        if name in found.names:
            at = found.names.index(name)
            places[row], offsets[row] = found.places[at], found.offsets[at]
            deviations[row], shares[row] = found.deviations[at], found.skin_shares[at]
    return MarkerLayout(places, offsets, deviations, layout.names, shares)


def _palm_place(hand: Hand, name: str, place: np.ndarray) -> tuple[str, np.ndarray]:
    """Return the landmark of a palm marker, and its offset from there [m]."""
    def offset(landmark: str) -> np.ndarray:
        return place - landmark_on_link(hand, landmark)[1]

    if name not in PALM_LANDMARKS:
        # On the wrist's link, where no finger moves it.
        name = min((landmark for landmark in PALM_LANDMARKS if not landmark.endswith('_mcp')),
                   key=lambda landmark: float(np.abs(offset(landmark)).max()))
    return name, offset(name)
