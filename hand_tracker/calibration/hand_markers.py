"""The markers of a hand in a recording of points, chosen by their labels."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import OTHER_SIDE
from ..core.model.marker_layout import (
    MARKERS,
    PALM_LANDMARKS,
    PALM_MARKERS,
    PAPER_PLACES,
    MarkerLayout,
)
from ..files.point_recording import PointRecording
from ..messages.labels import shown_labels
from .hand_axes import HandPoints, columns_of, hands_of, sided_hand
from .known_layouts import complete_layout
from .layout_labels import labelled_layout, point_names
from .worn_markers import WORN_LANDMARKS

LEAST_PALM = 3  # markers, without which no wrist is placed


class UnknownMarkers(HandTrackerError, ValueError):
    """A recording whose labels do not say which of its points are the hand's markers.

    Attributes
    ----------
    missing : tuple of str
        Those of the layout for which there is no label.
    """

    def __init__(self, message: str, missing: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.missing = tuple(missing)


class ChosenMarkers(NamedTuple):
    """Markers of a hand in a recording of points.

    Attributes
    ----------
    columns : tuple of tuple of int, length n
        Columns of each of the layout's markers, whose mean it is; empty where it is not there.
    layout : MarkerLayout
        Where they are worn.
    side : str
        That the labels name, empty where they name none.
    """

    columns: tuple[tuple[int, ...], ...]
    layout: MarkerLayout
    side: str

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the markers that are not there."""
        return tuple(name for name, columns in zip(self.layout.names, self.columns)
                     if not columns)

    def columns_of(self, names: Collection[str]) -> dict[str, int]:
        """Return the columns of some markers by the places where they are worn."""
        return {place: columns[0] for name, place, columns in zip(
            self.layout.names, self.layout.places, self.columns) if name in names and columns}


def choose_markers(recording: PointRecording, side: str | None = None,
                   names: Mapping[str, str] | None = None,
                   layout: MarkerLayout | None = None) -> ChosenMarkers:
    """Choose the markers of a layout by the labels of a recording.

    Parameters
    ----------
    recording : PointRecording
    side : {'right', 'left'}, optional
        Of the hand, where the recording may have two; the one with more markers when left out.
    names : mapping of str to str, optional
        Label of each marker that is not found by itself.
    layout : MarkerLayout, optional
        The markers; the paper's eight when left out, which by their labels are at the DIP or at
        the tip.

    Returns
    -------
    ChosenMarkers

    Raises
    ------
    UnknownMarkers
        Naming the markers that were not found, and the labels of the recording.
    """
    given = {marker: labelled_column(recording, marker, label)
             for marker, label in (names or {}).items()}
    if layout is None or layout.names == MARKERS:
        chosen = _choose_eight(_hand_of(recording, side), given, layout)
        lacks_palm = bool(set(chosen.missing) & set(PALM_MARKERS))
    else:
        found = labelled_layout(
            point_names(recording.labels, recording.is_landmarks), layout, side)
        columns = tuple(
            (given[name],) if name in given else (column,) * (column >= 0)
            for name, column in zip(layout.names, found.columns))
        chosen = ChosenMarkers(columns, layout, found.side)
        lacks_palm = sum(place in PALM_LANDMARKS and bool(one) for place, one in zip(
            layout.places, columns)) < LEAST_PALM
    has_digit = any(one and place not in PALM_LANDMARKS
                    for place, one in zip(chosen.layout.places, chosen.columns))
    if chosen.missing and (lacks_palm or not has_digit):
        other = (complete_layout(recording) if layout is None or layout.names == MARKERS
                 else None)
        instead = '' if other is None else (
            f'--side {other.side}, of which they are, or '
            if side and other.side == OTHER_SIDE[side]
            else f'--layout {other.name}, whose markers are all there, or ')
        raise UnknownMarkers(
            f'{recording.name}: no label for {", ".join(chosen.missing)}'
            + (f' of a {side} hand' if side else '') + f'; expected {instead}'
            f'--markers {chosen.missing[0]}=LABEL,... with labels of the file: '
            + shown_labels(recording.labels) + ' (hand_tracker track, view or demo --labels none '
            'finds a hand among points by its shape)',
            chosen.missing)
    return chosen


def _choose_eight(hand: HandPoints, given: Mapping[str, int],
                  layout: MarkerLayout | None) -> ChosenMarkers:
    """Choose the paper's eight markers, `given` by their columns or by landmarks."""
    columns: list[tuple[int, ...]] = []
    places: list[str] = []
    for slot, marker in enumerate(MARKERS):
        landmarks: Sequence[str] = (PAPER_PLACES[slot],)
        if layout is not None:
            landmarks = (layout.places[slot],)
        elif marker in WORN_LANDMARKS:
            landmarks = WORN_LANDMARKS[marker]
        place = next((name for name in landmarks if name in hand.columns), landmarks[0])
        places.append(place)
        if marker in given:
            columns.append((given[marker],))
        elif place == 'wrist' and place not in hand.columns:
            # Two markers at the sides of the wrist have it between them.
            columns.append(tuple(column for name, column in hand.columns.items()
                                 if name.startswith('wrist')))
        else:
            columns.append((hand.columns[place],) if place in hand.columns else ())
    return ChosenMarkers(tuple(columns), layout or MarkerLayout(places), hand.side)


def _hand_of(recording: PointRecording, side: str | None) -> HandPoints:
    """Return the hand of a side, with the points whose labels name no side."""
    hands = hands_of(recording)
    both = columns_of(hands, '')
    best = sided_hand(hands, side)
    if best is None or len(both) > len(best.columns):
        return HandPoints('', both)
    return HandPoints(best.side, columns_of(hands, best.side))


def labelled_column(recording: PointRecording, marker: str, label: str) -> int:
    """Return the column of the point with a label, which is to be a marker.

    Raises
    ------
    UnknownMarkers
        If no point has the label, or several have.
    """
    exact = [i for i, one in enumerate(recording.labels) if one == label]
    # Without its subject, where that leaves no doubt.
    short = [i for i, one in enumerate(recording.labels) if one.rpartition(':')[2] == label]
    found = exact or short
    if len(found) != 1:
        raise UnknownMarkers(f"{recording.name}: {len(found) or 'no'} points with the label "
                             f"'{label}' for {marker}; expected one of "
                             f'{shown_labels(recording.labels, label)}')
    return found[0]


def marker_points(recording: PointRecording, chosen: ChosenMarkers) -> np.ndarray:
    """Return the chosen markers of a recording, NaN where missing, shape (T, n, 3) [m]."""
    points = np.full((len(recording.points), len(chosen.columns), 3), np.nan, dtype=np.float32)
    for slot, columns in enumerate(chosen.columns):
        if columns:
            points[:, slot] = np.mean([recording.points[:, column] for column in columns], axis=0)
    return points
