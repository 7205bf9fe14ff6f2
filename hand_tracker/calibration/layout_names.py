"""Markers of takes that are named as those of a layout preset."""

from collections.abc import Iterable

import numpy as np

from ..core.errors import InvalidLayout
from ..core.model.layout_presets import LAYOUT_PRESETS, preset_layout, skin_preset
from ..core.model.marker_layout import PALM_LANDMARKS, MarkerLayout
from .marker_names import UsualPlace, canonical_name, identify

NEAR_LANDMARK = .013  # [m] from a landmark, within which a marker may be named after it


def layout_named(names: Iterable[str], given: MarkerLayout | None = None) -> MarkerLayout | None:
    """Return the layout that has markers of just these names, in the order of the names.

    Parameters
    ----------
    names : iterable of str
    given : MarkerLayout, optional
        Any of the presets when left out, with its markers where people wear them.

    Returns
    -------
    MarkerLayout or None
    """
    wanted = [str(name) for name in names]
    presets = (preset_layout(skin_preset(make()) or name) for name, make in LAYOUT_PRESETS.items())
    for layout in presets if given is None else (given,):
        if set(layout.names) == set(wanted):
            order = [layout.names.index(name) for name in wanted]
            return MarkerLayout([layout.places[row] for row in order], layout.offsets[order],
                                layout.deviations[order], wanted, layout.skin_shares[order])
    return None


def layout_hint(names: Iterable[str]) -> str:
    """Return the end of a message, with the preset whose markers have these names; else empty."""
    preset = worn_preset(names)
    return f'; its names are those of --layout {preset}' if preset else ''


def worn_preset(names: Iterable[str]) -> str:
    """Return the preset whose markers have these names, as people wear them; else empty."""
    wanted = {canonical_name(str(name)) for name in names}
    return next((skin_preset(make()) or preset for preset, make in LAYOUT_PRESETS.items()
                 if {canonical_name(name) for name in make().names} == wanted), '')


def names_in_layout(layout: MarkerLayout) -> tuple[tuple[str, ...], dict[str, UsualPlace]]:
    """Return the names by which a calibration knows the markers of a layout.

    Parameters
    ----------
    layout : MarkerLayout

    Returns
    -------
    names : tuple of str
        Of landmarks, where a marker is at one.
    usual : dict of str to UsualPlace
        Of the others.

    Raises
    ------
    InvalidLayout
        If two markers are at one landmark of a digit, where a calibration knows one.
    """
    names: list[str] = []
    usual = {}
    for name, place, offset in zip(layout.names, layout.places, layout.offsets):
        on_palm = place in PALM_LANDMARKS
        is_alone = [other for other in layout.places].count(place) == 1
        if place in names and not on_palm:
            raise InvalidLayout(f'markers {layout.names[names.index(place)]} and {name}: both at '
                                f'{place}; expected one at each landmark of a digit')
        if not on_palm or is_alone and np.linalg.norm(offset) < NEAR_LANDMARK:
            names.append(place)
            continue
        known, = identify((name,))
        own = canonical_name(
            name if known is not None and known.digit < 0 else f'hand_{name}')
        names.append(own)
        usual[own] = UsualPlace(place, tuple(offset.tolist()))
    return tuple(names), usual
