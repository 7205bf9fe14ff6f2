"""Match of a recording's labels with the layout presets, and the side of its hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import BOTH, SIDES
from ..core.model.layout_presets import LAYOUT_PRESETS, PAPER_LAYOUT, preset_layout
from ..core.model.marker_layout import PAPER_PLACES
from ..core.numerics.sampling import every_few
from ..files.point_recording import UNIT_SPELLINGS, PointRecording
from .cloud_side import likely_side
from .cloud_size import nameless_columns
from .hand_axes import HandPoints, columns_of, hands_of, likelier_unit, side_likelihood
from .layout_labels import labelled_layout, point_names

LEAST_LIKELIHOOD = .2      # of layouts that are listed
LEAST_PRESENT = .5         # of a layout's markers that are there
NAMED_SIDE = .99           # likelihood of a side that labels name
COUNTED_FRAMES = 200       # in which points are counted, up to twice as many
HAND_SPAN = .30            # [m] that a hand's markers are within


class LikelyLayout(NamedTuple):
    """A layout that a recording may have.

    Attributes
    ----------
    name : str
        Of `LAYOUT_PRESETS`.
    side : {'right', 'left', 'unknown'}
    likelihood : float
        0 to 1.
    is_complete : bool
        Whether all its markers are there.
    """

    name: str
    side: str
    likelihood: float
    is_complete: bool = False


def likely_layouts(recording: PointRecording) -> list[LikelyLayout]:
    """Return the layouts that a recording may have, by its labels and the hand's shape.

    Parameters
    ----------
    recording : PointRecording

    Returns
    -------
    list of LikelyLayout
        The most likely first. The likelihood is the share of names that layout and recording
        have in common, times that of the side; where there are no names, the share of frames
        with as many points as the layout has markers, together within a hand's size.
    """
    labelled = hands_of(recording)
    hands = {hand.side: hand.columns for hand in labelled}
    likelihoods = {side: _right_likelihood(recording, HandPoints(side, columns_of(labelled, side)))
                   for side in ('', *SIDES)}
    found: dict[tuple[str, str], LikelyLayout] = {}
    for name, match in _matches(recording, hands):
        if not match.side and any(len(hands.get(side, ())) > 2 for side in SIDES):
            continue
        right = likelihoods[match.side]
        for side, share in (('right', right), ('left', 1. - right)):
            likelihood = match.share if right == .5 else match.share * share
            if likelihood < LEAST_LIKELIHOOD or right == .5 and side == 'left':
                continue
            one = LikelyLayout(name, 'unknown' if right == .5 else side, round(likelihood, 3),
                               match.is_complete)
            # Of points that name a side and of those that name none.
            other = found.setdefault((one.name, one.side), one)
            found[one.name, one.side] = max(one, other, key=lambda layout: layout.likelihood)
    return sorted(found.values() or _by_number(recording), key=lambda one: -one.likelihood)


def complete_layout(recording: PointRecording) -> LikelyLayout | None:
    """Return the likeliest preset whose markers are all in a recording, None for none."""
    return first_complete(likely_layouts(recording))


def first_complete(layouts: Sequence[LikelyLayout]) -> LikelyLayout | None:
    """Return the likeliest layout whose markers are all present, None for none."""
    return next((layout for layout in layouts if layout.is_complete), None)


def has_both(recording: PointRecording, layouts: Sequence[LikelyLayout], name: str) -> bool:
    """Return whether labels name both hands, with all markers of a preset on each."""
    complete = {one.side: one.likelihood for one in layouts
                if one.name == name and one.is_complete}
    if not set(SIDES) <= complete.keys():
        return False
    # Of one hand whose side its shape alone tells the likelihoods add up to 1 at most.
    return set(SIDES) <= {hand.side for hand in hands_of(recording)} or (
        sum(complete[side] for side in SIDES) > 1.)


def _right_likelihood(recording: PointRecording, hand: HandPoints) -> float:
    """Return the probability of a right hand, by its labels and by its shape."""
    by_shape, side = side_likelihood(recording, hand), hand.side or recording.side
    if not side:
        return by_shape
    by_name = NAMED_SIDE if side == 'right' else 1. - NAMED_SIDE
    both = by_name * by_shape
    return both / (both + (1. - by_name) * (1. - by_shape))


class LayoutMatch(NamedTuple):
    """Overlap of a layout's markers with those of a recording's hand.

    Attributes
    ----------
    side : str
        As the labels say, empty where they do not.
    share : float
        Of the markers of both that they have in common (F1 score) [1].
    is_complete : bool
    """

    side: str
    share: float
    is_complete: bool


def _matches(recording: PointRecording, hands: Mapping[str, Mapping[str, int]]
             ) -> Iterator[tuple[str, LayoutMatch]]:
    """Yield how far each preset and each hand have the same markers."""
    labels = recording.labels
    names = point_names(labels, recording.is_landmarks)
    # Numbers name a layout only where there are no others.
    unnumbered = point_names(['' if label.isdecimal() else label for label in labels],
                             recording.is_landmarks)
    for preset in LAYOUT_PRESETS:
        layout = preset_layout(preset)
        is_numbered = (all(name.isdecimal() for name in layout.names)
                       and len(list(filter(None, labels))) != len(layout.names))
        matches = {}
        for wanted in SIDES:
            found = labelled_layout(unnumbered if is_numbered else names, layout, wanted)
            mine, total = len(found.found), len(layout.names)
            there = found.found.union(hands.get('', {}).values(),
                                      hands.get(found.side, {}).values())
            if mine >= LEAST_PRESENT * total:
                matches[found.side] = LayoutMatch(
                    found.side, 2. * mine / (total + len(there)), mine == total)
        yield from ((preset, match) for match in matches.values())


def _by_number(recording: PointRecording) -> list[LikelyLayout]:
    """Return the layouts of as many markers as there are points, none of which has a name.

    Where some have no label, a hand is also searched among them by its shape, as the tracker does.
    """
    points = every_few(recording.points, COUNTED_FRAMES)[:, nameless_columns(recording)]
    if points.size == 0:
        return []
    counts = np.isfinite(points).all(axis=2).sum(axis=1)
    full = points[counts >= len(PAPER_PLACES)]
    if not len(full):
        return []
    # In the unit in which they are the likelier ones of a hand.
    unit = likelier_unit(recording)
    full = full * (UNIT_SPELLINGS[unit][0] / recording.axes.scale) if unit else full
    span = np.nanmax(full, axis=1) - np.nanmin(full, axis=1)
    near = float(np.mean(np.linalg.norm(span, axis=1) < HAND_SPAN))
    sizes = {preset: len(preset_layout(preset).names) for preset in LAYOUT_PRESETS}
    likelihoods = {preset: near * float(np.mean(counts == size)) / [*sizes.values()].count(size)
                   for preset, size in sizes.items()}
    found = {(name, 'unknown'): one for name, one in likelihoods.items()
             if one >= LEAST_LIKELIHOOD}
    if not all(recording.labels):
        found = {**_by_shape(full, near, max(likelihoods.values())), **{
            key: one for key, one in found.items() if key[0] != PAPER_LAYOUT}}
    return [LikelyLayout(name, side, round(one, 3)) for (name, side), one in found.items()
            if round(one, 3)]


def _by_shape(points: np.ndarray, near: float, by_number: float) -> dict[tuple[str, str], float]:
    """Return the likelihood of the paper's markers on hands found by shape, by layout and side.

    Parameters
    ----------
    points : ndarray, shape (T, n, 3)
        NaN where missing [m].
    near : float
        Share of the frames with all of them within a hand's size [1].
    by_number : float
        Greatest likelihood of a layout by the number of points.
    """
    counts = np.isfinite(points).all(axis=2).sum(axis=1)
    usual = near * max(float(np.mean(counts == len(PAPER_PLACES))), .1)
    side, share = likely_side(points)
    likelihood = max(usual, (1. - by_number) * share)
    return {(PAPER_LAYOUT, one): likelihood
            for one in (SIDES if side == BOTH else (side or 'unknown',))}
