"""Search exchanged labels where several markers show a digit: solve the hand under others. No ROS.

With one marker a digit a hand meets its markers under any labels, and only their usual places tell
(`exchange_check`); with more, the labels are right under which the hand fits.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from ..core.model.hand import DIGITS, Hand
from ..core.model.marker_layout import ALL_LANDMARKS, OF_PALM, MarkerLayout
from ..core.model.states import MarkerState, PalmState, are_seen
from ..core.numerics.jit import JIT_IS_ON
from ..core.options import TrackerOptions
from ..core.tracker import HandState, HandTracker
from .exchange_check import LEAST_MOVE, LEAST_STEP, ExchangeCheck, LabelCheck

SEARCHED_FRAMES, MOST_FRAMES = 6, 30    # in which an exchange is tried, and of a search
# Fall of the residuals' sum that an exchange needs on average. Of captured and simulated hands no
# exchange of right labels gains anything, and the right one of exchanged labels 28 mm at least,
# also where the hand's size is not known. Ours.
LEAST_FALL = .015       # [m]
USUAL_RESIDUAL = .0025  # [m] of a marker of a measured hand, at most; ours
# Sum of the residuals beyond it, of the markers that an exchange touches, from which it is tried.
LEAST_EXCESS = .010     # [m]; ours
EXCESS_SPREAD = .1      # share by which that sum differs from pose to pose; ours
LARGEST_RESIDUAL = .010     # [m] mean, after an exchange: another hand never fits; ours
UNSOLVED = 1.           # [m] residual where the markers are no hand's
SOLVED_AT_ONCE = 10     # exchanges tried after a frame, about 4 ms; ours
SEARCH_PAUSE = 5.       # [s] from a search to the next, while the residuals stay as they are
# Each frame alone, by the labels as they are.
UNTRUSTING = TrackerOptions(
    smoothing=False, angle_filter=False, rigidity=False, outlier_gate=0., swap_margin=0.,
    frozen_frames=0, palm_stretch=10., palm_shrink=.01, palm_flatness=.01)


def exchange_check_for(tracker: HandTracker) -> LabelCheck:
    """Return what finds the exchanged labels of a tracker's layout."""
    digits = tracker.layout.digits
    if JIT_IS_ON and all(digits.count(digit) > 1 for digit in DIGITS):
        return ExchangeSearch(tracker)
    return ExchangeCheck(tracker.hand, tracker.layout)


def exchanges(layout: MarkerLayout) -> list[dict[int, int]]:
    """Return the exchanges of labels that people make.

    Those of two markers of the palm, of one finger or of the same joint, and those of two digits,
    also with their knuckles.

    Returns
    -------
    list of dict of int to int
        Row of each marker that is exchanged, and of the other.
    """
    names = [place.split('_') for place in layout.places]
    digits = layout.digits
    fingers = [name[0] for name in names]   # with their knuckles
    found = [{i: j, j: i} for i, j in combinations(range(len(names)), 2)
             if digits[i] == digits[j] or fingers[i] == fingers[j]
             or names[i][-1] == names[j][-1]]
    for kind in (digits, fingers):
        rows = [sorted((row for row, digit in enumerate(kind) if digit == name),
                       key=lambda row: ALL_LANDMARKS.index(layout.places[row])) for name in DIGITS]
        for one, other in combinations(rows, 2):
            exchange = {**dict(zip(one, other)), **dict(zip(other, one))}
            if len(one) == len(other) > 1 and exchange not in found:
                found.append(exchange)
    return found


