"""Marker messages without usable labels: read all points, and label those of the hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..core.labelling.cloud_labeller import CloudLabeller
from ..core.labelling.natural_poses import model_prototype
from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
from ..messages.marker_array import MarkerFrame
from ..messages.points import PointReader
from ..messages.stamps import seconds

LABEL_SOURCES = ('source', 'none')
SEARCHED_LONG = 3.  # [s] without the hand among enough points, before a pose is asked for


class PointLabelReader:
    """Read the hand's markers from messages of points without labels.

    It stands in for a reader of labelled markers.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    points : PointReader
    """

    signature = None  # such messages are never alike

    def __init__(self, hand: Hand, layout: MarkerLayout, points: PointReader) -> None:
        self._points = points
        self._side, self._count = hand.side, len(layout.names)
        self._labeller = CloudLabeller([model_prototype(hand, layout, tuple(layout.names))])
        self._searched_since: float | None = None
        self._was_found = False
        self._asked = False
        self._news: list[tuple[bool, str]] = []

    def read(self, message: Any) -> MarkerFrame:
        """Return the markers of a message; those not found are not seen."""
        frame = self._points.read(message)
        positions = np.full((self._count, 3), np.nan)
        if frame.stamp is None:
            return MarkerFrame(None, frame.frame_id, positions, (), frame.foreign, ())
        time = seconds(frame.stamp)
        labels = self._labeller.update(frame.points, time, frame.ids)
        rows = labels.rows[0]
        positions[rows >= 0] = frame.points[rows[rows >= 0]]
        self._note(time, labels.found[0], len(frame.points), labels.other_side[0])
        return MarkerFrame(frame.stamp, frame.frame_id, positions, (), frame.foreign, ())

    def _note(self, time: float | None, found: bool, count: int, other_side: bool) -> None:
        """Collect what to log: the hand found, a hand of the other side, a pose to ask for."""
        if found:
            if not self._was_found:
                self._news.append((False, f'the {self._side} hand is found among {count} points '
                                   'without labels'))
            self._was_found, self._searched_since, self._asked = True, None, False
            return
        if time is None:
            return
        if self._searched_since is None or time < self._searched_since:
            self._searched_since = time
        if self._asked or time - self._searched_since < SEARCHED_LONG:
            return
        self._asked, self._was_found = True, False
        other = 'left' if self._side == 'right' else 'right'
        if other_side:
            self._news.append((True, f'the points look like a {other} hand: set side:={other}, or '
                               'check whether axes are exchanged or mirrored'))
        elif count < self._count:
            self._news.append((True, f'only {count} points; the hand has {self._count} markers'))
        else:
            self._news.append((True, f'the {self._side} hand is not found among {count} points: '
                               'spread your fingers for a moment; else check unit_scale, side and '
                               'where the markers are'))

    def news(self) -> list[tuple[bool, str]]:
        """Return the lines to log since the last call: whether it is a warning, and the line."""
        news, self._news = self._news, []
        return news

    def load_kernels(self, folder: Path | None = None) -> None:
        """Do nothing: the kernels that label points are loaded for all readers."""

    def use_loaded_kernels(self) -> None:
        """Do nothing: loaded kernels are used at once."""
