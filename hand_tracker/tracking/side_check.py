"""Recognise a hand of the other side by its labelled markers: fingers bend to the palm. No ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ..core.model.hand import FINGERS, OTHER_SIDE
from ..core.model.marker_layout import PALM_MARKERS
from ..core.model.states import SEEN, are_seen
from ..core.pose.report import mean_residual
from ..core.tracker import HandState
from .setting_names import BAG_OPTION_NAMES, SettingNames

# [m] depth beyond the palm's plane at which a digit counts: more than that of fingers hyperextended
# by 30 degrees at the MCP, or of a thumb behind the palm; ours.
BEYOND_PALM = .035
LEAST_FINGERS = 3       # seen fingers beyond the palm's plane, at least
LEAST_BENT = .4         # [s] of digits beyond the palm for a verdict
GREATEST_STEP = .25     # [s] longest time that one frame counts for
FITS = .010             # [m] mean residual of a frame whose labels may be put right, at most; ours
MINOR_SHARE = .25       # largest ratio of the times on the two sides for a verdict
MEMORY = 1.             # [s] bound of these times, so that a verdict can change. Ours


class SideCheck:
    """Judge whether markers are rather of the other hand, or mirrored.

    Parameters
    ----------
    side : {'right', 'left'}
        Of the hand that is tracked.
    principal : sequence of int, shape (8,)
        Rows of the principal markers, -1 for none.
    """

    def __init__(self, side: str, principal: Sequence[int]) -> None:
        self.side, self._principal = side, list(principal)
        self._sign = 1. if side == 'right' else -1.
        self._last: float | None = None
        self._palmar = self._dorsal = 0.

    def add(self, state: HandState, time: float | None) -> bool | None:
        """Note a frame; return whether the side is wrong, None where that is not known yet.

        Parameters
        ----------
        state : HandState
            Not every frame's need be given.
        time : float or None
            Of the frame [s].
        """
        states = state.marker_states
        # Labels of a mirrored palm, put right, make one of this side that does not fit.
        seen = are_seen(states) if mean_residual(state.residuals) <= FITS else states == SEEN
        return self.add_markers(np.where(seen[:, None], state.markers, np.nan), time)

    def add_markers(self, positions: np.ndarray, time: float | None) -> bool | None:
        """Note a frame that is not tracked, as `add`.

        Parameters
        ----------
        positions : ndarray, shape (n, 3)
            Of all markers, NaN where one is not seen [m].
        time : float or None
            [s]
        """
        if time is None or not math.isfinite(time):
            return None
        step = 0. if self._last is None else min(max(time - self._last, 0.), GREATEST_STEP)
        self._last = time
        # The last row stands for markers that the layout does not have.
        markers = np.vstack((positions, np.full(3, np.nan)))[self._principal]
        r, p, q = markers[:len(PALM_MARKERS)]
        normal = self._sign * np.cross(p - r, q - r)  # to the palm's inner side
        length = float(np.sqrt(normal @ normal))
        if not length > 0.:  # a marker is hidden
            return None
        depths = (markers[len(PALM_MARKERS):] - p) @ (normal / length)
        if _are_beyond(depths):
            self._palmar += step
        elif _are_beyond(-depths):
            self._dorsal += step
        longest = max(self._palmar, self._dorsal)
        if longest < LEAST_BENT:
            return None
        if longest > MEMORY:
            self._palmar *= MEMORY / longest
            self._dorsal *= MEMORY / longest
        if self._palmar < MINOR_SHARE * self._dorsal:
            return True
        return False if self._dorsal < MINOR_SHARE * self._palmar else None


def _are_beyond(depths: np.ndarray) -> bool:
    """Return whether digits are beyond the palm's plane: most fingers, or thumb and finger mean.

    Parameters
    ----------
    depths : ndarray, shape (5,)
        Of the digits' markers beyond the palm's plane, NaN where one is not seen [m].
    """
    fingers, thumb = depths[:len(FINGERS)], depths[len(FINGERS)]
    if (fingers > BEYOND_PALM).sum() >= LEAST_FINGERS:
        return True
    seen = np.isfinite(fingers)
    return bool(thumb > BEYOND_PALM and seen.sum() >= LEAST_FINGERS and fingers[seen].sum() > 0.)


def side_fault(side: str, names: SettingNames) -> str:
    """Return what is wrong where fingers bend away from the palm of a hand of a side."""
    other = OTHER_SIDE[side]
    mirrored, axes = (f' ({name})' if name else '' for name in (names.mirrored, names.axes))
    return (f'the fingers bend away from the palm of a {side} hand, which is left out: set '
            f'{names.side.format(other)} if it is a {other} one, else an axis is mirrored'
            f'{mirrored}, or two are exchanged{axes}')


def recorded_side_fault(frames: Iterable[tuple[float, np.ndarray]], side: str,
                        principal: Sequence[int]) -> str | None:
    """Return why recorded markers are not of a side, without tracking them; None if they may be.

    Parameters
    ----------
    frames : iterable of (float, ndarray)
        Time [s] and positions, as for `SideCheck.add_markers`; read until the side is seen right.
    side, principal
        See `SideCheck`.
    """
    check, is_wrong = SideCheck(side, principal), None
    for time, positions in frames:
        verdict = check.add_markers(positions, time)
        is_wrong = is_wrong if verdict is None else verdict
        if is_wrong is False:
            break
    return side_fault(side, BAG_OPTION_NAMES) if is_wrong else None
