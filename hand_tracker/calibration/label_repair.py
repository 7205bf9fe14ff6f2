"""Exchanged labels of the eight worn markers in a take, put right before it is fitted.

The tracker puts them right; it tracks the take as that of a usual hand of the size of its markers.
"""

from dataclasses import replace

import numpy as np

from ..core.model.hand import Hand
from ..core.model.layout_presets import SKIN_LAYOUT, preset_layout
from ..core.model.marker_layout import DIGIT_LANDMARKS, MARKERS
from ..core.model.states import SEEN, SWAPPED
from ..core.tracker import HandTracker
from .marker_names import canonical_name
from .size import fit_size
from .takes import MarkerTake
from .worn_markers import PAPER_PALM


def with_labels_put_right(take: MarkerTake, order: list[int]) -> tuple[MarkerTake, int]:
    """Put exchanged labels of a take of the eight worn markers alone right.

    Parameters
    ----------
    take : MarkerTake
    order : list of int
        Of `worn_order`.

    Returns
    -------
    MarkerTake
        The same where none are exchanged. In frames with exchanged labels a marker that the
        tracker does not see is missing.
    int
        In how many frames labels were exchanged.
    """
    places = [canonical_name(take.names[row]) for row in order]
    layout = replace(preset_layout(SKIN_LAYOUT), places=tuple(places))
    usual = Hand.scaled(side=take.side)
    points = take.points[:, order]
    tracker = HandTracker(fit_size(points, usual, layout) or usual, layout)
    right, changed = take.points.copy(), 0
    for frame, (measured, sequence) in enumerate(zip(points, take.sequence)):
        if frame and sequence != take.sequence[frame - 1]:
            tracker.reset()
        state = tracker.update(measured, frame / take.rate)
        is_swapped = state.marker_states == SWAPPED
        if not is_swapped.any():
            continue
        changed += 1
        put_right = np.where(is_swapped[:, None], state.markers, measured)
        put_right[~is_swapped & (state.marker_states != SEEN)] = np.nan
        right[frame, order] = put_right
    return (take._replace(points=right), changed) if changed else (take, 0)


def worn_order(take: MarkerTake) -> list[int] | None:
    """Return the rows of the eight worn markers, in the order of `MARKERS`; None for others."""
    names = [canonical_name(name) for name in take.names]
    wanted = [(place,) for place in PAPER_PALM] + [
        DIGIT_LANDMARKS[digit] for digit in MARKERS[len(PAPER_PALM):]]
    found = [[row for row, name in enumerate(names) if name in places] for places in wanted]
    is_worn = len(names) == len(MARKERS) and all(len(rows) == 1 for rows in found)
    return [row for row, in found] if is_worn else None
