"""Marker messages without usable labels: read all points, and label those of the hand."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core.model.hand import OTHER_SIDE, Hand
from ..core.model.layout_presets import (
    JOINT_CENTRE_PRESETS,
    LAYOUT_PRESETS,
    preset_layout,
    skin_preset,
)
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..core.point_labelling.cloud_labeller import CloudLabeller, CloudLabels
from ..core.point_labelling.natural_poses import ANYBODY, model_prototype, tolerances_of
from ..core.point_labelling.prototypes import HandPrototype
from ..messages.marker_array import MarkerFrame
from ..messages.points import PointFrame, PointReader
from ..messages.stamps import seconds
from .setting_names import PARAMETER_NAMES, SettingNames

SEARCHED_LONG = 2.  # [s] without the hand among enough points, before the cure is named


def usual_shape_warning(hand: Hand, layout: MarkerLayout) -> str | None:
    """Return a warning of many markers to be labelled by the shape of a usual hand, else None.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    """
    if len(layout.names) <= len(MARKERS) or tolerances_of(hand) is not ANYBODY:
        return None
    return (f'{len(layout.names)} markers without labels are told apart by the shape of a usual '
            'hand, so that many labels are wrong until a hand file of yours is given '
            '(hand_tracker calibrate)')


def _worn_presets(names: tuple[str, ...], most: int) -> list[str]:
    """Return the presets of other worn markers than those of some names, at most so many."""
    worn = {preset: tuple(preset_layout(preset).names) for preset in LAYOUT_PRESETS
            if preset not in JOINT_CENTRE_PRESETS}
    return [preset for preset, others in worn.items() if len(others) <= most and others != names]


@lru_cache(maxsize=8)
def hand_prototype(hand: Hand, layout: MarkerLayout) -> HandPrototype:
    """Return the prototype to label a hand by, kept as it takes tenths of a second.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
        All of its markers are labelled.
    """
    return model_prototype(hand, layout, tuple(layout.names), tolerances_of(hand))


class PointLabels:
    """Label the points of one topic's messages: which is which marker of which hand on it.

    Each message is labelled once for all hands that are read from it.
    """

    def __init__(self) -> None:
        self._prototypes: dict[str, HandPrototype] = {}
        self._points = PointReader()
        self._labeller: CloudLabeller | None = None
        self._message: Any = None
        self._labelled: tuple[PointFrame, CloudLabels | None] | None = None
        self._read: set[str] = set()   # sides that have read this message
        self.told: set[str] = set()    # sides whose hand is logged as found

    def set_hand(self, hand: Hand, layout: MarkerLayout, points: PointReader) -> None:
        """Label points also for a hand; it replaces the one of its side.

        A followed hand of the same markers keeps its labels.

        Parameters
        ----------
        hand : Hand
        layout : MarkerLayout
        points : PointReader
            Of all hands.
        """
        self._points = points
        former, new = self._prototypes.get(hand.side), hand_prototype(hand, layout)
        self._prototypes[hand.side] = new
        if former is None or former.names != new.names:
            self._labeller = None
        elif self._labeller is not None and former is not new:
            self._labeller.replace_prototype(self._number(hand.side), new)

    def reset(self) -> None:
        """Forget the hands that were found, and the postures of their wearer."""
        self._labeller = self._labelled = None
        self.told.clear()

    def _number(self, side: str) -> int:
        """Return the place of a hand among those of the labeller."""
        return list(self._prototypes).index(side)

    def read(self, message: Any, side: str) -> tuple[PointFrame, np.ndarray, bool, bool]:
        """Return the points of a message, and those of a hand.

        Parameters
        ----------
        message : bytes or MarkerArray
        side : {'right', 'left'}

        Returns
        -------
        points : PointFrame
        places : ndarray, shape (M, 3)
            Of its markers; not numbers where one is hidden [m].
        found, other_side : bool
            See `CloudLabels`.
        """
        if self._labeller is None:
            self._labeller, self._message = CloudLabeller(list(self._prototypes.values())), None
        if message is not self._message or side in self._read:
            frame = self._points.read(message)
            self._labelled = frame, None if frame.stamp is None else self._labeller.update(
                frame.points, seconds(frame.stamp), frame.ids)
            self._message = message
            self._read.clear()
        self._read.add(side)
        assert self._labelled is not None
        frame, labels = self._labelled
        if labels is None:
            return frame, np.full((len(self._prototypes[side].names), 3), np.nan), False, False
        number = self._number(side)
        return frame, labels.places[number], labels.found[number], labels.other_side[number]

    def cloud_of(self, side: str) -> np.ndarray | None:
        """Return the points of the last message without those labelled as of another hand.

        Parameters
        ----------
        side : {'right', 'left'}

        Returns
        -------
        ndarray, shape (n, 3), or None
            None where the message had none [m].
        """
        frame, labels = self._labelled or (None, None)
        if frame is None or labels is None:
            return None
        others = [rows[rows >= 0] for number, rows in enumerate(labels.rows)
                  if number != self._number(side)]
        return np.delete(frame.points, np.concatenate(others), axis=0) if others else frame.points


class PointLabelReader:
    """Read the hand's markers from messages of points without labels.

    It stands in for a reader of labelled markers.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    points : PointReader
    labels : PointLabels, optional
        Shared with the reader of the other hand in these messages.
    names : SettingNames, optional
        Those of the node's parameters when left out.
    """

    signature = None  # such messages are never alike

    def __init__(self, hand: Hand, layout: MarkerLayout, points: PointReader,
                 labels: PointLabels | None = None,
                 names: SettingNames = PARAMETER_NAMES) -> None:
        self._labels = labels or PointLabels()
        self._labels.set_hand(hand, layout, points)
        self._side, self._layout, self._points, self._settings = hand.side, layout, points, names
        self._last: MarkerFrame | None = None
        self._searched_since: float | None = None
        self._has_told = self._has_told_side = self._is_other_side = False
        self._log_lines: list[tuple[bool, str]] = []

    def read(self, message: Any) -> MarkerFrame:
        """Return the markers of a message; those not found are not seen."""
        frame, places, found, other_side = self._labels.read(message, self._side)
        markers = MarkerFrame(
            frame.stamp, frame.frame_id, places, (), frame.foreign, (), frame.points)
        if frame.stamp is not None:
            self._note(seconds(frame.stamp), found, markers, other_side)
        return markers

    @property
    def cloud(self) -> np.ndarray | None:
        """The points of the last message but those of another hand, (n, 3) [m]; None without."""
        return self._labels.cloud_of(self._side)

    def replace_hand(self, hand: Hand) -> None:
        """Label by another hand of this side from now on, such as one of the wearer's size."""
        self._labels.set_hand(hand, self._layout, self._points)

    def _note(self, time: float | None, found: bool, markers: MarkerFrame,
              other_side: bool) -> None:
        """Collect what to log: the hand found, a hand of the other side, a pose to ask for."""
        self._last, self._is_other_side = markers, other_side
        if found:
            if self._side not in self._labels.told:
                self._log_lines.append((False, f'the {self._side} hand is found among '
                                        f'{markers.points_seen} points without labels'))
            self._labels.told.add(self._side)
            self.forget_search()
            return
        if time is None:
            return
        if self._searched_since is None or time < self._searched_since:
            self._searched_since = time
        is_told = self._has_told_side if other_side else self._has_told
        if is_told or not (other_side or time - self._searched_since >= SEARCHED_LONG):
            return
        self._has_told, self._has_told_side = True, other_side
        self._labels.told.discard(self._side)
        self._log_lines.append((True, self.why_not_found))

    @property
    def why_not_found(self) -> str:
        """Why no hand is found for long in the last points, and the cure; else empty."""
        if self._last is None or not self._has_told:
            return ''
        count, names = self._last.points_seen, tuple(self._layout.names)
        if self._is_other_side:
            other = OTHER_SIDE[self._side]
            return (f'the points look like a {other} hand: set '
                    f'{self._settings.side.format(other)}, or check whether axes are exchanged or '
                    'mirrored')
        if count < len(names):
            return f'only {count} points; the hand has {len(names)} markers'
        # Any of the points may be of no hand: the markers are these, or fewer.
        others = _worn_presets(names, count)
        known = f' (if you wear another, set it: {", ".join(others)})' if others else ''
        skin = skin_preset(self._layout)
        worn = f'; the layout {skin} has its markers where people wear them' if skin else ''
        return (f'the {self._side} hand is not found among {count} points: spread your fingers '
                f'for a moment{worn}; else the layout, of {len(names)} markers, does not fit '
                f'them{known}; or check the side and {self._settings.scale}')

    def forget_search(self) -> None:
        """Forget for how long no hand is found, and what was told of it."""
        self._searched_since = None
        self._has_told = self._has_told_side = False

    def pop_log_lines(self) -> list[tuple[bool, str]]:
        """Return the lines to log since the last call: whether it is a warning, and the line."""
        lines, self._log_lines = self._log_lines, []
        return lines

    def load_kernels(self, folder: Path | None = None) -> None:
        """Do nothing: the kernels that label points are loaded for all readers."""

    def use_loaded_kernels(self) -> None:
        """Do nothing: loaded kernels are used at once."""