class ExchangeSearch:
    """Search whether markers are rather others of the hand, as a node or a recording goes on.

    Parameters
    ----------
    tracker : HandTracker
        Of a layout with several markers a digit; its hand may change. While it runs as plain
        Python nothing is searched, as that would take a second.
    """

    needs_side = False

    def __init__(self, tracker: HandTracker) -> None:
        self._tracker, layout = tracker, tracker.layout
        self._exchanges = exchanges(layout)
        self._orders = np.array([[exchange.get(row, row) for row in range(len(layout.names))]
                                 for exchange in self._exchanges])
        self._moved = self._orders != np.arange(len(layout.names))
        digits = np.array(layout.digits)
        # Markers whose residuals an exchange may lower: all, where the palm is placed by others.
        self._touched = np.array([
            np.isin(digits, digits[list(exchange)]) | (OF_PALM in digits[list(exchange)])
            for exchange in self._exchanges], dtype=float)
        self._hand: Hand | None = None  # of the solver
        self._solver: HandTracker | None = None
        self._solved = 0    # frames
        self.begin()

    def begin(self) -> None:
        """As of `LabelCheck`."""
        self._last, self._resumed = -math.inf, -math.inf   # [s]
        self._places = np.full((self._orders.shape[1], 3), math.inf)
        self._doubted = math.inf    # [m] sum of the residuals where an exchange was found
        self._excess: list[float] = []  # [m] sum of that of the residuals, in the last search
        self._begin_search()

    def _begin_search(self) -> None:
        self._frames = self._fitting = 0
        # Of each exchange: frames, and sums over them of the fall and of the mean residual [m].
        self._tried, self._falls, self._residual_sums = np.zeros((3, len(self._exchanges)))
        self._present = self._total = 0.    # [m] sum of the residuals, of a frame and of all
        self._alive = np.arange(len(self._exchanges))
        self._markers: np.ndarray | None = None     # of the frame under search
        self._untried: list[int] = []

    def add(self, state: HandState, time: float | None) -> dict[int, int] | None:
        """As of `LabelCheck`."""
        if time is None or not math.isfinite(time) or not self._tracker.is_compiled:
            return None
        if self._markers is None and not self._takes(state, time):
            return None
        if self._markers is None:
            self._fitting += 1
            if self._fitting < SEARCHED_FRAMES:
                return None
            self._begin_search()
            self._doubted = math.inf
            return {}
        for which in self._untried[:SOLVED_AT_ONCE]:
            residuals = self._residuals(self._markers[self._orders[which]])
            self._tried[which] += 1.
            self._falls[which] += self._present - np.nansum(residuals)
            self._residual_sums[which] += np.nanmean(residuals)
        del self._untried[:SOLVED_AT_ONCE]
        return None if self._untried else self._judge(time)

    def _takes(self, state: HandState, time: float) -> bool:
        """Begin with a frame if it can be judged, and is another pose; return whether it is.

        No exchange is tried where none can lower the residuals by enough.
        """
        if (0. <= time - self._last < LEAST_STEP
                or state.palm is not PalmState.TRACKED):
            return False
        places = (state.markers - state.wrist_position) @ state.wrist_rotation
        if not np.abs(places - self._places).max() >= LEAST_MOVE:
            return False
        self._last, self._places = time, places
        excess = np.maximum(np.nan_to_num(state.residuals) - USUAL_RESIDUAL, 0.)
        alive = self._alive[self._touched[self._alive] @ excess >= LEAST_EXCESS]
        total, seen = float(excess.sum()), are_seen(state.marker_states)
        if not len(alive):
            return True
        # As they came: two that the tracker has exchanged are exchanged back.
        put_right = np.flatnonzero(state.marker_states == MarkerState.SWAPPED)
        # A marker that is not seen tells nothing of its label.
        untried = alive[(seen | ~self._moved[alive]).all(axis=1)].tolist()
        self._fitting = 0
        if self._is_paused(time, total) or not untried or len(put_right) not in (0, 2):
            return False
        self._markers = np.where(seen[:, None], state.markers, np.nan)
        self._markers[put_right] = self._markers[put_right[::-1]]
        self._present = float(np.nansum(self._residuals(self._markers)))
        self._total += self._present
        self._untried, self._alive = untried, alive
        self._excess = [*self._excess * (self._frames > 0), total]
        return True

    def _is_paused(self, time: float, excess: float) -> bool:
        """Return whether a search ended a while ago, and the residuals are as they were in it."""
        if self._frames or not time < self._resumed:
            return False
        margin = LEAST_FALL + EXCESS_SPREAD * max(self._excess)
        return min(self._excess) - margin < excess < max(self._excess) + margin

    def _residuals(self, markers: np.ndarray) -> np.ndarray:
        """Return the distances of the markers from a hand that is solved from this frame alone."""
        if self._solver is None or self._hand is not self._tracker.hand:
            self._hand = self._tracker.hand
            self._solver = HandTracker(self._hand, self._tracker.layout, UNTRUSTING)
            if not self._solver.is_compiled:
                self._solver.use_loaded_kernels()
        self._solved += 1
        # Time jumps back: each frame is the first.
        state = self._solver.update(markers, -float(self._solved))
        is_solved = state.palm is PalmState.TRACKED
        return state.residuals if is_solved else np.full(len(markers), UNSOLVED)

    def _judge(self, time: float) -> dict[int, int] | None:
        """Drop the exchanges that gain nothing; return the verdict once enough is tried."""
        self._markers, self._fitting = None, 0
        self._frames += 1
        alive, tried = self._alive, self._tried[self._alive]
        alive = alive[(self._falls[alive] >= tried * LEAST_FALL)
                      & (self._residual_sums[alive] <= tried * LARGEST_RESIDUAL)]
        self._alive, tried = alive, self._tried[alive]
        best = int((self._falls[alive] / np.maximum(tried, 1.)).argmax()) if len(alive) else -1
        if len(alive) and tried[best] < SEARCHED_FRAMES and self._frames < MOST_FRAMES:
            return None
        found: dict[int, int] | None = None
        if len(alive) and tried[best] >= SEARCHED_FRAMES:
            found = self._exchanges[alive[best]]
            self._doubted = self._total / self._frames
        elif not len(alive) and self._total / self._frames <= self._doubted - LEAST_FALL:
            # Else the hand may only be in a pose in which no exchange fits.
            found, self._doubted = {}, math.inf
        self._begin_search()
        self._resumed = time + SEARCH_PAUSE
        return found
