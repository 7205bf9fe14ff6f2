"""Online estimate of hand size, for a hand that nobody measured. No ROS."""

from __future__ import annotations

from threading import Thread
from typing import NamedTuple

import numpy as np

from ..calibration.size import fit_size
from ..core.model.hand import Hand
from ..core.model.marker_layout import PALM_MARKERS, MarkerLayout
from ..core.numerics.sampling import evenly_spaced
from .label_confirmation import are_confirmed
from .point_labels import hand_prototype

# [s] with the whole palm seen after which the size is estimated; after the last it is kept.
LEARNING_TIMES = (1., 2.5, 5.)
SAMPLE_PERIOD = .02     # [s] between two frames that are kept
CHECKED_CLOUDS = 12     # frames whose labels are checked, of points without labels
CHECKED_POINTS = 100    # of such a frame: a search among more takes longer than a frame may
MOST_REFUSALS = 6       # of estimates by wrong labels, after which no other is made; ours


class _Estimate(NamedTuple):
    """Estimated hand, None where the markers tell none, and whether its labels are confirmed."""

    hand: Hand | None
    are_labels_confirmed: bool | None


class AutoSize:
    """Collect the first seconds of markers, and estimate the hand's size from them.

    Parameters
    ----------
    hand : Hand
        Of which side, limits and coupling are kept.
    layout : MarkerLayout
    in_background : bool, optional
        Whether a thread estimates, so that no frame waits; the size then comes some frames
        later.

    Attributes
    ----------
    hand
    is_learning : bool
        Whether another estimate is to come.
    is_confirmed : bool
        Whether points may be labelled by the last hand of `add`: single frames confirm the labels
        that it is estimated from.
    is_refused : bool
        Whether the last estimate was refused, as single frames contradict its labels.
    """

    def __init__(self, hand: Hand, layout: MarkerLayout, in_background: bool = False) -> None:
        self.is_learning = True
        self.is_confirmed = self.is_refused = False
        self.hand, self._layout, self._in_background = hand, layout, in_background
        self._palm = list(layout.principal[:len(PALM_MARKERS)])
        self._refusals = 0
        self._is_estimating = False     # until the estimate is taken
        self._estimate: _Estimate | None = None
        self._begin()

    def anew(self) -> AutoSize:
        """Return another one that has seen no frame of the hand."""
        return AutoSize(self.hand, self._layout, self._in_background)

    def stop(self) -> None:
        """Make no other estimate."""
        self._due.clear()
        self.is_learning = False

    def _begin(self) -> None:
        self._kept: list[np.ndarray] = []
        self._clouds: list[tuple[np.ndarray, np.ndarray]] = []
        self._seen_for = 0.
        self._last: float | None = None
        self._due = list(LEARNING_TIMES)

    def add(self, markers: np.ndarray, time: float | None,
            cloud: np.ndarray | None = None) -> Hand | None:
        """Take a frame.

        Parameters
        ----------
        markers : ndarray, shape (n, 3)
            In the order of the layout, NaN where not seen [m].
        time : float or None
            Of the frame; frames without a time are not counted [s].
        cloud : ndarray, shape (m, 3), optional
            The points among which the markers were labelled by the hand's shape. An estimate by
            labels that single frames contradict is refused, and learning begins anew; one that was
            taken before stays.

        Returns
        -------
        Hand or None
            A hand of the size estimated since the last frame, None where there is none.
        """
        found = self._take_estimate()
        if self._due and time is not None:
            self._keep(markers, time, cloud)
        if self._due and self._seen_for >= self._due[0] and not self._is_estimating:
            self._due.pop(0)
            self._is_estimating = True
            frames = np.array(self._kept)
            clouds = [self._clouds[i] for i in evenly_spaced(len(self._clouds), CHECKED_CLOUDS)]
            if self._in_background:
                Thread(target=self._fit, args=(frames, clouds), name='fit size',
                       daemon=True).start()
            else:
                self._fit(frames, clouds)
                found = self._take_estimate()
        self.is_learning = bool(self._due) or self._is_estimating
        return found

    def _keep(self, markers: np.ndarray, time: float, cloud: np.ndarray | None) -> None:
        if not np.isfinite(markers[self._palm]).all():
            self._last = None
            return
        step = SAMPLE_PERIOD if self._last is None else time - self._last
        if step < 0.:
            self._last = time  # time jumped back
        elif step >= SAMPLE_PERIOD:
            self._seen_for += min(step, 2. * SAMPLE_PERIOD)
            self._last = time
            self._kept.append(markers.copy())
            if cloud is not None and len(cloud) <= CHECKED_POINTS:
                self._clouds.append((cloud, self._kept[-1]))

    def _fit(self, frames: np.ndarray, clouds: list[tuple[np.ndarray, np.ndarray]]) -> None:
        estimate = _Estimate(None, None)
        try:
            hand, are_right = fit_size(frames, self.hand, self._layout), None
            if hand is not None and clouds:
                are_right = are_confirmed(clouds, hand_prototype(self.hand, self._layout))
            if are_right:
                hand_prototype(hand, self._layout)  # so that no frame waits for it
            estimate = _Estimate(hand, are_right)
        finally:
            self._estimate = estimate

    def _take_estimate(self) -> Hand | None:
        """Return the hand of an estimate that has come and is not refused."""
        if self._estimate is None:
            return None
        hand, are_right = self._estimate
        self._estimate, self._is_estimating = None, False
        self.is_confirmed, self.is_refused = bool(are_right), are_right is False
        if not self.is_refused:
            return hand
        self._refusals += 1
        self._begin()
        if self._refusals >= MOST_REFUSALS:
            self._due.clear()
        return None
