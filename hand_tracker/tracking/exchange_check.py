"""Recognise labels of digits that are exchanged from the start: each digit has its place. No ROS.

In single frames exchanged neighbours look like right ones in another pose, and the tracker goes by
the labels; over seconds of motion they do not.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from ..core.labelling.plausibility import permuted_costs, typical_places
from ..core.labelling.readings import DIGIT_PERMUTATIONS
from ..core.model.hand import DIGITS, LEFT_HAND_MIRROR, Hand
from ..core.model.marker_layout import PALM_MARKERS, MarkerLayout
from ..core.model.states import PalmState, are_seen
from ..core.tracker import HandState

REVIEWED_FRAMES = 30    # that are judged together
LEAST_STEP = .08        # [s] between two of them: a node's fast path shows a frame every 0.1 s
LEAST_MOVE = .002       # [m] of a digit between two of them: a pose that is held is but one
# Other labels are named if they are better by so much on average, and in most frames: in 30 of
# captures and of simulated motions right labels never look exchanged, two that are in 98 %. Ours.
LEAST_GAIN = 1.         # [variances]
FURTHER_GAIN = .6       # [variances] more, where more than two digits are exchanged
BETTER_SHARE = .9
MOST_GAIN = 30.         # of one frame
MOVES_MANY = (DIGIT_PERMUTATIONS != np.arange(len(DIGITS))).sum(axis=1) > 2


class LabelCheck(Protocol):
    """Anything that judges from frame to frame whether labels are exchanged.

    Attributes
    ----------
    needs_side : bool
        Whether fingers of a hand of the other side look exchanged to it.
    """

    needs_side: bool

    def begin(self) -> None:
        """Forget the frames noted so far."""

    def add(self, state: HandState, time: float | None) -> dict[int, int] | None:
        """Note a frame; return which markers are rather others, once that is known.

        Parameters
        ----------
        state : HandState
            Not every frame's need be given.
        time : float or None
            Of the frame [s].

        Returns
        -------
        dict of int to int, or None
            Row of each marker, and of the one that it rather is; empty where the labels are the
            best; None where that is not clear, or not enough frames have come.
        """


class ExchangeCheck:
    """Judge whether markers that are tracked as those of some digits are rather of others.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
        Without a principal marker on each digit, nothing is judged.
    """

    needs_side = True   # as it judges by usual places

    def __init__(self, hand: Hand, layout: MarkerLayout) -> None:
        right = hand.as_right()
        self._typical = typical_places(right, layout.principal_mounting(right))
        self._palm_variance = self._typical.template.var(axis=0).sum()
        self._mirror = 1. if hand.side == 'right' else LEFT_HAND_MIRROR
        self._principal = np.array(layout.principal)
        self._has_all = -1 not in layout.principal
        self.begin()

    def begin(self) -> None:
        """As of `LabelCheck`."""
        self._last, self._places = -math.inf, np.full((5, 3), math.inf)   # of the last one noted
        self._begin_review()

    def _begin_review(self) -> None:
        self._count = 0
        self._gain = np.zeros(len(DIGIT_PERMUTATIONS))
        self._better = np.zeros(len(DIGIT_PERMUTATIONS), dtype=int)

    def add(self, state: HandState, time: float | None) -> dict[int, int] | None:
        """As of `LabelCheck`; those of digits alone are judged."""
        if (time is None or not math.isfinite(time) or 0. <= time - self._last < LEAST_STEP
                or not self._has_all or state.palm is not PalmState.TRACKED):
            return None
        if not are_seen(state.marker_states[self._principal]).all():
            return None
        markers = state.markers[self._principal]
        palm, digits = markers[:len(PALM_MARKERS)], markers[len(PALM_MARKERS):]
        places = (digits - state.wrist_position) @ state.wrist_rotation * self._mirror
        if not np.abs(places - self._places).max() >= LEAST_MOVE:
            return None
        self._last, self._places = time, places
        size = math.sqrt(palm.var(axis=0).sum() / self._palm_variance)
        costs = permuted_costs(places / size, DIGIT_PERMUTATIONS, self._typical)
        gain = costs[0] - costs
        self._count += 1
        self._gain += np.minimum(np.maximum(gain, -MOST_GAIN), MOST_GAIN)
        self._better += gain > 0.
        return self._judge() if self._count == REVIEWED_FRAMES else None

    def _judge(self) -> dict[int, int] | None:
        """Return the verdict on the frames noted, and begin anew."""
        gains, is_clear = self._gain / self._count, self._better >= BETTER_SHARE * self._count
        self._begin_review()
        if not (gains > 0.).any():
            return {}
        gains = np.where(is_clear, gains, 0.) - FURTHER_GAIN * MOVES_MANY
        best = int(gains.argmax())
        if gains[best] < LEAST_GAIN:
            return None
        digits = self._principal[len(PALM_MARKERS):].tolist()
        return {digits[row]: digits[digit] for digit, row in enumerate(DIGIT_PERMUTATIONS[best])
                if row != digit}
