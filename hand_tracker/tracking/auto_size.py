"""Online estimate of hand size, for a hand that nobody measured. No ROS."""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread

import numpy as np

from ..calibration.size import fit_size
from ..core.model.hand import Hand
from ..core.model.marker_layout import PALM_MARKERS, MarkerLayout

# [s] with the whole palm seen after which the size is estimated; after the last it is kept.
LEARNING_TIMES = (1., 2.5, 5.)
MOST_REFUSALS = 6     # of estimates, after which the size stays as it is; ours
SAMPLE_PERIOD = .02  # [s] between two frames that are kept


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
    is_learning : bool
        Whether another estimate is to come.
    """

    def __init__(self, hand: Hand, layout: MarkerLayout, in_background: bool = False) -> None:
        self.is_learning = True
        self._hand, self._layout, self._in_background = hand, layout, in_background
        self._palm = list(layout.principal[:len(PALM_MARKERS)])
        self._kept: list[np.ndarray] = []
        self._seen_for = 0.
        self._last: float | None = None
        self._due = list(LEARNING_TIMES)
        self._refusals = 0
        self._fits = self._is_refused = False
        self._found: Hand | None = None

    def add(self, markers: np.ndarray, time: float | None,
            accepts: Callable[[Hand], bool] | None = None) -> Hand | None:
        """Take a frame.

        Parameters
        ----------
        markers : ndarray, shape (n, 3)
            In the order of the layout, NaN where not seen [m].
        time : float or None
            Of the frame; frames without a time are not counted [s].
        accepts : callable, optional
            Returns whether a hand of the size estimated may be taken, in the thread that
            estimates; where not, learning starts anew.

        Returns
        -------
        Hand or None
            A hand of the size estimated since the last frame, None where there is none.
        """
        if self._due and time is not None:
            self._keep(markers, time)
        if self._due and self._seen_for >= self._due[0] and not self._fits:
            self._due.pop(0)
            self._fits = True
            frames = np.array(self._kept)
            if self._in_background:
                Thread(target=self._fit, args=(frames, accepts), name='fit size',
                       daemon=True).start()
            else:
                self._fit(frames, accepts)
        found, self._found = self._found, None
        if self._is_refused:
            self._start_anew()
        self.is_learning = bool(self._due) or self._fits or self._found is not None
        return found

    def _keep(self, markers: np.ndarray, time: float) -> None:
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

    def _start_anew(self) -> None:
        """Forget the frames so far, which were not of the hand; give up after some times."""
        self._is_refused = False
        self._refusals += 1
        self._kept.clear()
        self._seen_for, self._last = 0., None
        self._due = list(LEARNING_TIMES) if self._refusals < MOST_REFUSALS else []

    def _fit(self, frames: np.ndarray, accepts: Callable[[Hand], bool] | None) -> None:
        found = fit_size(frames, self._hand, self._layout)
        self._is_refused = found is not None and accepts is not None and not accepts(found)
        if not self._is_refused:
            self._found = found
        self._fits = False
